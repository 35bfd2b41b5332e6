"""What the sensors of a stage can determine together, with all of them there."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.metrology.error_motion import COMPONENTS
from rotary_error_monitor.metrology.rigid_motion import observable_components, redundant_sensors
from rotary_error_monitor.sensors.library import listed_fields, listed_sensitivity


def possible_components(stage: StageDescription) -> tuple[str, ...]:
    """Components of error motion that heads, command, autocollimator and listed sensors determine."""
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
    ring, tilt = stage.encoder is not None, stage.autocollimator is not None
    return np.array([ring, ring, False, tilt, tilt, ring])
