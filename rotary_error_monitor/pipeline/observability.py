"""What the sensors of a stage can determine together, with all of them there."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.metrology.encoder_heads import HeadLayout
from rotary_error_monitor.metrology.error_motion import COMPONENTS
from rotary_error_monitor.metrology.rigid_motion import observable_components, redundant_sensors
from rotary_error_monitor.pipeline.mixed_rotation import head_row, is_mixed
from rotary_error_monitor.sensors.library import listed_fields, listed_sensitivity

_ECC = COMPONENTS.index("ecc")


def possible_components(stage: StageDescription) -> tuple[str, ...]:
    """Components of error motion that heads, command, autocollimator and listed sensors determine.

    Positioning of heads that see it and displacement as one number is as sure as the ring's place is, at least.
    """
    known, rows = _without_listed(stage)
    seen = observable_components(known, np.vstack([rows, listed_sensitivity(listed_fields(stage))]))
    seen[_ECC] |= bool(stage.azimuths)
    return tuple(name for name, there in zip(COMPONENTS, seen.tolist(), strict=True) if there)


def unchecked_sensors(stage: StageDescription) -> tuple[str, ...]:
    """Listed sensors of which a fault would not show in what all others say."""
    fields = listed_fields(stage)
    known, rows = _without_listed(stage)
    owner = np.array([field.number for field in fields], np.intp)
    heads = len(stage.sensors) + np.arange(len(rows))
    sensitivity = np.vstack([listed_sensitivity(fields), rows])
    checked = redundant_sensors(known, sensitivity, np.concatenate([owner, heads]))[: len(stage.sensors)]
    return tuple(name for name, seen in zip(stage.sensors, checked.tolist(), strict=True) if not seen)


def rotation_is_lacking(stage: StageDescription) -> str:
    """Why there is no estimate of a stage, in words."""
    if stage.encoder is None:
        return "at no time was the command there, which alone tells the rotation"
    return "at no time was a head there, with a command beside it where it does not tell rotation from displacement"


def _without_listed(stage: StageDescription) -> tuple[NDArray[np.bool_], Array]:
    """(6,) components that heads, command and autocollimator determine, all of them there, and (h, 6) rows of heads.

    There are rows of heads that determine none.
    """
    seen = rotation_and_centre(stage)
    tilt = stage.autocollimator is not None
    rows = [head_row(azimuth, stage.ring.disc_radius) for azimuth in stage.azimuths.values()] if is_mixed(stage) else []
    known = np.array(["x" in seen, "y" in seen, False, tilt, tilt, "theta" in seen])
    return known, np.array(rows).reshape(-1, len(COMPONENTS))


def rotation_and_centre(stage: StageDescription) -> tuple[str, ...]:
    """Which of rotation and ring's centre (`theta`, `x`, `y`) the heads determine, each free of the others."""
    return HeadLayout(tuple(stage.azimuths.values())).observable if stage.azimuths else ()
