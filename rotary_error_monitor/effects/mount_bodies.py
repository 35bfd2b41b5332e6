"""Effects of a mount's bodies and of what is around it: flexure under gravity, settling ground, the air.

A beam that carries its own weight turns its end by an angle in proportion to the moment, which is the cross product of
the beam's direction and gravity. Each flexure is that product for one body.
"""

from __future__ import annotations

import numpy as np

from rotary_error_monitor.effects.effect import Parameter, Values
from rotary_error_monitor.effects.mount_effect import Array, MountEffect, PointingState, cross, dot

_POINTING = "Wallace 2002, A rigorous algorithm for telescope pointing (Proc. SPIE 4848)"


class TubeFlexure(MountEffect):
    """The tube, or what holds mirror and camera in it, sags."""

    name = "tube_flexure"
    title = "tube sags"
    source = f"{_POINTING}: TF; in proportion to the sine of the zenith distance"
    parameters = (Parameter("sag", "rad", 3e-4, bound=0.1),)

    def turn(self, values: Values, location: str, state: PointingState) -> Array:
        """Downward by the sag times the sine of the zenith distance."""
        return np.asarray(values[0] * cross(state.tube, -state.upward), np.float64)


class DeclinationAxisFlexure(MountEffect):
    """The declination axis sags."""

    name = "declination_axis_flexure"
    title = "declination axis sags"
    source = f"{_POINTING}: DAF"
    parameters = (Parameter("sag", "rad", 3e-4, bound=0.1),)

    def turn(self, values: Values, location: str, state: PointingState) -> Array:
        """The axis's end that the tube sits on goes down."""
        return np.asarray(values[0] * cross(state.declination, -state.upward), np.float64)


class ForkFlexure(MountEffect):
    """What carries the declination axis's bearings yields about that axis."""

    name = "fork_flexure"
    title = "fork yields"
    source = f"{_POINTING}: FO"
    parameters = (Parameter("yield", "rad", 3e-4, bound=0.1),)

    def turn(self, values: Values, location: str, state: PointingState) -> Array:
        """About the declination axis, by the part of the weight across the fork."""
        # Gravity along both axes is borne; what is left, across their plane, bends the fork's arms about the bearings.
        across = cross(state.polar, state.declination)
        return np.asarray(values[0] * dot(across, state.upward) * state.declination, np.float64)


class SettlingGround(MountEffect):
    """The ground or a leg of the tripod gives way steadily."""

    name = "settling_ground"
    title = "mount tips over time"
    source = "rotation of the base about a level axis in proportion to time"
    parameters = (Parameter("rate", "rad/s", 1e-8, 2, bound=1e-4),)

    def turn(self, values: Values, location: str, state: PointingState) -> Array:
        """About south and east in proportion to time."""
        return np.stack([values[0] * state.time, values[1] * state.time, np.zeros_like(state.time)])


class RefractionScale(MountEffect):
    """The air bends light otherwise than the twin says, or the controller has taken a part of it out already."""

    name = "refraction_scale"
    title = "other refraction"
    source = "Stone 1996, PASP 108, 1051 (refraction in proportion to density); -1: none is left in the file"
    parameters = (Parameter("relative", "1", 0.3, bound=10.0),)

    def turn(self, values: Values, location: str, state: PointingState) -> Array:
        """The mount that shows a star stands lower by what is more: the prediction moves down, not the star up."""
        up = cross(state.sought, state.upward)
        level = up / np.maximum(np.sqrt(dot(up, up)), 1e-12)
        return np.asarray(-values[0] * state.refraction * level, np.float64)
