"""Sources that gather samples, poll devices, or ask the mock stage."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.sources.mock import MockSettings, MockSource, last_midnight, mock_stage
from rotary_error_monitor.sources.mock_machine import MachineMotion
from rotary_error_monitor.sources.source import Gathered, Polled

EPOCH = 1_700_000_000_000_000_000
MS = 1_000_000
SETTINGS = MockSettings(seed=3, epoch_ns=EPOCH, speeds=(0.5, 1.5), rate=10_000.0)


def test_gathered_samples_become_blocks():
    source = Gathered(("x", "y"))
    assert source.take(0, 100) is None
    for time in (10, 20, 30):
        source.add(time, (float(time), -float(time)))
    block = source.take(0, 30)
    assert block is not None
    assert block.times_ns.tolist() == [10, 20]
    assert block.column("y").tolist() == [-10.0, -20.0]
    source.add(35, (0.0, 0.0))
    late = source.take(40, 80)
    assert late is not None
    assert late.times_ns.tolist() == [30, 35], "what came late for its block is in the next one"
    assert source.take(40, 80) is None


@pytest.mark.parametrize(
    ("time", "values", "problem"),
    [
        (10, (1.0,), "not after the one before"),
        (11, (float("nan"),), "expected 1 finite numbers"),
        (11, (1.0, 2.0), "expected 1 finite numbers"),
    ],
)
def test_samples_that_cannot_be_used(time, values, problem):
    source = Gathered(("angle",))
    source.add(10, (0.0,))
    with pytest.raises(InputError, match=problem):
        source.add(time, values)


@pytest.mark.parametrize("ahead_s", [0.2, 5.0, 3600.0, 86400.0 * 365])
def test_a_sample_from_the_future_is_refused_and_the_next_one_is_taken(ahead_s):
    source = Gathered(("angle",))
    source.add(EPOCH, (0.0,), EPOCH + MS)
    with pytest.raises(InputError, match=r"a sample stamped in the future: .* ahead of this computer's clock"):
        source.add(EPOCH + round(ahead_s * 1e9), (1.0,), EPOCH + 2 * MS)
    source.add(EPOCH + 3 * MS, (2.0,), EPOCH + 4 * MS)
    block = source.take(EPOCH, EPOCH + 5 * MS)
    assert block is not None and block.column("angle").tolist() == [0.0, 2.0]


def test_an_old_sample_is_refused():
    source = Gathered(("angle",))
    with pytest.raises(InputError, match="too old at arrival"):
        source.add(EPOCH, (0.0,), EPOCH + 2000 * MS)


@pytest.mark.parametrize("polled", [False, True])
def test_a_clock_that_is_set_back_ends_no_source(polled):
    class Device:
        def read(self) -> tuple[float]:
            return (4.0,)

    source = Polled(("angle",), Device()) if polled else Gathered(("angle",))
    for time in (EPOCH, EPOCH - 3600 * 1000 * MS):
        if isinstance(source, Polled):
            source.poll(time)
        else:
            source.add(time, (4.0,), time)
        block = source.take(time, time + MS)
        assert block is not None and block.times_ns.tolist() == [time]


def test_polled_device():
    class Device:
        def read(self) -> tuple[float]:
            return (4.0,)

    source = Polled(("angle",), Device())
    source.poll(5)
    block = source.take(0, 10)
    assert block is not None
    assert (block.times_ns.tolist(), block.column("angle").tolist()) == ([5], [4.0])


@given(st.lists(st.integers(1, 400), min_size=1, max_size=8))
def test_blocks_of_the_mock_stage_do_not_depend_on_how_they_are_asked_for(lengths_ms):
    plant = mock_stage(load_stage(), SETTINGS)
    source, start = MockSource(plant, "head_b"), EPOCH + 1_000 * MS
    blocks, since = [], start
    for length in lengths_ms:
        blocks.append(source.take(since, since + length * MS))
        since += length * MS
    first = plant.index_at("head_b", start)
    whole = plant.samples("head_b", first, plant.index_at("head_b", since) - first)
    found = [block for block in blocks if block is not None]
    np.testing.assert_array_equal(np.concatenate([block.times_ns for block in found]), whole.times_ns)
    np.testing.assert_array_equal(np.concatenate([block.column("angle") for block in found]), whole.column("angle"))


def test_no_sample_is_no_block():
    source = MockSource(mock_stage(load_stage(), SETTINGS), "temperature")
    assert source.take(EPOCH + 1 * MS, EPOCH + 2 * MS) is None


def test_forces_can_be_left_out():
    quiet = mock_stage(load_stage(), MockSettings(3, EPOCH, (0.5,), forces=False))
    pushed = mock_stage(load_stage(), MockSettings(3, EPOCH, (0.5,)))
    time = np.linspace(0, 40, 4000)
    assert not quiet.forces.at(time).any()
    assert np.abs(pushed.forces.at(time)).max() > 1.0


def test_midnight():
    assert last_midnight(EPOCH) <= EPOCH < last_midnight(EPOCH) + 86_400 * 1000 * MS
    assert last_midnight(EPOCH) % (86_400 * 1000 * MS) == 0


@pytest.mark.parametrize("name", ["xyzac_trt", "pan2013"])
def test_the_mock_machine_moves_within_its_travel(name):
    machine, plant = load_machine(name), mock_stage(load_stage(), SETTINGS)
    motion = MachineMotion(machine, plant)
    times = EPOCH + np.arange(0, 40_000, 250) * MS
    states = [motion.at(int(time)) for time in times]
    assert tuple(state.letter for state in states[0]) == machine.letters
    positions = np.array([[axis.position for axis in state] for state in states])
    later = np.array([[axis.position for axis in motion.at(int(time) + 1000)] for time in times])
    velocities = np.array([[axis.velocity for axis in state] for state in states])
    np.testing.assert_allclose((later - positions) / 1e-6, velocities, atol=2e-3)
    for column, axis in enumerate(machine.axes):
        if axis.letter == machine.monitored:
            command, _ = plant.motion.at((times - EPOCH) * 1e-9)
            np.testing.assert_allclose(positions[:, column], command, atol=1e-9)
        else:
            assert axis.travel[0] < positions[:, column].min() < positions[:, column].max() < axis.travel[1]
