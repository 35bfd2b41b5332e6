"""Gain, roll and zero of an autocollimator are as sure as is stated: the covariance of the tilt says so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pipeline.test_responses import IDEAL, RESPONSES, estimated

SEEDS = 8
KNOWN = RESPONSES["autocollimator"]
STATED = {"autocollimator.gain": 0.02, "autocollimator.roll": 0.02, "autocollimator.zero": 2e-6}
ASSEMBLY = {"mirror.tilt": 1e-8, "encoder.eccentricity": 1e-9}
"""Calibrated well, so that nothing else hides what the instrument is off by."""


def deviations(seed, uncertainty):
    """(n, 2) errors of the tilt over its stated standard deviation, of an instrument off by chance as `STATED` says."""
    off = np.random.default_rng([seed, 7]).normal(size=4) * [*STATED.values(), STATED["autocollimator.zero"]]
    true = replace(
        KNOWN, gain=KNOWN.gain + off[0], roll=KNOWN.roll + off[1], zero=tuple(np.add(KNOWN.zero, off[2:]).tolist())
    )
    made = replace(IDEAL, responses={"autocollimator": true})
    told = replace(IDEAL, responses={"autocollimator": KNOWN}, uncertainty={**ASSEMBLY, **uncertainty})
    _, motion, error = estimated(made, told, seed, 12.0)
    variance = motion.covariance[:, [3, 4], [3, 4]]
    return (error[:, 2:4] / np.sqrt(variance))[-3000::50]  # behind the turn that verifies the description


@pytest.mark.few(1)
@pytest.mark.parametrize("stated", [STATED, {}], ids=["stated", "not stated"])
def test_the_tilt_is_as_uncertain_as_its_instrument(stated):
    found = np.concatenate([deviations(seed, stated) for seed in range(SEEDS)])
    inside = np.mean(np.abs(found) < 1.96)
    # the errors of a seed stay the same over its time: so many are 16 of a normal distribution
    assert inside >= 0.85 if stated else inside < 0.6
    assert not stated or 0.6 < np.sqrt(np.mean(found**2)) < 1.4
