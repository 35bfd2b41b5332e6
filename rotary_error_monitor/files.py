"""Files that people give: read whole, up to a size, and only where they are files.

What is read here may come from anywhere. A limit on its size stands before anything is parsed, so that a wrong path (a
device, a recording, a packed nothing of gigabytes) costs no more than a right one.
"""

from __future__ import annotations

import codecs
import contextlib
import errno
import io
import os
import stat
import zlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import IO

from rotary_error_monitor.errors import InputError

MOST_BYTES = 16 << 20
"""Bytes of a text, unpacked: what it costs to make lists and words of more is seconds, and a gigabyte of memory."""

MOST_LINES = 200_000
"""Lines of a table of measurements: hundreds of times the longest that is known."""

_START = 1 << 16

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


def check_places(files: Iterable[Path]) -> None:
    """Refuse files that cannot be written where they should be, before anything is computed.

    Raises:
        InputError: one of them is a folder, or there is none for it.
    """
    for path in files:
        if exists(path) and path.is_dir():
            raise InputError(f"{path}: cannot be written (it is a folder); give a file in one")
        if not exists(path.parent) or not path.parent.is_dir():
            raise InputError(f"{path}: cannot be written (no folder {path.parent}); give a file in one that exists")


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


def write_whole(path: Path, content: bytes) -> None:
    """Write a file whole or not at all: what stood there before stays until the new content is on the disk.

    Raises:
        InputError: it cannot be written.
    """
    write_all({path: content})


def make_folder(path: Path) -> None:
    """Make a folder for results, and those above it; one that exists stays.

    Raises:
        InputError: it cannot be made.
    """
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{error.filename or path}: cannot be written: {error.strerror}") from error


def write_all(contents: Mapping[Path, bytes | Callable[[IO[bytes]], None]]) -> None:
    """Write files that belong together, all of them or none: what stood there stays until all are on the disk.

    A device or a pipe is written as it is, for nothing may take its place. What is too large for memory is a function
    that writes it to the file that it is given.

    Raises:
        InputError: one of them cannot be written.
    """
    temporaries: dict[Path, Path] = {}
    path = next(iter(contents), Path())
    try:
        for path, content in contents.items():
            temporaries[path] = path.with_name(f".{path.name}.{os.getpid()}.part")
            if path.is_dir():
                raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
            special = path.exists() and not path.is_file()
            with (path if special else temporaries[path]).open("wb") as file:
                if callable(content):
                    content(file)
                else:
                    file.write(content)
                file.flush()
                if not special:
                    os.fsync(file.fileno())
        for path, temporary in temporaries.items():
            if temporary.exists():
                temporary.replace(path)
    except (OSError, ValueError) as error:  # ValueError: a path with a zero byte
        why = error.strerror if isinstance(error, OSError) else error
        raise InputError(f"{path}: cannot be written ({why}); give a file in a folder that exists") from error
    finally:  # also of what Ctrl-C ended
        for temporary in temporaries.values():
            with contextlib.suppress(OSError, ValueError):
                temporary.unlink()


def lines_of(text: str) -> Iterator[str]:
    r"""Lines of a text without their ends, one after another; they end by `\n`, `\r` or both."""
    return (line.removesuffix("\n") for line in io.StringIO(text, newline=None))


def check_lines(path: Path, kind: str, count: int, most_lines: int) -> None:
    """Refuse a file of more lines.

    Raises:
        InputError: it has more.
    """
    if count > most_lines:
        raise InputError(f"{path}: {count} lines; {kind} is expected, of at most {most_lines}")


def read_first_line(path: Path, kind: str) -> str:
    """First line of a text file, packed or not, however much follows; of what is no text as far as it is one.

    Raises:
        InputError: there is no such file, or it is none.
    """
    content = _read_file(path, kind, _START)
    if content.startswith(_GZIP):
        try:
            content = zlib.decompressobj(_GZIP_FORMAT).decompress(content, _START)
        except zlib.error as error:
            raise InputError(f"{path}: cannot be unpacked ({error}); give the path of {kind}") from error
    lines = content.decode(errors="replace").splitlines()
    return lines[0] if lines else ""


def read_text(
    path: Path, kind: str, most_bytes: int = MOST_BYTES, encoding: str = "utf-8", most_lines: int | None = None
) -> str:
    """Text of a file, packed by gzip or not.

    Args:
        path: the file.
        kind: what it should be, for messages: 'a CSV file'.
        most_bytes: of the text.
        encoding: of the text.
        most_lines: of the text; None for any number.

    Raises:
        InputError: there is no such file, it is none (a folder, a device), it is larger, or it is no text.
    """
    content = read_unpacked(path, kind, most_bytes)
    if most_lines is not None:
        _check_lines(content, path, kind, most_lines)
    return _decoded(content, path, kind, encoding)


def read_table_text(path: Path, kind: str) -> str:
    """Text of a table of measurements as instruments and spreadsheets save it; arguments and errors as `read_text`.

    UTF-8, UTF-16 with its byte order mark ("Unicode text" of spreadsheets), and what is neither as Windows-1252, of
    which the digits are those of all other single-byte encodings.
    """
    content = read_unpacked(path, kind)
    _check_lines(content, path, kind, MOST_LINES)
    if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return _decoded(content, path, kind, "utf-16")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        if b"\0" in content:
            raise InputError(f"{path}: cannot be read (it is no text); give the path of {kind}") from None
    return _decoded(content, path, kind, "cp1252")


def _check_lines(content: bytes, path: Path, kind: str, most: int) -> None:
    check_lines(path, kind, content.count(b"\n") + content.count(b"\r") - content.count(b"\r\n"), most)


def _decoded(content: bytes, path: Path, kind: str, encoding: str) -> str:
    try:
        return content.decode(encoding)
    except UnicodeDecodeError as error:
        where = f"{error}, in line {content.count(10, 0, error.start) + 1}"
        raise InputError(f"{path}: cannot be read ({where}); give the path of {kind} that is saved as UTF-8") from error


def read_unpacked(path: Path, kind: str, most_bytes: int = MOST_BYTES) -> bytes:
    """Content of a file, packed by gzip or not; arguments and errors as `read_text`."""
    content = _read_file(path, kind, most_bytes + 1)
    if len(content) > most_bytes:
        raise _too_large(path, kind, most_bytes)
    return _unpacked(content, path, kind, most_bytes) if content.startswith(_GZIP) else content


def _read_file(path: Path, kind: str, most_bytes: int) -> bytes:
    """The first bytes of a file."""
    try:
        regular = stat.S_ISREG(path.stat().st_mode)
        content = b""
        if regular:  # a pipe would be waited for
            with path.open("rb") as file:
                content = file.read(most_bytes)
    except (OSError, ValueError) as error:  # ValueError: a path with a zero byte
        raise InputError(f"{path}: cannot be read ({error}); give the path of {kind}") from error
    if not regular:
        raise InputError(f"{path}: cannot be read (it is no file); give the path of {kind}")
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
