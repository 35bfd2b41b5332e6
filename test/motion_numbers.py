"""All numbers of an error motion beside its times, to hold two of them against each other."""

from __future__ import annotations

import numpy as np

from rotary_error_monitor.metrology.error_motion import ErrorMotion


def numbers_of(motion: ErrorMotion) -> np.ndarray:
    """(m, k) a row for each time."""
    arrays = (each for name, each in vars(motion).items() if name != "times_ns")
    return np.column_stack([each.reshape(len(motion.times_ns), -1) for each in arrays])


def assert_same_bits(first: ErrorMotion, second: ErrorMotion) -> None:
    """That both are of the same times, and say the same to the last bit."""
    np.testing.assert_array_equal(first.times_ns, second.times_ns)
    np.testing.assert_array_equal(numbers_of(first), numbers_of(second))
