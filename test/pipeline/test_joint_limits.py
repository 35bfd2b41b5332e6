"""What sensors show together, held against limits: by what it takes to be believed again."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.description.stage_limits import StageLimits
from rotary_error_monitor.pipeline.joint_limits import JointLimits

TILT = np.array([False, False, False, True, True, False])
WITHIN, BEYOND = np.zeros(6), np.array([0.0, 0.0, 0.0, 2e-4, 0.0, 0.0])


def after(windows: int, shown: np.ndarray, turning: float) -> JointLimits:
    """A tilt beyond the limit, and then so many windows within it in which that is `shown`."""
    limits = JointLimits(StageLimits(tilt=1e-4))
    limits.judge(0.01, 0.0, TILT, BEYOND, np.full(6, 1e-7))
    assert "tilt error motion of 200 µrad; the stage's is 100 µrad at most" in limits.doubt
    for number in range(windows):
        limits.judge(0.01, turning * (number + 1), shown, WITHIN, np.full(6, 1e-7))
    return limits


@pytest.mark.parametrize(
    ("windows", "shown", "turning", "believed"),
    [
        (130, TILT, 0.05, True),
        (100, TILT, 0.05, False),  # less than a turn
        (40, TILT, 0.2, False),  # a turn, in less than half a second
        (1000, TILT, 0.0, False),
        (1000, np.zeros(6, np.bool_), 0.05, False),  # silence proves nothing
    ],
)
def test_a_turn_within_the_limits_is_believed(windows, shown, turning, believed):
    assert (not after(windows, shown, turning).doubt) is believed


def test_what_is_as_uncertain_as_it_is_large_is_no_contradiction():
    limits = JointLimits(StageLimits(tilt=1e-4))
    limits.judge(0.01, 0.0, TILT, BEYOND, np.full(6, 2e-5))
    assert not limits.doubt
