"""How often the 95 % bounds of a machine identified from poses hold the truth: a short look; the sweep has 500."""

from __future__ import annotations

import pytest
from calibration.simulated_machine import rates


@pytest.mark.long
@pytest.mark.parametrize("kind", ["trunnion, few poses", "grinder"])
def test_bounds_hold_the_truth(kind: str) -> None:
    """Of 12 tools at 95 %, 8 or fewer are held by chance less often than three in a thousand; parameters are many."""
    found = rates(kind, 12)
    assert found["parameters"] >= 0.9, found
    assert found["tool"] >= 9 / 12, found
    assert found["held-out check"] >= 10 / 12, found
