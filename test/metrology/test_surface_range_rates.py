"""Of 500 simulated surfaces of each kind the 95 % interval of flatness holds the truth in 93 to 97 of 100."""

from __future__ import annotations

import numpy as np
from metrology.simulated_surfaces import KINDS, SIZES, held

SURFACES = 500

CHANCE = 3.5 * np.sqrt(0.95 * 0.05 / SURFACES)
"""Of a rate of 95 %: less comes by chance once in four thousand."""


def test_intervals_hold_the_flatness_in_93_to_97() -> None:
    """Over all kinds together; each by itself no less than chance makes of 95 %, and hardly one without interval."""
    found = {(kind, size): held(kind, *size, SURFACES) for kind in KINDS for size in SIZES}
    print(*found.items(), sep="\n")
    rates = {key: each["held"] for key, each in found.items()}
    assert 0.93 <= np.mean(list(rates.values())) <= 0.97
    assert {key: rate for key, rate in rates.items() if not 0.95 - CHANCE <= rate <= 0.975} == {}
    assert max(each["none"] for each in found.values()) < 0.12
