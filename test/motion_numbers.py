"""Numbers of an error motion, to hold two of them against each other, and what was decided for each of its times."""

from __future__ import annotations

from dataclasses import fields

import numpy as np

from rotary_error_monitor.metrology.error_motion import ErrorMotion
from rotary_error_monitor.pipeline.publication import Decision, Decisions


def numbers_of(motion: ErrorMotion) -> np.ndarray:
    """(m, k) a row for each time."""
    arrays = (each for name, each in vars(motion).items() if name != "times_ns")
    return np.column_stack([each.reshape(len(motion.times_ns), -1) for each in arrays])


def assert_same_bits(first: ErrorMotion, second: ErrorMotion) -> None:
    """That both are of the same times, and say the same to the last bit."""
    np.testing.assert_array_equal(first.times_ns, second.times_ns)
    np.testing.assert_array_equal(numbers_of(first), numbers_of(second))


def decisions_of(motion: ErrorMotion) -> Decisions:
    """What the run decided that published error motion, by the stamp of each tick."""
    said = (getattr(motion, each.name).tolist() for each in fields(Decision))
    return {time: Decision(*each) for time, *each in zip(motion.times_ns.tolist(), *said, strict=True)}
