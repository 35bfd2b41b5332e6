"""Error motion as columns of a sample block, by their names in the wire contract, and back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields
from functools import cache
from itertools import combinations_with_replacement

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.metrology.error_motion import COMPONENTS, ErrorMotion
from rotary_error_monitor.signals.blocks import SampleBlock, block_from_samples

_BITS = 1 << np.arange(len(COMPONENTS))
_FIRST, _LAST = len(COMPONENTS), len(COMPONENTS) * (len(COMPONENTS) + 1)
"""Places of the covariances among all numbers of a time, which are these in their order:"""

_BESIDE = tuple(each.name for each in fields(ErrorMotion))[5:]
_DOUBTS = _BESIDE[1]


def _covariance(row: str, column: str) -> str:
    """Name of the covariance of two components, of one with itself that of its variance."""
    return f"var_{row}" if row == column else f"cov_{'_'.join(sorted((row, column), key=COMPONENTS.index))}"


_NAMES = (
    *COMPONENTS,
    *(_covariance(row, column) for row in COMPONENTS for column in COMPONENTS),
    *("theta", "observable", *_BESIDE),
)
_SEEN_TOGETHER = (("exc", "eyc", "ecc"), ("eac",), ("ebc",))
"""Components that heads and autocollimator show; others are correlated where a stage lists sensors."""

_ALWAYS = (
    *("theta", *COMPONENTS, "observable", "streams"),
    *(_covariance(*pair) for part in _SEEN_TOGETHER for pair in combinations_with_replacement(part, 2)),
)
"""Columns that each stage has, since the first version."""


def block_from_error_motion(motion: ErrorMotion, columns: Sequence[str]) -> SampleBlock:
    """Error motion at one time at least as the columns that the wire contract names after `t`."""
    numbers = np.empty((len(motion.theta), len(_NAMES)))
    numbers[:, :_FIRST], numbers[:, _FIRST:_LAST] = motion.components, motion.covariance.reshape(-1, _LAST - _FIRST)
    numbers[:, _LAST], numbers[:, _LAST + 1] = motion.theta, motion.observable @ _BITS
    for place, name in enumerate(_BESIDE, start=_LAST + 2):
        numbers[:, place] = getattr(motion, name)
    return block_from_samples(motion.times_ns, columns, np.take(numbers, _places_of(tuple(columns)), axis=1))


def error_motion_from_block(block: SampleBlock) -> ErrorMotion:
    """Error motion of a block of the wire contract; what earlier versions did not say is as of `ErrorMotion.of`.

    Raises:
        InputError: the block lacks one of the columns that each stage has.
    """
    if not _has_all(block.names):
        for name in _ALWAYS:
            block.column(name)  # says what there is
    count, width = block.rows.shape
    columns = np.empty((width + 2, count))
    columns[:width], columns[width], columns[width + 1] = block.rows.T, 0.0, 1.0
    numbers = columns[_places_in(block.names)].T  # half of the time of choosing columns
    theta, observable, streams, doubts, *beside = numbers[:, _LAST:].T
    return ErrorMotion(
        theta,
        numbers[:, :_FIRST],
        observable.astype(np.int64)[:, None] & _BITS != 0,
        numbers[:, _FIRST:_LAST].reshape(-1, _FIRST, _FIRST),
        block.times_ns,
        streams.astype(np.int64),
        doubts.astype(np.int64),
        *beside,
    )


def tells_doubts(block: SampleBlock) -> bool:
    """Whether a block of error motion says what was doubted, which one of an earlier version does not."""
    return _DOUBTS in block.names


@cache
def _has_all(names: tuple[str, ...]) -> bool:
    return set(_ALWAYS) <= set(names)


@cache
def _places_of(columns: tuple[str, ...]) -> NDArray[np.intp]:
    """Where each column stands in `_NAMES`."""
    return np.array([_NAMES.index(name) for name in columns], np.intp)


@cache
def _places_in(names: tuple[str, ...]) -> NDArray[np.intp]:
    """Where each of `_NAMES` stands in columns that are followed by two for those that are absent: zeros and ones."""
    zeros, ones = len(names), len(names) + 1
    absent = {name: ones if name.endswith(("_scale", "_conflict")) else zeros for name in _NAMES}
    return np.array([names.index(name) if name in names else absent[name] for name in _NAMES], np.intp)
