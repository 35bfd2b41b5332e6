"""Types of arrays, by what their elements are."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

Number = TypeVar("Number", np.float64, np.int64)

Array = NDArray[np.float64]

Complex = NDArray[np.complex128]

Mask = NDArray[np.bool_]

Times = NDArray[np.int64]
"""Stamps, ns."""


def differences(values: NDArray[Number], before: ArrayLike) -> NDArray[Number]:
    """(n, ...) of each of at least one value from the one before, of the first from `before`.

    As `np.diff` with `prepend`, which takes five times as long.
    """
    steps = np.empty_like(values)
    steps[0] = values[0] - before
    np.subtract(values[1:], values[:-1], out=steps[1:])
    return steps
