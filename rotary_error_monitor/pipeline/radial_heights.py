"""Radial error motion at heights of the user's choice, from the estimate as it is published."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.topics import columns_named
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.error_motion import ErrorMotion, radial_covariance_at, radial_error_motion_at
from rotary_error_monitor.signals.blocks import SampleBlock, block_from_samples

HIGHEST = 10.0
"""Height above the ring, m, that no stage is larger than."""


def check_height(height: float, most: float, unit: str, told: str) -> None:
    """Refuse a height that no stage has; `told` says what was given and how, such as `--height is 20000`.

    Raises:
        InputError: it is farther from the ring than `most`, `HIGHEST` in its unit, or no number.
    """
    if not abs(height) <= most:
        raise InputError(f"{told}; it must be a height above the ring in {unit}, at most {HIGHEST:g} m")


def radial_block(motion: ErrorMotion, heights: Sequence[float]) -> SampleBlock:
    """Block of the radial error motion at heights above the ring.

    Args:
        motion: error motion at m ticks.
        heights: above the ring, m.

    Returns:
        Block with a row for each height at each tick, in the order in which the heights were given; of the columns
        of the wire contract, zero where not observable.
    """
    columns = _columns()
    parts = np.zeros((len(motion.times_ns), len(heights), len(columns)))
    for place, height in enumerate(heights):
        seen = is_observable_at(motion.observable, height)
        covariance = radial_covariance_at(motion.covariance, height)
        parts[:, place, 0], parts[:, place, 3] = height, seen
        parts[seen, place, 1:3] = radial_error_motion_at(motion.components[seen], height)
        for column, (i, j) in enumerate(((0, 0), (1, 1), (0, 1)), start=4):
            parts[seen, place, column] = covariance[seen, i, j]
    rows = parts.reshape(-1, len(columns))
    return block_from_samples(np.repeat(motion.times_ns, len(heights)), columns, rows)


def _columns() -> tuple[str, ...]:
    """Height, radial error motion (x, y), whether it is observable, its variances (x, y) and its covariance."""
    return columns_named("error_motion_heights_samples")


def is_observable_at(observable: NDArray[np.bool_], height: float) -> NDArray[np.bool_]:
    """(m,) whether radial motion is, by components (m, 6) that are; at the ring itself the tilt does not count."""
    components = [0, 1] if height == 0.0 else [0, 1, 3, 4]
    return np.asarray(observable[:, components].all(axis=1))


def figures_of(block: SampleBlock) -> tuple[tuple[str, ...], Array, Array]:
    """Latest radial error motion of a block as people read it: names, µm, and standard uncertainties in µm.

    Names are such as `radial_x_at_60mm`; what is not observable is NaN.
    """
    time = block.rows[:, 0]
    latest = block.columns(_columns())[time == time[-1]]
    names = [f"radial_{axis}_at_{height * 1e3:g}mm".replace("-", "minus_") for height in latest[:, 0] for axis in "xy"]
    seen = np.repeat(latest[:, 3] == 1.0, 2)
    values, stds = latest[:, 1:3].ravel(), np.sqrt(latest[:, 4:6]).ravel()
    return tuple(names), np.where(seen, values * 1e6, np.nan), np.where(seen, stds * 1e6, np.nan)
