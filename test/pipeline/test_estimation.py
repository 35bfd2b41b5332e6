"""The estimator: right values, the same bits in any order of arrival, stated behaviour when streams fail."""

from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest
from draws import ALL
from hypothesis import example, given, settings
from hypothesis import strategies as st
from motion_numbers import assert_same_bits, decisions_of, numbers_of
from pushed_inputs import push_block

from rotary_error_monitor.description.harmonics import AngularHarmonic
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.stage_section import Encoder, Mirror
from rotary_error_monitor.description.two_axis_section import Autocollimator
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.error_motion import ErrorMotion
from rotary_error_monitor.pipeline.estimation import Estimator
from rotary_error_monitor.pipeline.estimator_settings import EstimatorSettings
from rotary_error_monitor.signals.admission import LATE, NOT_FINITE
from rotary_error_monitor.signals.blocks import SampleBlock, block_from_samples

AZIMUTHS = {"a": 0.0, "b": np.pi, "c": np.pi / 2, "d": 3 * np.pi / 2}
STAGE = StageDescription(
    Encoder(0.1, 31488, 100, 3e-7, AZIMUTHS, (2e-5, -1e-5), (AngularHarmonic(2, 1e-6, 3e-6),)),
    Autocollimator(5e-4, 5e-7, 5e-7),
    Mirror((5e-5, -3e-5)),
)
START = 1_763_700_000_000_000_000
SPEED = 3.0
NAMES = ("head_a", "head_b", "head_c", "head_d", "autocollimator", "command")


def true_motion(t):
    theta = SPEED * t + 1e-5 * np.sin(2.0 * t)
    return theta, 3e-6 * np.cos(2 * theta), -2e-6 * np.sin(theta), 1e-5 * np.sin(theta), 2e-5 * np.cos(theta)


def values(name, t):
    """Readings by the contract's formulas, exact and without noise."""
    theta, exc, eyc, eac, ebc = true_motion(t)
    if name == "command":
        return (SPEED * t)[:, None]
    if name == "autocollimator":
        x = 5e-5 * np.cos(theta) + 3e-5 * np.sin(theta) + eac
        y = 5e-5 * np.sin(theta) - 3e-5 * np.cos(theta) + ebc
        return np.stack([x, y], 1)
    phi = AZIMUTHS[name[-1]]
    x = exc + 2e-5 * np.cos(theta) + 1e-5 * np.sin(theta)
    y = eyc + 2e-5 * np.sin(theta) - 1e-5 * np.cos(theta)
    psi = phi - theta
    error = 1e-6 * np.cos(2 * psi) + 3e-6 * np.sin(2 * psi)
    return (theta + (-x * np.sin(phi) + y * np.cos(phi)) / 0.1 + error)[:, None]


def blocks(name, duration=0.6, rate=10_000.0, block=0.005, drop=(), offset=0.0):
    """Blocks of one stream, without those that cover a time in `drop` (pairs of seconds)."""
    fields = ("tilt_x", "tilt_y") if name == "autocollimator" else ("angle",)
    step = round(1e9 / rate)
    made = []
    for k in range(round(duration / block)):
        times = np.arange(round(rate * block)) * step + round(k * block * 1e9) + round(offset * 1e9)
        t = times * 1e-9
        if any(begin <= t[0] < end for begin, end in drop):
            continue
        made.append(block_from_samples(START + times, fields, values(name, t)))
    return made


def streams(**changes):
    return {
        name: blocks(name, **({"offset": 7e-6 * i} | changes.get(name, {}) | changes.get("every", {})))
        for i, name in enumerate(NAMES)
        if changes.get(name, {}) is not None
    }


def in_order(all_streams):
    pairs = [(name, block) for name, stream in all_streams.items() for block in stream]
    return sorted(pairs, key=lambda pair: int(pair[1].times_ns[-1]))


def run(pairs, stage=STAGE, finish=True, **options):
    estimator = Estimator(stage, options.pop("settings", None), **options)
    out = [made for name, block in pairs for made in push_block(estimator, name, block)]
    if finish:
        out += estimator.finish()
    return estimator, ErrorMotion.joined(out)


