"""An autocollimator that goes wrong beside listed sensors that see tilt as well: it is named, not one of these."""

from __future__ import annotations

import numpy as np
import pytest
from described_stages import stage_of
from draws import seeds
from world import FAULTS, Options, Recording, make_recording, random_stage

from faults.documenting import Row, shows
from faults.judging import estimated, judge
from faults.recordings import MOST_WRONG
from rotary_error_monitor.metrology.error_motion import ErrorMotion
from rotary_error_monitor.pipeline.estimation import Estimator

DURATION, BEGIN = 8.0, 4.0
MOTIONS = ("both_directions", "s_curves", "steady")
LISTED = ("axial_probe_", "radial_probe_", "tilt_sensor_")


def recorded(number: int) -> Recording:
    """A stage with an autocollimator, and with three radial probes at each of two heights, which see tilt as well."""
    drawn = (random_stage(each) for each in range(1000 * number, 1000 * number + 1000))
    section = dict(next(each for each in drawn if len(each["encoder"]["heads"]) > 2))
    draw = np.random.default_rng([number, 11])
    section["sensors"] = {
        f"{level}{place}": {
            "kind": "radial_probe",
            "azimuth": float(start + 2.0 * np.pi * place / 3.0),
            "height": height,
            "noise": 1e-8,
            "resolution": 5e-9,
            "range": 1e-4,
            "uncertainty": 2e-8,
            "zero": float(draw.uniform(-5e-6, 5e-6)),
            "gain": float(draw.choice([-1.0, 1.0])),
            "form": [{"order": order, "cos": 1e-6 / order**2, "sin": 5e-7 / order**2} for order in (1, 2, 3)],
        }
        for level, height, start in (("low", 0.05, draw.uniform(-1, 1)), ("high", 0.15, draw.uniform(-1, 1)))
        for place in range(3)
    }
    options = Options(motion=MOTIONS[number % 3], odd_rates=False, peak_speed=5.0)
    return make_recording(number, duration=DURATION, stage=section, options=options)


@shows(
    Row(
        "autocollimator",
        "It drifts, steps or sticks beside listed sensors that see tilt as well",
        "`error_estimator: estimate` names it where these agree with one another, and what is not predicted of each "
        "goes as a tilt makes it; with one sensor alone, that either may be wrong",
        "it is left out, and what was doubted of late for it was held against it is believed again",
        "the tilt that the listed sensors show, with their uncertainty",
        "after 0.5 s in which it agrees with them",
    )
)
@pytest.mark.parametrize("fault", ["autocollimator_drifts", "autocollimator_stepped", "autocollimator_stuck"])
def test_it_is_named_and_no_sensor_that_is_right(fault):
    """Two to four healthy sensors were left out in its place, and the tilt with them."""
    blamed, told, wrong, there = {}, {}, {}, {}
    for number in seeds(12):
        sound, draw = recorded(number), np.random.default_rng([number, 5])
        found = judge(FAULTS[fault](sound, draw, begin=BEGIN).recording, sound.stage)
        blamed[number] = [name for name in found.doubted if name.startswith(LISTED)]
        told[number], wrong[number] = "autocollimator" in found.doubted, found.worst
        there[number] = found.available["eac"]
    assert sum(map(bool, blamed.values())) <= 0.1 * len(blamed), blamed
    assert sum(part > MOST_WRONG for part in wrong.values()) <= 0.1 * len(wrong), wrong
    assert np.median(list(there.values())) > 0.9, there


@pytest.mark.parametrize("fault", ["autocollimator_drifts", "autocollimator_stepped"])
def test_what_is_left_out_does_not_depend_on_how_much_is_estimated_together(fault, monkeypatch):
    sound, draw = recorded(2), np.random.default_rng([2, 5])
    faulty, said = FAULTS[fault](sound, draw, begin=BEGIN).recording, []
    for together_ns in (80_000_000, 1_000_000_000):
        monkeypatch.setattr("faults.judging.TURN_OF_THE_NODE", together_ns)
        parts = estimated(faulty, Estimator(stage_of(sound.stage)), lambda _: None)
        said.append(ErrorMotion.joined(parts))
    few, many = said
    np.testing.assert_array_equal(few.streams, many.streams)
    np.testing.assert_array_equal(few.doubts, many.doubts)
    assert len(np.unique(few.streams)) > 1
    np.testing.assert_allclose(few.components, many.components, rtol=1e-5, atol=1e-11)
