"""Faults among right corrections, at random times: what is commanded stays within what the right ones said."""

import math

import numpy as np
import pytest
from faults.documenting import Row, shows
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from rotary_error_monitor.linuxcnc_controller.gate import CorrectionMessage, GateLimits, RefusalError
from rotary_error_monitor.linuxcnc_controller.intake import CorrectionIntake
from rotary_error_monitor.linuxcnc_controller.kinematics import RotaryTableKinematics, TrivialKinematics
from rotary_error_monitor.linuxcnc_controller.offsets import (
    ControllerReading,
    OffsetControl,
    OffsetLimits,
    corrections_of,
)
from rotary_error_monitor.linuxcnc_controller.protocol import LinkSettings

AXES = tuple("XYZAC")
SETTINGS = LinkSettings()
LIMITS = SETTINGS.course_limits(name in "AC" for name in AXES)
COUNT = SETTINGS.count
MS, LOOK_NS = 10**6, 4_000_000
NOW = 1_800_000_000_000_000_000
TABLE = RotaryTableKinematics((0.003, -0.005, 0.007), (0.020, 0.010), 0.047)
AFTER_FAULT = 1.0
"""Time after the end of a fault from which corrections are followed again, s."""


class Bridge:
    """Intake and offsets of a machine whose numbers follow the counts at once, looked at 250 times a second."""

    def __init__(self, kinematics):
        self.intake = CorrectionIntake(GateLimits(AXES, LIMITS.largest, AXES))
        self.control = OffsetControl(AXES, OffsetLimits((COUNT,) * 5, LIMITS))
        self.kinematics, self.look_number = kinematics, 0
        self.last_ns = 0
        self.counts = (0,) * 5
        self.requested = (0.0,) * 5
        self.listed = ("/compensation",)

    @property
    def time_ns(self):
        return self.look_number * LOOK_NS

    @property
    def hold(self):
        return self.intake.hold(self.time_ns)

    def receive(self, message, number):
        if not self.intake.sources.continues(number):
            self.intake.sources.enlist(self.listed, self.time_ns)
        try:
            believed = self.intake.take(message, number, NOW + self.time_ns, self.time_ns)
            self.control.aim(believed.positions)
            self.last_ns = believed.stamp_ns
        except RefusalError:
            if self.intake.sources.trouble(self.time_ns):
                self.control.halt()

    def look(self, axes):
        """Corrections of the joints after the look."""
        self.look_number += 1
        if self.look_number % 60 == 0:
            self.intake.sources.enlist(self.listed, self.time_ns)
        reading = ControllerReading(
            stamp_ns=NOW + self.time_ns, axes=axes, joints=(), commands=(), joint_velocities=(),
            requested=self.requested, applied=self.requested,
            counts=self.counts, enabled=True, homed=True, coordinated=True, limited=False, pulse=self.look_number,
        )  # fmt: skip
        step = self.control.step(reading, self.kinematics, self.time_ns)
        if step.counts is not None:
            moved = [(new - old) * COUNT for new, old in zip(step.counts, self.counts, strict=True)]
            self.requested = tuple(np.add(self.requested, moved).tolist())
            self.counts = step.counts
        return corrections_of(self.kinematics, axes, self.requested)


def right(time_s):
    """Corrections as a program asks for: some 30 um/s and 0.3 mrad/s at most."""
    waves = np.sin(2 * math.pi * time_s * np.array([0.5, 0.3, 0.7, 0.2, 0.4]) + np.arange(5))
    return tuple((waves * [1e-5, 2e-5, 5e-6, 1e-4, 1e-4]).tolist())


def stamped(bridge, positions, names=AXES, age_ns=30 * MS):
    return CorrectionMessage(NOW + bridge.time_ns - age_ns, names, positions)