@pytest.mark.parametrize(("rate", "block"), [(10_000.0, 0.005), (50_000.0, 0.005), (400.0, 0.1)])
def test_error_motion_of_a_known_stage(rate, block):
    _, result = run(in_order(streams(every={"rate": rate, "block": block})))
    t = (result.times_ns - START) * 1e-9
    theta, *components = true_motion(t)
    inside = (t > 0.02) & (t < 0.57)
    assert inside.sum() > 540
    assert result.observable[inside][:, [0, 1, 3, 4, 5]].all()
    assert not result.observable[:, 2].any()
    np.testing.assert_allclose(result.theta[inside], theta[inside], atol=2e-10)
    for index, truth in zip((0, 1, 3, 4), components, strict=True):
        np.testing.assert_allclose(result.components[inside, index], truth[inside], atol=3e-10)
    np.testing.assert_allclose(result.components[inside, 5], 1e-5 * np.sin(2 * t[inside]), atol=2e-10)


def test_dense_samples_lower_the_covariance():
    """Where the stamps are exact; what these may be off by, no number of samples lowers."""
    proven = EstimatorSettings(check_turns=0.0)
    stage = dataclasses.replace(STAGE, uncertainty={"encoder.timing": 0.0})
    _, sparse = run(in_order(streams(every={"rate": 400.0, "block": 0.1})), stage=stage, settings=proven)
    _, dense = run(in_order(streams(every={"rate": 50_000.0})), stage=stage, settings=proven)
    middle = len(dense.theta) // 2
    assert dense.covariance[middle, 0, 0] < 0.15 * sparse.covariance[:, 0, 0].mean()


@settings(deadline=None, max_examples=15)
@given(st.integers(0, 10_000), st.integers(0, 12))
def test_bits_do_not_depend_on_when_blocks_arrive(seed, delay):
    """Each stream keeps its own order; how they interleave, within the patience, is left to chance."""
    generator = np.random.default_rng(seed)
    everything = streams()
    reference = run(in_order(everything))[1]
    late = NAMES[generator.integers(len(NAMES))]
    keyed = []
    for name, stream in everything.items():
        for block in stream:
            jitter = generator.uniform(0, 0.004) + (delay * 0.005 if name == late else 0.0)
            keyed.append((int(block.times_ns[-1]) * 1e-9 + jitter, name, block))
    arrival: dict[str, float] = {}
    for i, (when, name, block) in enumerate(keyed):
        arrival[name] = max(when, arrival.get(name, 0.0) + 1e-6)
        keyed[i] = (arrival[name], name, block)
    keyed.sort(key=lambda item: item[0])
    shuffled = run([(name, block) for _, name, block in keyed])[1]
    assert_same_bits(shuffled, reference)


def test_before_a_turn_has_verified_the_description_it_is_as_uncertain_as_the_stage_can_move():
    _, result = run(in_order(streams()))
    limits = STAGE.limits
    assert (result.covariance[:, 0, 0] > limits.radial**2 / 3).all()
    assert (result.covariance[:, 3, 3] > limits.tilt**2 / 3).all()
    _, proven = run(in_order(streams()), settings=EstimatorSettings(check_turns=0.0))
    assert (proven.covariance[:, 0, 0] < 1e-4 * limits.radial**2).all()


def test_blocks_of_another_size_give_the_same_bits():
    small = run(in_order(streams(every={"block": 0.005})))[1]
    large = run(in_order(streams(every={"block": 0.1})))[1]
    assert_same_bits(small, large)


