"""The errors that a user can mend."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager

_NUMBERS = re.compile(r"[-+]?\d[\d.]*(e[-+]?\d+)?")


class InputError(ValueError):
    """Wrong input; the message names the value, where it came from and what would be right."""


class MissingPackageError(InputError, ImportError):
    """An optional package is not installed; the message says how it is."""


@contextmanager
def told_of(where: object) -> Iterator[None]:
    """Name what wrong input is about, such as a file, before what is told of it within."""
    try:
        yield
    except InputError as error:
        raise InputError(f"{where}: {error}") from error


def one_line(text: str) -> str:
    r"""The text with `\n` and all that a terminal or a log would not print written out: it may come from anybody."""
    return text if text.isprintable() else "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


def printable(text: str) -> str:
    """The same with its lines left as they are: what is said to a terminal, whatever somebody forgot."""
    return "\n".join(map(one_line, text.split("\n")))


def excerpt(text: object, most: int = 200) -> str:
    """The text for a message, in one line: of one that is longer than `most` characters its beginning and its end."""
    shown = str(text)
    if len(shown) > most:
        half = most // 2
        shown = f"{shown[:half]} … {shown[-half:]}"
    return one_line(shown)


def without_numbers(text: str) -> str:
    """The text without its numbers: reasons that differ in nothing else are the same reason."""
    return _NUMBERS.sub("", text)
