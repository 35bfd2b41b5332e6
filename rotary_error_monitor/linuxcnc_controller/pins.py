"""LinuxCNC's HAL pins as this package sees them: read and written in m, rad and counts."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.linuxcnc_controller.clock import Clock
from rotary_error_monitor.linuxcnc_controller.kinematics import (
    ROTARY,
    XYZAC,
    Kinematics,
    Position,
    RotaryTableKinematics,
    TrivialKinematics,
)
from rotary_error_monitor.linuxcnc_controller.offsets import ControllerReading

TABLE_PINS = "xyzac-trt-kins"
_LOOKS = 10
_AGREEMENT = 1e-7
"""Kinematics whose joints lie within this of the controller's, m or rad, are taken for the controller's."""


class Hal(Protocol):
    """What is used of LinuxCNC's module `hal`."""

    def get_value(self, name: str) -> Any:  # noqa: ANN401 (a pin is a bit, a whole number or a float)
        """Value of a pin."""

    def set_p(self, name: str, value: str) -> object:
        """Set a pin that no signal drives."""

    def get_info_pins(self) -> list[dict[str, Any]]:
        """Names and more of all pins."""


@dataclass(frozen=True)
class Units:
    """The controller's units: how many of them are one metre and one radian."""

    per_metre: float = 1000.0
    per_radian: float = 180.0 / math.pi

    def of(self, name: str) -> float:
        """Units for the axis of that letter."""
        return self.per_radian if name in ROTARY else self.per_metre


class MachinePins:
    """The pins of one running machine.

    Attributes:
        names: letters of its axes, in the order of its joints.
    """

    def __init__(self, hal: Hal, names: Sequence[str], units: Units) -> None:
        """The pins of a machine with the axes `names`.

        Raises:
            InputError: the machine has joints that its axes do not explain.
        """
        self._hal = hal
        self.names = tuple(names)
        pins = {pin["NAME"] for pin in hal.get_info_pins()}
        joints = sum(1 for pin in pins if pin.startswith("joint.") and pin.endswith(".coarse-pos-cmd"))
        if not self.names or joints != len(self.names):
            raise InputError(
                f"the machine has {joints} joints for the axes {' '.join(self.names) or '(none)'}, not one for each"
            )
        self._has_table = self.names == XYZAC and f"{TABLE_PINS}.y-offset" in pins
        self._axes = tuple(f"axis.{name.lower()}" for name in self.names)
        self._joints = tuple(f"joint.{index}" for index in range(joints))
        self._units = tuple(units.of(name) for name in self.names)
        self._per_metre = units.per_metre

    def enable(self, count: float) -> None:
        """Let the controller take up counts of `count` m or rad.

        The scale goes first: it counts for changes from then on. Offsets that are enabled already stay so, since
        enabling anew would zero the controller's number and leave the motors where they are.

        Raises:
            InputError: another part of the configuration drives one of the pins.
        """
        for axis, unit in zip(self._axes, self._units, strict=True):
            self._set(f"{axis}.eoffset-clear", "0")
            self._set(f"{axis}.eoffset-scale", repr(count * unit))
            if not self._hal.get_value(f"{axis}.eoffset-enable"):
                self._set(f"{axis}.eoffset-enable", "1")

    def write(self, counts: Sequence[int]) -> None:
        """Put numbers on the counts pins.

        Raises:
            InputError: another part of the configuration drives one of the pins.
        """
        for axis, number in zip(self._axes, counts, strict=True):
            self._set(f"{axis}.eoffset-counts", str(number))

    def clear(self) -> None:
        """Ask the controller to zero its offsets; `enable` ends the request.

        As long as the request stands, counts move nothing: they go back to the middle of their 32 bits.

        Raises:
            InputError: another part of the configuration drives one of the pins.
        """
        for axis in self._axes:
            self._set(f"{axis}.eoffset-clear", "1")
        self.write((0,) * len(self._axes))

    def read(self, clock: Clock) -> ControllerReading:
        """One consistent look: what two looks in a row agree on, as the servo thread writes in between now and then.

        It is stamped by the clock between these two: then it was so, however long anything before or after took.
        """
        look = self._look()
        for _ in range(_LOOKS):
            now = clock()
            again = self._look()
            if again == look:
                break
            look = again
        axes, joints, requested, applied, commands, velocities = look
        value = self._hal.get_value
        return ControllerReading(
            stamp_ns=now.stamp_ns,
            axes=axes,
            joints=joints,
            commands=commands,
            joint_velocities=velocities,
            requested=requested,
            applied=applied,
            counts=tuple(int(value(f"{axis}.eoffset-counts")) for axis in self._axes),
            enabled=bool(value("motion.motion-enabled")),
            homed=bool(value("motion.is-all-homed")),
            coordinated=bool(value("motion.coord-mode") or value("motion.teleop-mode")),
            limited=bool(value("motion.eoffset-limited")),
            pulse=self.pulse(),
        )

    def pulse(self) -> int:
        """Number that changes with every servo period: the time that the last one took."""
        return int(self._hal.get_value("motion-controller.time"))

    def kinematics(self, reading: ControllerReading) -> Kinematics | None:
        """The kinematics that the controller uses now; None where it is none that this package knows.

        What a machine is configured to use can be switched while it runs, so the joints themselves are asked.
        """
        tool = [axis + offset for axis, offset in zip(reading.axes, reading.applied, strict=True)]
        for candidate in self._candidates():
            differences = zip(candidate.to_joints(tool), reading.joints, strict=True)
            if all(abs(expected - joint) < _AGREEMENT for expected, joint in differences):
                return candidate
        return None

    def _candidates(self) -> tuple[Kinematics, ...]:
        if not self._has_table:
            return (TrivialKinematics(),)
        x, y, z, dy, dz, tool = (
            self._hal.get_value(f"{TABLE_PINS}.{pin}") / self._per_metre
            for pin in ("x-rot-point", "y-rot-point", "z-rot-point", "y-offset", "z-offset", "tool-offset")
        )
        return RotaryTableKinematics((x, y, z), (dy, dz), tool), TrivialKinematics()

    def _look(self) -> tuple[Position, ...]:
        return (
            self._values(self._axes, "pos-cmd"),
            self._values(self._joints, "coarse-pos-cmd"),
            self._values(self._axes, "eoffset-request"),
            self._values(self._axes, "eoffset"),
            self._values(self._joints, "pos-cmd"),
            self._values(self._joints, "vel-cmd"),
        )

    def _values(self, owners: Sequence[str], pin: str) -> Position:
        value = self._hal.get_value
        return tuple(value(f"{owner}.{pin}") / unit for owner, unit in zip(owners, self._units, strict=True))

    def _set(self, pin: str, value: str) -> None:
        try:
            self._hal.set_p(pin, value)
        except RuntimeError as error:
            raise InputError(
                f"HAL pin {pin} cannot be set to {value} ({error}); it must be connected to nothing"
            ) from error
