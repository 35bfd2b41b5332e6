"""A stage whose calibration states its uncertainty is certain where it is right, and not where it is wrong.

The ring may have been mounted anew since, or another mistake was made: nothing in a turn tells that from the rotor's
own motion, so it must be within what is stated.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from functools import cache
from typing import Any

import numpy as np
import pytest
from described_stages import stage_of
from draws import seeds
from world import Options, Recording, make_recording, random_stage

from faults.judging import Judgement, judge
from faults.recordings import MOST_WRONG

UNCERTAINTY = {"encoder.eccentricity": 1e-8, "mirror.tilt": 1e-7}
SEEDS = seeds(6)
DURATION = 8.0

Stage = dict[str, Any]


@cache
def stage(seed: int) -> Stage:
    """A random stage whose ring has three heads or more, and which has a mirror."""
    drawn = (random_stage(number) for number in range(1000 * seed, 1000 * seed + 1000))
    return next(each for each in drawn if len(each["encoder"]["heads"]) > 2 and "mirror" in each)


@cache
def recorded(seed: int) -> Recording:
    """It turns fast enough to make some turns."""
    motion = ("both_directions", "s_curves", "steady")[seed % 3]
    options = Options(motion=motion, odd_rates=False, peak_speed=4.0)
    return make_recording(seed, duration=DURATION, stage=stage(seed), options=options)


def described(seed: int, change: Callable[[Stage, int], None] | None = None) -> Judgement:
    """What is made of the recording with a calibrated description, wrong by a change."""
    section = deepcopy(stage(seed)) | {"uncertainty": UNCERTAINTY}
    if change is not None:
        change(section, seed)
    return judge(recorded(seed), section)


def mounted_anew(section: Stage, seed: int) -> None:
    """Ring and mirror sit elsewhere, by some tenths of what the stage can move."""
    generator, limits = np.random.default_rng(seed), stage_of(section).limits
    for part, key, size in (("encoder", "eccentricity", limits.radial), ("mirror", "tilt", limits.tilt)):
        size, angle = generator.uniform(0.1, 0.45) * size, generator.uniform(0.0, 2.0 * np.pi)
        x, y = section[part][key]
        section[part][key] = [float(x + size * np.cos(angle)), float(y + size * np.sin(angle))]


def radius_a_fifth_small(section: Stage, seed: int) -> None:
    section["encoder"]["disc_radius"] *= 0.8


def azimuths_turned(section: Stage, seed: int) -> None:
    for head in section["encoder"]["heads"].values():
        head["azimuth"] = float(np.fmod(head["azimuth"] + 0.2, 2.0 * np.pi))


def mirror_turned(section: Stage, seed: int) -> None:
    x, y = section["mirror"]["tilt"]
    section["mirror"]["tilt"] = [float(value) for value in (0.88 * x - 0.48 * y, 0.48 * x + 0.88 * y)]


MISTAKES = (mounted_anew, radius_a_fifth_small, azimuths_turned, mirror_turned)


@pytest.mark.parametrize("mistake", MISTAKES, ids=lambda change: change.__name__)
def test_a_calibration_that_does_not_hold_is_not_certain(mistake):
    found = {seed: described(seed, mistake) for seed in SEEDS}
    wrong = {seed: (dict(each.wrong), each.doubted) for seed, each in found.items() if each.worst > MOST_WRONG}
    assert not wrong
    assert sum(each.available["exc"] > 0.1 for each in found.values()) >= len(SEEDS) / 2


def test_a_calibration_that_holds_stays_as_certain():
    """Of what is beside the description in a turn, pushes and noise among it, next to nothing counts."""
    judged = 0
    for seed in SEEDS:
        found, truth = described(seed), stage_of(stage(seed))
        belief, reading = found.estimator.belief, truth.encoder.noise + truth.encoder.resolution
        assert found.worst <= MOST_WRONG
        assert not found.doubted
        for figure, noise, motion in (
            (belief.ring.figure, reading * truth.encoder.disc_radius, truth.spindle.radial),
            (belief.tilt.figure, truth.autocollimator.noise + truth.autocollimator.resolution, truth.spindle.tilt),
        ):
            if figure.covered == 1.0:
                judged += 1
                size = np.sqrt(0.5 * sum(np.square([*row.x, *row.y]).sum() for row in motion))
                assert figure.unresolved < 0.5 * noise + 0.03 * size
    assert judged > len(SEEDS)