def test_a_dead_head_leaves_the_others_to_go_on():
    dead = {"head_d": {"drop": ((0.3, 9.0),)}}
    estimator, result = run(in_order(streams(**dead)), finish=False, settings=EstimatorSettings(check_turns=0.0))
    t = (result.times_ns - START) * 1e-9
    assert estimator.status.absent == ("head_d",)
    assert estimator.status.unseen_orders == tuple(range(1, 13))  # three heads contradict nothing
    assert np.diff(result.times_ns).max() == 1_000_000  # no tick is lost
    assert result.observable[t > 0.3][:, :2].all()
    theta, exc, eyc, _, _ = true_motion(t)
    np.testing.assert_allclose(result.components[5:-5, 0], exc[5:-5], atol=3e-10)
    mask = result.streams
    assert set(mask[(t > 0.31) & (t < 0.59)]) == {0b110111}
    assert result.covariance[t > 0.35][0, 0, 0] > 1.2 * result.covariance[t < 0.25][0, 0, 0]


def test_two_opposed_heads_left_give_one_component_and_no_contradiction():
    dead = {"head_c": {"drop": ((0.3, 9.0),)}, "head_d": {"drop": ((0.3, 9.0),)}}
    _, result = run(in_order(streams(**dead)), finish=False)
    t = (result.times_ns - START) * 1e-9
    late = t > 0.32
    assert not result.observable[late][:, 0].any()
    assert result.observable[late][:, 1].all()
    assert (result.components[late][:, 0] == 0).all()
    np.testing.assert_allclose(result.components[late, 1], true_motion(t[late])[2], atol=3e-10)


def test_with_one_head_left_only_the_rotation_is_told():
    """As sure as it is where the ring is: a head sees its displacement as rotation."""
    dead = {name: {"drop": ((0.3, 9.0),)} for name in ("head_b", "head_c", "head_d")}
    result = run(in_order(streams(**dead)), finish=False)[1]
    t = (result.times_ns - START) * 1e-9
    late = t > 0.31
    assert late.sum() > 100 and (result.streams[late] & 0b1111 == 0b0001).all()
    assert not result.observable[late, :3].any() and result.observable[late, 5].all()
    std = np.sqrt(result.covariance[:, 5, 5])
    assert std[late].min() > STAGE.limits.radial / STAGE.ring.disc_radius / np.sqrt(3.0)


def test_without_a_head_nothing_is_published():
    dead = {f"head_{letter}": {"drop": ((0.3, 9.0),)} for letter in "abcd"}
    estimator, result = run(in_order(streams(**dead)), finish=False)
    assert (result.times_ns[-1] - START) * 1e-9 < 0.301
    assert estimator.status.unobservable > 100


def test_a_head_that_comes_back_counts_again_after_the_patience():
    gone = {"head_d": {"drop": ((0.15, 0.3),)}}
    result = run(in_order(streams(**gone)))[1]
    t = (result.times_ns - START) * 1e-9
    used = result.streams & 0b1000 > 0
    back = t[used & (t > 0.2)][0]
    assert back == pytest.approx(0.3 + 0.1 + 0.005, abs=0.002)  # patience and one block
    assert used[t < 0.149].all()


def test_a_head_that_joins_when_nobody_waits_for_it_any_more_leaves_no_hole():
    late = {"head_d": {"drop": ((0.0, 0.3),)}}
    result = run(in_order(streams(**late)))[1]
    assert set(np.diff(result.times_ns)) == {1_000_000}
    used = result.streams & 0b1000 > 0
    assert not used[0]
    assert used[-1]


def test_a_head_that_comes_back_with_another_zero_is_left_out_at_once():
    """The other streams were judged at a wrong rotation for a moment: that is forgotten with the head."""
    everything = streams(every={"rate": 1000.0, "duration": 1.0}, head_d={"drop": ((0.15, 0.3),)})
    everything["head_d"] = [
        SampleBlock(b.stamp_ns, b.names, b.rows + [0.0, 0.3 * (b.stamp_ns > START + 200_000_000)])
        for b in everything["head_d"]
    ]
    estimator, result = run(in_order(everything))
    assert dict(estimator.belief.reasons).keys() == {"head_d"}
    t = (result.times_ns - START) * 1e-9
    back = t > 0.48
    assert np.sum(back) > 450, "it came back at 0.4 s"
    assert set(result.streams[back]) == {0b110111}
    assert (result.observable[back] == [True, True, False, True, True, True]).all()
    np.testing.assert_allclose(result.components[back, 1][:-5], true_motion(t[back][:-5])[2], atol=1e-9)


