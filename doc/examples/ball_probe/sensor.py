"""What a ball probe shows of the rotor: the rest of the package follows from that."""

from collections.abc import Mapping

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.sensors.listed import ListedKind


class BallProbe(ListedKind):
    """Displacement of the ball's centre along the line of the probe."""

    kind = "ball_probe"
    moved_by = ("sensors", "spindle.radial", "spindle.axial", "spindle.tilt")

    def sensitivity(self, place: Mapping[str, float]) -> Array:
        """The centre moves by (exc + h ebc, eyc - h eac, ezc)."""
        out, height = np.cos(place["elevation"]), place["height"]
        x, y = out * np.cos(place["azimuth"]), out * np.sin(place["azimuth"])
        return np.array([x, y, np.sin(place["elevation"]), -height * y, height * x, 0.0])
