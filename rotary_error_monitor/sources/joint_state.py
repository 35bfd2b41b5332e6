"""A read head, or the command of a stage, behind a third-party driver that publishes joint states."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, ClassVar, Protocol

from rotary_error_monitor.description.settings import Setting
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.signals.blocks import NANOSECONDS
from rotary_error_monitor.sources.device import Device, Instrument
from rotary_error_monitor.sources.source import Heard
from rotary_error_monitor.sources.unwrapping import unwrap_angle
from rotary_error_monitor.units import ANGLE_UNITS

_SETTINGS = (
    Setting("joint_state.topic", "joint_states", "topic of the third-party driver"),
    Setting("joint_state.joint", "", "name of the joint in its messages; empty for their only one"),
    Setting(
        "joint_state.unit",
        "rad",
        "unit of its positions and velocities, which the message's definition has in rad",
        choices=tuple(ANGLE_UNITS),
    ),
)


class _JointDriver(Device):
    """One joint of a message with several."""

    hears = True
    settings = _SETTINGS
    source: ClassVar[type[ContinuousAngle]]
    fields: ClassVar[tuple[Callable[[JointMotions, str], float], ...]]

    def open(self, instrument: Instrument) -> ContinuousAngle:
        """Source of what the joint does."""
        joint, radian = instrument.setting("joint_state.joint"), ANGLE_UNITS[instrument.setting("joint_state.unit")]
        return self.source(
            instrument.fields,
            instrument.setting("joint_state.topic"),
            "sensor_msgs/msg/JointState",
            lambda message: tuple(field(message, joint) / radian for field in self.fields),
        )


class ContinuousAngle(Heard):
    """Angles of a third-party driver; those that wrap are made continuous."""

    _last: float | None = None

    def add(self, time_ns: int, values: Sequence[float], arrival_ns: int | None = None) -> None:
        """Keep one angle, as `Gathered.add`.

        Raises:
            InputError: as there; an angle that is refused leaves no trace in those after it.
        """
        continuous = self.continuous(values[0])
        super().add(time_ns, (continuous, *values[1:]), arrival_ns)
        self._last = continuous

    def continuous(self, angle: float) -> float:
        """The angle that is nearest to the last one, by whole turns.

        Raises:
            InputError: it is not finite.
        """
        if not math.isfinite(angle):
            raise InputError(f"a position is {angle}; expected a finite angle in rad")
        return angle if self._last is None else unwrap_angle(angle, self._last)


class CommandedAngle(ContinuousAngle):
    """Commanded angles with their speeds; a driver need not tell these.

    Without one the speed is that of the parabola through the last three angles, at the last: exact while the stage
    accelerates evenly. The first two angles only make the third one's speed.
    """

    def __init__(self, *how: Any) -> None:  # noqa: ANN401 (as `Heard`)
        """As `Heard`."""
        super().__init__(*how)
        self._angles: list[tuple[int, float]] = []

    def add(self, time_ns: int, values: Sequence[float], arrival_ns: int | None = None) -> None:
        """Keep one angle and its speed, NaN where the driver tells none; as `Gathered.add`."""
        angle, speed = values
        if not math.isnan(speed):
            super().add(time_ns, values, arrival_ns)
            self._angles.clear()
            return
        if self._angles and time_ns <= self._angles[-1][0]:
            self._angles.clear()  # the order of stamps is judged below
        points = [*self._angles[-2:], (time_ns, self.continuous(angle))]
        if len(points) == 3:
            super().add(time_ns, (angle, _slope(points)), arrival_ns)
        self._last = points[-1][1]
        self._angles = points


def _slope(points: Sequence[tuple[int, float]]) -> float:
    """Slope, per s, at the last of three points (ns, value), of the parabola through them."""
    (first, a), (second, b), (third, c) = points
    before, after = (b - a) / (second - first), (c - b) / (third - second)
    return NANOSECONDS * (after + (after - before) * (third - second) / (third - first))


class JointMotions(Protocol):
    """What is read of a `sensor_msgs/msg/JointState`."""

    name: Sequence[str]
    position: Sequence[float]
    velocity: Sequence[float]


def joint_position(message: JointMotions, joint: str) -> float:
    """Position of one joint of a joint state, m or rad; with an empty name that of the only one.

    Raises:
        InputError: the message has no such joint, or several where no name is given, or no position for it.
    """
    place = _place_of(message, joint)
    if len(message.position) != len(message.name):
        raise _lacking(message, joint)
    return float(message.position[place])


def joint_velocity(message: JointMotions, joint: str) -> float:
    """Velocity of one joint of a joint state, m/s or rad/s; NaN where the message has no velocities. As above.

    Raises:
        InputError: as above, or there are velocities, but not as many as joints.
    """
    place = _place_of(message, joint)
    if len(message.velocity) == 0:
        return math.nan
    if len(message.velocity) != len(message.name):
        raise InputError(
            f"a joint state holds the joints {list(message.name)} with {len(message.velocity)} velocities; "
            "expected one of each or none"
        )
    return float(message.velocity[place])


def _place_of(message: JointMotions, joint: str) -> int:
    if joint == "" and len(message.name) == 1:
        return 0
    if joint not in message.name:
        raise _lacking(message, joint)
    return list(message.name).index(joint)


def _lacking(message: JointMotions, joint: str) -> InputError:
    return InputError(
        f"a joint state holds the joints {list(message.name)} with {len(message.position)} positions; "
        f"expected a position of joint {joint or (message.name[0] if len(message.name) == 1 else '')!r}"
    )


class JointStateDriver(_JointDriver):
    """Position of one joint, in rad unless its driver tells another unit."""

    name = "joint_state"
    meaning = "a driver that publishes sensor_msgs/JointState"
    serves = ("encoder_head",)
    source = ContinuousAngle
    fields = (joint_position,)


class CommandDriver(_JointDriver):
    """Commanded position of one joint with its speed, in rad and rad/s unless its controller tells another unit."""

    name = "joint_state"
    meaning = "a controller that publishes sensor_msgs/JointState"
    serves = ("stage_command",)
    source = CommandedAngle
    fields = (joint_position, joint_velocity)
