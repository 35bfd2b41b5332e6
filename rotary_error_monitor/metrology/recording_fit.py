"""Does a recording fit what was taken from it? What is left is held against the noise that the description states.

What is left may be larger than the described noise by as much again as the noise of a single reading: a description
claims nothing below that, and noise of another colour than white reaches it. If it is larger still, at a false-alarm
rate of `FALSE_ALARM`, the recording holds something that the model has no place for.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.metrology.distributions import chi_square_tail
from rotary_error_monitor.metrology.rotation_fit import FALSE_ALARM, effective_count

TREND_ORDER = 3
"""Highest polynomial of time that counts as a trend: a drift that sets in, settles, or comes back."""

LEAST_SHARE = 0.1
"""Part of the power that does not fit from which a cause is named."""


@dataclass(frozen=True)
class RecordingFit:
    """What a recording says against the model that was taken from it.

    Attributes:
        ratio: root mean square of what is left over the noise and resolution that the description explains.
        excess: root mean square of what is left beyond those, rad.
        allowed: the described noise of a single reading, rad: `excess` may reach it.
        probability: of so much being left if the excess were as large as allowed.
        lines: orders and their amplitude, rad, that repeat with the rotation and have no place in the model.
        trend: root mean square of a slow change over the recording, rad.
        direction: root mean square of what changes with the direction of rotation, rad.
    """

    ratio: float
    excess: float
    allowed: float
    probability: float
    lines: tuple[tuple[int, float], ...]
    trend: float
    direction: float

    @property
    def fits(self) -> bool:
        """Whether so much is left by chance more often than `FALSE_ALARM`."""
        return self.probability >= FALSE_ALARM

    @property
    def discrepancy(self) -> float:
        """How far a coefficient may be off by what has no place in the model, as a standard uncertainty, rad.

        Of an order with no place in the model, as much may hide in each coefficient as shows beside it. Where the
        recording does not fit, all that is left may.
        """
        shown = float(sum(size**2 for _, size in self.lines))
        return float(np.sqrt(shown / 2 if self.fits else max(shown, 2 * self.excess**2)))

    def causes(self) -> tuple[tuple[str, float], ...]:
        """What the excess consists of and its root mean square, rad, largest first."""
        parts = [(size / np.sqrt(2), f"order {order} of the rotation") for order, size in self.lines]
        parts += [(self.trend, "a trend over time"), (self.direction, "the direction of rotation")]
        rest = self.excess**2 - sum(size**2 for size, _ in parts)
        parts.append((float(np.sqrt(max(0.0, rest))), "neither the rotation nor a slow change"))
        named = sorted((part for part in parts if part[0] ** 2 > LEAST_SHARE * self.excess**2), reverse=True)
        return tuple((words, float(size)) for size, words in named)

    def sentence(self, what: str, scale: float, unit: str) -> str:
        """By how much it does not fit, and what is left looks like; rad times `scale` is `unit`."""
        causes = ", ".join(f"{words} {size * scale:.3f}" for words, size in self.causes())
        return (
            f"{what}: {self.excess * scale:.3f} {unit} are left beyond the noise, where a single reading's noise is "
            f"{self.allowed * scale:.3f} (p-value {self.probability:.1g}): {causes}"
        )


def judge_recording(
    residual: Array,
    variances: Array,
    reading_variance: float,
    parameters: int,
    times: Array,
    speed: Array,
    lines: tuple[tuple[int, float], ...] = (),
) -> RecordingFit:
    """Hold what is left (n, c) against the described variances (n,) rad² of each row.

    Args:
        residual: measured minus model, rad; independent channels of equal noise.
        variances: of a row's channels by the described noise and resolution.
        reading_variance: of a single reading by the same.
        parameters: how many were fitted.
        times: (n,) s.
        speed: (n,) rad/s.
        lines: orders that have no place in the model, with their amplitude.
    """
    values = residual.size - parameters
    square = float((residual**2).sum()) / max(1, values)
    described = float(variances.mean())
    freedom = effective_count(residual) * max(1, values) / residual.size
    probability = chi_square_tail(freedom * square / (described + reading_variance), freedom)
    trend, direction = _slow_parts(residual, times, speed)
    return RecordingFit(
        ratio=float(np.sqrt(square / described)),
        excess=float(np.sqrt(max(0.0, square - described))),
        allowed=float(np.sqrt(reading_variance)),
        probability=probability,
        lines=lines,
        trend=trend,
        direction=direction,
    )


def _slow_parts(residual: Array, times: Array, speed: Array) -> tuple[float, float]:
    """Root mean square of a trend over time and of what changes with the direction, the larger taken out first."""
    share = 2 * (times - times[0]) / max(float(np.ptp(times)), 1e-9) - 1
    slow, way = legendre.legvander(share, TREND_ORDER)[:, 1:], np.sign(speed)[:, None]

    def part(design: Array, values: Array) -> Array:
        design = design - design.mean(axis=0)
        return np.asarray(design @ np.linalg.lstsq(design, values - values.mean(axis=0), rcond=None)[0])

    trend, direction = part(slow, residual), part(way, residual)
    if np.sum(trend**2) > np.sum(direction**2):
        direction = part(way, residual - trend)
    else:
        trend = part(slow, residual - direction)
    return float(np.sqrt(np.mean(trend**2))), float(np.sqrt(np.mean(direction**2)))
