"""Counts follow corrections through every surprise that the controller has in store."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.linuxcnc_controller import offsets
from rotary_error_monitor.linuxcnc_controller.kinematics import TrivialKinematics
from rotary_error_monitor.linuxcnc_controller.offsets import ControllerReading, OffsetControl, OffsetLimits
from rotary_error_monitor.linuxcnc_controller.shaping import CourseLimits

COUNT = 1e-10
LARGEST, SPEED, ACCELERATION = (1e-4, 1e-3), (2e-3, 2e-2), (0.05, 0.5)
LIMITS = OffsetLimits((COUNT, COUNT), CourseLimits(LARGEST, SPEED, ACCELERATION))
NOW = 1_000_000_000_000
LOOK = 0.004


class Machine:
    """Two axes whose requested offset follows the counts at once, unless a test meddles."""

    def __init__(self, counts=(0, 0), requested=(0.0, 0.0)):
        self.reading = ControllerReading(
            stamp_ns=NOW, axes=(0.1, 0.2), joints=(0.1, 0.2), commands=(0.1, 0.2), joint_velocities=(0, 0),
            requested=requested, applied=requested, counts=counts, enabled=True, homed=True, coordinated=True,
            limited=False, pulse=0,
        )  # fmt: skip
        self.control = OffsetControl("XA", LIMITS)
        self.kinematics = TrivialKinematics()

    def change(self, **values):
        self.reading = dataclasses.replace(self.reading, **values)

    def step(self, *, late=False):
        """One look; `late`: no servo period has passed since the last."""
        self.change(stamp_ns=self.reading.stamp_ns + 4_000_000, pulse=self.reading.pulse + (not late))
        step = self.control.step(self.reading, self.kinematics, self.reading.stamp_ns)
        if step.counts is not None and not late:
            moved = [(new - old) * COUNT for new, old in zip(step.counts, self.reading.counts, strict=True)]
            requested = tuple(a + b for a, b in zip(self.reading.requested, moved, strict=True))
            self.change(counts=step.counts, requested=requested)
        return step

    def settle(self):
        for _ in range(LIMITS.settling + 1):
            step = self.step()
        return step

    def correct(self, *positions):
        self.control.aim(positions)

    def arrive(self, *positions):
        """Correct, and take the time that the way takes: at most a tenth of a second for the largest."""
        self.correct(*positions)
        for _ in range(60):
            step = self.step()
        return step


def test_offsets_reach_the_corrections_to_the_count():
    machine = Machine()
    assert machine.arrive(12.3e-6, -1e-4).held == ""
    assert machine.reading.counts == (123000, -1000000)
    assert machine.reading.requested == pytest.approx((12.3e-6, -1e-4), abs=COUNT / 2)


def test_what_stands_on_the_pins_from_before_is_taken_over_without_a_step():
    """A bridge that starts again finds counts and offsets of its predecessor, here far beyond what is asked for now."""
    machine = Machine(counts=(777, -5), requested=(9e-5, 3e-6))
    machine.correct(1e-6, 0.0)
    machine.settle()
    assert machine.reading.requested == pytest.approx((9e-5, 3e-6), abs=ACCELERATION[1] * LOOK**2)
    machine.arrive(1e-6, 0.0)
    assert machine.reading.requested == pytest.approx((1e-6, 0.0), abs=COUNT)
    assert machine.control.takeovers == 0


def test_nothing_is_written_before_the_first_correction_or_before_the_numbers_settle():
    machine = Machine(requested=(2e-6, 0.0))
    assert machine.step().held == offsets.SETTLING
    step = machine.settle()
    assert step.counts is None
    assert step.held == offsets.WAITING
    assert machine.control.to_go == (0.0, 0.0)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"enabled": False}, "the machine is off"),
        ({"homed": False}, "the machine is not homed"),
        ({"coordinated": False}, "the machine is in joint mode"),
    ],
)
def test_nothing_is_written_while_the_controller_would_lose_or_queue_it(change, reason):
    """What was asked for before or meanwhile is forgotten: the machine may be elsewhere when it goes on."""
    machine = Machine()
    machine.arrive(1e-6, 0.0)
    machine.change(**change)
    machine.correct(2e-6, 0.0)
    step = machine.step()
    assert (step.counts, step.held) == (None, reason)
    machine.change(enabled=True, homed=True, coordinated=True)
    assert machine.settle().held == offsets.WAITING
    machine.arrive(3e-6, 0.0)
    assert machine.reading.requested == pytest.approx((3e-6, 0.0), abs=COUNT)


def test_after_machine_off_and_on_the_zeroed_number_is_the_new_start():
    machine = Machine()
    machine.arrive(1e-6, 2e-6)
    machine.change(enabled=False)
    machine.step()
    machine.change(enabled=True, requested=(0.0, 0.0))
    machine.settle()
    assert machine.reading.requested == (0.0, 0.0)
    machine.arrive(1e-6, 2e-6)
    assert machine.reading.requested == pytest.approx((1e-6, 2e-6), abs=COUNT)


def test_a_number_changed_by_another_hand_is_taken_over_once_it_stays():
    machine = Machine()
    machine.arrive(1e-6, 2e-6)
    machine.change(requested=(0.0, 0.0))
    for _ in range(LIMITS.settling):
        assert machine.step().counts is not None
        assert machine.control.takeovers == 0
    machine.arrive(1e-6, 2e-6)
    assert machine.control.takeovers == 1
    assert machine.reading.requested == pytest.approx((1e-6, 2e-6), abs=COUNT)


def test_counts_written_by_another_hand_are_taken_over_too_and_no_step_follows():
    machine = Machine()
    machine.arrive(1e-6, 2e-6)
    machine.change(counts=(5, 5), requested=(8e-5, 0.0))
    machine.settle()
    assert machine.control.takeovers == 1
    assert machine.reading.requested == pytest.approx((8e-5, 0.0), abs=2 * ACCELERATION[1] * LOOK**2)
    machine.arrive(1e-6, 2e-6)
    assert machine.reading.requested == pytest.approx((1e-6, 2e-6), abs=COUNT)


def test_a_controller_that_pauses_is_not_taken_for_another_hand():
    """Without real time the servo thread stops for a while now and then; counts written meanwhile are not lost."""
    machine = Machine()
    machine.arrive(1e-6, 0.0)
    machine.correct(3e-6, 0.0)
    for _ in range(10 * LIMITS.settling):
        step = machine.step(late=True)
        machine.change(counts=step.counts)
    machine.change(requested=(3e-6, 0.0))
    assert machine.step().counts == step.counts
    assert machine.control.takeovers == 0


def test_without_new_corrections_it_comes_to_rest_at_the_last():
    machine = Machine()
    machine.correct(9e-5, 0.0)
    for _ in range(1000):
        machine.step()
    assert machine.reading.requested == pytest.approx((9e-5, 0.0), abs=COUNT)


def test_a_halt_comes_to_rest_on_the_way_and_the_next_correction_is_followed():
    machine = Machine()
    machine.correct(1e-4, 0.0)
    machine.settle()
    for _ in range(5):
        machine.step()
    machine.control.halt()
    assert machine.control.to_go[0] > 0
    before = machine.reading.requested[0]
    for _ in range(100):
        machine.step()
    assert before < machine.reading.requested[0] < 5e-5
    assert machine.control.to_go == (0.0, 0.0)
    machine.arrive(1e-4, 0.0)
    assert machine.reading.requested == pytest.approx((1e-4, 0.0), abs=COUNT)


class Moved(TrivialKinematics):
    """The same machine by other kinematics: a joint is its axis turned round."""

    def to_joints(self, axes):
        return tuple(-axis for axis in axes)

    to_axes = to_joints

    def __eq__(self, other):
        return isinstance(other, Moved)


def test_other_kinematics_make_no_step():
    machine = Machine()
    machine.arrive(9e-5, 0.0)
    machine.kinematics = Moved()
    machine.step()
    assert machine.reading.requested == pytest.approx((9e-5, 0.0), abs=ACCELERATION[0] * LOOK**2)
    machine.arrive(9e-5, 0.0)
    assert machine.reading.requested == pytest.approx((-9e-5, 0.0), abs=COUNT)


@pytest.mark.parametrize("positions", [(math.nan, 0.0), (2e-4, 0.0), (0.0, -math.inf), (0.0,), (0.0, 0.0, 0.0)])
def test_wrong_corrections_do_not_come_so_far_and_change_nothing_if_they_do(positions):
    machine = Machine()
    machine.arrive(1e-6, 0.0)
    with pytest.raises(InputError, match="expected at most"):
        machine.control.aim(positions)
    machine.settle()
    assert machine.reading.requested == pytest.approx((1e-6, 0.0), abs=COUNT)


def test_counts_at_the_end_of_their_pins_are_not_wrapped():
    machine = Machine(counts=(2**31 - 10, 0))
    step = machine.arrive(1e-6, 0.0)
    assert step.counts is None
    assert "end of their 32 bits" in step.held


shares = st.tuples(st.floats(-1, 1), st.floats(-1, 1))


@settings(max_examples=100, deadline=None)
@given(shares, st.lists(st.tuples(st.one_of(st.none(), shares), st.booleans()), min_size=10, max_size=120))
def test_offsets_keep_size_speed_and_acceleration_whatever_is_asked(start, history):
    """To half a count, by which each is rounded."""
    machine = Machine(requested=tuple(np.multiply(start, LARGEST).tolist()))
    machine.settle()
    seen = [machine.reading.requested]
    for target, halts in history:
        if target is not None:
            machine.correct(*np.multiply(target, LARGEST).tolist())
        elif halts:
            machine.control.halt()
        machine.step()
        seen.append(machine.reading.requested)
    speeds = np.diff(seen, axis=0) / LOOK
    changes = np.diff(speeds, axis=0) / LOOK
    assert (np.abs(seen) <= np.array(LARGEST) + COUNT).all()
    assert (np.abs(speeds) <= np.array(SPEED) + COUNT / LOOK).all()
    assert (np.abs(changes) <= np.array(ACCELERATION) + 2.001 * COUNT / LOOK**2).all()


def test_only_joints_that_the_program_moves_have_a_velocity():
    assert offsets.commanded_velocities((0.0, 1.0), (0.0, 1.1), (3e-6, 0.2)) == (0.0, 0.2)


def test_corrections_of_offsets_are_what_they_move_the_joints_by():
    assert offsets.corrections_of(Moved(), (0.5, 1.0), (1e-6, -2e-6)) == pytest.approx((-1e-6, 2e-6), abs=1e-15)