def test_a_short_gap_costs_only_its_own_ticks():
    gone = {"head_d": {"drop": ((0.30, 0.305),)}}
    estimator, result = run(in_order(streams(**gone)))
    t = (result.times_ns - START) * 1e-9
    unused = t[result.streams & 0b1000 == 0]
    assert 5 <= np.sum((unused > 0.29) & (unused < 0.31)) <= 7
    assert estimator.status.streams["head_d"].lost == 1


@pytest.mark.parametrize("lost", [1, 2, 3])
@pytest.mark.parametrize("rate", [60.0, 90.0])
def test_what_lacks_for_a_gap_that_is_not_joined_is_counted(rate, lost):
    """Also where it is no more than one sample, which may as well be the scatter of stamps."""
    gone = {"autocollimator": {"rate": rate, "block": 1.0 / rate, "drop": ((0.299, 0.299 + lost / rate),)}}
    estimator, result = run(in_order(streams(**gone)))
    tilt = result.observable[:, 3]
    lacking = ~tilt[np.flatnonzero(tilt)[0] :]
    assert np.sum(lacking) > 20
    assert estimator.status.unjoined == {"autocollimator": np.sum(lacking)}


@pytest.mark.parametrize("pause", [8, 30 * 86400])
def test_after_a_pause_of_any_length_the_rotation_is_told_as_before(pause):
    turns = pause * 1_000_000_000

    def later(name, block):
        return name, SampleBlock(block.stamp_ns + turns, block.names, block.rows)

    pairs = in_order(streams())
    _, before = run(pairs)
    _, result = run([*pairs, *(later(*pair) for pair in pairs)])
    since = result.times_ns - START
    np.testing.assert_array_equal(numbers_of(result.at(since < 1_000_000_000)), numbers_of(before))
    second = since > 1_000_000_000
    shared = np.isin(before.times_ns, result.times_ns[second] - turns)
    assert shared[before.times_ns >= START + 250_000_000].all()  # the streams count again after their patience
    np.testing.assert_array_equal(result.theta[second], before.theta[shared])


@pytest.mark.few(6)
@pytest.mark.parametrize("jump", [0.0, 0.4, 0.9, 1.7], ids=lambda jump: f"{jump:g} s missed")
@pytest.mark.parametrize("back", [0.2, 3.0, 7200.0, 86_400.0], ids=lambda back: f"{back:g} s back")
def test_after_the_clock_was_set_back_nothing_is_doubted_and_all_is_told_at_once(back, jump):
    """The rotor has moved on meanwhile, or what is played again begins elsewhere: that is no step of an instrument."""
    estimator, draw = Estimator(STAGE, EstimatorSettings(check_turns=0.0)), np.random.default_rng(1)

    def noisy(name, t):
        exact = values(name, t)
        return exact + {"command": 0.0, "autocollimator": 5e-7}.get(name, 3e-7) * draw.normal(size=exact.shape)

    for name, block in in_order(streams(every={"rate": 1000.0, "block": 0.01, "duration": 2.0})):
        measured = noisy(name, (block.times_ns - START) * 1e-9)
        before = block_from_samples(block.times_ns, block.names[1:], measured)
        push_block(estimator, name, before, int(block.times_ns[-1]) + 2_000_000)
    assert not dict(estimator.belief.reasons)
    out = []
    for name, block in in_order(streams(every={"rate": 1000.0, "block": 0.01, "duration": 1.0})):
        times = block.times_ns - round(back * 1e9) + 2_000_000_000
        later = block_from_samples(times, block.names[1:], noisy(name, (block.times_ns - START) * 1e-9 + 2.0 + jump))
        out += push_block(estimator, name, later, int(times[-1]) + 2_000_000)
        assert not dict(estimator.belief.reasons)
    assert estimator.status.restarts == 1
    told = ErrorMotion.joined(out)
    late = told.times_ns > told.times_ns[0] + 200_000_000
    assert (told.observable[late] == [True, True, False, True, True, True]).all()
    theta, exc, eyc, eac, ebc = true_motion((told.times_ns[late] + round(back * 1e9) - START) * 1e-9 + jump)
    for place, true in ((0, exc), (1, eyc), (3, eac), (4, ebc)):
        variance = told.covariance[late, place, place]
        off = np.abs(told.components[late, place] - true) / np.sqrt(variance)
        assert off.max() < 6.0 and variance.max() < 2e-6**2


