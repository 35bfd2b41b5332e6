"""One of the two axes of an autocollimator repeats its reading, while the other goes on."""

from __future__ import annotations

from functools import cache

import numpy as np
from draws import seeds
from world import random_stage
from world.fault import SECOND, Acting, values_fault
from world.recording import AUTOCOLLIMATOR

from faults.documenting import Row, shows
from faults.ending import SIGMAS, distance_of, heard
from faults.judging import record
from faults.recordings import MOST_WRONG

DURATION, BEGIN = 5.0, 2.5


def _one_axis_stuck(acting: Acting) -> np.ndarray:
    axis = int(acting.rng.integers(2))
    values = acting.values.copy()
    values[:, axis] = acting.previous[axis]
    return values


STUCK = values_fault("one_axis_stuck", "One axis repeats a value.", "autocollimator", _one_axis_stuck)


@cache
def tried(number: int) -> tuple[float, bool]:
    """Part of the ticks that are wrong, and whether the autocollimator was doubted within 2 s."""
    section = random_stage(number)
    sound = record(number, section, DURATION)
    injected = STUCK(sound, np.random.default_rng(number), begin=BEGIN, topic=AUTOCOLLIMATOR)
    found = heard(injected.recording, section)
    off, deviation = distance_of(sound, found.motion)
    wrong = found.motion.observable & ~(off <= SIGMAS * deviation)
    told = found.told(injected.begin_ns, injected.begin_ns + 2 * SECOND)
    return float(wrong.sum(axis=0).max()) / (DURATION * 1e3), "autocollimator" in told


@shows(
    Row(
        "autocollimator",
        "One axis of the autocollimator repeats a value under fresh stamps, while the other goes on",
        "`error_estimator: estimate` names it: stuck, the same reading of x or y for so many ms, once noise would have "
        "made so many equal readings less often than one in 1e9, or what is described would have moved it",
        "the tilt is not used",
        "everything but tilt; of an instrument whose steps hide its noise, until then a tilt that is off by no more "
        "than the stage can tilt",
        "within 1 s of its end, once it was for 0.5 s near what it was before",
    )
)
def test_an_axis_that_is_stuck_is_named_though_the_other_moves():
    """Of drawn stages three quarters said nothing, as long as both readings were not the same as before."""
    found = [tried(number) for number in seeds(24, first=200)]
    assert np.mean([wrong > MOST_WRONG for wrong, _ in found]) <= 0.1
    assert np.mean([told for _, told in found]) > 0.8
