"""What a recording says does not depend on how much of it is looked at at once."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from analysis.in_memory import compare_stays, estimate_stops, fall_outs

from rotary_error_monitor.analysis.health import FallOuts
from rotary_error_monitor.analysis.runs import find_segments
from rotary_error_monitor.description.two_axis_section import RadialReference
from rotary_error_monitor.metrology.error_motion import ErrorMotion
from rotary_error_monitor.signals import rows

START_NS = 1_763_700_000_000_000_000
PARTS = (37, 1_000)


def drawn_rotation(seed):
    """Timestamps with gaps, and a rotation that goes, stops, trembles and turns back."""
    rng = np.random.default_rng(seed)
    steps = np.where(rng.random(30_000) < 3e-4, rng.integers(1_000, 2_000_000), 1_000) * 1_000
    times = START_NS + np.cumsum(steps)
    speeds = np.repeat(rng.choice([-3.0, -2.97, 0.0, 0.0, 1.5, 4.0, 4.05], 12), 2_500)
    slow = np.convolve(speeds, np.ones(200) / 200, "same") + rng.choice([0.0, 0.04]) * rng.normal(size=len(times))
    return times, np.cumsum(slow * steps * 1e-9), rng


@pytest.mark.few(4)
@pytest.mark.parametrize("seed", range(8))
def test_segments_and_stops(seed, monkeypatch):
    times, theta, rng = drawn_rotation(seed)
    ecc = np.where(rng.random(len(times)) < 0.1, np.nan, 1e-5 * rng.normal(size=len(times)))
    whole, stops = find_segments(times, theta), estimate_stops(times, theta, ecc)
    assert whole
    for part in PARTS:
        monkeypatch.setattr(rows, "PART", part)
        assert find_segments(times, theta) == whole
        found = estimate_stops(times, theta, ecc)
        assert (found.stops, found.remarks) == (stops.stops, stops.remarks)
        monkeypatch.undo()


@pytest.mark.parametrize("seed", range(8))
def test_times_without_an_instrument(seed):
    rng = np.random.default_rng(seed)
    times = START_NS + np.arange(20_000) * 1_000_000
    used = np.full(len(times), 0b111)
    for bit in (1, 2, 4):
        for _ in range(int(rng.integers(1, 15))):
            begin = int(rng.integers(0, len(times)))
            used[begin : begin + int(rng.integers(1, 1_500))] &= ~bit
    bits = {"head_a": 1, "head_b": 2, "command": 4, "never": 8}
    whole = fall_outs(times, used, bits, 1_000_000)
    assert whole and all(each.what != "never" for each in whole)
    parts = FallOuts(bits, 1_000_000)
    edges = [0, *sorted(rng.integers(1, len(times), 60).tolist()), len(times)]
    for first, last in itertools.pairwise(edges):
        if last > first:
            parts.add(times[first:last], used[first:last])
    assert parts.found == whole


@pytest.mark.parametrize("seed", range(3))
def test_heights_of_an_lvdt(seed, monkeypatch):
    rng = np.random.default_rng(seed)
    times = START_NS + np.arange(15_000) * 1_000_000
    theta = 3.0 * (times - START_NS) * 1e-9
    tilt = 2e-5 * np.stack([np.cos(theta), np.sin(2 * theta)], 1)
    at = np.repeat(rng.choice([0.005, 0.016, 0.06, 0.1], 3, replace=False), 5_000)
    seen = at[:, None] * np.stack([tilt[:, 1], -tilt[:, 0]], 1) + 5e-8 * rng.normal(size=(len(times), 2))
    components = np.zeros((len(times), 6))
    components[:, 3:5] = tilt
    covariance = np.tile(1e-16 * np.eye(6), (len(times), 1, 1))
    motion = ErrorMotion.of(theta, components, np.ones((len(times), 6), np.bool_), covariance)
    there = rng.random(len(times)) > 0.01
    given = (times, motion, RadialReference(0.016, 5e-8), times[there] + 137, seen[there])
    whole = compare_stays(*given)
    assert len(whole) == 3
    monkeypatch.setattr(rows, "PART", 701)
    for one, other in zip(compare_stays(*given), whole, strict=True):
        assert (one.height, one.begin_ns, one.end_ns) == (other.height, other.begin_ns, other.end_ns)
        for name in ("rms", "maximum", "inside"):
            assert getattr(one.comparison, name) == pytest.approx(getattr(other.comparison, name), rel=1e-12)
