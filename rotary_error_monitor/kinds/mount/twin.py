"""The twin of a two-axis mount: where its tube points at given readings of its axes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.kinds.mount.description import MountDescription, MountGeometry, mount_machine
from rotary_error_monitor.kinds.mount.effects import MountEffect, PointingState, cross, dot
from rotary_error_monitor.kinds.mount.refraction import LOWEST, Weather, refraction_of
from rotary_error_monitor.machine.kinematics import arrange_machine, stand
from rotary_error_monitor.machine.transforms import rotate, rotation_by
from rotary_error_monitor.twin.finite import check_finite

FEWEST_POINTINGS = 30
"""Six angles of geometry and some effects, on both components, and a sixth of the sky left out."""


@dataclass(frozen=True)
class MountRecording:
    """Stars that a mount was pointed at, and what its axes read.

    Attributes:
        readings: (n, 2) of hour and declination axis, rad, without jumps over the travel.
        direction: (n, 2) sign of the travel by which each was reached, 0 if unknown.
        stars: (n, 2) hour angle and declination of the star without refraction, rad.
        time: (n,) s.
        latitude: rad.
        weather: for refraction.
    """

    readings: Array
    direction: Array
    stars: Array
    time: Array
    latitude: float
    weather: Weather

    def chosen(self, rows: NDArray[np.intp] | NDArray[np.bool_]) -> MountRecording:
        """Some of the pointings, in that order."""
        parts = (self.readings[rows], self.direction[rows], self.stars[rows], self.time[rows])
        return MountRecording(*parts, self.latitude, self.weather)


class MountTwin:
    """Mount and recording with all that does not depend on geometry and effects.

    Attributes:
        seen: (3, n) unit vectors to the stars as the mount must point at them, in the ground's frame.
        sought: (3, n) the same without refraction.
        too_low: (n,) whether a star is lower than its refraction is known.
        side: (n,) of the pier, as `PointingState` has it.
        machine: the mount's machine as the description has it.
        known: effects that the twin has.
    """

    def __init__(self, mount: MountDescription, recording: MountRecording, known: Sequence[Cause] = ()) -> None:
        self.mount = mount
        self.recording = recording
        self.latitude = recording.latitude if mount.latitude is None else mount.latitude
        self.machine = mount_machine(self.latitude, mount.geometry)
        self.known = tuple(known)
        self._positions = np.ascontiguousarray(recording.readings.T)
        self._direction = np.ascontiguousarray(recording.direction.T)
        self.sought = star_directions(recording.stars, self.latitude)
        self.upward = np.array([[0.0], [0.0], [1.0]])
        altitude = np.arcsin(np.clip(self.sought[2], -1.0, 1.0))
        self.refraction = refraction_of(altitude, recording.weather)
        self.too_low = (altitude < LOWEST) & (self.refraction > 0)
        lifted = rotate(rotation_by(self._lift()), self.sought)
        self.seen = lifted if mount.refraction else self.sought
        self._west, self._north = _ways(self.seen, self.latitude)
        self.side = np.where(np.cos(recording.readings[:, 1]) < 0, 1.0, -1.0)
        self._time = recording.time - 0.5 * (recording.time.min() + recording.time.max())

    def state(self, geometry: MountGeometry, causes: Sequence[Cause] = ()) -> PointingState:
        """Where the mount stands, the causes' rotations not yet made."""
        machine = mount_machine(self.latitude, geometry)
        for cause in (*self.known, *causes):
            assert isinstance(cause.effect, MountEffect)
            machine = cause.effect.amend(machine, cause.values, cause.location)
        model = arrange_machine(machine)
        stance = stand(model, self._positions, model.components.at(self._positions, self._direction, None))
        on_hour, on_declination = stance.tool.steps[1], stance.tool.steps[2]
        return PointingState(
            polar=on_hour[:, 2],
            declination=-on_declination[:, 1],
            tube=stance.tool_in_workpiece()[:, 2],
            upward=self.upward,
            sought=self.sought,
            refraction=self.refraction,
            side=self.side,
            time=self._time,
        )

    def pointing(self, geometry: MountGeometry, causes: Sequence[Cause] = ()) -> Array:
        """(3, n) where the tube points.

        Raises:
            UnpredictableError: a value is not finite.
        """
        with np.errstate(invalid="ignore", over="ignore", divide="ignore"):  # what is not finite is told below
            state = self.state(geometry, causes)
            total = np.zeros_like(state.tube)
            for cause in (*self.known, *causes):
                assert isinstance(cause.effect, MountEffect)
                turn = cause.effect.turn(cause.values, cause.location, state)
                if turn is not None:
                    total = total + turn
            pointing = rotate(rotation_by(total), state.tube)
        check_finite("the tube's direction", pointing, (*self.known, *causes))
        return pointing

    def error(self, geometry: MountGeometry, causes: Sequence[Cause] = ()) -> Array:
        """(2, n) star minus pointing on the sky at the star, along growing hour angle and declination, rad."""
        away = self.seen - self.pointing(geometry, causes)
        return np.stack([dot(away, self._west), dot(away, self._north)])

    def _lift(self) -> Array:
        level = cross(self.sought, self.upward)
        return self.refraction * level / np.maximum(np.sqrt(dot(level, level)), 1e-12)


def star_directions(stars: Array, latitude: float) -> Array:
    """(3, n) unit vectors, x south, y east, z up, to stars (n, 2) at hour angle and declination in rad."""
    hour, declination = stars.T
    south = np.cos(declination) * np.cos(hour)
    east = -np.cos(declination) * np.sin(hour)
    polar = np.sin(declination)
    sine, cosine = np.sin(latitude), np.cos(latitude)
    return np.stack([sine * south - cosine * polar, east, cosine * south + sine * polar])


def _ways(stars: Array, latitude: float) -> tuple[Array, Array]:
    """(3, n) unit vectors on the sky along growing hour angle and growing declination."""
    pole = np.array([[-np.cos(latitude)], [0.0], [np.sin(latitude)]])
    west = cross(stars, pole)
    west = west / np.maximum(np.sqrt(dot(west, west)), 1e-12)
    return west, cross(west, stars)
