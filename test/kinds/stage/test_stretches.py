"""A long recording, taken stretch by stretch, says what the same recording says as a whole."""

from __future__ import annotations

import re

import numpy as np
import pytest
from draws import seeds
from kinds.stage.test_unknown import slipped_near_reversal

from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.gap.diagnosis import diagnose
from rotary_error_monitor.gap.normal import combine, stack
from rotary_error_monitor.gap.verdict import Verdict
from rotary_error_monitor.kinds.stage import stretches
from rotary_error_monitor.kinds.stage.noise_learning import NoiseLearning
from rotary_error_monitor.kinds.stage.stretches import LongStageProblem, cut_recording, stage_problem
from rotary_error_monitor.noise.jitter import Jitter
from rotary_error_monitor.noise.stage_noise import CELLS

STRETCH = 8.0


@pytest.fixture
def both(stage_problem, monkeypatch):
    """Function that gives a problem as a whole, the same in stretches, and its truth."""
    monkeypatch.setattr(stretches, "STRETCH", STRETCH)

    def make(*args, **named):
        whole, truth = stage_problem(*args, **named)
        return whole, LongStageProblem(whole.stage, whole.recording, whole.effects), truth

    return make


def test_every_row_is_in_one_block_of_one_stretch(both):
    _, long, _ = both(4, "null", rough=True)
    conditions = long.conditions
    assert conditions.stretches == 2
    for channel in long.channels:
        time = long.times(channel)
        parts = [part for s in range(2) for _, part in conditions.pieces(channel, time, s)]
        assert [parts[0].start, *(part.stop for part in parts)] == [*(part.start for part in parts), len(time)]
        assert parts[0].start == 0


def test_equations_are_those_of_the_whole(both, monkeypatch):
    # eight seconds tell a spectrum less well than sixteen, and what is slow weighs by it
    monkeypatch.setattr(NoiseLearning, "estimate_jitter", lambda self, raw: (Jitter(), np.zeros(0)))
    whole, long, _ = both(11, "single", ["unbalance"], rough=True)
    effect = next(e for e in whole.effects if e.name == "unbalance")
    at_zero = Cause(effect, "", effect.start(""))
    sums = []
    for problem in (whole, long):
        columns = [problem.nuisance(()), problem.signature(at_zero, [0, 1])]
        sums.append(stack(problem, problem.residual(()), columns).total())
    # Filters start anew in each stretch: a few rows in a hundred are missing.
    size = np.sqrt(np.diag(sums[0].gram))
    np.testing.assert_allclose(sums[1].gram / np.outer(size, size), sums[0].gram / np.outer(size, size), atol=0.1)
    shown = combine(long, [long.signature(at_zero, [0, 1])], [np.array([1e-8, 0.0])])
    kept = combine(whole, [whole.signature(at_zero, [0, 1])], [np.array([1e-8, 0.0])])
    assert np.std(shown["head_a"]) == pytest.approx(np.std(kept["head_a"]), rel=0.02)


def test_joined_blocks_hold_the_sums_of_their_label(both):
    _, long, _ = both(4, "null", rough=True)
    joined, columns = long.conditions.joined(), [long.nuisance(())]
    each = stack(long, long.residual(()), columns)
    few = stack(long, long.residual(()), columns, conditions=joined)
    assert len(few.power) == len(long.conditions.names) < len(each.power)
    for label in range(len(long.conditions.names)):
        own, same = each.total(long.conditions.labels == label), few.total(joined.labels == label)
        np.testing.assert_allclose(same.gram, own.gram, atol=1e-9 * np.abs(own.gram).max())
        assert (same.power, same.count) == (pytest.approx(own.power), pytest.approx(own.count))


@pytest.mark.few(1)
@pytest.mark.parametrize("rough", [False, True])
def test_the_verdict_is_that_of_the_whole(both, rough):
    whole, long, truth = both(21, "single", ["mirror_wobble"], rough=rough)
    one, other = diagnose(whole), diagnose(long)
    assert one.verdict is other.verdict is Verdict.EXPLAINED
    (a,), (b,) = one.causes, other.causes
    assert a.cause.key == b.cause.key == (truth.faults[0].name, "")
    # Parameters of different stretches of the same noise agree within the spread that they state.
    tilt, again = a.parameters["tilt"], b.parameters["tilt"]
    assert np.all(np.abs(np.subtract(tilt.value, again.value)) < 2 * np.asarray(tilt.std))
    assert other.gap.shrink > 0.95
    assert one.where[0].channel.rpartition("_")[0] == other.where[0].channel.rpartition("_")[0]


