"""The faults: each changes only what it says, before its begin nothing, and does what its name promises."""

from __future__ import annotations

import functools

import numpy as np
import pytest

from .fault import Injected
from .faults import FAULTS
from .options import Options
from .recording import AUTOCOLLIMATOR, COMMAND, Recording, samples
from .stage import make_recording
from .test_world_stage import DEFAULT


@functools.cache
def healthy(turning: bool = True) -> Recording:
    """A short recording with several turns, or the same at rest."""
    options = Options(
        motion="steady" if turning else "standstill", peak_speed=2.5, start_angle=0.4, start_ns=10**18, lvdt=True,
        force=True, temperature=True, block_period=0.03, lost_blocks=0.0,
    )  # fmt: skip
    return make_recording(1, duration=8.0, stage=DEFAULT, options=options)


def put(name: str, seed: int = 0, **fixed: object) -> Injected:
    """A fault in the healthy recording."""
    return FAULTS[name](healthy(), np.random.default_rng(seed), **fixed)


def pair(injected: Injected, topic: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, values before and values after of a topic whose samples stay."""
    times, before = samples(healthy().blocks[topic])
    return times, before, samples(injected.recording.blocks[topic])[1]


ALLOWED = {
    "head": lambda r: [[topic] for topic in r.head_topics],
    "two heads": lambda r: [[a, b] for a in r.head_topics for b in r.head_topics] + [[a] for a in r.head_topics],
    "heads": lambda r: [r.head_topics],
    "autocollimator": lambda r: [[AUTOCOLLIMATOR]],
    "command": lambda r: [[COMMAND]],
    "stream": lambda r: [[topic] for topic in (*r.head_topics, AUTOCOLLIMATOR, COMMAND)],
    "all": lambda r: [list(r.blocks)],
}


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_changes_only_what_it_says(name, seed):
    injected = put(name, seed)
    before, after = healthy(), injected.recording
    assert injected.acts
    assert sorted(injected.topics) in [sorted(topics) for topics in ALLOWED[FAULTS[name].streams](before)]
    assert after.truth is before.truth
    assert after.blocks.keys() == before.blocks.keys()
    for topic, blocks in before.blocks.items():
        assert len(after.blocks[topic]) == len(after.arrivals[topic])
        assert np.all(np.diff(after.arrivals[topic]) >= 0)
        if topic not in injected.topics:
            assert after.blocks[topic] is blocks
            assert after.arrivals[topic] is before.arrivals[topic]
            continue
        times, values = samples(blocks)
        early = int(np.argmax(times >= injected.begin_ns)) if times[-1] >= injected.begin_ns else len(times)
        new_times, new_values = samples(after.blocks[topic])
        if name not in ("heads_swapped", "head_two_publishers"):
            assert np.array_equal(new_times[:early], times[:early])
            assert np.array_equal(new_values[:early].ravel(), values[:early].ravel())
        late = times >= injected.end_ns
        if late.any() and len(new_times) == len(times):
            assert np.array_equal(new_values[late], values[late])


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_reproducible_and_says_what_it_is(name):
    first, second, other = put(name, 5), put(name, 5), put(name, 6)
    assert (first.begin_ns, first.size, first.topics) == (second.begin_ns, second.size, second.topics)
    for topic in first.topics:
        a, b = (samples(injected.recording.blocks[topic]) for injected in (first, second))
        assert np.array_equal(a[0], b[0])
        assert np.array_equal(a[1], b[1], equal_nan=True)
    assert FAULTS[name].sentence.endswith(".")
    assert other.name == name == FAULTS[name].name


def test_faults_leave_the_healthy_recording_as_it_was():
    before = {topic: samples(blocks) for topic, blocks in healthy().blocks.items()}
    for name in FAULTS:
        put(name, 11)
    for topic, blocks in healthy().blocks.items():
        assert np.array_equal(samples(blocks)[0], before[topic][0])
        assert np.array_equal(samples(blocks)[1], before[topic][1])


def test_time_size_and_topic_can_be_wanted():
    topic = healthy().head_topics[2]
    injected = put("head_jumps_10", begin=3.0, size=-7.0, topic=topic)
    times, before, after = pair(injected, topic)
    assert injected.topics == (topic,)
    assert injected.begin_ns == healthy().start_ns + 3_000_000_000
    expected = np.where(times >= injected.begin_ns, -7.0 * healthy().count, 0.0)
    assert np.allclose(after[:, 0] - before[:, 0], expected, atol=1e-12)


@pytest.mark.parametrize("n", [1, 2, 10, 100, "line"])
def test_jumps_are_of_so_many_counts(n):
    injected = put(f"head_jumps_{n}")
    _, before, after = pair(injected, injected.topics[0])
    counts = DEFAULT["encoder"]["counts_per_line"] if n == "line" else n
    assert np.isclose(abs((after - before)[-1, 0]) / healthy().count, counts)


@pytest.mark.parametrize(("name", "low"), [("0_2pi", 0.0), ("pm_pi", -np.pi)])
def test_wraps_stay_within_a_turn(name, low):
    injected = put(f"heads_wraps_{name}")
    for topic in healthy().head_topics:
        _, before, after = pair(injected, topic)
        assert low - 1e-9 <= after.min()
        assert after.max() <= low + 2.0 * np.pi + 1e-9
        turns = (before - after) / (2.0 * np.pi)
        assert np.allclose(turns, np.rint(turns), atol=1e-9)
        assert np.abs(turns).max() > 0.5


def test_a_wrap_that_is_never_reached_does_nothing():
    injected = FAULTS["heads_wraps_0_2pi"](healthy(turning=False), np.random.default_rng(0))
    assert not injected.acts


def test_a_restart_counts_from_zero_after_a_turn():
    injected = put("heads_restarted")
    for topic in healthy().head_topics:
        times, values = samples(injected.recording.blocks[topic])
        again = times >= injected.begin_ns + round(injected.size * 1e9)
        assert np.abs(values[again][0, 0]) < 0.2  # what it turned until the next block begins
        assert np.abs(values[~again][-1, 0] - values[0, 0]) >= 2.0 * np.pi - 0.1


def test_late_heads_have_old_values():
    injected = put("head_late", size=0.02, begin=0.0)
    times, _ = samples(healthy().blocks[injected.topics[0]])
    new, _ = samples(injected.recording.blocks[injected.topics[0]])
    assert np.all(new - times == 20_000_000)


@pytest.mark.parametrize("name", ["head_nan", "head_inf", "head_1e30", "head_1e300"])
def test_values_that_are_no_readings_are_some_of_the_samples(name):
    injected = put(name)
    _, before, after = pair(injected, injected.topics[0])
    assert np.any(~(np.abs(after) < 1e20))
    good = np.abs(after) < 1e20
    assert np.array_equal(after[good], before[good])


def test_times_fall_or_stand():
    for name, most in (("head_time_equal", 0), ("head_time_falls", -1)):
        injected = put(name, 4)
        steps = np.diff(samples(injected.recording.blocks[injected.topics[0]])[0])
        assert steps.min() <= most
        if name == "head_time_equal":
            assert steps.min() == 0


def test_stamps_of_the_future_and_of_1969():
    ahead = put("head_future_365d")
    assert ahead.recording.blocks[ahead.topics[0]][-1].stamp_ns > 10**18 + 364 * 86_400 * 10**9
    past = put("head_1969", 1)
    assert min(block.stamp_ns for block in past.recording.blocks[past.topics[0]]) < 0


def test_clocks_step_together():
    for name, sign in (("clocks_step_forward", 1), ("clocks_step_back", -1)):
        injected = put(name)
        for topic, blocks in healthy().blocks.items():
            shift = injected.recording.blocks[topic][-1].stamp_ns - blocks[-1].stamp_ns
            assert shift == sign * round(injected.size * 1e9)


def test_two_dead_heads_are_opposed_or_neighbours():
    azimuth = {f"/stage/head_{name}/samples": head["azimuth"] for name, head in DEFAULT["encoder"]["heads"].items()}
    for name, apart in (("opposed", np.pi), ("neighbours", 0.5 * np.pi)):
        for seed in range(4):
            a, b = put(f"two_heads_dead_{name}", seed).topics
            assert np.isclose(abs(np.angle(np.exp(1j * (azimuth[a] - azimuth[b])))), apart)


def test_a_pause_leaves_a_gap_in_all_streams():
    injected = put("recording_paused")
    for topic, blocks in injected.recording.blocks.items():
        if topic == "/stage/temperature/samples":
            continue
        times, _ = samples(blocks)
        gap = np.diff(times).max() * 1e-9
        assert injected.size - 0.25 < gap < injected.size + 0.25


def test_overlapping_blocks_repeat_samples():
    injected = put("blocks_overlapping", begin=0.0, size=1.0)
    topic = injected.topics[0]
    times, values = samples(healthy().blocks[topic])
    new_times, new_values = samples(injected.recording.blocks[topic])
    places = np.searchsorted(times, new_times - 1)
    assert len(new_times) > len(times)
    assert np.abs(times[places] - new_times).max() <= 1
    assert np.array_equal(values[places], new_values)


def test_faults_can_follow_one_another():
    rng = np.random.default_rng(3)
    recording = healthy()
    for name in ("head_drifts", "clocks_step_back", "blocks_empty", "autocollimator_spikes", "head_nan", "head_late"):
        recording = FAULTS[name](recording, rng).recording
    assert len(recording.timeline()) == sum(len(blocks) for blocks in recording.blocks.values())


@pytest.mark.parametrize("heads", [2, 3, 5, 6])
def test_every_fault_can_be_put_into_a_stage_of_other_heads(heads):
    places = {"abcdef"[i]: {"azimuth": 2.0 * np.pi * i / heads} for i in range(heads)}
    stage = {**DEFAULT, "encoder": {**DEFAULT["encoder"], "heads": places}}
    options = Options(motion="steady", peak_speed=4.0, start_angle=0.1, block_period=0.02)
    recording = make_recording(heads, duration=3.0, stage=stage, options=options)
    for fault in FAULTS.values():
        assert fault(recording, np.random.default_rng(heads)).acts
