"""A bag of third-party drivers' messages as the bag that the nodes of a cell would have recorded.

Each message goes to the same source as in the node: which topic, joint and unit stand in the cell's parameter file, and
nowhere else.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from rotary_error_monitor.bags.bag_files import BagFiles
from rotary_error_monitor.bags.recorded_files import RawMessage
from rotary_error_monitor.bags.writer import BagTopic, BagWriter
from rotary_error_monitor.codec.definitions import known_typestore
from rotary_error_monitor.codec.messages import encode
from rotary_error_monitor.description.settings import Setting
from rotary_error_monitor.description.stage import StageDescription, load_stage
from rotary_error_monitor.description.topics import place_of
from rotary_error_monitor.description.wire import Topic, Wire, wire_of
from rotary_error_monitor.errors import InputError, excerpt, without_numbers
from rotary_error_monitor.files import exists
from rotary_error_monitor.signals.blocks import NANOSECONDS
from rotary_error_monitor.sources.device import Device, Instrument, told_of
from rotary_error_monitor.sources.library import device_settings, load_devices
from rotary_error_monitor.sources.source import Heard
from rotary_error_monitor.supervision.cell_file import CellNode, nodes_of, parameters_of
from rotary_error_monitor.supervision.served_sensors import topics_filled

BLOCK_PERIOD = 0.005
"""Time covered by a block, s, where the file states none, as of the nodes."""


@dataclass
class DriverStream:
    """What becomes of the messages of one driver.

    Attributes:
        heard: topic of the driver in the bag.
        source: of the node.
        topic: of the wire contract that it fills.
        period_ns: time covered by a block, ns.
        samples: that were taken.
        refused: messages that were not, by reason, and of each reason the first one's words.
    """

    heard: str
    source: Heard
    topic: Topic
    period_ns: int
    samples: int = 0
    refused: Counter[str] = field(default_factory=Counter)
    words: dict[str, str] = field(default_factory=dict)
    _begun_ns: int | None = None

    def add(self, message: object, time_ns: int) -> Iterator[bytes]:
        """Take in a message that was measured at a timestamp (ns); give the blocks that are complete now."""
        try:
            with told_of(self.heard):
                self.source.add(time_ns, self.source.sample(message))
        except InputError as error:
            reason = without_numbers(str(error))
            self.refused[reason] += 1
            self.words.setdefault(reason, str(error))
            return
        self.samples += 1
        begun = time_ns if self._begun_ns is None else self._begun_ns
        self._begun_ns = begun
        if time_ns - begun >= self.period_ns:
            self._begun_ns = time_ns
            yield from self.rest(time_ns)

    def rest(self, until_ns: int = 1 << 62) -> Iterator[bytes]:
        """The block of the samples before a timestamp (ns) that still wait, if there are any."""
        block = self.source.take(0, until_ns)
        if block is not None:
            yield encode(block, self.topic.frame)


def convert(
    bag: Path, cell_file: Path, stage_file: Path | None, output: Path, stamps: str, cell: str
) -> list[DriverStream]:
    """Write what the drivers in a bag said as sample blocks of the wire contract, with what else of it the bag has.

    Args:
        bag: as `ros2 bag record` or anyone left it.
        cell_file: parameter file of the cell's nodes, as for `up`: source, topic, joint and unit of each instrument.
        stage_file: of the stage; None takes the parameter `stage` of the file.
        output: new folder of the bag.
        stamps: `header`, when the driver says that it measured, or `log`, when the message was recorded.
        cell: namespace in which relative topics stand, such as `/left`; empty for none.

    Raises:
        InputError: a file is wrong, names no driver of which the bag has a message, or the bag cannot be read.
    """
    nodes = [replace(node, namespace=node.namespace or cell) for node in nodes_of(cell_file)]
    parameters = parameters_of(cell_file, nodes)
    shared = next((str(row["stage"]) for row in parameters.values() if row.get("stage")), None)
    stage = load_stage(stage_file or shared)
    if not exists(bag):
        raise InputError(f"{excerpt(bag)}: no such bag; give the folder of a rosbag2 bag, or an mcap file")
    files = BagFiles(bag)
    named = stage_file or (None if shared is None else Path(shared))
    drivers = [_stream(node, parameters[node], (named, stage), cell, cell_file) for node in nodes]
    spoken = {name for name, content in files.topics.items() if content.count}
    streams = {each.heard: each for each in drivers if each is not None and each.heard in spoken}
    if not streams:
        wanted = ", ".join(each.heard for each in drivers if each is not None) or "none"
        raise InputError(
            f"{bag}: no message of a driver that {cell_file} names ({wanted}); the bag has messages on "
            f"{excerpt(', '.join(sorted(spoken))) or 'no topic'}"
        )
    for name, each in streams.items():
        if files.topics[name].type != each.source.type:
            raise InputError(f"{bag}: {name} is a {excerpt(files.topics[name].type)}; expected {each.source.type}")
    filled = {each.topic.name for each in streams.values()}
    taken = {name: ours for name, ours in _of_contract(files, cell) if ours not in filled}
    _write(files, streams, taken, wire_of(stage), output, stamps)
    return [each for each in drivers if each is not None]


def _of_contract(files: BagFiles, cell: str) -> Iterator[tuple[str, str]]:
    """Topics of the bag that are the cell's by name and type, each with its name in the contract."""
    for name, content in files.topics.items():
        place = place_of(name)
        if place is not None and place.namespace == cell.rstrip("/") and content.type == place.topic.type:
            yield name, place.name


