"""Read heads over a graduated ring.

Sight lines are exact: a head at azimuth phi looks along the radius, which cuts a ring of radius r whose centre is
displaced by c at the angle asin((-c_x sin phi + c_y cos phi) / r) from where it would cut a centred ring.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.harmonics import AngularHarmonic
from rotary_error_monitor.description.periodic_tables import AngularTable
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.effects.rotor import HEAD, RotorState
from rotary_error_monitor.metrology.periodic_curves import angular_slopes, angular_values
from rotary_error_monitor.sensors.sensor import Pose, Sensor


class ReadHead(Sensor):
    """One stream a head."""

    kind = HEAD
    section = "encoder"
    fields = ("angle",)
    unit = "rad"
    moved_by = ("encoder", "spindle.radial")

    def streams(self, stage: StageDescription) -> tuple[str, ...]:
        """One for each letter."""
        return tuple(f"{HEAD}_{letter}" for letter in sorted(stage.azimuths))

    def noise(self, stage: StageDescription, stream: str) -> float:
        """Of a reading, rad."""
        return float(np.hypot(stage.ring.noise, stage.ring.resolution / np.sqrt(12)))

    def resolution(self, stage: StageDescription, stream: str) -> float:
        """One count, rad."""
        return stage.ring.resolution

    def shown(self, stream: str, pose: Pose) -> Array:
        """(n,) reading, rad."""
        encoder, state = pose.stage.ring, pose.state
        azimuth = encoder.azimuths[stream.removeprefix(f"{HEAD}_")]
        ahead = _sight_line(azimuth, pose)
        reading = ahead + state.theta
        if encoder.graduation:
            # What the head sees of the ring lies where its sight line cuts it, not where it would cut a centred one.
            error, slope = state.keep(
                "graduation", (encoder.graduation, azimuth), lambda: _graduation(encoder.graduation, azimuth, state)
            )
            reading += error - slope * ahead
        table = encoder.graduation_table
        if table is not None:
            error, slope = state.keep("graduation_table", (table, azimuth), lambda: _measured(table, azimuth, state))
            reading += error - slope * ahead
        return reading


def _sight_line(azimuth: float, pose: Pose) -> Array:
    """(m,) angle by which a head's sight line cuts the displaced ring beside where it would cut a centred one."""
    encoder = pose.stage.ring
    sideways = np.array([-np.sin(azimuth), np.cos(azimuth)]) / encoder.disc_radius
    # The eccentricity turns with the ring: its sideways part is a wave of order 1.
    x, y = encoder.eccentricity
    cos, sin = pose.state.harmonic(1)
    across = pose.radial() @ sideways
    across += (x * sideways[0] + y * sideways[1]) * cos
    across += (x * sideways[1] - y * sideways[0]) * sin
    return np.asarray(np.arcsin(across, out=across), np.float64)


def _measured(table: AngularTable, azimuth: float, state: RotorState) -> Array:
    """(2, m) error by a measured curve that a head sees of a centred ring, and its slope over the ring."""
    psi = azimuth - state.theta
    return np.stack([angular_values(table, psi), angular_slopes(table, psi)])


def _graduation(rows: Sequence[AngularHarmonic], azimuth: float, state: RotorState) -> Array:
    """(2, m) error of the graduation that a head sees of a centred ring, and its slope over the ring."""
    total = np.zeros((2, len(state.theta)))
    for row in rows:
        # psi = azimuth - theta, so cos(k psi) and sin(k psi) follow from the kept harmonics of theta.
        cos, sin = state.harmonic(row.order)
        at_cos, at_sin = np.cos(row.order * azimuth), np.sin(row.order * azimuth)
        even, odd = row.cos * at_cos + row.sin * at_sin, row.cos * at_sin - row.sin * at_cos
        total[0] += even * cos + odd * sin
        total[1] += row.order * (even * sin - odd * cos)
    return total
