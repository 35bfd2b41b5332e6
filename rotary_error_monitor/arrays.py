"""Types of arrays, by what their elements are."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

Complex = NDArray[np.complex128]

Mask = NDArray[np.bool_]

Times = NDArray[np.int64]
"""Stamps, ns."""
