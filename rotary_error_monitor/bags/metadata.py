"""The `metadata.yaml` of a rosbag2 bag, version 9, and what its mcap channels say beside it."""

from __future__ import annotations

import functools
import os
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path, PurePath
from typing import Any

import yaml
from mcap.records import Channel

from rotary_error_monitor.bags.marks import METADATA
from rotary_error_monitor.description.wire_section import Qos
from rotary_error_monitor.description.yaml_files import parse_yaml, read_yaml
from rotary_error_monitor.errors import InputError, excerpt
from rotary_error_monitor.files import exists
from rotary_error_monitor.signals.blocks import NANOSECONDS

VERSION = 9
SIMULATED = "simulated"
"""Name of the note in which a recorder lists the topics of simulated devices, with `, ` between."""

QOS_KEY = "offered_qos_profiles"
_LATEST = 1 << 63  # timestamps of ROS 2 are signed, ns
_INFINITE = {"sec": 9223372036, "nsec": 854775807}  # what ROS 2 says for a deadline that is none


@dataclass(frozen=True)
class TopicEntry:
    """One topic of a bag: type, the offered quality of service as rosbag2 writes it, number of messages."""

    name: str
    type: str
    qos: Sequence[dict[str, Any]]
    count: int


@dataclass(frozen=True)
class FileEntry:
    """One file of a bag: number of messages, and timestamps (ns) of the first and the last."""

    name: str
    count: int
    start_ns: int
    end_ns: int


@dataclass(frozen=True)
class BagMetadata:
    """What `metadata.yaml` says that reading needs.

    Attributes:
        files: names in their order.
        packing: how each message is packed; empty where it is not.
        counts: messages by topic.
        notes: what else its writer had to say, texts by name.
        span: timestamps (ns) of the first and last message as it says them; None where it says none.
    """

    files: tuple[str, ...] = ()
    packing: str = ""
    counts: Mapping[str, int] = field(default_factory=dict)
    notes: Mapping[str, str] = field(default_factory=dict)
    span: tuple[int, int] | None = None

    def missing(self, folder: Path) -> tuple[str, ...]:
        """Files that are not there."""
        return tuple(name for name in self.files if not exists(folder / name))


def recorded_span(bag: Path) -> str:
    """When a bag was recorded and for how long, in words, as its metadata says; empty of other files."""
    try:
        span = read_metadata(bag).span
    except InputError:
        return ""
    if span is None:
        return ""
    begin_ns, end_ns = span
    begin = datetime.fromtimestamp(begin_ns / NANOSECONDS, UTC)
    return f"{begin:%Y-%m-%d %H:%M:%S} UTC, {(end_ns - begin_ns) / NANOSECONDS:.1f} s"


def read_metadata(folder: Path) -> BagMetadata:
    """Read the `metadata.yaml` of a bag, of any version.

    Raises:
        InputError: there is none, or it is none of a bag.
    """
    path = folder / METADATA
    content = read_yaml(path, f"a bag with its {METADATA}").content
    information = content.get("rosbag2_bagfile_information") if isinstance(content, dict) else None
    files = information.get("relative_file_paths") if isinstance(information, dict) else None
    if not isinstance(information, dict) or not isinstance(files, list):
        raise InputError(f"{path}: no metadata of a bag: rosbag2_bagfile_information.relative_file_paths is missing")
    names = [PurePath(name).name if isinstance(name, str) else "" for name in files]
    if not all(names):
        raise InputError(f"{path}: relative_file_paths: {excerpt(files)}; expected names of files")
    mode, packing = information.get("compression_mode"), information.get("compression_format")
    each = isinstance(mode, str) and mode.lower() == "message"
    custom = information.get("custom_data")
    notes = {str(name): str(text) for name, text in custom.items()} if isinstance(custom, dict) else {}
    packed = str(packing) if each else ""
    return BagMetadata(tuple(names), packed, _counts(information), notes, _span(information))


def _counts(information: dict[str, Any]) -> dict[str, int]:
    """Messages by topic, none where they are not said as expected."""
    counts: Counter[str] = Counter()
    try:
        for entry in information["topics_with_message_count"]:
            counts[str(entry["topic_metadata"]["name"])] += int(entry["message_count"])
    except (KeyError, TypeError, ValueError):
        return {}
    return dict(counts)


