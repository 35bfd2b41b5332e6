"""Drift, stops, LVDT and streams of recordings, against what was put into them."""

from __future__ import annotations

import numpy as np
import pytest
from analysis.in_memory import compare_stays, estimate_stops, fall_outs
from draws import seeds

from rotary_error_monitor.analysis.course import Samples, estimate_drifts
from rotary_error_monitor.analysis.motion import analyse_motion
from rotary_error_monitor.analysis.runs import find_segments
from rotary_error_monitor.analysis.signals import Estimates
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.description.two_axis_section import RadialReference
from rotary_error_monitor.metrology.error_motion import ErrorMotion

START_NS = 1_763_700_000_000_000_000


def times(seconds, rate=1000.0):
    return START_NS + np.rint(np.arange(int(seconds * rate)) * 1e9 / rate).astype(np.int64)


def estimates_of(stamps, theta, motion, noise=2e-8):
    spread = np.full((6, 6), np.nan)
    spread[:2, :2] = noise**2 * np.eye(2)
    components = np.full((len(stamps), 6), np.nan)
    components[:, :2] = motion
    count = len(stamps)
    covariance, unresolved = np.tile(spread, (count, 1, 1)), np.zeros((count, 2))
    return Estimates(stamps, theta, components, covariance, unresolved, np.ones(count), np.ones(count, np.bool_))


@pytest.mark.long
def test_drift_with_temperature_is_inside_its_uncertainty():
    inside, count = 0, 0
    for seed in range(30):
        rng = np.random.default_rng(seed)
        stamps = times(40)
        seconds = (stamps - START_NS) * 1e-9
        theta = 3.0 * seconds
        warmth = 20 + 2.0 * (1 - np.exp(-seconds / rng.uniform(10, 30)))
        slopes = rng.normal(0, 4e-7, 2)
        drift = (warmth - 20)[:, None] * slopes
        noise = 2e-8 * rng.normal(size=drift.shape) + 3e-8 * rng.normal(size=(40, 2))[(seconds.astype(int))]
        waves = 2e-6 * np.stack([np.cos(2 * theta), np.sin(3 * theta)], 1)
        segments = analyse_motion(estimates_of(stamps, theta, drift + noise + waves), load_stage(), (0.0,))
        found = {each.signal: each for each in estimate_drifts(segments, {"hall": Samples(stamps, warmth)})}
        for axis, slope in zip("xy", slopes, strict=True):
            row = found[f"radial_{axis}_at_0mm"]
            inside += abs(row.slopes["hall"].value - slope) <= row.slopes["hall"].expanded
            count += 1
            middle = np.interp(row.times_ns - START_NS, stamps - START_NS, drift[:, "xy".index(axis)])
            assert row.range.value == pytest.approx(np.ptp(middle), abs=1.2e-7)
    assert inside >= 0.93 * count


def run_both_ways(rng, noise, stated):
    """How fast the axis wanders (2,), m/s, and estimates of forth and back, where stamps of heads are apart."""
    stamps = times(26)
    along = (stamps - START_NS) * 1e-9
    speed = np.where(along < 13, 3.0, -3.0)
    wander = rng.uniform(0, 1e-7, 2) * (rng.random(2) < 0.5)
    motion = along[:, None] * wander + speed[:, None] * 1.4e-7 * rng.normal(size=2)  # heads at 100 mm, 2 µs apart
    motion += noise * rng.normal(size=motion.shape)
    return wander, estimates_of(stamps, np.cumsum(speed) * 1e-3, motion, stated)


