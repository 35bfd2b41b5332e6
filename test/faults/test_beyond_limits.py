"""What sensors show together is no error motion of the stage where it is more than the stage can do."""

from __future__ import annotations

import numpy as np
import pytest
from described_stages import stage_of
from draws import seeds
from world import Options, Recording, make_recording, random_stage
from world.recording import probe_topic

from faults.documenting import Row, shows
from faults.judging import judge
from faults.recordings import MOST_WRONG

DURATION = 8.0
MOTIONS = ("both_directions", "s_curves", "steady")
RADIUS = 0.05
"""Of the circle on which face probes stand, m."""


def before_a_face(number: int) -> dict:
    """A stage without autocollimator, whose tilt three face probes at 120° show."""
    drawn = (random_stage(each) for each in range(1000 * number, 1000 * number + 1000))
    section = dict(next(each for each in drawn if len(each["encoder"]["heads"]) > 2))
    section.pop("autocollimator", None)
    draw, limit = np.random.default_rng([number, 7]), stage_of(section).limits.tilt
    amplifier = {"noise": 1e-8, "resolution": 5e-9, "range": 40.0 * limit * RADIUS, "uncertainty": 2e-8}
    # exchanged, they make a tilt that stands, and one that turns with the rotor
    zeros = np.array([1.0, -1.0, 0.0]) * limit * RADIUS * draw.uniform(1.0, 4.0)
    form = [{"order": 1, "cos": limit * RADIUS * draw.uniform(1.0, 4.0), "sin": 0.0}]
    section["sensors"] = {
        name: {"kind": "axial_probe", "radius": RADIUS, "azimuth": azimuth, "zero": zero, "form": form, **amplifier}
        for name, azimuth, zero in zip(("one", "two", "three"), (0.0, 2.1, 4.2), zeros.tolist(), strict=True)
    }
    return section


def recorded(number: int) -> Recording:
    options = Options(motion=MOTIONS[number % 3], odd_rates=False, peak_speed=5.0)
    return make_recording(number, duration=DURATION, stage=before_a_face(number), options=options)


def exchanged(sound: Recording) -> Recording:
    """The cables of two probes change places, from the first sample to the last."""
    one, two = (probe_topic(name, sound.stage["sensors"][name]) for name in ("one", "two"))
    moved = {one: (sound.blocks[two], sound.arrivals[two]), two: (sound.blocks[one], sound.arrivals[one])}
    return sound.with_topics(moved)


@pytest.mark.parametrize("fault", [False, True], ids=["sound", "exchanged"])
def test_three_face_probes_show_the_tilt_of_a_stage_where_they_stand_as_described(fault):
    wrong, told, there = {}, {}, {}
    for number in seeds(12):
        sound = recorded(number)
        found = judge(exchanged(sound) if fault else sound, sound.stage)
        wrong[number], there[number] = found.worst, found.available["eac"]
        told[number] = {name for name in found.doubted if name.startswith("axial_probe")}
    assert max(wrong.values()) <= MOST_WRONG, wrong
    if fault:
        assert all(told.values()), told
    else:
        assert not any(told.values()) and min(there.values()) > 0.9, (told, there)


shows(
    Row(
        "sensors",
        "Probes exchanged, of the wrong sign or at other places than described, so that together they show an error "
        "motion that the stage cannot make",
        "`error_estimator: estimate` names them, with what they show and what the stage can do",
        "what they alone show is believed again after a turn within what the stage can do",
        "what heads and other sensors show without them",
        "after a turn without it, or with a reset",
    )
)(test_three_face_probes_show_the_tilt_of_a_stage_where_they_stand_as_described)
