"""Tests for structure: silent on noise, and telling what was put in."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rotary_error_monitor.gap.orders import order_spectrum
from rotary_error_monitor.gap.posterior import PRIOR_OF_UNKNOWN
from rotary_error_monitor.gap.problem import StructureTest
from rotary_error_monitor.gap.structure import Track, find_shared, find_structure
from rotary_error_monitor.gap.verdict import Verdict, probability_of_unknown
from rotary_error_monitor.kinds.stage.search import find_step, find_wave

COUNT, PERIOD = 6000, 0.004


@pytest.fixture
def track():
    time = PERIOD * np.arange(COUNT)
    labels = (np.arange(COUNT) >= COUNT // 2).astype(np.intp)
    speed = np.where(labels == 0, 1.6, -5.0)
    rows = np.random.default_rng(8).normal(size=COUNT)
    return Track("head_a", rows, time, np.cumsum(speed) * PERIOD, labels, ("+1.6 rad/s", "-5 rad/s"))


def with_rows(track, added):
    return Track(track.channel, track.rows + added, track.time, track.angle, track.labels, track.names)


def found(track, kind):
    return next(finding for finding in find_structure(track) if finding.kind == kind)


ARCS = pytest.mark.parametrize("arc", [1.0, 0.05, 0.001], ids=["turns", "an arc of 70 degrees", "an arc of a degree"])


@ARCS
def test_noise_alone_keeps_the_rate(track, arc):
    rng = np.random.default_rng(9)
    chances = []
    for _ in range(80):
        quiet = replace(track, rows=rng.normal(size=COUNT), angle=arc * track.angle)
        chances += [min(f.log_p_value for f in find_structure(quiet)) + np.log(5)]
    # At a level of 5 % four of eighty are expected; eleven would come once in 500 runs of this test.
    assert np.count_nonzero(np.array(chances) < np.log(0.05)) <= 10


@pytest.mark.parametrize(
    ("kind", "added", "words"),
    [
        ("orders", lambda t: 0.3 * np.cos(5 * t.angle) * (t.labels == 1), "order 5 at -5 rad/s"),
        ("line", lambda t: 0.3 * np.cos(40 * t.angle), "order 40"),
        ("frequency", lambda t: 0.3 * np.cos(2 * np.pi * 12.5 * t.time), "12.50 Hz"),
        ("place", lambda t: 6.0 * (np.abs(np.mod(t.angle, 2 * np.pi) - 1.0) < 0.02), "place 57°"),
        ("time", lambda t: 1.0 * ((t.time > 10.0) & (t.time < 10.5)), "at 10."),
    ],
)
def test_structure_is_found_and_described(track, kind, added, words):
    finding = found(with_rows(track, added(track)), kind)
    assert finding.log_p_value < -12
    assert words in finding.pattern


@pytest.fixture
def heads(track):
    """Function that gives four heads, each against the mean of all, scaled to variance one."""

    def make(rng, added=0.0):
        rows = rng.normal(size=(4, COUNT)) + added
        rows = (rows - rows.mean(axis=0)) / np.sqrt(0.75)
        return {f"head_{letter}": row for letter, row in zip("abcd", rows, strict=True)}

    return make


def shared(track, rows):
    return find_shared([replace(track, channel=name, rows=row) for name, row in rows.items()], len(rows) - 1)


@pytest.mark.few(1)
@ARCS
def test_noise_of_heads_against_their_mean_keeps_the_rate(track, heads, arc):
    rng = np.random.default_rng(10)
    track = replace(track, angle=arc * track.angle)
    chances = np.array([[f.log_p_value for f in shared(track, heads(rng))] for _ in range(400)])
    # At a level of 5 % twenty of 400 are expected, with a standard deviation of 4.4.
    line, orders = (int(np.count_nonzero(column < np.log(0.05))) for column in chances.T)
    assert line < 35 and orders < 35
    # On a short arc orders are alike: they are fewer trials than they are counted for, and none is noise for another.
    assert line > 6 or arc < 1.0
    assert orders > 6 or arc < 0.05


def test_an_order_that_is_weak_in_each_head_stands_out_of_all(track, heads):
    wave = 0.05 * np.array([1.0, -1.0, 1.0, -1.0])[:, None] * np.cos(3 * track.angle)
    rows = heads(np.random.default_rng(12), wave)
    alone = [found(replace(track, rows=row), "line").log_p_value for row in rows.values()]
    line, orders = shared(track, rows)
    assert line.log_p_value < min(alone) - 8
    assert line.channel in rows and line.pattern == orders.pattern == "angle: order 3 in 4 channels"


def test_order_spectrum_is_chi_square_and_tells_amplitude(track):
    power = order_spectrum(track.angle, track.rows, 50)
    assert power.mean() == pytest.approx(2.0, abs=0.8)
    arc = track.angle - 1000 * np.round(track.angle / 1000) + 0.3
    rng = np.random.default_rng(11)
    several = [order_spectrum(0.01 * arc, rng.normal(size=COUNT), 50)[[0, 9, 49]] for _ in range(400)]
    np.testing.assert_allclose(np.mean(several, axis=0), 2.0, atol=4 * 2 / np.sqrt(400))
    moved = order_spectrum(track.angle, track.rows + 0.5 * np.sin(7 * track.angle), 50)
    assert np.argmax(moved) == 6
    assert moved[6] == pytest.approx(0.5**2 * COUNT / 2, rel=0.2)


def test_a_step_is_found_to_the_sample(track):
    rows = track.rows + 1.5 * (track.time >= 13.0)
    assert find_step(track.time, rows)[0] == pytest.approx(13.0, abs=0.05)


def test_a_wave_of_no_whole_order_is_found(track):
    angle = {"x": track.angle, "y": track.angle}
    rows = {"x": track.rows + np.cos(3.37 * track.angle), "y": track.rows[::-1] + np.sin(3.37 * track.angle)}
    order, trials = find_wave(angle, rows)
    assert order == pytest.approx(3.37, abs=0.005)
    assert trials > 10


def test_a_wave_needs_turns():
    angle = {"x": np.linspace(0.0, 0.5, 300)}
    assert find_wave(angle, {"x": np.random.default_rng(1).normal(size=300)}, highest=1.0)[1] >= 1


def test_the_chance_of_something_unknown_grows_with_the_finding():
    def finding(log_p_value):
        return StructureTest("x", "line", log_p_value, 1.0, "order 3")

    assert probability_of_unknown([]) == PRIOR_OF_UNKNOWN
    assert probability_of_unknown([finding(-0.5)]) == PRIOR_OF_UNKNOWN
    # Sellke, Bayarri and Berger (2001), Table 1: p = 0.01 is odds of at most 1 : 0.125 against noise.
    odds = probability_of_unknown([finding(np.log(0.01))]) / (1 - probability_of_unknown([finding(np.log(0.01))]))
    assert odds == pytest.approx(PRIOR_OF_UNKNOWN / (1 - PRIOR_OF_UNKNOWN) / 0.1252, rel=1e-3)
    assert probability_of_unknown([finding(-2000.0)]) == pytest.approx(1.0)


def test_exit_codes():
    assert {verdict.value: verdict.exit_code for verdict in Verdict} == {
        "no_gap": 0,
        "explained": 10,
        "partly_explained": 11,
        "unknown": 12,
    }
