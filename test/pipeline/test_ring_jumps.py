"""Jumps of the ring and the level that was usual: what tells the end of a fault from its begin."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rotary_error_monitor.pipeline.ring_jumps import RingJumps
from rotary_error_monitor.pipeline.ring_scatter import PREVAILS, StampsScatter
from rotary_error_monitor.pipeline.usual_level import UsualLevel

ALLOWED = 1e-7
"""Change of the ring within a window that a bearing makes, m."""


def followed(course: np.ndarray, first: int) -> RingJumps:
    """A course (n, 3) of windows, where the jump at `first` is the first of all."""
    jumps = RingJumps()
    for number, change in enumerate(np.diff(course, axis=0).tolist(), start=1):
        if number == first:
            jumps.begin(tuple(change))
        else:
            jumps.follow(tuple(change), jump=max(map(abs, change[:2])) > ALLOWED)
    return jumps


def fault(seed: int, part: float) -> tuple[np.ndarray, int]:
    """A slow motion with a jump in it, split between two windows, of which a part is taken back later."""
    draw = np.random.default_rng(seed)
    course = np.cumsum(draw.uniform(-0.02, 0.02, (200, 3)) * ALLOWED, axis=0)
    size = draw.choice([-1.0, 1.0], 3) * draw.uniform(5.0, 500.0, 3) * ALLOWED
    begin, end = int(draw.integers(20, 60)), int(draw.integers(100, 180))
    course[begin] += draw.uniform(0.3, 1.0) * size
    course[begin + 1 : end] += size
    course[end] += (1.0 - draw.uniform(0.3, 1.0) * part) * size
    course[end + 1 :] += (1.0 - part) * size
    return course, begin


@pytest.mark.parametrize("seed", range(20))
def test_jumps_that_are_taken_back_are_told_however_far_the_ring_went_meanwhile(seed):
    course, begin = fault(seed, 1.0)
    course[:, :2] += np.linspace(0.0, 20.0, len(course))[:, None] * ALLOWED  # a tenth of a jump a window
    assert followed(course, begin).are_taken_back(0.5, 2.0 * ALLOWED)
    assert not followed(course[:95], begin).are_taken_back(0.5, 2.0 * ALLOWED)


@pytest.mark.parametrize("seed", range(20))
def test_a_part_that_stays_is_not_taken_for_none(seed):
    course, begin = fault(seed, float(np.random.default_rng(seed + 100).uniform(0.1, 0.4)))
    assert not followed(course, begin).are_taken_back(0.5, 2.0 * ALLOWED)


def test_what_the_rotation_did_counts_where_a_command_tells_it():
    for turned, back in ((5.0, False), (math.nan, True), (0.0, True)):
        jumps = RingJumps()
        jumps.begin((10.0 * ALLOWED, 0.0, 0.0))
        jumps.follow((-10.0 * ALLOWED, 0.0, turned * ALLOWED), jump=True)
        assert jumps.are_taken_back(0.5, 2.0 * ALLOWED) is back


def test_behind_other_heads_nothing_is_told():
    jumps = RingJumps()
    jumps.begin((10.0 * ALLOWED, 0.0, 0.0))
    jumps.follow(None, jump=True)
    jumps.follow((-10.0 * ALLOWED, 0.0, 0.0), jump=True)
    assert not jumps.are_taken_back(0.5, 2.0 * ALLOWED)


@pytest.mark.parametrize("seed", range(10))
def test_the_usual_level_is_that_of_most_windows(seed):
    draw, level = np.random.default_rng(seed), UsualLevel()
    usual, other = draw.uniform(-1.0, 1.0, (2, 2))
    for _ in range(int(draw.integers(400, 900))):
        level.add(tuple(usual + draw.uniform(-0.01, 0.01, 2)))
    for _ in range(int(draw.integers(50, 300))):
        level.add(tuple(other))
    assert level.is_at(tuple(usual), (0.011, 0.011))
    near = 0.5 * float(np.abs(usual - other).max())
    assert not level.is_at(tuple(other), (near, near))
    for _ in range(1000):  # ten seconds later it is the other one
        level.add(tuple(other))
    assert level.is_at(tuple(other), (1e-9, 1e-9))


def test_a_few_windows_make_no_usual_level():
    level = UsualLevel()
    for _ in range(9):
        level.add((0.0, 0.0))
    assert not level.is_at((0.0, 0.0), (1.0, 1.0))


@pytest.mark.parametrize("seed", range(10))
def test_what_stamps_make_goes_with_the_square_of_the_speed(seed):
    draw, scatter = np.random.default_rng(seed), StampsScatter()
    share = draw.uniform(0.05, 1.0)
    assert scatter.at(100.0) == 0.0
    for tolerance in draw.uniform(1.0, 300.0, 500):
        scatter.add(share * tolerance**2 * draw.uniform(0.5, 1.5), tolerance)
    for tolerance in (2.0, 30.0, 1000.0):
        assert 1.5 < scatter.at(tolerance) / (share * tolerance**2) < 2.5
    assert scatter.at(0.99 * PREVAILS) == 0.0
