"""A stage without read heads whose command is stuck, on recordings of the independent world.

The rotor turns on as before; only what the command's source says stands still, under fresh stamps.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from described_stages import stage_of
from motion_numbers import assert_same_bits
from pushed_inputs import push_block
from world import Options, Recording, make_recording, random_stage, samples, with_probes, with_probes_alone

from faults.documenting import Row, shows
from faults.judging import TURNING
from faults.test_without_heads import published, repeated, streams_of
from rotary_error_monitor.pipeline.estimation import Estimator
from rotary_error_monitor.signals.blocks import SampleBlock

COMMAND = "/stage/command/samples"
SEEDS = range(12)
DURATION, BEGIN, END = 7.0, 3.0, 5.0
WINDOW = 0.01


@cache
def recorded(seed: int, tilt: bool = False) -> Recording:
    """Steady or with changes of speed; with an autocollimator and other probes, or three radial probes alone."""
    stage = random_stage(1000 * seed)
    section = with_probes(stage, seed) if tilt else with_probes_alone(stage, seed)
    section = {name: part for name, part in section.items() if name != "encoder"}
    made = Options(motion=TURNING[seed % len(TURNING)], odd_rates=False, peak_speed=4.0)
    return make_recording(seed, duration=DURATION, stage=section, options=made)


def with_command(recording: Recording, change) -> Recording:
    """The recording with other values of the command: `change(seconds, values)`."""
    blocks = []
    for block in recording.blocks[COMMAND]:
        seconds = (block.times_ns - recording.start_ns) * 1e-9
        blocks.append(
            SampleBlock(
                block.stamp_ns, block.names, np.column_stack([block.rows[:, 0], change(seconds, block.rows[:, 1:])])
            )
        )
    return recording.with_topics({COMMAND: (blocks, recording.arrivals[COMMAND])})


def stuck(recording: Recording, velocity: str) -> tuple[Recording, float]:
    """Its source repeats the angle from `BEGIN` to `END`; `velocity` goes on, is the same again and again, or 0."""
    times, values = samples(recording.blocks[COMMAND])
    before = values[np.searchsorted(times, recording.start_ns + round(BEGIN * 1e9)) - 1]

    def change(seconds, own):
        frozen = np.tile(before, (len(own), 1))
        frozen[:, 1] = {"goes on": own[:, 1], "frozen": before[1], "zero": 0.0}[velocity]
        return np.where(((seconds >= BEGIN) & (seconds < END))[:, None], frozen, own)

    return with_command(recording, change), float(before[1])


def run(recording: Recording):
    """Times (s) of what is published, when (s) which streams were doubted first, and the estimator at the end."""
    stage, named = stage_of(recording.stage), []
    estimator, doubted = Estimator(stage), {}
    for _, topic, block in recording.timeline():
        name = topic.split("/")[2]
        if name in estimator.inputs and len(block.rows):
            named += push_block(estimator, name, block)
            for what, _ in estimator.reasons:
                doubted.setdefault(what, (int(block.times_ns[-1]) - recording.start_ns) * 1e-9)
    named += estimator.finish()
    return (np.concatenate([made.times_ns for made in named]) - recording.start_ns) * 1e-9, doubted, estimator


@shows(
    Row(
        "command",
        "A stage without heads: the source of the command repeats its angle under fresh stamps, while its velocity is "
        "not zero",
        "`error_estimator: estimate` names the command: stuck, its angle stands while its velocity would have moved it",
        "the command is not used from three windows (30 ms) after the velocity would have moved it by "
        "`following_error` and `latency` times the speed",
        "nothing: all is of that rotation",
        "once it has moved again for 0.5 s, no faster than the axis can turn",
    )
)
@pytest.mark.parametrize("velocity", ["goes on", "frozen"])
@pytest.mark.parametrize("tilt", [False, True])
def test_an_angle_that_stands_while_its_velocity_does_not_is_told_at_once(velocity, tilt):
    told = 0
    for seed in SEEDS:
        recording, speed = stuck(recorded(seed, tilt), velocity)
        limits = stage_of(recording.stage).limits
        if abs(speed) < 0.5:  # it stands, or turns about
            continue
        explained = limits.following_error / (0.5 * abs(speed)) + limits.latency
        times, doubted, _ = run(recording)
        assert "command" in doubted, seed
        late = BEGIN + explained + 4 * WINDOW
        assert not ((times > late) & (times < END)).any(), (seed, speed)
        if TURNING[seed % len(TURNING)] == "steady":
            assert (times > DURATION - 0.5).sum() > 450, "it moves again"
        told += 1
    assert told >= 6


@shows(
    Row(
        "command",
        "The same, and its velocity is 0 as well",
        "`error_estimator: estimate` names the command where readings that turn with the rotor (artefact, mirror, "
        "described error motion) run four times more smoothly, in mean square, if the rotor goes on as fast as before: "
        "in most cases within 0.5 s. It is not told where these are small, or the rotor changes its speed meanwhile",
        "the command is not used from then on",
        "until then error motion of a wrong rotation; then nothing",
        "once it has moved again for 0.5 s, no faster than the axis can turn",
    )
)
@pytest.mark.parametrize("tilt", [False, True])
def test_a_command_that_stands_still_in_all_while_the_rotor_turns_is_mostly_told_by_what_turns_with_it(tilt):
    """A rotor that goes on steadily: at least three of four; never is something doubted that another speed explains."""
    told = []
    for seed in range(2, 2 + 4 * 12, 4):  # those that turn steadily
        recording, speed = stuck(recorded(seed, tilt), "zero")
        assert TURNING[seed % len(TURNING)] == "steady" and abs(speed) > 0.05
        times, _, _ = run(recording)
        told.append(not ((times > BEGIN + 0.5) & (times < END)).any())
    assert np.mean(told) >= 0.75, told


@pytest.mark.parametrize("tilt", [False, True])
@pytest.mark.parametrize("seed", range(24))
def test_a_command_that_moves_and_stops_as_it_says_is_believed(seed, tilt):
    _, doubted, _ = run(recorded(seed, tilt))
    assert "command" not in doubted


@pytest.mark.parametrize("seed", range(0, 12, 2))
def test_a_velocity_that_nobody_filled_in_contradicts_nothing(seed):
    """Drivers without a velocity say 0: an angle that moves is the rotation all the same."""
    unfilled = with_command(recorded(seed), lambda seconds, values: values * [1.0, 0.0])
    times, doubted, _ = run(unfilled)
    right, _, _ = run(recorded(seed))
    assert "command" not in doubted and len(times) == len(right)


@pytest.mark.parametrize("velocity", ["frozen", "zero"])
def test_a_replay_of_a_command_that_was_stuck_gives_the_same_bits(velocity):
    recording, _ = stuck(recorded(2), velocity)
    stage, pairs = streams_of(recording)
    live = published(Estimator(stage), pairs)
    assert_same_bits(repeated(stage, pairs, live), live)
