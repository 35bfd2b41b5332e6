"""An autocollimator that looks at the mirror on the rotor."""

from __future__ import annotations

import numpy as np

from rotary_error_monitor.description.stage import StageDescription, Turbulence
from rotary_error_monitor.effects.rotor import AUTOCOLLIMATOR, Array
from rotary_error_monitor.sensors.sensor import Pose, Sensor


class Autocollimator(Sensor):
    """Tilt of the mirror about x and y."""

    kind = AUTOCOLLIMATOR
    title = "autocollimator"
    section = "autocollimator"
    fields = ("tilt_x", "tilt_y")
    unit = "rad"
    moved_by = ("mirror", "autocollimator", "spindle.tilt")

    def noise(self, stage: StageDescription) -> float:
        """Of one component, rad."""
        return float(np.hypot(stage.autocollimator.noise, stage.autocollimator.resolution / np.sqrt(12)))

    def turbulence(self, stage: StageDescription) -> Turbulence | None:
        """Of the air on the way to the mirror."""
        return stage.autocollimator.turbulence

    def shown(self, stream: str, pose: Pose) -> Array:
        """(n, 2) tilt of the mirror as a rotation vector, rad."""
        mirror, state = pose.stage.mirror, pose.state
        return state.turned(mirror.tilt) + pose.tilt() + state.harmonics(mirror.flatness)

    def within_range(self, stage: StageDescription, shown: Array) -> Array:
        """The tilt, which the detector does not see beyond its range."""
        return np.clip(shown, -stage.autocollimator.range, stage.autocollimator.range)
