"""A mock stage that follows an axis: smooth, close behind, and true to what it has said."""

import numpy as np
import pytest

from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.plant import tracking
from rotary_error_monitor.plant.tracking import TrackedMotion
from rotary_error_monitor.signals.blocks import NANOSECONDS
from rotary_error_monitor.sources.follower import FollowedSource, FollowedStage
from rotary_error_monitor.sources.mock import MockSettings

EPOCH_NS = 1_000_000_000_000
STEP_NS = 4_000_000


def steered(course, duration=2.0, bandwidth=60.0):
    motion = TrackedMotion(bandwidth)
    for time in np.arange(0.0, duration, 0.004):
        motion.steer(float(time), *course(time))
    return motion


def test_at_constant_speed_it_does_not_trail():
    motion = steered(lambda t: (0.3 + 1.5 * t, 1.5))
    angle, velocity = motion.at(np.array([1.9]))
    assert angle == pytest.approx(0.3 + 1.5 * 1.9, abs=1e-6)
    assert velocity == pytest.approx(1.5, abs=1e-6)


def test_under_acceleration_it_trails_by_acceleration_over_bandwidth_squared():
    """The closed form of a critically damped drive with velocity feed-forward: x'' = w²(u - x) + 2w(u' - x')."""
    motion = steered(lambda t: (0.5 * 3.0 * t * t, 3.0 * t), bandwidth=30.0)
    angle, _ = motion.at(np.array([1.998]))
    assert 0.5 * 3.0 * 1.998**2 - angle == pytest.approx(3.0 / 30.0**2, rel=0.1)


def test_the_velocity_has_no_steps():
    draw = np.random.default_rng(3)
    motion = steered(lambda t: (t + 3e-4 * draw.standard_normal(), 1.0))
    _, velocity = motion.at(np.arange(0.1, 1.9, 1e-4))
    assert np.abs(np.diff(velocity)).max() < 1e-3


def test_without_further_commands_it_does_not_speed_up_for_ever():
    motion = TrackedMotion()
    motion.steer(0.0, 0.0, 0.0)
    motion.steer(0.004, 0.1, 0.0)
    _, velocity = motion.at(np.array([0.2, 100.0]))
    assert velocity[0] == velocity[1]


def test_a_command_for_the_past_is_refused():
    motion = TrackedMotion()
    motion.steer(1.0, 0.0, 0.0)
    with pytest.raises(InputError, match=r"a command for 1\.0 s, not after the last one at 1\.0 s"):
        motion.steer(1.0, 0.0, 0.0)


def test_it_forgets_the_distant_past_only(monkeypatch):
    monkeypatch.setattr(tracking, "_LARGEST", 16)
    short, long = steered(lambda t: (t, 1.0)), None
    monkeypatch.undo()
    long = steered(lambda t: (t, 1.0))
    late = np.arange(1.97, 2.0, 1e-3)
    np.testing.assert_array_equal(short.at(late), long.at(late))


@pytest.fixture
def stage():
    return FollowedStage(load_stage(), MockSettings(1, EPOCH_NS, (), forces=False, rate=1000.0))


def test_before_the_axis_is_known_nothing_is_said(stage):
    assert FollowedSource(stage, "head_a").take(EPOCH_NS, EPOCH_NS + NANOSECONDS) is None


def test_heads_and_command_show_the_axis(stage):
    sources = {stream: FollowedSource(stage, stream) for stream in ("head_a", "head_b", "command")}
    blocks = {stream: [] for stream in sources}
    for index in range(250):
        now_ns = EPOCH_NS + NANOSECONDS + index * STEP_NS
        stage.command(now_ns, 0.2 + 0.8 * index * 0.004, 0.8)
        for stream, source in sources.items():
            blocks[stream].append(source.take(now_ns, now_ns + STEP_NS))
    last = {stream: rows[-1] for stream, rows in blocks.items()}
    seconds = (last["command"].times_ns - EPOCH_NS - NANOSECONDS) / NANOSECONDS
    np.testing.assert_allclose(last["command"].column("angle"), 0.2 + 0.8 * seconds, atol=1e-6)
    mean = 0.5 * (last["head_a"].column("angle") + last["head_b"].column("angle"))
    np.testing.assert_allclose(mean, last["command"].column("angle"), atol=2e-4)
    assert len({id(block) for block in blocks["head_a"]}) == 250


def test_what_an_instrument_has_said_stays_true(stage):
    """A joint state that comes late acts on what is still to be said."""
    source = FollowedSource(stage, "command")
    stage.command(EPOCH_NS, 0.0, 0.0)
    said = source.take(EPOCH_NS, EPOCH_NS + 10 * STEP_NS)
    stage.command(EPOCH_NS + STEP_NS, 0.1, 0.0)
    stage.command(EPOCH_NS + 2 * STEP_NS, 0.1, 0.0)
    np.testing.assert_array_equal(source.take(EPOCH_NS, EPOCH_NS + 10 * STEP_NS).rows, said.rows)
    later = source.take(EPOCH_NS + 60 * STEP_NS, EPOCH_NS + 70 * STEP_NS)
    assert later.column("angle").max() > 0.01


def test_a_span_without_samples_gives_none(stage):
    stage.command(EPOCH_NS, 0.0, 0.0)
    assert FollowedSource(stage, "command").take(EPOCH_NS + 1, EPOCH_NS + 2) is None
