"""The streams of a bag as they were recorded, whatever stage they are of."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.codec.contents import Content, JointState, PointStamped, Temperature
from rotary_error_monitor.commissioning.streams import RawStream, join_blocks
from rotary_error_monitor.description.topics import place_of, stream_of_topic
from rotary_error_monitor.description.wire import Topic
from rotary_error_monitor.errors import InputError, one_line
from rotary_error_monitor.notebook.read_only import sealed
from rotary_error_monitor.notebook.tables import table_over_time
from rotary_error_monitor.recordings.stream_health import contents_within
from rotary_error_monitor.signals.blocks import SampleBlock, block_from_samples

if TYPE_CHECKING:
    from pandas import DataFrame


JOINTS = "machine_joint_states"
OF_MACHINE = (JOINTS, "axis_corrections", "applied_corrections", "tool_probe", "machine_temperature")
"""Keys of topics whose messages are samples by themselves, and repeat no stream."""

_POINT = ("x", "y", "z")


@dataclass(frozen=True, slots=True, eq=False)
class RecordedStream:
    """Samples of one topic as they came, nothing corrected; arrays are read-only.

    Attributes:
        name: such as `head_a`, `command`, `machine_joint_states`.
        topic: its name in the wire contract.
        fields: name of each column.
        units: of each column, SI and °C; `m, rad` where the bag does not say which axis is linear.
        times_ns: (n,) timestamps (ns since 1970, UTC), increasing.
        values: (n, len(fields)) samples.
        raw: whether an instrument or the controller gave them, and not this package by a computation.
        lost: samples that are missing between others.
        disordered: samples left out because they were not after the one before, or not finite.
    """

    name: str
    topic: str
    fields: tuple[str, ...]
    units: tuple[str, ...]
    times_ns: NDArray[np.int64]
    values: Array
    raw: bool
    lost: int
    disordered: int

    def __len__(self) -> int:
        return len(self.times_ns)

    def __getitem__(self, field: str) -> Array:
        """(n,) samples of one field.

        Raises:
            InputError: there is no such field.
        """
        if field not in self.fields:
            raise InputError(f"{self.name} has no field '{one_line(field)}'; it has {', '.join(self.fields)}")
        return self.values[:, self.fields.index(field)]

    def __repr__(self) -> str:
        columns = ", ".join(f"{field} ({unit})" for field, unit in zip(self.fields, self.units, strict=True))
        return f"<{self.name}: {len(self)} samples, {self.rate:.4g} Hz: {columns}>"

    @property
    def rate(self) -> float:
        """Samples a second (Hz) by the median of their distances; 0 of less than two."""
        return 1e9 / float(np.median(np.diff(self.times_ns))) if len(self) > 1 else 0.0

    def to_dataframe(self) -> DataFrame:
        """Table with a column for each field, index `time` (UTC), units in `attrs["units"]`.

        Raises:
            MissingPackageError: pandas is not installed.
        """
        columns = {field: self.values[:, i] for i, field in enumerate(self.fields)}
        return table_over_time(self.times_ns, columns, dict(zip(self.fields, self.units, strict=True)))


def read_recorded(reader: BagReader) -> tuple[dict[str, RecordedStream], tuple[str, ...]]:
    """Every stream of the wire contract that a bag holds by its name, and what could not be read of them.

    Messages for people and plotting tools, which repeat the samples of a stream, are left out.

    Raises:
        InputError: the bag cannot be read.
    """
    named = {name: stream for name in reader.topics if (stream := _name_of(name)) and reader.topics[name].count}
    found: dict[str, list[Content]] = {name: [] for name in named}
    refused: dict[str, list[InputError]] = {}
    for name, content, _ in contents_within(reader, list(named), lambda n, e: refused.setdefault(n, []).append(e)):
        found[name].append(content)
    streams = {}
    for name, contents in found.items():
        try:
            streams[named[name]] = _stream(named[name], name, contents)
        except InputError as error:
            refused.setdefault(name, []).append(error)
    return {name: stream for name, stream in streams.items() if len(stream)}, tuple(_remarks(refused))


def _remarks(refused: Mapping[str, Sequence[InputError]]) -> Iterator[str]:
    for name, errors in refused.items():
        yield f"{name}: {len(errors)} messages left out, the first: {one_line(str(errors[0]))}"


def _name_of(name: str) -> str | None:
    """Name of the stream of a topic; None of one that holds no samples, or repeats those of another."""
    place = place_of(name)
    if place is None or place.namespace:
        return None
    return place.topic.key if place.topic.key in OF_MACHINE else stream_of_topic(name)


def _stream(name: str, topic: str, contents: Sequence[Content]) -> RecordedStream:
    """The stream of the contents of a topic.

    Raises:
        InputError: they do not belong together.
    """
    place = place_of(topic)
    assert place is not None
    blocks = [content if isinstance(content, SampleBlock) else _block_of(content, place.topic) for content in contents]
    fields = blocks[0].names[1:] if blocks else ()
    joined: RawStream = join_blocks([_ordered(block, fields) for block in blocks], fields)
    times, values = sealed((joined.times_ns, joined.values))
    units = tuple(_unit_of(place.topic, field) for field in fields)
    is_raw = place.topic.is_raw or name in OF_MACHINE
    return RecordedStream(name, topic, fields, units, times, values, is_raw, joined.lost, joined.disordered)


def _block_of(content: Content, topic: Topic) -> SampleBlock:
    """The message of a topic as a block of one sample."""
    if isinstance(content, JointState):
        names, row = content.names, content.position
    elif isinstance(content, PointStamped):
        names, row = _POINT, content.point
    elif isinstance(content, Temperature):
        names, row = (topic.fields[0].name,), np.array([content.temperature])
    else:
        raise InputError(f"a {type(content).__name__} is no sample of a stream")
    return block_from_samples(np.array([content.stamp_ns]), names, np.asarray(row, np.float64)[None, :])


def _ordered(block: SampleBlock, fields: tuple[str, ...]) -> SampleBlock:
    """The block as it is, unless it has other fields than the first one or twice the same.

    Raises:
        InputError: it has.
    """
    if sorted(block.names[1:]) != sorted(set(fields)):
        raise InputError(f"fields {one_line(', '.join(block.names[1:]))} beside {one_line(', '.join(fields))}")
    return block


def _unit_of(topic: Topic, field: str) -> str:
    """Unit that the contract gives to a field; of axes and points, which it names as a whole, that of the whole."""
    known = {each.name: each.unit for each in topic.fields}
    return known.get(field) or known.get("position") or known.get("point") or "1"