FAR = (4e-4, -4e-4, 4e-4, 4e-3, -4e-3)
FAULTS = {
    "X alone": lambda b: stamped(b, (4e-4,), ("X",)),
    "empty": lambda b: stamped(b, (), ()),
    "X twice": lambda b: stamped(b, (4e-4, *FAR), ("X", *AXES)),
    "no positions": lambda b: stamped(b, ()),
    "NaN": lambda b: stamped(b, (*FAR[:4], math.nan)),
    "infinite": lambda b: stamped(b, (-math.inf, *FAR[1:])),
    "1e300": lambda b: stamped(b, (1e300, *FAR[1:])),
    "mm for m": lambda b: stamped(b, tuple(1e3 * value for value in right(0.3))),
    "no stamp": lambda b: CorrectionMessage(0, AXES, FAR),
    "old": lambda b: stamped(b, FAR, age_ns=101 * MS),
    "10 ms ahead": lambda b: stamped(b, FAR, age_ns=-10 * MS),
    "1 h ahead": lambda b: stamped(b, FAR, age_ns=-3600 * 10**9),
    "365 days ahead": lambda b: stamped(b, FAR, age_ns=-365 * 86400 * 10**9),
    "repeated stamp": lambda b: CorrectionMessage(b.last_ns, AXES, FAR),
    "falling stamp": lambda b: CorrectionMessage(b.last_ns - MS, AXES, FAR),
    "nothing comes": lambda b: None,
}
begins, durations, gaps = st.integers(100, 200), st.integers(1, 150), st.integers(1, 4)
TAIL = 270


def check_bounds(seen):
    """Size, speed and acceleration of all that was commanded, to the rounding of counts, turned by the table."""
    step, rounding = LOOK_NS * 1e-9, 4 * COUNT
    speeds = np.diff(seen, axis=0) / step
    changes = np.diff(speeds, axis=0) / step
    assert (np.abs(seen) <= np.array(LIMITS.largest) + rounding).all()
    assert (np.abs(speeds) <= np.array(LIMITS.speed) + rounding / step).all()
    assert (np.abs(changes) <= np.array(LIMITS.acceleration) + 2 * rounding / step**2).all()


def run(bridge, inject, looks):
    """What was commanded and whether it was held, look after look; `inject(number, look)` sends what comes then."""
    commanded, held = [], []
    for look in range(looks):
        inject(look)
        angle = 0.5 * look * LOOK_NS * 1e-9
        axes = (0.03, -0.02, 0.04, 0.3 * math.sin(angle), angle)
        commanded.append(bridge.look(axes))
        held.append(bridge.hold is not None)
    return np.array(commanded), np.array(held)


def check_against_right(commanded, held, end):
    """Never outside what the right ones say, within a look of them from a second after the fault's end."""
    times = np.arange(len(commanded)) * LOOK_NS * 1e-9
    wanted = np.array([right(time) for time in times])
    settled = 80  # numbers settle, and corrections approach from zero
    low, high = np.minimum.accumulate(wanted), np.maximum.accumulate(wanted)
    slack = 0.02 * (high - low).max(axis=0) + 1e-8
    assert (commanded[settled:] >= (np.minimum(low, 0.0) - slack)[settled:]).all()
    assert (commanded[settled:] <= (np.maximum(high, 0.0) + slack)[settled:]).all()
    after = end + round(AFTER_FAULT / (LOOK_NS * 1e-9))
    assert not held[after:].any()
    assert (np.abs(commanded - wanted)[after:] <= slack).all()


