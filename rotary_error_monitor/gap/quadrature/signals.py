"""Files of sine and cosine signals: comma-separated text, plain or packed by gzip, with a line of headings.

Either the columns `Phase (deg)` and `Radius` (counts), others being left out, or the columns `cos` and `sin` (counts).
"""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np

from rotary_error_monitor.effects.quadrature_effect import Complex
from rotary_error_monitor.errors import InputError, excerpt
from rotary_error_monitor.files import read_text
from rotary_error_monitor.twin.quadrature import FEWEST_SAMPLES, QuadratureRecording

_POLAR, _CARTESIAN = ("phase (deg)", "radius"), ("cos", "sin")


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
    lines = read_text(path, "a .csv or .csv.gz file of signals").splitlines()
    heads = [head.strip().lower() for head in lines[0].split(",")] if lines else []
    wanted = next((pair for pair in (_POLAR, _CARTESIAN) if set(pair) <= set(heads)), None)
    if wanted is None:
        raise InputError(
            f"{path}:1: columns {excerpt(heads) if heads else 'none'}; expected {' and '.join(_POLAR)}, or cos and sin"
        )
    if len(lines) - 1 < FEWEST_SAMPLES:
        raise InputError(f"{path}: {max(len(lines) - 1, 0)} samples; at least {FEWEST_SAMPLES} are needed")
    columns = [heads.index(name) for name in wanted]
    try:
        values = np.loadtxt(io.StringIO("\n".join(lines[1:])), delimiter=",", usecols=columns, comments=None, ndmin=2)
    except (ValueError, IndexError) as error:
        raise InputError(
            f"{path}: {excerpt(error)}; expected numbers in columns {wanted[0]} and {wanted[1]}"
        ) from error
    bad = np.flatnonzero(~(np.abs(values) <= LARGEST).all(axis=1))
    if len(bad):
        raise InputError(f"{path}:{int(bad[0]) + 2}: {values[bad[0]]}; expected finite numbers of at most {LARGEST:g}")
    if wanted == _CARTESIAN:
        return np.asarray(values[:, 0] + 1j * values[:, 1], np.complex128)
    return np.asarray(values[:, 1] * np.exp(1j * np.radians(values[:, 0])), np.complex128)
