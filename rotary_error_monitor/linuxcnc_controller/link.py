"""The link to a running LinuxCNC: reads the machine, and follows corrections by external offsets.

A program beside LinuxCNC (see `session`); when it ends, the offsets stay as they are.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.linuxcnc_controller import session
from rotary_error_monitor.linuxcnc_controller.beat import ServoBeat
from rotary_error_monitor.linuxcnc_controller.clock import NANOSECONDS, Clock, Moment
from rotary_error_monitor.linuxcnc_controller.kinematics import ROTARY, Kinematics, Position
from rotary_error_monitor.linuxcnc_controller.offsets import (
    ControllerReading,
    OffsetControl,
    OffsetLimits,
    commanded_velocities,
    corrections_of,
)
from rotary_error_monitor.linuxcnc_controller.pins import MachinePins
from rotary_error_monitor.linuxcnc_controller.protocol import (
    LINK_SILENCE,
    ClearRequest,
    CorrectionRequest,
    HaltRequest,
    LinkSettings,
    Record,
    State,
)

UNKNOWN_KINEMATICS = "the joints do not lie where any kinematics known to the bridge puts them"
CLEARING = "the external offsets are being cleared"
_CLEARING_TIME = 0.1
"""How long the request to clear stands, s; some servo periods."""
_LOOKS_AT_REST = 10
_ATTEMPTS = 3
"""Servo periods of which one is to be seen whole in a look: a computer without real time is late for some."""


class Link:
    """Reads one machine, follows corrections, and says what it sees; the caller gives it the time."""

    def __init__(self, pins: MachinePins, settings: LinkSettings, beat: ServoBeat | None = None) -> None:
        """Let the machine take up offsets; with `beat` each look is that of a servo period, stamped by its beginning.

        Raises:
            InputError: its pins are not free.
        """
        self._pins = pins
        self._beat = beat
        self._settings = settings
        limits = settings.course_limits(name in ROTARY for name in pins.names)
        self._limits = OffsetLimits((settings.count,) * len(pins.names), limits)
        self._control = OffsetControl(pins.names, self._limits)
        self._last_joints: Position | None = None
        self._pulse: tuple[int, int] | None = None
        self._looks_at_rest = 0
        self._clear_until_ns = 0
        self._looked_ns: int | None = None
        self._stood = False
        pins.enable(settings.count)

    def handle(self, record: Record, now: Moment) -> None:
        """Take up what the other side says.

        Corrections that waited while this process stood still are not followed: there is no room for the newest behind
        some seconds of them, and the next one comes at once.

        Raises:
            InputError: corrections are beyond the limits, which the other side should have seen.
        """
        if isinstance(record, ClearRequest):
            self._control = OffsetControl(self._pins.names, self._limits)
            self._clear_until_ns = now.steady_ns + round(_CLEARING_TIME * NANOSECONDS)
            self._pins.clear()
        elif isinstance(record, CorrectionRequest) and not (self._stood or self._has_stood(now.steady_ns)):
            self._control.aim(record.positions)
        elif isinstance(record, HaltRequest):
            self._control.halt()

    def look(self, clock: Clock) -> State:
        """Read the machine, write the counts that are due, and say how it stands.

        Raises:
            InputError: the servo thread stands still, or the pins are not free any more.
        """
        (reading, is_exact), now = self._read(clock), clock()
        self._stood = self._has_stood(now.steady_ns)
        if self._stood:
            self._control.halt()  # what it was on its way to is as old
        self._looked_ns = now.steady_ns
        self._check_pulse(reading, now.steady_ns)
        kinematics = self._pins.kinematics(reading)
        if kinematics is None:  # as where the machine is off, and lets its joints be anywhere
            return self._state(reading, is_exact, None, self._control.blocked(reading) or UNKNOWN_KINEMATICS)
        trouble = CLEARING
        if now.steady_ns >= self._clear_until_ns:
            if self._clear_until_ns:
                self._pins.enable(self._settings.count)
                self._clear_until_ns = 0
            step = self._control.step(reading, kinematics, now.steady_ns)
            trouble = step.held
            if step.counts is not None and step.counts != reading.counts:
                self._pins.write(step.counts)
        return self._state(reading, is_exact, kinematics, trouble)

    def _read(self, clock: Clock) -> tuple[ControllerReading, bool]:
        """A look, and whether all of it is of one servo period, with the beginning of which it is stamped then."""
        if self._beat is None:
            return self._pins.read(clock), False
        for _ in range(_ATTEMPTS):
            beat, reading = self._beat.wait(clock), self._pins.read(clock)
            if beat is None:
                break
            if beat.on_time and beat.pulse == reading.pulse:
                return replace(reading, stamp_ns=beat.moment.stamp_ns), True
        return reading, False

    def _has_stood(self, steady_ns: int) -> bool:
        """Whether this process has not looked for so long that it counted as hung."""
        return self._looked_ns is not None and steady_ns - self._looked_ns > LINK_SILENCE * NANOSECONDS

    def _check_pulse(self, reading: ControllerReading, steady_ns: int) -> None:
        if self._pulse is None or self._pulse[0] != reading.pulse:
            self._pulse, self._looks_at_rest = (reading.pulse, steady_ns), 0
        self._looks_at_rest += 1
        still = (steady_ns - self._pulse[1]) / NANOSECONDS
        # Many looks as well as a long time: after a pause of this process itself, a single look says nothing.
        if still > self._settings.pulse_timeout and self._looks_at_rest > _LOOKS_AT_REST:
            raise InputError(f"LinuxCNC's servo thread has stood still for {still:.3g} s")

    def _state(self, reading: ControllerReading, is_exact: bool, kinematics: Kinematics | None, trouble: str) -> State:
        joints: Position = ()
        effect: Position = ()
        if kinematics is not None:
            joints = kinematics.to_joints(reading.axes)
            effect = corrections_of(kinematics, reading.axes, reading.applied)
        before, self._last_joints = self._last_joints, joints or None
        velocities = commanded_velocities(before or joints, joints, reading.joint_velocities) if joints else ()
        pending = zip(reading.requested, reading.applied, strict=True)
        return State(
            stamp_ns=reading.stamp_ns,
            positions=joints,
            velocities=velocities,
            is_exact=is_exact,
            commands=reading.commands,
            speeds=reading.joint_velocities,
            valid=kinematics is not None and reading.enabled and reading.homed,
            offsets=reading.applied,
            effect=effect,
            to_go=self._control.to_go,
            slowed=self._control.slowed,
            lag=max(abs(requested - applied) for requested, applied in pending),
            limited=reading.limited,
            trouble=trouble,
            takeovers=self._control.takeovers,
        )


def start(settings: dict[str, Any], pins: MachinePins) -> tuple[Link, float]:
    """The link with `LinkSettings` by name, and its period, s."""
    chosen = LinkSettings(**settings)
    return Link(pins, chosen, ServoBeat(pins.pulse)), chosen.period


def main(arguments: list[str] | None = None) -> int:
    """Run the link; 0 when the other side closed, 1 if LinuxCNC could not be reached or is lost."""
    return session.run("link", start, arguments)


if __name__ == "__main__":
    raise SystemExit(main())
