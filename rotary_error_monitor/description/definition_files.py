"""The files of the wire contract: those of `msg_defs/`, and those of other packages of their kinds of sensors."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from pathlib import Path

from rotary_error_monitor.description.sections import read
from rotary_error_monitor.description.wire_section import WireSection
from rotary_error_monitor.description.yaml_files import MOST_BYTES, parse_yaml
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.files import read_text
from rotary_error_monitor.plugins import load_plugin, origin_of, plugins_of
from rotary_error_monitor.resources import share

ENTRY_POINTS = "rotary_error_monitor.msg_defs"
"""Group of packages in whose folders such files (*.yaml) lie."""

SENSOR = "{sensor}"
LISTED = "listed_sensor"
"""The node that publishes what a listed sensor shows."""

_LISTENERS = {"error_estimator", "gap_monitor", "recorder"}
"""Nodes that take the samples of any listed sensor."""


def definitions(folder: Path | None = None) -> Iterator[tuple[Path, WireSection]]:
    """What each file of a folder says; without a folder those of the package, and those of others.

    Raises:
        InputError: there is none, it breaks the schema, or one of others defines what it may not.
    """
    for path in own_files(folder):
        yield path, _definition(path)
    for path in plugged_files() if folder is None else ():
        section = _definition(path)
        check_plugged(section, path)
        yield path, section


@cache
def own_columns(kind: str) -> tuple[str, ...]:
    """Columns after `t` of the samples of a kind of listed sensor that the package has itself.

    Raises:
        InputError: a file breaks the schema, or the package has no such kind.
    """
    frame = f"{kind}_{SENSOR}"
    for topic in (topic for path in own_files() for topic in _definition(path).topics.values()):
        if topic.is_sample_block and topic.frame == frame:
            return tuple(column.name for column in topic.columns)
    raise InputError(f"the package's wire contract has no samples of frame {frame}")


def own_files(folder: Path | None = None) -> tuple[Path, ...]:
    """Files in a folder, by default the package's `msg_defs/`.

    Raises:
        InputError: there is none.
    """
    folder = folder or share() / "msg_defs"
    found = tuple(sorted(folder.glob("*.yaml")))
    if not found:
        raise InputError(f"{folder}: no wire contract (*.yaml) in this folder")
    return found


@cache
def plugged_files() -> tuple[Path, ...]:
    """Files of other packages, in the order of the names of their entry points.

    Raises:
        InputError: an entry point cannot be loaded, is no package, or has no such file in its folder.
    """
    found: list[Path] = []
    for entry in plugins_of(ENTRY_POINTS):
        folders = getattr(load_plugin(entry), "__path__", ())
        files = [path for folder in folders for path in sorted(Path(folder).glob("*.yaml"))]
        if not files:
            raise InputError(
                f"{origin_of(entry)}: {entry.value} is no package with a wire contract (*.yaml) in its folder; name "
                "one, and the files among its package data"
            )
        found += files
    return tuple(found)


def check_plugged(section: WireSection, path: Path) -> None:
    """Hold a file of another package against what it may define: topics of a kind of sensor that a stage lists.

    Raises:
        InputError: it defines something else; the message says what is expected.
    """
    for key, topic in section.topics.items():
        for what, found, wanted in (
            ("frame", topic.frame, topic.frame.endswith(f"_{SENSOR}")),
            ("name", topic.name, f"/{topic.frame}/" in topic.name),
            ("publishers", topic.publishers, topic.publishers == (LISTED,)),
            ("subscribers", topic.subscribers, set(topic.subscribers) <= _LISTENERS),
        ):
            if not wanted:
                raise InputError(
                    f"{path}: topic '{key}': {what} {found!r}; expected a topic /stage/KIND_{SENSOR}/… of frame "
                    f"KIND_{SENSOR}, published by {LISTED}, read by none but {', '.join(sorted(_LISTENERS))}"
                )
    if section.services:
        raise InputError(f"{path}: defines services; expected topics of a kind of listed sensor alone")


def _definition(path: Path) -> WireSection:
    return _section(read_text(path, "a YAML file", MOST_BYTES), str(path))


@cache
def _section(text: str, origin: str) -> WireSection:
    """The definitions of a text, which are read once however many stages there are."""
    return read(WireSection, parse_yaml(text, origin), what="wire")
