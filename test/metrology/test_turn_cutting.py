"""Turns that are cut part after part: those of the whole run to the last bit, and the waves that were put in."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.metrology.turns import RunSurvey, TurnCutter, cut_turns


def drawn(seed):
    """Rotation with jitter, signals with missing samples, runs, and the waves that the signals are made of."""
    rng = np.random.default_rng(seed)
    runs, parts = [], []
    for sense in rng.permutation([1, -1, 1]):
        count = int(rng.integers(900, 4_000))
        speed = rng.uniform(0.01, 0.03)
        parts.append(sense * speed * np.arange(count) + rng.uniform(-9, 9) + 2e-3 * speed * rng.normal(size=count))
        begin = runs[-1][1] if runs else 0
        runs.append((begin, begin + count))
    theta = np.concatenate(parts)
    orders, phases = rng.integers(2, 8, 2), rng.uniform(0, 6, 2)
    values = np.cos(orders * theta[:, None] + phases)
    missing = rng.random(len(theta)) < 2e-3
    values[missing, 0] = np.nan
    gap = int(rng.integers(100, 800))
    values[gap : gap + 60] = np.nan

    def filtered(angles, cut_off):
        """By the Gaussian that lets half of the amplitude through at the cut-off (ISO 16610-21)."""
        return 0.5 ** ((orders / cut_off) ** 2) * np.cos(orders * angles[:, None] + phases)

    return theta, values, runs, filtered


def cut_in_parts(theta, values, runs, rng, summed):
    """Turns, cut of parts of drawn lengths, and the sums over their samples."""
    seen = RunSurvey()
    for first, last in runs:
        seen.begin()
        for a, b in drawn_parts(first, last, rng):
            seen.add(theta[a:b], values[a:b])
    cutter = TurnCutter(seen, seen.grid(40), 2, summed.shape[1])
    for first, last in runs:
        cutter.begin()
        for a, b in drawn_parts(first, last, rng):
            cutter.add(theta[a:b], values[a:b], np.arange(a, b), summed[a:b])
    return cutter.finish(), cutter.sums


def drawn_parts(first, last, rng):
    while first < last:
        end = min(last, first + int(rng.choice([1, 2, 30, 400])))
        yield first, end
        first = end


@pytest.mark.parametrize("seed", range(12))
def test_parts_make_the_turns_of_the_whole(seed):
    theta, values, runs, true = drawn(seed)
    rng = np.random.default_rng(seed)
    summed = rng.normal(size=(len(theta), 2))
    whole = cut_turns(theta, values, runs, 40)
    parts, sums = cut_in_parts(theta, values, runs, rng, summed)
    assert whole.count > 4 and whole.incomplete > 0
    assert parts.profiles.tobytes() == whole.profiles.tobytes()
    for name in ("cut_off", "samples", "incomplete", "whole"):
        assert getattr(parts, name) == getattr(whole, name)
    assert np.array_equal(parts.labels, whole.labels) and np.array_equal(parts.edges, whole.edges)
    inside = np.zeros(len(theta), np.bool_)
    for first, last in whole.labels:
        inside[first : last + 1] = True
    inside &= np.isfinite(values).all(axis=1)
    assert sums == pytest.approx(summed[inside].sum(axis=0), abs=1e-9)
    # a straight line over a step of 0.03 rad misses 0.006 of a wave of order 7, more where samples are missing; at the
    # ends of a run the filter has neighbours on one side only, 0.02 rad away, in which such a wave changes by 0.14
    off = np.abs(parts.profiles - true(parts.angles, parts.cut_off))
    assert np.quantile(off, 0.98) < 0.006 and off.max() < 0.15
