"""A mock stage that goes where it is commanded: exact, never ahead of what is known, and true to what it has said."""

import numpy as np
import pytest

from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.plant import tracking
from rotary_error_monitor.plant.tracking import CommandedMotion
from rotary_error_monitor.signals.blocks import NANOSECONDS
from rotary_error_monitor.sources.follower import FollowedSource, FollowedStage
from rotary_error_monitor.sources.mock import MockSettings

EPOCH_NS = 1_000_000_000_000
STEP_NS = 4_000_000


def commanded(course, times):
    motion = CommandedMotion()
    for time in times:
        motion.command(float(time), *course(time))
    return motion


@pytest.mark.parametrize("seed", range(5))
def test_it_is_on_any_cubic_that_it_is_commanded(seed):
    """However far the commands are apart: a cubic is the one through its values and slopes."""
    draw = np.random.default_rng(seed)
    cubic = np.polynomial.Polynomial(draw.standard_normal(4))
    times = np.cumsum(draw.uniform(0.002, 0.3, 20))
    motion = commanded(lambda t: (cubic(t), cubic.deriv()(t)), times)
    looks = np.sort(draw.uniform(times[0], times[-1], 500))
    angle, velocity = motion.at(looks)
    np.testing.assert_allclose(angle, cubic(looks), rtol=1e-9, atol=1e-9)
    np.testing.assert_allclose(velocity, cubic.deriv()(looks), rtol=1e-7, atol=1e-7)


def test_before_the_first_and_after_the_last_command_it_stands():
    motion = commanded(lambda t: (0.3 + 1.5 * t, 1.5), [1.0, 1.004, 1.008])
    angle, velocity = motion.at(np.array([0.0, 1.008, 1.5]))
    np.testing.assert_allclose(angle, [0.3 + 1.5, 0.3 + 1.5 * 1.008, 0.3 + 1.5 * 1.008])
    assert velocity.tolist() == [0.0] * 3


def test_a_command_changes_nothing_before_the_one_before_it():
    draw = np.random.default_rng(3)
    motion = commanded(lambda t: (t + 3e-4 * draw.standard_normal(), 1.0), np.arange(0.0, 1.0, 0.004))
    looks = np.linspace(0.0, motion.newest, 2000)
    before = motion.at(looks)
    motion.command(1.2, 7.0, -3.0)
    after = motion.at(looks)
    np.testing.assert_array_equal(before[0], after[0])
    np.testing.assert_array_equal(before[1][:-1], after[1][:-1])


def test_a_command_for_the_past_is_refused():
    motion = commanded(lambda t: (0.0, 0.0), [1.0])
    with pytest.raises(InputError, match=r"a command for 1\.0 s, not after the last one at 1\.0 s"):
        motion.command(1.0, 0.0, 0.0)


def test_it_forgets_the_distant_past_only(monkeypatch):
    monkeypatch.setattr(tracking, "_LARGEST", 16)
    short = commanded(lambda t: (t * t, 2 * t), np.arange(0.0, 2.0, 0.004))
    monkeypatch.undo()
    long = commanded(lambda t: (t * t, 2 * t), np.arange(0.0, 2.0, 0.004))
    late = np.arange(1.97, 2.0, 1e-3)
    np.testing.assert_array_equal(short.at(late), long.at(late))


@pytest.fixture
def stage():
    return FollowedStage(load_stage(), MockSettings(1, EPOCH_NS, (), forces=False, rate=1000.0))


def test_before_a_command_nothing_is_said(stage):
    assert FollowedSource(stage, "head_a").take(EPOCH_NS, EPOCH_NS + NANOSECONDS) is None


def test_heads_show_what_is_commanded_as_far_as_that_is_known(stage):
    """Commands come late, by other times than the blocks; each sample comes once."""
    sources = {stream: FollowedSource(stage, stream) for stream in ("head_a", "head_b")}
    blocks = {stream: [] for stream in sources}
    begin_ns = EPOCH_NS + NANOSECONDS
    for index in range(250):
        now_ns = begin_ns + index * STEP_NS
        stage.command(now_ns - 3_000_000, 0.2 + 0.8 * (index * 0.004 - 0.003), 0.8)
        for stream, source in sources.items():
            block = source.take(now_ns, now_ns + STEP_NS)
            assert block is None or block.times_ns[-1] < now_ns - 3_000_000
            blocks[stream] += [] if block is None else [block]
    times = {stream: np.concatenate([block.times_ns for block in each]) for stream, each in blocks.items()}
    for each in times.values():
        np.testing.assert_array_equal(np.diff(each), NANOSECONDS // 1000)
        assert len(each) >= 990
    read = [np.concatenate([block.column("angle") for block in each]) for each in blocks.values()]
    meant = [0.2 + 0.8 * (each - begin_ns) / NANOSECONDS for each in times.values()]
    mean = 0.5 * (read[0] - meant[0] + read[1] - meant[1])
    np.testing.assert_allclose(mean, 0.0, atol=2e-4)


def test_without_commands_it_stands_and_goes_on_showing_so(stage):
    source = FollowedSource(stage, "head_a")
    for index in range(10):
        stage.command(EPOCH_NS + index * STEP_NS, 0.1 * index, 0.0)
        source.take(0, EPOCH_NS + index * STEP_NS)
    late_ns = EPOCH_NS + 3 * NANOSECONDS
    assert source.take(0, EPOCH_NS + NANOSECONDS) is None, "it waits for a command that is late"
    first, second = (source.take(0, late_ns + k * STEP_NS) for k in (0, 10))
    assert second.times_ns[0] - first.times_ns[-1] == NANOSECONDS // 1000, "what was said stays true"
    np.testing.assert_allclose(second.column("angle"), 0.9, atol=1e-3)
    stage.command(late_ns, 5.0, 0.0)
    assert source.take(0, late_ns + 10 * STEP_NS) is None, "a command for what has been said is lost"


def test_a_span_without_samples_gives_none(stage):
    stage.command(EPOCH_NS, 0.0, 0.0)
    assert FollowedSource(stage, "head_a").take(0, EPOCH_NS + 1) is None
