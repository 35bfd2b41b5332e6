"""Autocollimator: from quadrant voltages or angles to the tilt of the mirror."""

from __future__ import annotations

import numpy as np

from rotary_error_monitor.arrays import Array, Mask
from rotary_error_monitor.description.response import IDEAL, Response
from rotary_error_monitor.description.two_axis_section import Autocollimator
from rotary_error_monitor.errors import InputError


def tilt_from_quadrants(voltages: Array, sensitivity: float, dark: Array) -> Array:
    """Tilt of the mirror as a rotation vector (n, 2), rad, from a quadrant photodetector (Lou et al. 2019, Figure 4).

    The reflected beam moves by twice the tilt: a tilt about y shifts the spot along +x, a tilt about x shifts it along
    -y. The normalised differences do not depend on the light's power.

    Args:
        voltages: (n, 4) of the quadrants in the order of the plane's: (+x, +y), (-x, +y), (-x, -y), (+x, -y).
        sensitivity: tilt per normalised difference, rad; from the calibration against a reference autocollimator.
        dark: (4,) voltages without light.

    Raises:
        InputError: a sample has no light: the sum of the four does not exceed the dark voltages.
    """
    light = voltages - dark
    total = light[:, 0] + light[:, 1] + light[:, 2] + light[:, 3]
    if not (total > 0).all():
        index = int(np.argmin(total))
        raise InputError(f"quadrant voltages {voltages[index]} of sample {index} hold no light above the dark {dark}")
    x = (light[:, 0] + light[:, 3] - light[:, 1] - light[:, 2]) / total
    y = (light[:, 0] + light[:, 1] - light[:, 2] - light[:, 3]) / total
    return np.stack([-sensitivity * y, sensitivity * x], axis=1)


def check_saturation(tilt: Array, instrument: Autocollimator, response: Response = IDEAL) -> Mask:
    """(n,) whether a corrected sample (n, 2) stands at the end of the measuring range, where it says nothing."""
    # The range is of what the detector reads: zero shifts it and roll turns it against the tilts that are corrected.
    if not response.changes_no_value:
        tilt = response.readings(tilt) / abs(response.gain)
    limit = instrument.range - 0.5 * instrument.resolution
    return np.asarray((np.abs(tilt[:, 0]) >= limit) | (np.abs(tilt[:, 1]) >= limit))
