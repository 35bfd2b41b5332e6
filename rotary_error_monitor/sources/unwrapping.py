"""Readings that start again after a whole turn or a full counter, made continuous."""

from __future__ import annotations

import math


def unwrap_count(count: int, before: int, modulus: int) -> int:
    """The number congruent to `count` nearest to the unwrapped `before`; whole numbers, so no digit is lost at 2**64.

    Right as long as less than half of the modulus passes between two readings.
    """
    step = (count - before) % modulus
    return before + (step - modulus if step > modulus // 2 else step)


def unwrap_angle(angle: float, before: float) -> float:
    """The angle in rad that differs from `angle` by whole turns and is nearest to the unwrapped `before`."""
    return angle - 2 * math.pi * round((angle - before) / (2 * math.pi))
