"""What the sensors of a stage can determine together, with all of them there."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.metrology.encoder_heads import HeadLayout
from rotary_error_monitor.metrology.error_motion import COMPONENTS
from rotary_error_monitor.metrology.rigid_motion import observable_components, redundant_sensors
from rotary_error_monitor.sensors.library import listed_fields, listed_sensitivity


def possible_components(stage: StageDescription) -> tuple[str, ...]:
    """Components of error motion that heads, command, autocollimator and listed sensors determine.

    None without the rotation, at which all that turns with the rotor is taken off.
    """
    if stage.encoder is not None and "theta" not in rotation_and_centre(stage):
        return ()
    seen = observable_components(_without_listed(stage), listed_sensitivity(listed_fields(stage)))
    return tuple(name for name, there in zip(COMPONENTS, seen.tolist(), strict=True) if there)


def unchecked_sensors(stage: StageDescription) -> tuple[str, ...]:
    """Listed sensors of which a fault would not show in what all others say."""
    fields = listed_fields(stage)
    owner = np.array([field.number for field in fields], np.intp)
    checked = redundant_sensors(_without_listed(stage), listed_sensitivity(fields), owner)
    return tuple(name for name, seen in zip(stage.sensors, checked.tolist(), strict=True) if not seen)


def rotation_is_lacking(stage: StageDescription) -> str:
    """Why there is no estimate of a stage, in words."""
    if stage.encoder is None:
        return "at no time was the command there, which alone tells the rotation"
    return "at no time were two opposed or three heads there together"


def _without_listed(stage: StageDescription) -> NDArray[np.bool_]:
    """(6,) components that heads, command and autocollimator determine, all of them there."""
    seen = rotation_and_centre(stage)
    tilt = stage.autocollimator is not None
    return np.array(["x" in seen, "y" in seen, False, tilt, tilt, "theta" in seen])


def rotation_and_centre(stage: StageDescription) -> tuple[str, ...]:
    """Which of rotation and ring's centre (`theta`, `x`, `y`) the heads determine, each free of the others."""
    heads = {} if stage.encoder is None else stage.encoder.azimuths
    return HeadLayout(tuple(heads.values())).observable if len(heads) > 1 else ()
