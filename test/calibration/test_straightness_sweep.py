"""Of 500 simulated straightness calibrations the 95 % bound of each result holds the truth in 93 to 97 of 100."""

from __future__ import annotations

import numpy as np
import pytest
from calibration.simulated_guideway import WAYS, held

SEEDS = range(500)


@pytest.mark.parametrize("way", WAYS)
def test_bounds_hold_the_truth_in_93_to_97(way: str) -> None:
    found = [held(way, seed) for seed in SEEDS]
    rates = {name: round(float(np.mean([each[name] for each in found])), 3) for name in found[0]}
    print(way, rates)
    assert all(0.93 <= rate <= 0.97 for rate in rates.values()), rates
