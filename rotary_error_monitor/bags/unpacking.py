"""Packed parts of bags, unpacked up to a size: what a file says of itself is checked before memory is given for it."""

from __future__ import annotations

import lz4.frame
import zstandard

from rotary_error_monitor.errors import InputError

MOST_AT_ONCE = 64 << 20
"""Bytes of one message or one unpacked chunk: recorders write chunks of a megabyte; a million samples are 16 MB."""

MOST_EXPANSION = 500
"""Bytes that a byte of a file may become: measured signals with noise give 15 at most, without any noise 450."""


class DamageError(ValueError):
    """A part of a bag that cannot be read; the message says why."""


class Budget:
    """How much the parts of one file may be, all unpacked.

    Args:
        origin: the file, for messages.
        size: its bytes.
    """

    def __init__(self, origin: object, size: int) -> None:
        self._origin = origin
        self._most = MOST_AT_ONCE + MOST_EXPANSION * size
        self._taken = 0

    def take(self, count: int) -> None:
        """Count bytes that are about to be unpacked.

        Raises:
            InputError: all together they are more than a recording of the file's size becomes.
        """
        self._taken += count
        if self._taken > self._most:
            raise InputError(
                f"{self._origin}: unpacked it would be more than {self._most} bytes ({MOST_EXPANSION} times its size); "
                "no recording packs that well"
            )


def unpack(data: bytes | memoryview, packing: str, size: int | None = None) -> bytes | memoryview:
    """Content of a chunk or a message.

    Args:
        data: as they lie in the file.
        packing: 'zstd', 'lz4', or '' for data that are not packed.
        size: bytes that it has unpacked, where the file says it.

    Raises:
        DamageError: it is larger than `MOST_AT_ONCE`, not of this size, or no such data.
    """
    if not packing:
        content = data
    elif packing not in ("zstd", "lz4"):
        raise DamageError(f"it is packed by {packing!r}; zstd and lz4 can be unpacked")
    else:
        check_size(size or 0)
        content = _zstd(bytes(data), size) if packing == "zstd" else _lz4(bytes(data), size)
    if size is not None and len(content) != size:
        raise DamageError(f"it holds {len(content)} bytes where it says {size}")
    return content


def check_size(size: int) -> None:
    """Refuse a size that a part says it has unpacked.

    Raises:
        DamageError: it is larger than `MOST_AT_ONCE`.
    """
    if size > MOST_AT_ONCE:
        raise DamageError(f"unpacked it would be {size} bytes; at most {MOST_AT_ONCE} are read at once")


def _zstd(data: bytes, size: int | None) -> bytes:
    try:
        said = zstandard.frame_content_size(data)  # -1 where the frame does not say it
        check_size(said)
        return zstandard.ZstdDecompressor().decompress(data, max_output_size=MOST_AT_ONCE if size is None else size)
    except zstandard.ZstdError as error:
        raise DamageError(f"it cannot be unpacked: {error}") from error


def _lz4(data: bytes, size: int | None) -> bytes:
    unpacker = lz4.frame.LZ4FrameDecompressor()
    try:
        content: bytes = unpacker.decompress(data, max_length=MOST_AT_ONCE if size is None else size)
    except (RuntimeError, ValueError) as error:
        raise DamageError(f"it cannot be unpacked: {error}") from error
    if not unpacker.eof:
        raise DamageError("it cannot be unpacked: it ends too early, or is larger than it says")
    return content
