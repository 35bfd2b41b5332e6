"""The memory of the last turns: how far back it goes, what bounds it, and what makes it start anew."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.pipeline.recent_turns import RecentTurns
from rotary_error_monitor.signals.blocks import SampleBlock, block_from_samples

STREAMS = {"command": ("angle", "velocity"), "head_a": ("angle",), "force": ("force_x", "force_y")}
STEP_NS = 10_000_000  # 100 samples a second, blocks of ten
BLOCK = 10
EPOCH_NS = 1_700_000_000_000_000_123


def recent(turns=3.0, shortest=0.0, longest=60.0, most_samples=100_000, rate=np.inf):
    return RecentTurns(STREAMS, "command", turns, shortest, longest, most_samples, rate)


def command_block(number, speed=2 * np.pi, start=0.0, first_ns=EPOCH_NS):
    index = np.arange(number * BLOCK, (number + 1) * BLOCK)
    angle = start + speed * index * STEP_NS * 1e-9
    values = np.stack([angle, np.full(BLOCK, speed)], axis=1)
    return block_from_samples(first_ns + index * STEP_NS, STREAMS["command"], values)


def head_block(number, first_ns=EPOCH_NS + 3_000_000):
    index = np.arange(number * BLOCK, (number + 1) * BLOCK)
    return block_from_samples(first_ns + index * STEP_NS, ("angle",), index[:, None].astype(float))


def run(memory, blocks, speed=2 * np.pi, silent=()):
    for number in blocks:
        if "command" not in silent:
            memory.push("command", command_block(number, speed))
        if "head_a" not in silent:
            memory.push("head_a", head_block(number))


def times(memory, stream, span=0.0):
    return np.concatenate([block.times_ns for block in memory.blocks(span)[stream]])


@pytest.mark.parametrize("speed", [2 * np.pi, -2 * np.pi], ids=["forward", "backward"])
def test_it_goes_back_to_where_the_last_turns_began(speed):
    memory = recent()
    run(memory, range(25), speed)
    assert not memory.is_full
    run(memory, range(25, 100), speed)
    assert memory.is_full
    assert 3.0 <= memory.turns < 3.0 + 0.11  # a turn a second, blocks of a tenth
    assert memory.duration == pytest.approx(3.0, abs=0.11)
    kept = times(memory, "command")
    assert kept[-1] == memory.newest_ns == EPOCH_NS + 999 * STEP_NS
    assert (np.diff(kept) == STEP_NS).all()


def test_other_streams_cover_what_the_command_covers():
    memory = recent()
    run(memory, range(100))
    command, head = times(memory, "command"), times(memory, "head_a")
    assert command[0] <= head[0] < command[0] + STEP_NS
    assert command[-1] - STEP_NS < head[-1] <= command[-1]
    assert "force" not in memory.blocks()


def test_a_stream_that_fell_silent_before_the_last_turns_is_left_out():
    memory = recent()
    run(memory, range(20))
    run(memory, range(20, 40), silent=("head_a",))
    assert times(memory, "head_a")[-1] < EPOCH_NS + 200 * STEP_NS
    run(memory, range(40, 60), silent=("head_a",))
    assert set(memory.blocks()) == {"command"}
    assert recent().blocks() == {}


def test_joined_blocks_hold_the_same_samples():
    memory = recent()
    run(memory, range(40))
    alone, joined = memory.blocks()["head_a"], memory.blocks(0.5)["head_a"]
    assert len(alone) >= 30 > 8 >= len(joined)
    for column in ("angle",):
        np.testing.assert_array_equal(
            np.concatenate([block.column(column) for block in alone]),
            np.concatenate([block.column(column) for block in joined]),
        )
    np.testing.assert_array_equal(times(memory, "head_a"), times(memory, "head_a", 0.5))
    assert all(block.times_ns[-1] - block.times_ns[0] < 0.61e9 for block in joined)


def test_time_bounds_it_when_the_stage_hardly_turns():
    memory = recent(longest=2.0)
    run(memory, range(15), speed=0.0)
    assert not memory.is_full
    run(memory, range(15, 100), speed=0.0)
    assert memory.is_full and memory.turns == 0.0
    assert 1.8 <= memory.duration <= 2.0
    run(memory, range(100, 200), silent=("command",))
    assert times(memory, "command")[-1] == EPOCH_NS + 999 * STEP_NS, "the rest of the command is still there"


def test_it_keeps_a_shortest_time_when_the_stage_turns_fast():
    memory = recent(turns=1.0, shortest=4.0)
    run(memory, range(39))
    assert memory.turns > 3 and not memory.is_full
    run(memory, range(39, 100))
    assert memory.is_full
    assert 4.0 <= memory.duration <= 4.2


def test_a_number_of_samples_bounds_it_when_they_come_fast():
    memory = recent(turns=1000.0, longest=3600.0, most_samples=200)
    run(memory, range(100))
    assert memory.is_full
    assert len(times(memory, "command")) == 200
    memory.clear()
    assert not memory.is_full and memory.blocks() == {}


@pytest.mark.parametrize(("rate", "stride"), [(100.0, 1), (51.0, 1), (50.0, 2), (30.0, 3), (7.0, 14)])
def test_fast_streams_are_thinned_evenly(rate, stride):
    memory = recent(turns=2.0, rate=rate)
    run(memory, range(100))
    for stream in ("command", "head_a"):
        assert (np.diff(times(memory, stream)) == stride * STEP_NS).all()
    (values,) = {tuple(np.diff(block.column("angle"))) for block in memory.blocks(100.0)["head_a"]}
    assert set(values) == {float(stride)}, "each sample is one that came"
    assert memory.turns == pytest.approx(2.0, abs=0.11 + 0.02 * stride)


def test_blocks_of_one_sample_are_thinned_too():
    memory = recent(rate=25.0)
    command = command_block(0)
    for row, time_ns in zip(command.rows, command.times_ns, strict=True):
        memory.push("command", block_from_samples(np.array([time_ns]), STREAMS["command"], row[None, 1:]))
    assert len(times(memory, "command")) <= 4
    assert set(np.diff(times(memory, "command"))[1:]) == {4 * STEP_NS}


def test_what_came_before_is_dropped_and_counted():
    memory = recent()
    run(memory, range(20))
    memory.push("head_a", head_block(12))
    assert memory.late == 1
    assert (np.diff(times(memory, "head_a")) > 0).all()


def test_a_clock_that_was_set_back_starts_anew():
    memory = recent()
    run(memory, range(20))
    memory.push("command", command_block(0, first_ns=EPOCH_NS - 3_600_000_000_000))
    assert len(times(memory, "command")) == BLOCK
    assert "head_a" not in memory.blocks()


def test_an_angle_that_is_counted_anew_starts_anew():
    memory = recent()
    run(memory, range(20))
    memory.push("command", command_block(20, start=-40.0))
    assert len(times(memory, "command")) == BLOCK
    assert memory.turns < 0.1


def test_a_gap_in_the_command_is_travelled_at_its_speed():
    memory = recent(turns=10.0)
    run(memory, range(5))
    run(memory, range(25, 30))
    assert memory.turns == pytest.approx(3.0, abs=0.02)


def test_a_block_without_the_columns_is_refused():
    memory = recent()
    with pytest.raises(InputError, match="no field 'velocity'"):
        memory.push("command", SampleBlock(0, ("t", "angle"), np.zeros((2, 2))))
    assert memory.blocks() == {}
