"""How often the 95 % bounds of a straightness calibration hold the truth: a short look; the sweep has 500 of each."""

from __future__ import annotations

import numpy as np
import pytest
from calibration.simulated_guideway import WAYS, held

SEEDS = range(1000, 1030)


@pytest.mark.parametrize("way", WAYS)
def test_bounds_hold_the_truth(way: str) -> None:
    found = [held(way, seed) for seed in SEEDS]
    for name in found[0]:
        rate = np.mean([each[name] for each in found])
        # of 30 draws at 95 %, 23 or fewer come by chance less often than once in a thousand
        assert rate >= 24 / 30, (name, rate)
