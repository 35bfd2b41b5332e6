"""Files that people give: read whole, up to a size, and only where they are files.

What is read here may come from anywhere. A limit on its size stands before anything is parsed, so that a wrong path (a
device, a recording, a packed nothing of gigabytes) costs no more than a right one.
"""

from __future__ import annotations

import stat
import zlib
from collections.abc import Iterable
from pathlib import Path

from rotary_error_monitor.errors import InputError

MOST_BYTES = 64 << 20
"""Bytes of a text of measurements, unpacked: two million rows, hundreds of times the longest that is known."""

_RECORDED = frozenset({".mcap", ".db3", ".yaml"})
"""Endings of the files of a bag, packed or kept aside."""

_GZIP = b"\x1f\x8b"
_GZIP_FORMAT = 31  # for zlib: with the header of gzip


def exists(path: Path) -> bool:
    """Whether there is something at the path; False for a path that no system knows or gives away, as one too long."""
    try:
        return path.exists()
    except (OSError, ValueError):
        return False


def check_outputs(outputs: Iterable[Path | None], inputs: Iterable[Path | None]) -> None:
    """Refuse to write over what is read, by whatever name it is given; None stands for what was not given.

    Args:
        outputs: files to be written.
        inputs: files, or folders of files such as bags.

    Raises:
        InputError: one of the outputs is one of the inputs, or a file of a recording among them.
    """
    read = [path for path in inputs if path is not None and exists(path)]
    for output in outputs:
        if output is None or not exists(output):
            continue
        for path in read:
            if any(_is_same(output, each) for each in (path, *_recorded(path))):
                raise InputError(
                    f"{output}: not written, for it is {'a file of ' if path.is_dir() else ''}the input {path}; "
                    "give another path"
                )


def _recorded(path: Path) -> list[Path]:
    """What in a folder belongs to a recording; results may lie beside it."""
    if not path.is_dir():
        return []
    return [each for each in path.iterdir() if _RECORDED & {suffix.partition("-")[0] for suffix in each.suffixes}]


def _is_same(one: Path, other: Path) -> bool:
    try:
        return one.samefile(other)
    except OSError:
        return False


def read_text(path: Path, kind: str, most_bytes: int = MOST_BYTES, encoding: str = "utf-8") -> str:
    """Text of a file, packed by gzip or not.

    Args:
        path: the file.
        kind: what it should be, for messages: 'a CSV file'.
        most_bytes: of the text.
        encoding: of the text.

    Raises:
        InputError: there is no such file, it is none (a folder, a device), it is larger, or it is no text.
    """
    content = read_bytes(path, kind, most_bytes)
    try:
        if content.startswith(_GZIP):
            content = _unpacked(content, path, kind, most_bytes)
        return content.decode(encoding)
    except UnicodeDecodeError as error:
        raise InputError(f"{path}: cannot be read ({error}); give the path of {kind}") from error


def read_bytes(path: Path, kind: str, most_bytes: int = MOST_BYTES) -> bytes:
    """Content of a file; arguments and errors as `read_text`."""
    try:
        regular = stat.S_ISREG(path.stat().st_mode)
        content = b""
        if regular:  # a pipe would be waited for
            with path.open("rb") as file:
                content = file.read(most_bytes + 1)
    except (OSError, ValueError) as error:  # ValueError: a path with a zero byte
        raise InputError(f"{path}: cannot be read ({error}); give the path of {kind}") from error
    if not regular:
        raise InputError(f"{path}: cannot be read (it is no file); give the path of {kind}")
    if len(content) > most_bytes:
        raise _too_large(path, kind, most_bytes)
    return content


def _unpacked(content: bytes, path: Path, kind: str, most_bytes: int) -> bytes:
    """The text that is packed in one or several members, one after another."""
    parts, size = [], 0
    while content:
        member = zlib.decompressobj(_GZIP_FORMAT)
        try:
            parts.append(member.decompress(content, most_bytes + 1 - size))
        except zlib.error as error:
            raise InputError(f"{path}: cannot be unpacked ({error}); give the path of {kind}") from error
        size += len(parts[-1])
        if size > most_bytes:
            raise _too_large(path, kind, most_bytes)
        if not member.eof:
            raise InputError(f"{path}: cannot be unpacked (it ends too early); give the path of {kind}")
        content = member.unused_data.lstrip(b"\0")  # gzip files may be padded
    return b"".join(parts)


def _too_large(path: Path, kind: str, most_bytes: int) -> InputError:
    return InputError(f"{path}: larger than {most_bytes} bytes; {kind} is expected, of at most that size")