@pytest.mark.parametrize("stated", [4e-8, 6e-7], ids=["covariance too small", "covariance too large"])
def test_a_drift_is_inside_its_uncertainty_where_there_is_none_too(stated):
    stage, inside = load_stage(), []
    for seed in seeds(15):
        wander, estimates = run_both_ways(np.random.default_rng(seed), 2e-7, stated)
        for found, rate in zip(estimate_drifts(analyse_motion(estimates, stage, (0.0,)), {}), wander, strict=True):
            true = rate * np.ptp(found.times_ns[: len(found.times_ns) // 2]) * 1e-9
            inside.append(abs(found.range.value - true) <= found.range.expanded)
    assert np.mean(inside) >= 0.93


def test_a_stage_that_hardly_warmed_has_no_slope():
    stamps = times(10)
    theta = 3.0 * (stamps - START_NS) * 1e-9
    segments = analyse_motion(estimates_of(stamps, theta, np.zeros((len(stamps), 2))), load_stage(), (0.0,))
    drifts = estimate_drifts(segments, {"hall": Samples(stamps, np.full(len(stamps), 21.0))})
    assert drifts and all(not drift.slopes for drift in drifts)


def positions(targets, rng, repeats=5, backlash=0.0, spread=0.0):
    """Rotation, and its distance from the command, of a stage that goes to targets forth and back."""
    parts, off = [np.array([-0.3])], [np.zeros(1)]
    path = [(t, 1) for t in targets] + [(t, -1) for t in targets[::-1]]
    for _ in range(repeats):
        for target, way in [(-0.3, -1), *path[: len(targets)], (targets[-1] + 0.3, 1), *path[len(targets) :]]:
            begin = parts[-1][-1]
            parts += [np.linspace(begin, target, 300), np.full(600, target)]
            error = way * backlash / 2 + spread * rng.normal()
            off += [np.zeros(300), np.full(600, error)]
    theta, deviation = np.concatenate(parts), np.concatenate(off)
    return theta + deviation, deviation


def test_stops_give_the_figures_of_iso_230_2():
    rng = np.random.default_rng(0)
    targets = np.sort(rng.uniform(0.2, 5.0, 8))
    theta, ecc = positions(targets, rng, backlash=2e-5, spread=2e-6)
    found = estimate_stops(times(len(theta) / 1000), theta, ecc)
    assert found.figures is not None and found.figures.bidirectional is not None
    assert len(found.figures.targets) == 8
    assert found.figures.targets == pytest.approx(targets, abs=1e-3)
    assert found.figures.bidirectional.mean_reversal_error == pytest.approx(2e-5, rel=0.2)
    assert found.figures.forward.repeatability == pytest.approx(4 * 2e-6 * 1.4, rel=0.6)


def test_too_few_stops_are_told():
    rng = np.random.default_rng(1)
    theta, ecc = positions([1.0], rng, repeats=1)
    found = estimate_stops(times(len(theta) / 1000), theta, ecc)
    assert found.figures is None
    assert "ISO 230-2 takes at least two targets" in found.remarks[0]


@pytest.mark.parametrize("seed", range(5))
def test_the_heights_of_a_moved_lvdt_are_found(seed):
    rng = np.random.default_rng(seed)
    stamps = times(36)
    theta = 3.0 * (stamps - START_NS) * 1e-9
    tilt = 2e-5 * np.stack([np.cos(theta), np.sin(2 * theta)], 1)
    radial = 2e-6 * np.stack([np.cos(3 * theta), np.sin(2 * theta)], 1)
    heights = rng.choice([0.005, 0.016, 0.06, 0.1], 3, replace=False)
    at = np.repeat(heights, 12_000)
    lvdt = RadialReference(0.016, 5e-8, (2e-6, -1e-6))
    cos, sin = np.cos(theta), np.sin(theta)
    artefact = np.stack([2e-6 * cos + 1e-6 * sin, 2e-6 * sin - 1e-6 * cos], 1)
    seen = (
        radial + at[:, None] * np.stack([tilt[:, 1], -tilt[:, 0]], 1) + artefact + 5e-8 * rng.normal(size=(36_000, 2))
    )
    components = np.zeros((36_000, 6))
    components[:, :2], components[:, 3:5] = radial, tilt
    observable = np.ones((36_000, 6), np.bool_)
    motion = ErrorMotion.of(theta, components, observable, np.zeros((36_000, 6, 6)))
    stays = compare_stays(stamps, motion, lvdt, stamps, seen)
    assert [stay.height for stay in stays] == pytest.approx(heights, abs=5e-4)
    for stay in stays:
        assert stay.comparison.rms < 6e-8


@pytest.mark.parametrize("seed", range(5))
def test_an_lvdt_that_stays_is_one_stay_at_its_described_height(seed):
    """Estimates that are off by a tenth of a micrometre, slowly, as those of real sensors are."""
    rng = np.random.default_rng(seed)
    stamps = times(36)
    theta = 1.5 * (stamps - START_NS) * 1e-9
    tilt = 2e-5 * np.stack([np.cos(theta), np.sin(2 * theta)], 1)
    off = 1e-7 * np.stack([np.interp(np.arange(36_000), np.arange(0, 36_001, 300), rng.normal(size=121))] * 2, 1)
    seen = 0.016 * np.stack([tilt[:, 1], -tilt[:, 0]], 1) + off + 5e-8 * rng.normal(size=(36_000, 2))
    components = np.zeros((36_000, 6))
    components[:, 3:5] = tilt
    motion = ErrorMotion.of(theta, components, np.ones((36_000, 6), np.bool_), np.zeros((36_000, 6, 6)))
    (stay,) = compare_stays(stamps, motion, RadialReference(0.016, 5e-8), stamps, seen)
    assert stay.height == 0.016


def test_segments_are_those_that_were_commanded():
    stamps = times(40)
    speed = np.select([np.arange(40_000) < n for n in (9_000, 11_000, 20_000, 31_000)], [2.0, 0.0, -2.0, 5.0], 2.005)
    theta = np.cumsum(speed) * 1e-3
    found = find_segments(stamps, theta)
    assert [round(segment.speed, 1) for segment in found] == [2.0, -2.0, 5.0]
    assert len(found[0].runs) == 2  # the same speed again
    assert all(segment.steady for segment in found)
    swinging = find_segments(stamps, 40 * np.sin(np.arange(40_000) * 2e-4))
    assert [segment.steady for segment in swinging] == [False, False]
    assert find_segments(stamps, np.zeros(40_000)) == ()


def test_an_instrument_that_falls_out_is_told_with_its_time():
    stamps = times(10)
    used = np.full(len(stamps), 0b11)
    used[3_000:5_000] = 0b10
    used[7_000] = 0b10  # a single estimate is none
    (found,) = fall_outs(stamps, used, {"head_a": 1, "head_b": 2, "never": 4}, 1_000_000)
    assert (found.what, found.begin, found.duration) == ("head_a", pytest.approx(3.0), pytest.approx(2.0))
