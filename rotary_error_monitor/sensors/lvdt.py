"""A two-axis LVDT on an artefact above the ring."""

from __future__ import annotations

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.streams import OWN_REFERENCE
from rotary_error_monitor.sensors.sensor import Pose, RadialView, Sensor


class TwoAxisLvdt(Sensor):
    """Displacement of the artefact along x and y."""

    kind = section = OWN_REFERENCE
    fields = ("radial_x", "radial_y")
    unit = "m"
    is_needed = False
    moved_by = (OWN_REFERENCE, "spindle.radial", "spindle.tilt")

    def streams(self, stage: StageDescription) -> tuple[str, ...]:
        """One, if the stage has an LVDT."""
        return () if stage.reference is None else (OWN_REFERENCE,)

    def noise(self, stage: StageDescription, stream: str) -> float:
        """Of one component, m."""
        assert stage.reference is not None  # there is no such stream otherwise
        return stage.reference.noise

    def shown(self, stream: str, pose: Pose) -> Array:
        """(n, 2) displacement of the artefact, m."""
        reference, tilt = pose.stage.reference, pose.tilt()
        assert reference is not None
        leaned = reference.height * np.stack([tilt[:, 1], -tilt[:, 0]]).T
        return pose.radial() + leaned + pose.state.turned(reference.artefact_eccentricity)

    def radial_view(self, stage: StageDescription, stream: str) -> RadialView | None:
        """Both axes; its response has corrected the samples."""
        assert stage.reference is not None
        gain, roll, place = (stage.uncertainty.get(f"{stream}.{name}", 0.0) for name in ("gain", "roll", "height"))
        return RadialView(
            axes=("x", "y"),
            directions=np.eye(2),
            height=stage.reference.height,
            eccentricity=stage.reference.artefact_eccentricity,
            noise=stage.reference.noise,
            gain=gain / abs(stage.response(stream).gain),
            roll=roll,
            place=place,
        )
