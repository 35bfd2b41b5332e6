"""A read head behind a third-party driver that publishes joint states."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from rotary_error_monitor.description.settings import Setting
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.sources.device import Device, Instrument
from rotary_error_monitor.sources.source import Heard
from rotary_error_monitor.sources.unwrapping import unwrap_angle


class JointStateDriver(Device):
    """Position of one joint, rad."""

    name = "joint_state"
    serves = ("encoder_head",)
    settings = (
        Setting("joint_state.topic", "joint_states", "topic of the third-party driver"),
        Setting("joint_state.joint", "", "name of the joint in its messages; empty for their only one"),
    )

    def open(self, instrument: Instrument) -> ContinuousAngle:
        """Source of the joint's angles."""
        joint = instrument.setting("joint_state.joint")
        return ContinuousAngle(
            instrument.fields,
            instrument.setting("joint_state.topic"),
            "sensor_msgs/msg/JointState",
            lambda message: (joint_position(message, joint),),
        )


class ContinuousAngle(Heard):
    """Angles of a third-party driver; those that wrap are made continuous."""

    _last: float | None = None

    def add(self, time_ns: int, values: Sequence[float], arrival_ns: int | None = None) -> None:
        """Keep one angle, as `Gathered.add`.

        Raises:
            InputError: as there; an angle that is refused leaves no trace in those after it.
        """
        (angle,) = values
        if not np.isfinite(angle):
            raise InputError(f"a position is {angle}; expected a finite angle in rad")
        continuous = angle if self._last is None else unwrap_angle(angle, self._last)
        super().add(time_ns, (continuous,), arrival_ns)
        self._last = continuous


class JointPositions(Protocol):
    """What is read of a `sensor_msgs/msg/JointState`."""

    name: Sequence[str]
    position: Sequence[float]


def joint_position(message: JointPositions, joint: str) -> float:
    """Position of one joint of a joint state, m or rad; with an empty name that of the only one.

    Raises:
        InputError: the message has no such joint, or several where no name is given, or no position for it.
    """
    if joint == "" and len(message.name) == 1:
        joint = message.name[0]
    if joint not in message.name or len(message.position) != len(message.name):
        raise InputError(
            f"a joint state holds the joints {list(message.name)} with {len(message.position)} positions; "
            f"expected a position of joint {joint!r}"
        )
    return float(message.position[message.name.index(joint)])
