"""The play of a drive: what moves stands in a slot that a pin, the drive, moves in."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

LEAST_WIDTH = 1e-9
"""A slot narrower than this, m or rad, is as wide: the side is then that of the last movement."""


def play(path: NDArray[np.float64], width: NDArray[np.float64], side: NDArray[np.float64]) -> NDArray[np.float64]:
    """Where the pin stands in its slot: the play operator of hysteresis (Visintin 1994, III.2), exact for any path.

    A drive that turns back has to cross its slot before anything follows: its reversal error goes from one value to the
    other as it does, not at once.

    Args:
        path: (n, axes) positions of the drives, m or rad, at n times.
        width: (axes,) of the slots: the reversal errors.
        side: (axes,) +1 or -1, at which the pins stand at the first time.

    Returns:
        (n, axes) from -1 to 1: the sign of the travel, or less than that in the middle of the slot.
    """
    width = np.maximum(np.abs(width), LEAST_WIDTH)
    slack = 0.5 * width * (1.0 + np.sign(side))
    slacks = [slack]
    for step in np.diff(path, axis=0):
        slack = np.clip(slack + step, 0.0, width)
        slacks.append(slack)
    return np.asarray(2.0 * np.array(slacks) / width - 1.0, dtype=np.float64)