def _write(
    files: BagFiles,
    streams: Mapping[str, DriverStream],
    taken: Mapping[str, str],
    wire: Wire,
    output: Path,
    stamps: str,
) -> None:
    qos = {topic.name: topic.qos for topic in wire}
    topics = [BagTopic(each.topic.name, each.topic.type, each.topic.qos) for each in streams.values()]
    topics += [BagTopic(ours, files.topics[name].type, qos.get(ours, topics[0].qos)) for name, ours in taken.items()]
    stores = {name: known_typestore(each.source.type, files.topics[name].definition) for name, each in streams.items()}
    last_ns = 0
    with BagWriter(output, topics) as writer:
        for raw in files.messages({*streams, *taken}):
            last_ns = max(last_ns, raw.log_time_ns)
            if raw.topic in taken:
                writer.write(taken[raw.topic], raw.data, raw.log_time_ns)
                continue
            stream = streams[raw.topic]
            message = _message(stream, raw, stores[raw.topic])
            if message is not None:
                for data in stream.add(message, _time_ns(message, raw, stamps)):
                    writer.write(stream.topic.name, data, raw.log_time_ns)
        for stream in streams.values():
            for data in stream.rest():
                writer.write(stream.topic.name, data, last_ns)
        writer.notes["converted from"] = f"messages of drivers, with stamps of their {stamps}"


def _message(stream: DriverStream, raw: RawMessage, store: Any) -> Any:  # noqa: ANN401 (messages of any type)
    """The message; None, and counted, where its bytes are none."""
    try:
        return store.deserialize_cdr(raw.data, raw.type)
    except Exception as error:
        reason = f"{len(raw.data)} bytes are no {raw.type}: {excerpt(error) or type(error).__name__}"
        stream.refused[without_numbers(reason)] += 1
        stream.words.setdefault(without_numbers(reason), reason)
        return None


def _time_ns(message: Any, raw: RawMessage, stamps: str) -> int:  # noqa: ANN401 (messages of any type)
    stamp = message.header.stamp
    return raw.log_time_ns if stamps == "log" else int(stamp.sec) * NANOSECONDS + int(stamp.nanosec)


def _stream(
    node: CellNode, given: Mapping[str, object], stage: tuple[Path | None, StageDescription], cell: str, file: Path
) -> DriverStream | None:
    """What a node would make of a driver's messages; None of one that hears no driver."""
    devices = load_devices(node.executable)
    device = devices.get(str(given.get("source", "")))
    if device is None or not device.hears:
        return None
    named, described = stage
    (topic,) = topics_filled(node, given, wire_of(described), named)
    setting = _settings(devices, given, f"{file}: {node.name}")
    source = device.open(Instrument(topic.frame, topic.columns, described, setting, 0))
    assert isinstance(source, Heard)
    period = float(str(given.get("block_period", BLOCK_PERIOD)))
    heard = source.topic if source.topic.startswith("/") else f"{cell.rstrip('/')}/{source.topic}"
    return DriverStream(heard, source, topic, round(period * NANOSECONDS))


def _settings(devices: dict[str, Device], given: Mapping[str, object], where: str) -> Any:  # noqa: ANN401 (a lookup)
    known: dict[str, Setting] = {each.name: each for each in device_settings(devices)}

    def setting(name: str) -> object:
        value = given.get(name, known[name].default)
        known[name].check(value, where)
        return value

    return setting
