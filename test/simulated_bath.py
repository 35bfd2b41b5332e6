"""A bath that is heated and cooled, and a thermometer that follows it."""

from __future__ import annotations

from pathlib import Path

import numpy as np

LAG = 7.5
"""Time constant of the thermometer, s."""


def write_bath(file: Path) -> Path:
    """Write time, bath and a thermometer that follows it by Newton's law, in small steps of time."""
    rng = np.random.default_rng(4)
    fine = np.arange(0, 1200, 0.01)
    bath = 40 + 8 * np.sin(2 * np.pi * fine / 300) + 3 * np.sin(2 * np.pi * fine / 71)
    reading = np.empty_like(bath)
    reading[0] = bath[0]
    for i in range(len(fine) - 1):
        reading[i + 1] = reading[i] + (bath[i] - reading[i]) * 0.01 / LAG
    table = np.column_stack([fine, bath, reading + 0.02 * rng.normal(size=len(fine)) + 0.05])[::100]
    np.savetxt(file, table, delimiter=",", header="time,bath,thermometer", comments="")
    return file