@pytest.mark.parametrize("command", [True, False], ids=["with command", "without command"])
def test_a_silence_of_the_heads_is_seen_although_the_clock_shows_less_than_before(command):
    """Their zero may be another one after it: the command tells at once, without it a turn has to."""
    estimator = Estimator(STAGE)
    every = {"rate": 1000.0, "block": 0.01, "duration": 2.6}
    given = {} if command else {"command": None}
    for name, block in in_order(streams(every=every, **given)):
        push_block(estimator, name, block, int(block.times_ns[-1]) + 2_000_000)
    assert estimator.belief.verified == 1.0 and not estimator.belief.verdict.has("unverified")
    silent = {f"head_{letter}": every | {"duration": 1.6, "drop": [(0.6, 1.2)]} for letter in AZIMUTHS}
    unverified = {"before": [], "after": [], "at last": []}
    for name, block in in_order(streams(every=every | {"duration": 1.6}, **silent, **given)):
        later = block_from_samples(block.times_ns - 3600 * 10**9, block.names[1:], block.rows[:, 1:])
        push_block(estimator, name, later, int(later.times_ns[-1]) + 2_000_000)
        passed = (block.times_ns[-1] - START) * 1e-9
        when = "before" if passed < 0.6 else "after" if passed < 1.55 else "at last"
        unverified[when].append(estimator.belief.verdict.has("unverified"))
    assert not any(unverified["before"])
    assert any(unverified["after"])
    assert all(unverified["at last"]) != command


def test_a_missing_autocollimator_leaves_tilt_unobservable_and_zero():
    result = run(in_order(streams(autocollimator=None)))[1]
    assert not result.observable[:, 3:5].any()
    assert (result.components[:, 3:5] == 0).all()
    assert result.observable[:, :2].all()


def test_without_command_there_is_no_angular_positioning_error_motion():
    result = run(in_order(streams(command=None)))[1]
    assert not result.observable[:, 5].any()
    assert np.isfinite(numbers_of(result)).all()


def test_a_saturated_autocollimator_is_not_believed():
    everything = streams()
    end = STAGE.autocollimator.range
    clipped = []
    for block in everything["autocollimator"]:
        rows = block.rows.copy()
        if 0.2 <= (block.stamp_ns - START) * 1e-9 < 0.25:
            rows[:, 1] = end
        clipped.append(SampleBlock(block.stamp_ns, block.names, rows))
    everything["autocollimator"] = clipped
    estimator, result = run(in_order(everything))
    t = (result.times_ns - START) * 1e-9
    assert estimator.status.saturated == {"autocollimator": 500}
    assert not result.observable[(t > 0.2) & (t < 0.249)][:, 3:5].any()
    assert np.abs(result.components[:, 3]).max() < 2e-5


def test_a_head_that_jumps_is_told_and_left_out():
    everything = streams()
    everything["head_b"] = [
        SampleBlock(b.stamp_ns, b.names, b.rows + [0.0, 5e-5 * (b.stamp_ns > START + 300_000_000)])
        for b in everything["head_b"]
    ]
    estimator, result = run(in_order(everything))
    assert re.search(r"by 2\d\.\d* counts", dict(estimator.belief.reasons)["head_b"]), "5e-5 rad are 25.06 counts"
    t = (result.times_ns - START) * 1e-9
    assert 0.299 < t[np.argmax(np.diff(t))] < 0.302, "nothing goes out while it is not known which head is wrong"
    back = t > 0.301
    assert 0.3 < t[back][0] < 0.36
    assert set(result.streams[back]) == {0b111101}
    assert (result.doubts[t > 0.45] & 0b10001 == 0b10000).all(), "a further fault would not show"
    np.testing.assert_allclose(result.components[back, 1][:-5], true_motion(t[back][:-5])[2], atol=3e-10)