@pytest.mark.long
@pytest.mark.parametrize("seed", seeds(2, 7300))
def test_what_slipped_once_is_no_backlash_in_stretches_either(monkeypatch, seed):
    monkeypatch.setattr(stretches, "STRETCH", STRETCH)
    whole, _ = slipped_near_reversal(seed, np.random.default_rng(seed).uniform(4.0, 16.0))
    long = LongStageProblem(whole.stage, whole.recording, whole.effects)
    assert diagnose(long).verdict is Verdict.UNKNOWN


@pytest.mark.few(1)
@pytest.mark.parametrize("seed", seeds(3, 31))
def test_departures_are_told_as_of_the_whole(both, seed):
    whole, long, truth = both(seed, "variant", ["disc_eccentricity"], snr=(300.0, 600.0))
    one, other = diagnose(whole), diagnose(long)
    assert one.verdict is other.verdict
    assert [cause.cause.key for cause in other.causes] == [cause.cause.key for cause in one.causes]
    assert [shares(cause) for cause in other.causes] == [pytest.approx(shares(cause), abs=0.03) for cause in one.causes]


def shares(cause):
    """Shares by pattern of the departures of a cause that stand out."""
    return {each.pattern: each.share for each in cause.departures if each.share > 0.05}


def test_nothing_is_found_where_nothing_is(both):
    _, long, _ = both(5, "null")
    assert diagnose(long).verdict is Verdict.NO_GAP


def test_a_sensor_that_falls_silent_is_missing_from_later_stretches_only(both):
    whole, _, _ = both(6, "null")
    recording = whole.recording
    lvdt = recording.streams["lvdt"]
    first = lvdt.time < 9.0
    streams = {**recording.streams, "lvdt": type(lvdt)(lvdt.time[first], lvdt.values[first])}
    silent = type(recording)(recording.start_ns, streams)
    late = cut_recording(silent, 10.0, 20.0)
    assert "lvdt" not in late.streams and "command" in late.streams
    long = LongStageProblem(whole.stage, silent, whole.effects)
    assert len(long.times("lvdt.x")) == np.count_nonzero(first)
    assert diagnose(long).verdict is Verdict.NO_GAP


def test_noise_of_any_stretch_is_told(both):
    _, long, _ = both(6, "null")
    rest, later = long.residual(()), long._stretches[1].noise
    later.with_slow_noise("autocollimator", np.full((CELLS, 2), 3.0))
    later.with_levels({"lvdt": 2.0})
    told = "; ".join(long.remarks(rest))
    assert f"autocollimator: slow noise of {3e6 * np.sqrt(2) * later.std['autocollimator']:.2g} µrad" in told, told
    (level,) = re.findall(r"lvdt\.x: noise is ([\d.]+) times what the twin states", told)
    assert float(level) == pytest.approx(np.sqrt((1 + 2**2) / 2), rel=0.05)


def test_short_recordings_are_one_stretch(both):
    whole, _, _ = both(6, "null")
    assert type(stage_problem(whole.stage, whole.recording, whole.effects)) is not LongStageProblem


def test_channels_of_the_same_instants_share_their_times(both):
    _, long, _ = both(6, "null")
    heads = [f"head_{letter}" for letter in "abcd"]
    assert all(long.times(head) is long.times("command") for head in heads)
    assert long.times("lvdt.x") is long.times("lvdt.y") is long.recording.streams["lvdt"].time
    assert all(np.shares_memory(stretch.noise.grid.time, long.times("command")) for stretch in long._stretches)


def test_a_head_that_begins_late_has_times_of_its_own_and_is_tested_with_the_others(both):
    whole, _, _ = both(6, "null")
    recording = whole.recording
    head = recording.streams["head_b"]
    late = head.time > 11.0
    streams = {**recording.streams, "head_b": type(head)(head.time[late], head.values[late])}
    long = LongStageProblem(whole.stage, type(recording)(recording.start_ns, streams), whole.effects)
    assert long.times("head_a") is long.times("command") is not long.times("head_b")
    rest = long.residual(())
    assert list(rest)[-1] == "head_b"
    for channel, rows in rest.items():
        assert len(long.times(channel)) == len(rows) and np.all(np.diff(long.times(channel)) > 0)
    findings = long.structure(rest)
    own = [finding.channel for finding in findings if not finding.kind.startswith("shared")]
    assert list(dict.fromkeys(own)) == list(rest)
    of_heads = [finding for finding in findings if "4 channels" in finding.pattern]
    assert [finding.kind for finding in of_heads] == ["shared line", "shared orders"]
