"""The uncertainties that `compare` states hold the truth, on some stages; `test_compare_rates.py` asks 500."""

from __future__ import annotations

from recordings.compared_stages import rates

STAGES = 6


def test_stated_uncertainties_hold_the_truth() -> None:
    """Of six stages: bounds of 95 % miss more than two of twelve in one of fifty cases."""
    found = rates(STAGES, skip=20)
    assert found["compared"] >= 0.8, found
    assert found["eccentricity"] >= 0.8, found
    assert found["height"] >= 0.7, found
    assert 0.85 <= found["differences"] <= 0.999, found
    assert found["agrees"] >= 0.8, found