@shows(
    Row(
        "corrections",
        "A correction lacks an axis, names one twice or one too many, is empty, not finite, huge, in other "
        "units, old, in the future or repeated",
        "`corrections` of the bridge: held, with the reason; counted by reason",
        "whole messages only; limits of size, speed and acceleration of its own",
        "the axes come to rest within these limits and stay",
        "within 1 s of its end",
    ),
    Row(
        "corrections",
        "No correction comes",
        "`corrections` of the bridge: held for so many s",
        "the last one is held",
        "the axes stay",
        "with the next right one, approached within the limits",
    ),
)
@pytest.mark.parametrize("fault", FAULTS)
@settings(max_examples=8, deadline=None)
@given(begins, durations, gaps, st.booleans(), st.sampled_from([TABLE, TrivialKinematics()]))
def test_a_fault_moves_nothing_and_is_over_within_a_second(fault, begin, duration, gap, is_alone, kinematics):
    """In place of the right ones (`is_alone`) or among them, each time it comes or now and then."""
    bridge, number = Bridge(kinematics), 0

    def inject(look):
        nonlocal number
        is_faulty = begin <= look < begin + duration
        if look % 3 == 0 and not (is_faulty and is_alone):
            number += 1
            bridge.receive(stamped(bridge, right(bridge.time_ns * 1e-9)), number)
        if is_faulty and look % gap == 0:
            message = FAULTS[fault](bridge)
            if message is not None:
                number += 1
                bridge.receive(message, number)

    commanded, held = run(bridge, inject, begin + duration + TAIL)
    check_bounds(commanded)
    check_against_right(commanded, held, begin + duration)
    if is_alone and duration > 60:
        assert held[begin + 40 : begin + duration].all()


@shows(
    Row(
        "corrections",
        "A second publisher of corrections",
        "`corrections` of the bridge: two publishers, with their names",
        "told apart by the numbers of their messages and by the list of publishers",
        "the axes come to rest and stay",
        "within 1 s after one is left",
    ),
)
@settings(max_examples=20, deadline=None)
@given(begins, durations, st.integers(0, 2**40), st.integers(0, 2**40), gaps, st.booleans())
def test_a_second_publisher_moves_nothing_and_is_over_within_a_second(begin, duration, first, second, gap, is_killed):
    """One that is killed stays listed, and if it was never heard it is waited for, which this leaves out.

    If it begins just where the other's numbers stand, one word of it is heard.
    """
    assume(not is_killed or any(look % gap == 0 for look in range(begin, begin + duration)))
    bridge, number, other = Bridge(TrivialKinematics()), first, second

    def inject(look):
        nonlocal number, other
        is_there = begin <= look < begin + duration
        if look == begin or (look == begin + duration and not is_killed):
            bridge.listed = ("/compensation", "/double")[: 1 + is_there]
        if look % 3 == 0:
            number += 1
            bridge.receive(stamped(bridge, right(bridge.time_ns * 1e-9)), number)
        if is_there and look % gap == 0:
            other += 1
            bridge.receive(stamped(bridge, FAR), other)

    commanded, held = run(bridge, inject, begin + duration + TAIL)
    check_bounds(commanded)
    if not begin / 3 - 2 <= second - first <= (begin + duration) / 3 + 2:
        check_against_right(commanded, held, begin + duration)
    heard = begin + 2 * gap + 3
    assert held[heard : begin + duration].all()


@shows(
    Row(
        "corrections",
        "The compensation starts again",
        "`correction`: waiting for the controller to say which corrections it has in effect",
        "it begins from what the controller has in effect, and goes on at the rate limit",
        "held, then right",
        "within 1 s after its first correction",
    ),
)
@settings(max_examples=10, deadline=None)
@given(begins, st.integers(0, 100), st.integers(0, 2**40), st.integers(0, 2**40), st.booleans())
def test_a_compensation_that_starts_again_is_followed_within_a_second(begin, pause, first, second, is_killed):
    bridge, number = Bridge(TrivialKinematics()), first
    if second == first + begin // 3:
        second += 1  # where the numbers go on by chance, one that was killed is waited for

    def inject(look):
        nonlocal number
        if look == begin:
            number = second
        if look == begin + pause:
            bridge.listed = ("/compensation", "/compensation") if is_killed else ("/compensation",)
        if look % 3 == 0 and not begin <= look < begin + pause:
            number += 1
            bridge.receive(stamped(bridge, right(bridge.time_ns * 1e-9)), number)

    commanded, held = run(bridge, inject, begin + pause + TAIL)
    check_bounds(commanded)
    check_against_right(commanded, held, begin + pause)
