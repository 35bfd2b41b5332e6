"""How often the 95 % bounds of a straightness calibration hold the truth: a short look; the sweep has 500 of each."""

from __future__ import annotations

import pytest
from calibration.simulated_guideway import WAYS, rates


@pytest.mark.few(1)
@pytest.mark.parametrize("way", WAYS)
def test_bounds_hold_the_truth(way: str) -> None:
    """Of 30 draws at 95 %, 23 or fewer come by chance less often than once in a thousand."""
    found = rates(way, 30)
    assert all(rate >= 24 / 30 for rate in found.values()), found
