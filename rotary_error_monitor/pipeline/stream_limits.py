"""What the samples of each stream of a stage can be, by the description of its instrument."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.streams import AUTOCOLLIMATOR, COMMAND
from rotary_error_monitor.description.topics import samples_columns
from rotary_error_monitor.metrology.error_motion import remove_mirror
from rotary_error_monitor.metrology.harmonics import planar_sum
from rotary_error_monitor.metrology.tilt import check_saturation
from rotary_error_monitor.sensors.autocollimator import TwoAxisAutocollimator
from rotary_error_monitor.sensors.library import listed_kind
from rotary_error_monitor.sensors.read_head import ReadHead
from rotary_error_monitor.signals.admission import LARGEST_ANGLE, SampleLimits
from rotary_error_monitor.signals.blocks import SampleBlock
from rotary_error_monitor.signals.described_path import PLACES, DescribedPath
from rotary_error_monitor.units import TURN


def stream_limits(stage: StageDescription) -> dict[str, tuple[tuple[str, ...], SampleLimits]]:
    """Fields and limits of each stream of a stage, by its name."""
    encoder, instrument = stage.encoder, stage.autocollimator
    count = 0.0 if encoder is None else 6.0 * math.hypot(encoder.noise, encoder.resolution)
    angles = SampleLimits(LARGEST_ANGLE, stage.limits.speed, turns=True, jitter=count + stage.limits.following_error)
    found: dict[str, tuple[tuple[str, ...], SampleLimits]]
    found = {f"head_{name}": (ReadHead.fields, angles) for name in stage.azimuths}
    if instrument is not None:
        # Zero and axes of its own shift and turn what it can read against the tilts that are left of its readings.
        largest = stage.response(AUTOCOLLIMATOR).largest(2.0 * instrument.range)
        noise = math.hypot(instrument.noise, instrument.resolution)
        tilts = SampleLimits(largest, noise=noise, path=described_tilts(stage))
        found[AUTOCOLLIMATOR] = TwoAxisAutocollimator.fields, tilts
    # where the command is the rotation, its speed is held against its angle, which stands first
    commanded = samples_columns(COMMAND)
    found[COMMAND] = commanded[:1] if encoder else commanded, angles
    for name, sensor in stage.sensors.items():
        step = math.hypot(sensor.noise, sensor.resolution)
        found[name] = listed_kind(sensor).fields, SampleLimits(2.0 * sensor.range, noise=step)
    return found


def described_tilts(stage: StageDescription) -> DescribedPath:
    """Tilts of the mirror, rad, over a turn of the rotor."""
    return DescribedPath(described_tilt(stage, np.linspace(0.0, TURN, PLACES, endpoint=False)))


def described_tilt(stage: StageDescription, theta: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 2) tilt of the mirror, rad, that the description predicts at rotations `theta` (n,), rad."""
    mirror = -remove_mirror(np.zeros((len(theta), 2)), theta, stage.mirror)
    return planar_sum(stage.spindle.tilt, theta) + mirror


def is_saturated(stage: StageDescription, name: str, block: SampleBlock) -> NDArray[np.bool_]:
    """(n,) which samples of stream `name` stand at the end of the instrument's range, where they say nothing."""
    if name == AUTOCOLLIMATOR:
        return check_saturation(
            block.columns(TwoAxisAutocollimator.fields), stage.tilt_instrument, stage.response(name)
        )
    if name in stage.sensors:
        sensor = stage.sensors[name]
        readings = np.abs(block.columns(listed_kind(sensor).fields))
        return np.asarray((readings >= sensor.range - 0.5 * sensor.resolution).any(axis=1))
    return np.zeros(len(block.rows), np.bool_)
