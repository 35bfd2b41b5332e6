"""Joint states and vectors with a stamp, as drivers publish them, read from their CDR bytes without building a message.

Drivers send one message a sample, thousands a second, and each like the one before: the same frame and joints, as many
numbers. The layout is parsed once and then only compared; what is left are a stamp and a few numbers.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeAlias

from rotary_error_monitor.codec.cdr_blocks import BODY, CDR_LITTLE_ENDIAN, STAMP_END


@dataclass(slots=True)
class Stamp:
    """As `builtin_interfaces/msg/Time`."""

    sec: int
    nanosec: int


@dataclass(slots=True)
class Header:
    """As `std_msgs/msg/Header`."""

    stamp: Stamp
    frame_id: str


@dataclass(slots=True)
class JointStateMessage:
    """As `sensor_msgs/msg/JointState`."""

    header: Header
    name: tuple[str, ...]
    position: tuple[float, ...]
    velocity: tuple[float, ...]
    effort: tuple[float, ...]


@dataclass(slots=True)
class Vector:
    """As `geometry_msgs/msg/Vector3`."""

    x: float
    y: float
    z: float


@dataclass(slots=True)
class VectorMessage:
    """As `geometry_msgs/msg/Vector3Stamped`."""

    header: Header
    vector: Vector


DriverMessage: TypeAlias = JointStateMessage | VectorMessage


@dataclass(frozen=True)
class _Layout:
    """How the messages of a driver lie in their bytes.

    Attributes:
        form: of the whole body; bytes between its fields, which may hold anything, are left out.
        fixed: places of the fields that stay the same from message to message, and what they are.
        frame: of the header.
        names: of the joints; none in a vector.
        numbers: where positions, velocities and efforts lie among the fields, or x, y and z.
    """

    form: struct.Struct
    fixed: tuple[tuple[slice, tuple[int | bytes, ...]], ...]
    frame: str
    names: tuple[str, ...]
    numbers: tuple[slice, ...]


class DriverReader:
    """Reads the messages of one driver."""

    def __init__(self, msgtype: str) -> None:
        """Reader of messages of a type, such as `sensor_msgs/msg/JointState`."""
        self._parse = _PARSERS.get(msgtype)
        self._layout: _Layout | None = None

    def read(self, data: bytes) -> DriverMessage | None:
        """The message of these bytes; None where they are none that is read here, which a full reader has to judge."""
        if self._parse is None or data[:2] != CDR_LITTLE_ENDIAN:
            return None
        try:
            if self._layout is not None and (known := _read(data, self._layout)) is not None:
                return known
            self._layout = self._parse(data)
            return _read(data, self._layout)
        except (struct.error, UnicodeDecodeError):
            return None


def _read(data: bytes, layout: _Layout) -> DriverMessage | None:
    """The message, if it has that layout."""
    if len(data) < BODY + layout.form.size:
        return None
    fields = layout.form.unpack_from(data, BODY)
    for place, value in layout.fixed:
        if fields[place] != value:
            return None
    header = Header(Stamp(fields[0], fields[1]), layout.frame)
    first, second, third = layout.numbers
    if not layout.names:
        return VectorMessage(header, Vector(*fields[first]))
    return JointStateMessage(header, layout.names, fields[first], fields[second], fields[third])


def _vector_layout(data: bytes) -> _Layout:
    """Header and three numbers."""
    walk = _Walk(data)
    frame = walk.text()
    first = walk.numbers(3)
    return walk.layout(frame, (), (first, first, first))


def _joint_layout(data: bytes) -> _Layout:
    """Header, names, and three sequences of numbers."""
    walk = _Walk(data)
    frame = walk.text()
    names = tuple([walk.text() for _ in range(walk.length())])
    if not names:
        raise struct.error("a joint state without joints")
    positions, velocities, efforts = (walk.numbers(walk.length()) for _ in range(3))
    return walk.layout(frame, names, (positions, velocities, efforts))


class _Walk:
    """A walk through a message from its stamp on, which notes how the fields lie."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._at = STAMP_END
        self._form = "<iI"
        self._fields = 2
        self._fixed: list[tuple[slice, tuple[int | bytes, ...]]] = []

    def length(self) -> int:
        """Length of a sequence or text, which is the same in each message."""
        self._align(4)
        (count,) = struct.unpack_from("<I", self._data, self._at)
        if count > len(self._data):
            raise struct.error(f"a sequence of {count} in {len(self._data)} bytes")
        self._add("I", 1, 4)
        self._fixed.append((slice(self._fields - 1, self._fields), (count,)))
        return int(count)

    def text(self) -> str:
        """A text, which is the same in each message."""
        length = self.length()
        text = self._data[self._at : self._at + length]
        if length == 0 or len(text) < length:
            raise struct.error(f"a text of {length} bytes at byte {self._at} of {len(self._data)}")
        self._add(f"{length}s", 1, length)
        self._fixed.append((slice(self._fields - 1, self._fields), (text,)))
        return text[:-1].decode()

    def numbers(self, count: int) -> slice:
        """Places of so many numbers among the fields."""
        if count:
            self._align(8)
            self._add(f"{count}d", count, 8 * count)
        return slice(self._fields - count, self._fields)

    def layout(self, frame: str, names: tuple[str, ...], numbers: tuple[slice, ...]) -> _Layout:
        """What was noted."""
        return _Layout(struct.Struct(self._form), tuple(self._fixed), frame, names, numbers)

    def _align(self, size: int) -> None:
        gap = (BODY - self._at) % size
        self._form += f"{gap}x"
        self._at += gap

    def _add(self, form: str, fields: int, size: int) -> None:
        self._form += form
        self._fields += fields
        self._at += size


_PARSERS: Mapping[str, Callable[[bytes], _Layout]] = {
    "sensor_msgs/msg/JointState": _joint_layout,
    "geometry_msgs/msg/Vector3Stamped": _vector_layout,
}
