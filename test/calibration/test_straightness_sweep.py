"""Of 500 simulated straightness calibrations the 95 % bound of each result holds the truth in 93 to 97 of 100."""

from __future__ import annotations

import pytest
from calibration.simulated_guideway import WAYS, rates


@pytest.mark.parametrize("way", WAYS)
def test_bounds_hold_the_truth_in_93_to_97(way: str) -> None:
    found = rates(way, 500)
    print(way, found)
    assert all(0.93 <= rate <= 0.97 for rate in found.values()), found
