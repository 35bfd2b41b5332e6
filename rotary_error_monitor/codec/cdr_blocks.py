"""Sample blocks to and from the CDR bytes of `sensor_msgs/msg/PointCloud2`, without building the message."""

from __future__ import annotations

import functools
import struct
from dataclasses import dataclass
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.errors import InputError, excerpt
from rotary_error_monitor.signals.blocks import NANOSECONDS, TIME_COLUMN, SampleBlock

CDR_LITTLE_ENDIAN = b"\x00\x01"
BODY = 4
"""Bytes of the encapsulation header; alignment counts from its end."""

STAMP_END = BODY + 8
"""Where the stamp of a header, which begins a message, ends: seconds and nanoseconds have four bytes each."""

_FLOAT64 = 8  # sensor_msgs/msg/PointField.FLOAT64, and its size
_FARTHEST = 2**31
"""Seconds that a sample may lie from its block's stamp: as far as stamps of ROS messages reach."""


def encode_block(block: SampleBlock, frame: str) -> bytes:
    """Bytes of the point cloud of height 1 that holds a block; it is what rmw and rosbags make of the message."""
    count, width = block.rows.shape
    opening, description = _frame_of_blocks(frame, block.names)
    data = block.rows.astype("<f8", order="C", copy=False).tobytes()
    seconds, nanoseconds = divmod(block.stamp_ns, NANOSECONDS)
    return b"".join(
        (
            CDR_LITTLE_ENDIAN + b"\x00\x00",
            struct.pack("<iI", seconds, nanoseconds),
            opening,
            struct.pack("<II", 1, count),
            description,
            struct.pack("<II", _FLOAT64 * width * count, len(data)),
            data,
            b"\x01",  # is_dense
        )
    )


@functools.cache
def _frame_of_blocks(frame: str, names: tuple[str, ...]) -> tuple[bytes, bytes]:
    """What stands between stamp and height, and between width and row_step: the same in each block of a stream."""
    opening = _padded(_text(frame))
    description = struct.pack("<I", len(names))
    for index, name in enumerate(names):
        description += _padded(_text(name)) + struct.pack("<IB3xI", _FLOAT64 * index, _FLOAT64, 1)
    return opening, description + struct.pack("<B3xI", 0, _FLOAT64 * len(names))


def _text(text: str) -> bytes:
    data = text.encode() + b"\x00"
    return struct.pack("<I", len(data)) + data


def _padded(data: bytes) -> bytes:
    return data + bytes(-len(data) % 4)


@dataclass(frozen=True)
class _Layout:
    """What stays the same from block to block: the bytes around the counts, and what they say."""

    size_at: int  # height and width
    data_at: int  # row_step and the length of the data
    frame: bytes
    description: bytes
    names: tuple[str, ...]
    point_step: int


class BlockDecoder:
    """Reads the blocks of one topic; their layout is parsed once and then only compared."""

    def __init__(self, *, finite: bool = True, frame: str | None = None) -> None:
        """Decoder of blocks in one frame, by default in any.

        It refuses those with samples that are not finite, unless told to let them pass.
        """
        self._layout: _Layout | None = None
        self._finite, self._frame = finite, frame

    def decode(self, data: bytes) -> SampleBlock:
        """Block from the bytes of one message; its rows are a copy.

        Raises:
            InputError: the bytes are no sample block, they are in another frame, or a sample is not finite; the message
                names the frames, or column and sample.
        """
        try:
            return _decode(data, self._layout_of(data), finite=self._finite)
        except (struct.error, IndexError, UnicodeDecodeError) as error:
            raise _foreign(data, error) from error

    def span(self, data: bytes) -> tuple[float, float, int]:
        """Times (s after the stamp) of a block's first and last sample, and how many samples it has.

        Raises:
            InputError: the bytes are no sample block.
        """
        try:
            layout = self._layout_of(data)
            width, start = _extent(data, layout)
            (first,) = struct.unpack_from("<d", data, start)
            (last,) = struct.unpack_from("<d", data, start + (width - 1) * layout.point_step)
        except (struct.error, IndexError, UnicodeDecodeError) as error:
            raise _foreign(data, error) from error
        if not (abs(first) < _FARTHEST and abs(last) < _FARTHEST):
            raise InputError(f"t goes from {first:g} to {last:g} s; expected seconds after the stamp of the block")
        return first, last, width

    def _layout_of(self, data: bytes) -> _Layout:
        layout = self._layout
        if (
            layout is None
            or data[:2] != CDR_LITTLE_ENDIAN
            or data[STAMP_END : layout.size_at] != layout.frame
            or data[layout.size_at + 8 : layout.data_at] != layout.description
        ):
            layout = _parse(data)
            if self._frame is not None:
                self._check_frame(_string(data, STAMP_END)[0], self._frame)
            self._layout = layout
        return layout

    @staticmethod
    def _check_frame(frame: str, expected: str) -> None:
        """Components in another frame are along other axes, though nothing else tells."""
        if frame != expected:
            raise InputError(f"block in the frame '{excerpt(frame)}'; expected '{expected}'")