def _span(information: dict[str, Any]) -> tuple[int, int] | None:
    """Begin and end, None where they are not said as expected, or before anything was recorded."""
    try:
        begin_ns = int(information["starting_time"]["nanoseconds_since_epoch"])
        end_ns = begin_ns + int(information["duration"]["nanoseconds"])
    except (KeyError, TypeError, ValueError, OverflowError):
        return None
    return (begin_ns, end_ns) if 0 < begin_ns <= end_ns < _LATEST else None


def qos_profiles(qos: Qos) -> list[dict[str, Any]]:
    """Offered quality of service as rosbag2 writes it: no deadline, no lifespan, automatic liveliness."""
    return [
        {
            "history": qos.history,
            "depth": qos.depth,
            "reliability": qos.reliability,
            "durability": qos.durability,
            "deadline": dict(_INFINITE),
            "lifespan": dict(_INFINITE),
            "liveliness": "automatic",
            "liveliness_lease_duration": dict(_INFINITE),
            "avoid_ros_namespace_conventions": False,
        }
    ]


def channel_metadata(profiles: Sequence[dict[str, Any]]) -> dict[str, str]:
    """What an mcap channel carries of the quality of service."""
    return {QOS_KEY: _dump(list(profiles)).strip()}


def channel_profiles(channel: Channel) -> list[dict[str, Any]]:
    """Quality of service that an mcap channel carries; none where it is absent or unreadable."""
    try:
        profiles = parse_yaml(channel.metadata.get(QOS_KEY, ""), channel.topic).content
    except InputError:
        return []
    return profiles if isinstance(profiles, list) else []


def write_metadata(
    folder: Path, topics: Iterable[TopicEntry], files: Sequence[FileEntry], notes: Mapping[str, str] | None = None
) -> None:
    """Write `metadata.yaml` so that a reader finds the old one or the new one, never half of one.

    Args:
        folder: of the bag.
        topics: of all files.
        files: in their order.
        notes: what else there is to say, texts by name; rosbag2 calls it custom data.
    """
    filled = [file for file in files if file.count]
    start = min((file.start_ns for file in filled), default=0)
    end = max((file.end_ns for file in filled), default=0)
    information = {
        "version": VERSION,
        "storage_identifier": "mcap",
        "duration": {"nanoseconds": end - start},
        "starting_time": {"nanoseconds_since_epoch": start},
        "message_count": sum(file.count for file in files),
        "topics_with_message_count": [_topic(topic) for topic in topics],
        "compression_format": "",
        "compression_mode": "",
        "relative_file_paths": [file.name for file in files],
        "files": [
            {
                "path": file.name,
                "starting_time": {"nanoseconds_since_epoch": file.start_ns},
                "duration": {"nanoseconds": file.end_ns - file.start_ns},
                "message_count": file.count,
            }
            for file in files
        ],
        "custom_data": dict(notes) if notes else None,
        "ros_distro": "jazzy",
    }
    temporary = folder / f".{METADATA}.new"
    try:
        with temporary.open("w", encoding="utf-8") as file:
            file.write(_dump({"rosbag2_bagfile_information": information}))
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(folder / METADATA)
    except OSError:
        temporary.unlink(missing_ok=True)
        raise


@functools.cache
def type_hash(msgtype: str) -> str:
    """RIHS01 hash of a standard message type, empty for every other type."""
    from rotary_error_monitor.codec.encoding import typestore

    return typestore().hash_rihs01(msgtype) if msgtype in typestore().types else ""


@functools.cache
def type_definition(msgtype: str) -> str:
    """Definition of a standard message type and those that it needs, as mcap's `ros2msg`; empty for every other."""
    from rotary_error_monitor.codec.encoding import typestore

    return typestore().generate_msgdef(msgtype, ros_version=2)[0] if msgtype in typestore().types else ""


def _topic(topic: TopicEntry) -> dict[str, Any]:
    return {
        "topic_metadata": {
            "name": topic.name,
            "type": topic.type,
            "serialization_format": "cdr",
            "offered_qos_profiles": list(topic.qos),
            "type_description_hash": type_hash(topic.type),
        },
        "message_count": topic.count,
    }


class _PlainDumper(yaml.SafeDumper):
    """Repeats equal values instead of pointing to them: other YAML readers of rosbag2 bags know no anchors."""

    def ignore_aliases(self, data: object) -> bool:
        return True


def _dump(content: object) -> str:
    return yaml.dump(content, Dumper=_PlainDumper, sort_keys=False, allow_unicode=True)
