"""An autocollimator with a distortion: the estimator takes it off, and says how sure it is of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from pipeline.test_responses import IDEAL, estimated, rms

from rotary_error_monitor.description.response import Response
from rotary_error_monitor.pipeline.publication import AssemblyVariance
from rotary_error_monitor.twin.stage_parameters import uncertain_parameters

BENT = Response((2e-5, -3e-5), 1.02, 0.2, 2e-3, 0.03, 0.02, (-5e5, 6e5))
STATED = {"gain_difference": 0.02, "cross_coupling": 0.01, "cubic": 2e5}


def test_tilts_are_those_of_an_instrument_without_it():
    ideal = rms(estimated(IDEAL, duration=6.0)[2])
    made = replace(IDEAL, responses={"autocollimator": BENT})
    np.testing.assert_allclose(rms(estimated(made, duration=6.0)[2]), ideal, rtol=0.05)
    straight = Response(BENT.zero, BENT.gain, BENT.roll, BENT.latency)
    wrong = rms(estimated(made, replace(IDEAL, responses={"autocollimator": straight}), duration=6.0)[2])
    assert (wrong[2:4] > 1.5 * ideal[2:4]).all()


@pytest.mark.parametrize("roll", [0.0, 0.3, -1.2])
@pytest.mark.parametrize("tilt", [(1.5e-4, 0.0), (-1e-4, 2e-4), (3e-4, 3e-4)])
def test_the_variance_is_that_of_instruments_drawn_as_stated(roll, tilt):
    rng, shown = np.random.default_rng(11), np.array([tilt])
    plain = Response((0.0, 0.0), 1.02, roll)
    off = []
    for difference, coupling, *cubic in rng.normal(size=(4000, 4)) * [0.02, 0.01, 2e5, 2e5]:
        true = replace(plain, gain_difference=difference, cross_coupling=coupling, cubic=tuple(cubic))
        off.append(plain.corrected(true.readings(shown))[0] - tilt)
    names = {f"autocollimator.{name}": std for name, std in STATED.items()}
    stage = replace(IDEAL, responses={"autocollimator": plain}, uncertainty=names)
    x, y = shown.T
    variance = AssemblyVariance.of(stage)
    stated = np.array([*variance.linear(x, y), *variance.linear(y, x)]) + variance.by_distortion(x, y)[0]
    np.testing.assert_allclose(stated, np.var(off, axis=0), rtol=0.1)
    assert (np.array([*variance.tilt_by_reading(x, y), *variance.tilt_by_reading(y, x)]) >= stated).all()
    assert AssemblyVariance.of(replace(stage, uncertainty={})).tilt_by_reading(x, y) == 0.0


def test_each_of_its_numbers_may_be_uncertain_to_the_twin():
    names = {f"autocollimator.{name}": std for name, std in STATED.items()}
    stage = replace(IDEAL, responses={"autocollimator": BENT}, uncertainty=names)
    found = {each.name: each for each in uncertain_parameters(stage)}
    assert list(found) == [
        "autocollimator.gain_difference",
        "autocollimator.cross_coupling",
        "autocollimator.cubic[0]",
        "autocollimator.cubic[1]",
    ]
    shifted = found["autocollimator.cubic[1]"].shifted(stage, 1e4).response("autocollimator")
    assert shifted == replace(BENT, cubic=(-5e5, 6.1e5))