def test_heads_that_contradict_one_another_for_no_known_reason_publish_nothing():
    """One stands off from the start: all four say the same of it, so nothing tells which one is wrong."""
    everything = streams(every={"rate": 1000.0})
    everything["head_b"] = [SampleBlock(b.stamp_ns, b.names, b.rows + [0.0, 5e-5]) for b in everything["head_b"]]
    estimator = Estimator(STAGE)
    out = [made for name, block in in_order(everything) for made in push_block(estimator, name, block)]
    assert out == []
    assert estimator.status.withheld > 500
    assert "the heads contradict one another by 4" in dict(estimator.belief.reasons)["heads"]


@given(
    begins=st.lists(st.floats(0.0, 0.09), min_size=4, max_size=4),
    wrong=st.sampled_from("abcd"),
    size=st.floats(2e-4, 1.0),
)
@settings(deadline=None, max_examples=25 if ALL else 10)
def test_before_all_heads_that_are_awaited_have_begun_none_of_them_is_believed(begins, wrong, size):
    """Three heads contradict nothing: where one of them is wrong, only the fourth tells."""
    heads = [f"head_{letter}" for letter in AZIMUTHS]
    changes = {head: {"drop": [(0.0, begin)], "duration": 0.2} for head, begin in zip(heads, begins, strict=True)}
    estimator = Estimator(STAGE)
    for name, block in in_order(streams(**changes)):
        off = [0.0, size if name == f"head_{wrong}" else 0.0]
        shifted = SampleBlock(block.stamp_ns, block.names, block.rows + off) if name in heads else block
        for made in push_block(estimator, name, shifted):
            assert not np.any(made.streams >> heads.index(f"head_{wrong}") & 1), "a bearing cannot move that far"


