"""Files of sine and cosine signals: comma-separated text, plain or packed by gzip, with a line of headings.

Either the columns `Phase (deg)` and `Radius` (counts), others being left out, or the columns `cos` and `sin` (counts).
"""

from __future__ import annotations

import io
import itertools
import warnings
from pathlib import Path

import numpy as np

from rotary_error_monitor.arrays import Complex
from rotary_error_monitor.errors import InputError, excerpt
from rotary_error_monitor.files import check_lines, read_first_line, read_unpacked
from rotary_error_monitor.kinds.quadrature.twin import FEWEST_SAMPLES, QuadratureRecording

_POLAR, _CARTESIAN = ("phase (deg)", "radius"), ("cos", "sin")
_KIND = "a .csv or .csv.gz file of signals"

MOST_BYTES = 64 << 20
MOST_SAMPLES = 2_000_000
LONGEST_LINE = 1 << 16
"""Bytes, lines, and characters of a line: hundreds of times those of any recording that is known."""

_PART = 1 << 22

LARGEST = 2.0**53
"""Counts of a converter, or degrees, beyond which a double knows no single one."""


def read_quadrature(path: Path) -> QuadratureRecording:
    """Recording of a pair of signals.

    Raises:
        InputError: the file cannot be read, lacks the columns, holds something else than numbers, or is too short.
    """
    return QuadratureRecording(read_signals(path))


def read_signals(path: Path) -> Complex:
    """(n,) cosine + i sine, counts.

    Raises:
        InputError: as `read_quadrature`.
    """
    heads = [head.strip().lower() for head in read_first_line(path, _KIND).split(",")]
    wanted = next((pair for pair in (_POLAR, _CARTESIAN) if set(pair) <= set(heads)), None)
    if wanted is None:
        found = excerpt(heads) if any(heads) else "none"
        raise InputError(f"{path}:1: columns {found}; expected {' and '.join(_POLAR)}, or cos and sin")
    content = read_unpacked(path, _KIND, MOST_BYTES)
    _check_lines(path, content)
    columns = [heads.index(name) for name in wanted]
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that nothing but blank lines follows, which is said below
            values = np.loadtxt(_text(content), delimiter=",", skiprows=1, usecols=columns, comments=None, ndmin=2)
    except (ValueError, IndexError) as error:
        raise InputError(
            f"{path}: {excerpt(error)}; expected numbers in columns {wanted[0]} and {wanted[1]}"
        ) from error
    if len(values) < FEWEST_SAMPLES:
        raise InputError(f"{path}: {len(values)} samples; at least {FEWEST_SAMPLES} are needed")
    bad = np.flatnonzero(~(np.abs(values) <= LARGEST).all(axis=1))
    if len(bad):
        line = _line_of(content, int(bad[0]))
        raise InputError(f"{path}:{line}: {values[bad[0]]}; expected finite numbers of at most {LARGEST:g}")
    if wanted == _CARTESIAN:
        return np.asarray(values[:, 0] + 1j * values[:, 1], np.complex128)
    return np.asarray(values[:, 1] * np.exp(1j * np.radians(values[:, 0])), np.complex128)


def _text(content: bytes) -> io.TextIOWrapper:
    return io.TextIOWrapper(io.BytesIO(content), encoding="utf-8")


def _check_lines(path: Path, content: bytes) -> None:
    """Refuse what costs more to load than any recording of signals."""
    check_lines(path, _KIND, content.count(b"\n") + content.count(b"\r") - content.count(b"\r\n"), MOST_SAMPLES)
    longest, begin = 0, -1
    for start in range(0, len(content), _PART):
        part = np.frombuffer(content, np.uint8, min(_PART, len(content) - start), start)
        ends = start + np.flatnonzero((part == ord("\n")) | (part == ord("\r")))
        if len(ends):
            longest = max(longest, int(np.diff(ends, prepend=begin).max()) - 1)
            begin = int(ends[-1])
    longest = max(longest, len(content) - begin - 1)
    if longest > LONGEST_LINE:
        raise InputError(f"{path}: a line of {longest} characters; expected at most {LONGEST_LINE}")


def _line_of(content: bytes, sample: int) -> int:
    """Line of a sample; blank ones are none."""
    lines = (number for number, line in enumerate(_text(content), start=1) if number > 1 and line.strip("\n"))
    return next(itertools.islice(lines, sample, None))
