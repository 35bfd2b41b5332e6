"""An autocollimator that looks at the mirror on the rotor."""

from __future__ import annotations

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.streams import AUTOCOLLIMATOR
from rotary_error_monitor.description.two_axis_section import Turbulence
from rotary_error_monitor.metrology.periodic_curves import planar_values
from rotary_error_monitor.sensors.sensor import Pose, Sensor


class TwoAxisAutocollimator(Sensor):
    """Tilt of the mirror about x and y."""

    kind = AUTOCOLLIMATOR
    section = "autocollimator"
    fields = ("tilt_x", "tilt_y")
    unit = "rad"
    moved_by = ("mirror", "autocollimator", "spindle.tilt")

    def streams(self, stage: StageDescription) -> tuple[str, ...]:
        """One, if the stage has an autocollimator."""
        return () if stage.autocollimator is None else (AUTOCOLLIMATOR,)

    def noise(self, stage: StageDescription, stream: str) -> float:
        """Of one component, rad."""
        instrument = stage.tilt_instrument
        return float(np.hypot(instrument.noise, instrument.resolution / np.sqrt(12)))

    def resolution(self, stage: StageDescription, stream: str) -> float:
        """Of one component, rad."""
        return stage.tilt_instrument.resolution

    def turbulence(self, stage: StageDescription) -> Turbulence | None:
        """Of the air on the way to the mirror."""
        return None if stage.autocollimator is None else stage.autocollimator.turbulence

    def shown(self, stream: str, pose: Pose) -> Array:
        """(n, 2) tilt of the mirror as a rotation vector, rad."""
        mirror, state = pose.stage.mirror, pose.state
        shown = state.turned(mirror.tilt) + pose.tilt() + state.harmonics(mirror.flatness)
        table = mirror.flatness_table
        if table is None:
            return shown
        return shown + state.keep("flatness_table", table, lambda: planar_values(table, state.theta))

    def within_range(self, stage: StageDescription, stream: str, shown: Array) -> Array:
        """The tilt, which the detector does not see beyond its range."""
        most, response = stage.tilt_instrument.range, stage.response(stream)
        if response.changes_no_value:
            return np.clip(shown, -most, most)
        # The detector's range is of what it reads: about its zero and along its axes, which the tilts no longer are.
        most *= abs(response.gain)
        return response.corrected(np.clip(response.readings(shown), -most, most))