def _foreign(data: bytes, error: Exception) -> InputError:
    return InputError(f"{len(data)} bytes are no sensor_msgs/msg/PointCloud2: {error}")


def _extent(data: bytes, layout: _Layout) -> tuple[int, int]:
    """Number of samples, and where the first begins."""
    height, width = struct.unpack_from("<II", data, layout.size_at)
    _, size = struct.unpack_from("<II", data, layout.data_at)
    start = layout.data_at + 8
    if height != 1 or width == 0:
        raise InputError(f"no sample block: height {height}, width {width}; expected height 1 and at least one sample")
    if size != width * layout.point_step or start + size > len(data):
        needed = width * layout.point_step
        raise InputError(
            f"no sample block: {width} samples of {layout.point_step} bytes need {needed} bytes, but the message says "
            f"{size} and holds {max(len(data) - start, 0)}"
        )
    return width, start


def _decode(data: bytes, layout: _Layout, *, finite: bool) -> SampleBlock:
    seconds, nanoseconds = struct.unpack_from("<iI", data, BODY)
    width, start = _extent(data, layout)
    count = width * len(layout.names)
    # The copy is aligned, and free of the message's memory.
    rows = np.frombuffer(data, "<f8", count, start).copy().reshape(width, len(layout.names))
    block = SampleBlock(seconds * NANOSECONDS + nanoseconds, layout.names, rows)
    timed = block.is_timed() or bool((np.abs(rows[:, 0]) < _FARTHEST).all())  # NaN is not below
    if not timed or (finite and not np.isfinite(rows).all()):
        _refuse_samples(rows, layout.names)
    return block


def _refuse_samples(rows: NDArray[np.float64], names: tuple[str, ...]) -> NoReturn:
    """Say which sample is not finite or has a time too far off.

    Raises:
        InputError: always.
    """
    known = np.isfinite(rows)
    if not known.all():
        row, column = np.argwhere(~known)[0]
        raise InputError(f"sample {row} of '{excerpt(names[column])}' is {rows[row, column]}; samples must be finite")
    row = int(np.argmax(np.abs(rows[:, 0]) >= _FARTHEST))
    raise InputError(f"sample {row} has t = {rows[row, 0]:g} s; expected seconds after the stamp of the block")


def _parse(data: bytes) -> _Layout:
    """Walk through the message: header, height, width, fields, is_bigendian, point_step, row_step, data."""
    if data[:2] != CDR_LITTLE_ENDIAN:
        raise InputError(f"no sample block: encoding {data[:2].hex()}; expected little-endian CDR (0001)")
    _, position = _string(data, STAMP_END)
    size_at = _align(position)
    (count,) = struct.unpack_from("<I", data, size_at + 8)
    position = size_at + 12
    fields = []
    for _ in range(count):
        name, position = _string(data, _align(position))
        position = _align(position)
        offset, datatype = struct.unpack_from("<IB", data, position)
        (elements,) = struct.unpack_from("<I", data, position + 8)
        fields.append((name, offset, datatype, elements))
        position += 12
    is_bigendian = bool(data[position])
    data_at = _align(position + 1) + 4
    (point_step,) = struct.unpack_from("<I", data, data_at - 4)
    if is_bigendian:
        raise InputError("no sample block: the samples are big-endian; expected little-endian")
    packed = [(_FLOAT64 * index, _FLOAT64, 1) for index in range(len(fields))]
    if (
        not fields
        or fields[0][0] != TIME_COLUMN
        or [row[1:] for row in fields] != packed
        or point_step != _FLOAT64 * len(fields)
    ):
        raise InputError(
            f"no sample block: fields {excerpt(fields)}, point_step {point_step}; "
            "expected FLOAT64 fields one after another, 't' first"
        )
    return _Layout(
        size_at=size_at,
        data_at=data_at,
        frame=data[STAMP_END:size_at],
        description=data[size_at + 8 : data_at],
        names=tuple(name for name, *_ in fields),
        point_step=point_step,
    )


def _string(data: bytes, position: int) -> tuple[str, int]:
    (length,) = struct.unpack_from("<I", data, position)
    end = position + 4 + length
    if length == 0 or end > len(data):
        raise InputError(f"no sensor_msgs/msg/PointCloud2: a text of {length} bytes at byte {position} of {len(data)}")
    return data[position + 4 : end - 1].decode(), end


def _align(position: int) -> int:
    """Next multiple of 4, from the body as from the start."""
    return position + -position % 4
