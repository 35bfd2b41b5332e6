"""Of 500 simulated calibrations of a machine the 95 % bound of each result holds the truth in 93 to 97 of 100."""

from __future__ import annotations

import pytest
from calibration.simulated_machine import CALIBRATIONS, rates


@pytest.mark.parametrize("kind", CALIBRATIONS)
def test_bounds_hold_the_truth_in_93_to_97(kind: str) -> None:
    found = rates(kind, 500)
    print(kind, found)
    assert found.pop("held-out check") >= 0.975, found  # 99 in 100, less three standard deviations
    assert all(0.93 <= rate <= 0.97 for rate in found.values()), found
