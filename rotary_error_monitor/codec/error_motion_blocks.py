"""Error motion as columns of a sample block, by their names in the wire contract, and back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.metrology.error_motion import COMPONENTS, ErrorMotion
from rotary_error_monitor.signals.blocks import SampleBlock, block_from_samples

_COMPONENT = {name: place for place, name in enumerate(COMPONENTS)}
_BITS = 1 << np.arange(len(COMPONENTS))
_COVARIANCE = {
    f"var_{first}" if first == second else f"cov_{first}_{second}": (row, column)
    for first, row in _COMPONENT.items()
    for second, column in _COMPONENT.items()
    if row <= column
}
_ALWAYS = ("var_exc", "var_eyc", "cov_exc_eyc", "var_eac", "var_ebc", "var_ecc", "cov_exc_ecc", "cov_eyc_ecc")
"""Those that heads and autocollimator make; the others come of listed sensors."""

_BESIDE = {each.name for each in fields(ErrorMotion)} - {"theta", "components", "observable", "covariance", "times_ns"}
_MASKS = ("streams", "doubts")


def block_from_error_motion(motion: ErrorMotion, columns: Sequence[str]) -> SampleBlock:
    """Error motion at one time at least as the columns that the wire contract names after `t`."""
    return block_from_samples(motion.times_ns, columns, np.stack([_column(motion, name) for name in columns], axis=1))


def error_motion_from_block(block: SampleBlock) -> ErrorMotion:
    """Error motion of a block of the wire contract; what earlier versions did not say is as of `ErrorMotion.of`.

    Raises:
        InputError: the block lacks one of the columns that each stage has.
    """
    count, there = len(block.rows), set(block.names)
    covariance = np.zeros((count, len(COMPONENTS), len(COMPONENTS)))
    for name in (*_ALWAYS, *(_COVARIANCE.keys() & there)):
        row, column = _COVARIANCE[name]
        covariance[:, row, column] = covariance[:, column, row] = block.column(name)
    observable = block.column("observable").astype(np.int64)[:, None] & _BITS != 0
    motion = ErrorMotion.of(block.column("theta"), block.columns(COMPONENTS), observable, covariance)
    beside: dict[str, Any] = {name: block.column(name) for name in ("streams", *(_BESIDE & there))}
    beside |= {name: beside[name].astype(np.int64) for name in _MASKS if name in beside}
    return replace(motion, times_ns=block.times_ns, **beside)


def _column(motion: ErrorMotion, name: str) -> NDArray[Any]:
    if name in _COMPONENT:
        return motion.components[:, _COMPONENT[name]]
    if name in _COVARIANCE:
        row, column = _COVARIANCE[name]
        return motion.covariance[:, row, column]
    found: NDArray[Any] = motion.observable @ _BITS if name == "observable" else getattr(motion, name)
    return found
