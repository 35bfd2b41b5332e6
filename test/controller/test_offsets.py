"""Counts follow corrections through every surprise that the controller has in store."""

import dataclasses
import math

import pytest

from rotary_error_monitor.controller import offsets
from rotary_error_monitor.controller.kinematics import TrivialKinematics
from rotary_error_monitor.controller.offsets import Correction, OffsetControl, OffsetLimits, Reading
from rotary_error_monitor.errors import InputError

COUNT = 1e-10
LIMITS = OffsetLimits((COUNT, COUNT), (1e-4, 1e-3), 0.1)
NOW = 1_000_000_000_000


class Machine:
    """Two axes whose requested offset follows the counts at once, unless a test meddles."""

    def __init__(self, counts=(0, 0), requested=(0.0, 0.0)):
        self.reading = Reading(
            stamp_ns=NOW, axes=(0.1, 0.2), joints=(0.1, 0.2), joint_velocities=(0, 0), requested=requested,
            applied=requested, counts=counts, enabled=True, homed=True, coordinated=True, limited=False, pulse=0,
        )  # fmt: skip
        self.control = OffsetControl("XA", LIMITS)

    def change(self, **values):
        self.reading = dataclasses.replace(self.reading, **values)

    def step(self, *, late=False):
        """One look; `late`: no servo period has passed since the last."""
        self.change(stamp_ns=self.reading.stamp_ns + 4_000_000, pulse=self.reading.pulse + (not late))
        step = self.control.step(self.reading, TrivialKinematics())
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
        self.control.accept(Correction(self.reading.stamp_ns, positions), self.reading.stamp_ns)


def test_offsets_reach_the_corrections_to_the_count():
    machine = Machine()
    machine.correct(12.3e-6, -1e-4)
    machine.settle()
    assert machine.step().held == ""
    assert machine.reading.counts == (123000, -1000000)
    assert machine.reading.requested == pytest.approx((12.3e-6, -1e-4), abs=COUNT / 2)


def test_what_stands_on_the_pins_from_before_is_taken_over_not_added_to():
    """A bridge that starts again finds counts and offsets of its predecessor."""
    machine = Machine(counts=(777, -5), requested=(2e-6, 3e-6))
    machine.correct(1e-6, 0.0)
    machine.settle()
    assert machine.reading.requested == pytest.approx((1e-6, 0.0), abs=COUNT)
    assert machine.control.takeovers == 0


def test_nothing_is_written_before_the_first_correction_or_before_the_numbers_settle():
    machine = Machine(requested=(2e-6, 0.0))
    assert machine.step().held == "the controller's offsets settle"
    step = machine.settle()
    assert step.counts is None
    assert step.held == "no correction has come yet"


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"enabled": False}, "the machine is off"),
        ({"homed": False}, "the machine is not homed"),
        ({"coordinated": False}, "the machine is in joint mode"),
    ],
)
def test_nothing_is_written_while_the_controller_would_lose_or_queue_it(change, reason):
    machine = Machine()
    machine.correct(1e-6, 0.0)
    machine.settle()
    machine.change(**change)
    machine.correct(2e-6, 0.0)
    step = machine.step()
    assert (step.counts, step.held) == (None, reason)


def test_after_machine_off_and_on_the_zeroed_number_is_the_new_start():
    machine = Machine()
    machine.correct(1e-6, 2e-6)
    machine.settle()
    machine.change(enabled=False)
    machine.step()
    machine.change(enabled=True, requested=(0.0, 0.0))
    machine.settle()
    assert machine.reading.requested == pytest.approx((1e-6, 2e-6), abs=COUNT)


def test_a_number_changed_by_another_hand_is_taken_over_once_it_stays():
    machine = Machine()
    machine.correct(1e-6, 2e-6)
    machine.settle()
    machine.change(requested=(0.0, 0.0))
    for _ in range(LIMITS.settling):
        assert machine.step().counts is not None
        assert machine.control.takeovers == 0
    machine.settle()
    assert machine.control.takeovers == 1
    assert machine.reading.requested == pytest.approx((1e-6, 2e-6), abs=COUNT)


def test_counts_written_by_another_hand_are_taken_over_too():
    machine = Machine()
    machine.correct(1e-6, 2e-6)
    machine.settle()
    machine.change(counts=(5, 5))  # while offsets were disabled, say: the number has not followed
    machine.settle()
    machine.settle()
    assert machine.control.takeovers == 1
    assert machine.reading.requested == pytest.approx((1e-6, 2e-6), abs=COUNT)


def test_a_controller_that_pauses_is_not_taken_for_another_hand():
    """Without real time the servo thread stops for a while now and then; counts written meanwhile are not lost."""
    machine = Machine()
    machine.correct(1e-6, 0.0)
    machine.settle()
    machine.correct(3e-6, 0.0)
    step = machine.step(late=True)
    machine.change(counts=step.counts)
    for _ in range(10 * LIMITS.settling):
        assert machine.step(late=True).counts == step.counts
    machine.change(requested=(3e-6, 0.0))
    assert machine.step().counts == step.counts
    assert machine.control.takeovers == 0


def test_an_old_correction_is_held_and_said_so():
    machine = Machine()
    machine.correct(1e-6, 0.0)
    machine.settle()
    counts = machine.reading.counts
    machine.change(stamp_ns=machine.reading.stamp_ns + 200_000_000)
    step = machine.step()
    assert (step.counts, step.held) == (counts, offsets.STALE)
    machine.correct(2e-6, 0.0)
    assert machine.step().held == ""


def test_an_overtaken_correction_changes_nothing():
    machine = Machine()
    machine.correct(1e-6, 0.0)
    older = Correction(NOW - 1_000_000, (9e-6, 0.0))
    machine.control.accept(older, NOW)
    assert machine.control.correction == Correction(NOW, (1e-6, 0.0))


@pytest.mark.parametrize(
    ("correction", "message"),
    [
        (Correction(NOW, (math.nan, 0.0)), "correction of X is nan; expected at most 0.0001"),
        (Correction(NOW, (2e-4, 0.0)), "correction of X is 0.0002; expected at most 0.0001"),
        (Correction(NOW, (0.0, -math.inf)), "correction of A is -inf; expected at most 0.001"),
        (Correction(NOW, (0.0,)), "1 corrections for the axes X A"),
        (Correction(NOW - 200_000_000, (0.0, 0.0)), "correction is 0.2 s old; expected at most 0.1 s"),
        (Correction(NOW + 200_000_000, (0.0, 0.0)), "correction is -0.2 s old; expected at most 0.1 s"),
    ],
)
def test_a_wrong_correction_is_refused_and_the_last_one_stays(correction, message):
    control = OffsetControl("XA", LIMITS)
    control.accept(Correction(NOW, (1e-6, 0.0)), NOW)
    with pytest.raises(InputError, match=message):
        control.accept(correction, NOW)
    assert control.correction == Correction(NOW, (1e-6, 0.0))


def test_counts_at_the_end_of_their_pins_are_not_wrapped():
    machine = Machine(counts=(2**31 - 10, 0))
    machine.correct(1e-6, 0.0)
    step = machine.settle()
    assert step.counts is None
    assert "end of their 32 bits" in step.held


def test_only_joints_that_the_program_moves_have_a_velocity():
    assert offsets.commanded_velocities((0.0, 1.0), (0.0, 1.1), (3e-6, 0.2)) == (0.0, 0.2)