def test_samples_that_are_not_finite_or_late_are_refused_and_counted():
    everything = streams()
    broken = everything["head_a"][20].rows.copy()
    broken[3, 1] = np.nan
    everything["head_a"][20] = SampleBlock(everything["head_a"][20].stamp_ns, ("t", "angle"), broken)
    pairs = in_order(everything)
    pairs.insert(len(pairs) // 2, pairs[3])
    estimator, result = run(pairs)
    assert np.isfinite(numbers_of(result)).all()
    assert estimator.status.streams["head_a"].admission.refused[NOT_FINITE] == 1
    assert estimator.status.streams[pairs[3][0]].admission.refused[LATE] == 50


def test_a_replay_repeats_what_the_live_run_decided():
    """A block that came too late live was not used; with the published masks a replay does not use it either."""
    everything = streams()
    pairs = in_order(everything)
    held = [pair for pair in pairs if pair[0] == "head_c" and (pair[1].stamp_ns - START) * 1e-9 >= 0.3]
    live = run([pair for pair in pairs if pair not in held], finish=False)[1]
    again = run(pairs, decisions=decisions_of(live))[1]
    assert_same_bits(again, live)


@settings(deadline=None, max_examples=25 if ALL else 10)
@given(
    st.sampled_from([(10_000.0, 0.005), (10_000.0, 0.02), (50_000.0, 0.003), (1_000.0, 0.02), (400.0, 0.05)]),
    st.integers(0, 10_000),
)
def test_a_replay_repeats_a_live_run_that_missed_what_the_recorder_heard(sampling, seed):
    """Found late, or too busy for a block: whatever was published rests on samples that were all there."""
    generator = np.random.default_rng(seed)
    rate, block = sampling
    every = {"rate": rate, "block": block}
    offsets = generator.uniform(0, 1e-3, len(NAMES))
    recorded = in_order(
        streams(every=every, **{name: {"offset": offset} for name, offset in zip(NAMES, offsets, strict=True)})
    )
    heard_from = dict(zip(NAMES, START + generator.uniform(0, 0.2e9, len(NAMES)), strict=True))
    heard = [pair for pair in recorded if pair[1].stamp_ns >= heard_from[pair[0]] and generator.random() > 0.05]
    live = run(heard, finish=False)[1]
    again = run(recorded, decisions=decisions_of(live))[1]
    assert_same_bits(again, live)


@settings(deadline=None, max_examples=8)
@example(seed=0, wrong="head_a", off=0.02, place="last")
@given(
    st.integers(0, 10_000),
    st.sampled_from(NAMES),
    st.sampled_from([0.02, 0.3, 1.5, 3600.0, 365 * 86_400.0, -0.3, -3600.0]),
    st.sampled_from(["first", "middle", "last"]),
)
def test_a_wrong_stamp_inside_each_block_costs_its_own_sample_live_and_in_replay(seed, wrong, off, place):
    """Only by the order of the others a stamp within 0.1 s of the clock is wrong; the last of a block has none."""
    generator, proven = np.random.default_rng(seed), EstimatorSettings(check_turns=0.0)
    pairs, count = [], 0
    for name, block in in_order(streams(every={"duration": 0.3})):
        if name == wrong and block.stamp_ns > START + 100_000_000:
            rows = block.rows.copy()
            index = {"first": 0, "middle": int(generator.integers(1, 49)), "last": 48 if off == 0.02 else 49}[place]
            rows[index, 0] += off
            block, count = SampleBlock(block.stamp_ns, block.names, rows), count + 1
        pairs.append((name, block, START + round((block.stamp_ns - START) + 7e6)))
    told = []
    for recorded in (False, True):
        estimator, out = Estimator(STAGE, proven), []
        for number, (name, block, arrival) in enumerate(pairs):
            estimator.accept(name, block, arrival, recorded=recorded)
            out += estimator.advance() if number % 6 == 0 else []
        told.append(ErrorMotion.joined(out + estimator.finish()))
        assert estimator.status.restarts == 0
        assert not dict(estimator.belief.reasons)
        refused = {name: each.admission.refused.total() for name, each in estimator.status.streams.items()}
        assert refused == {name: count if name == wrong else 0 for name in NAMES}
        assert not estimator.status.refused
    assert_same_bits(told[0], told[1])
    assert len(told[0].theta) > 290
    found, t = told[0], (told[0].times_ns - START) * 1e-9
    inside = (t > 0.02) & (t < 0.27)
    assert found.observable[inside][:, :2].all()
    assert (found.observable[inside][:, [3, 4, 5]].mean(axis=0) > 0.7).all(), "but for ticks that lack their sample"
    for index, truth in zip((0, 1, 3, 4), true_motion(t)[1:], strict=True):
        there = inside & found.observable[:, index]
        np.testing.assert_allclose(found.components[there, index], truth[there], atol=1e-9)


def test_a_block_that_is_wholly_in_the_future_is_refused_live_and_in_replay():
    block = blocks("head_a")[0]
    for recorded in (False, True):
        estimator = Estimator(STAGE)
        with pytest.raises(InputError, match=r"in the future: 1\.5 s ahead"):
            estimator.accept("head_a", block, block.stamp_ns - 1_495_100_000, recorded=recorded)
        assert estimator.status.refused.total() == 1
        assert estimator.status.streams["head_a"].newest_ns is None


def test_an_unknown_stream_is_refused():
    with pytest.raises(InputError, match="no stream 'head_x' in this stage; it has head_a"):
        push_block(Estimator(STAGE), "head_x", blocks("head_a")[0])


@pytest.mark.parametrize("name", ["period_ns", "patience_ns", "max_gap_ns", "disagreement_limit"])
def test_settings_must_be_positive(name):
    with pytest.raises(InputError, match=f"{name} is 0; it must be above 0"):
        dataclasses.replace(EstimatorSettings(), **{name: 0})
