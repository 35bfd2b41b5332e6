"""Differences that are as large as stated agree, larger ones do not; by draws that nothing of the package made."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.analysis.comparison import stands_at, stands_of_reference
from rotary_error_monitor.analysis.reference_judgement import Variances, judge
from rotary_error_monitor.description.two_axis_section import RadialReference
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.error_motion import ErrorMotion

TURNS, ANGLES = 6, 200
START_NS = 1_763_700_000_000_000_000
DRAWS = 400


def said(seed, systematic=0.0, factor=1.0, lasting=0.0, wander=0.0):
    """Verdict on white noise of 50 nm, a wave of order 2, one number of all times, and stamps that wander by turns."""
    rng = np.random.default_rng(seed)
    size = 5e-8
    angle = 2 * np.pi * np.arange(ANGLES) / ANGLES
    profiles = factor * size * rng.normal(size=(TURNS, ANGLES)) + systematic * np.cos(2 * angle)
    profiles += lasting * rng.normal() + wander * rng.normal(size=(TURNS, 1)) * np.cos(3 * angle + rng.uniform(0, 7))
    count = profiles.size
    stated = [np.full(count, value**2) for value in (size, wander, 0.0, lasting)]
    return judge(profiles.ravel(), Variances(*stated), np.repeat(np.arange(TURNS), ANGLES), profiles)


@pytest.mark.parametrize("habit", [{}, {"lasting": 1e-7}, {"wander": 3e-7}, {"lasting": 1e-7, "wander": 1e-7}], ids=str)
def test_what_is_as_stated_is_hardly_ever_said_to_disagree(habit):
    """One in a hundred is allowed; of 400 draws 11 or more come by chance in less than one of a hundred tests."""
    assert sum(not said(seed, **habit).agrees for seed in range(DRAWS)) <= 10


@pytest.mark.parametrize(
    "wrong", [{"systematic": 2e-7}, {"factor": 2.0}, {"systematic": 2e-7, "wander": 5e-8}], ids=str
)
def test_what_is_larger_is_said_to_disagree(wrong):
    assert sum(said(seed, **wrong).agrees for seed in range(50)) <= 1


def leaning(seconds, heights, described, eccentricity=(3e-6, -2e-6), seed=0):
    """Where the LVDT stood by what it shows of a rotor that leans, one height after the other."""
    rng = np.random.default_rng(seed)
    count = 1000 * seconds * len(heights)
    stamps = START_NS + 1_000_000 * np.arange(count)
    theta = 3e-3 * np.arange(count)
    tilt = 2e-5 * np.stack([np.cos(theta) + np.sin(2 * theta), np.sin(2 * theta)], 1)
    at = np.repeat(heights, 1000 * seconds)[:, None]
    (x, y), cos, sin = eccentricity, np.cos(theta), np.sin(theta)
    seen = at * np.stack([tilt[:, 1], -tilt[:, 0]], 1) + np.stack([x * cos - y * sin, x * sin + y * cos], 1)
    components = np.zeros((count, 6))
    components[:, 3:5] = tilt
    motion = ErrorMotion.of(theta, components, np.ones((count, 6), np.bool_), np.zeros((count, 6, 6)))
    lvdt = RadialReference(described, 5e-8)  # nobody knows the eccentricity
    return stands_of_reference(stamps, motion, lvdt, stamps, seen + 5e-8 * rng.normal(size=(count, 2)))


@pytest.mark.parametrize("seed", range(3))
def test_an_lvdt_that_is_moved_stands_at_each_height(seed):
    heights = (0.005, 0.016, 0.06)
    stands = leaning(12, heights, 0.016, seed=seed)
    assert [stand.height for stand in stands] == pytest.approx(heights, abs=5e-4)
    assert [stand.stated == "as described" for stand in stands] == [False, True, False]
    ((_, at),) = stands_at({"lvdt": stands}, 0.0601)
    assert at.height == 0.0601 and (at.begin_ns, at.end_ns) == (stands[2].begin_ns, stands[2].end_ns)


@pytest.mark.parametrize("off", [0.0, 0.01, -0.03])
def test_an_lvdt_that_stays_stands_where_it_is_described_whatever_the_tilt_shows(off):
    (stand,) = leaning(12, (0.05,), 0.05 + off)
    assert (stand.height, stand.stated) == (0.05 + off, "as described")
    ((_, at),) = stands_at({"lvdt": (stand,)}, 0.05)  # who knows where it stood may say so
    assert at.height == 0.05


def test_a_height_that_nobody_recorded_is_told_with_those_that_were():
    stands = {"lvdt": leaning(4, (0.016,), 0.016), "none": ()}
    for height, told in ((0.06, "at 16 mm above the ring$"), (1.6e-5, r"16 \(mm\) may be meant"), (0.0, "at 16 mm")):
        with pytest.raises(InputError, match=told):
            stands_at(stands, height)
