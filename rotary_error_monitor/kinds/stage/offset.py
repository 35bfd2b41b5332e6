"""Where a stage's gap lands: in the error motion that the estimator publishes, and with it in the tool's offset."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.streams import AUTOCOLLIMATOR
from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.effects.rotor import HEAD
from rotary_error_monitor.kinds.stage.rows import StageRows
from rotary_error_monitor.metrology.encoder_heads import HeadLayout, estimate_ring_pose
from rotary_error_monitor.metrology.error_motion import remove_eccentricity, remove_graduation, remove_mirror
from rotary_error_monitor.twin.stage import StageTwin

INSTANTS = 4000
"""Instants at which the estimate is held against the truth: many to a turn of any usual recording."""

FEWEST_HEADS = 3

ABOVE = 0.1
"""Height above the ring, m, for which the offset is told beside that at the ring."""


def offset_figures(problem: StageRows, causes: Sequence[Cause]) -> Mapping[str, float]:
    """How wrong the tool's offset is while the causes are in the stage and not in its description, RMS.

    The twin with the causes plays the stage: it tells both what the sensors show and how the rotor truly moves. What
    the estimator makes of the one (Lou et al. 2019, Equations 1-7) is held against the other.
    """
    heads = problem.recording.heads
    if not causes or len(heads) < FEWEST_HEADS or AUTOCOLLIMATOR not in problem.twin.times:
        return {}
    time = np.linspace(0.0, problem.recording.duration, INSTANTS)
    read = {name: np.interp(time, problem.twin.times[name], problem.twin.observed[name]) for name in heads}
    twin = StageTwin(
        problem.stage, problem.twin.inputs, dict.fromkeys((*heads, AUTOCOLLIMATOR), time), read, problem.twin.known
    )
    wrong = [after - before for after, before in zip(_errors(twin, time, causes), _errors(twin, time, ()), strict=True)]
    rotation, radial, tilt = wrong
    above = radial + ABOVE * np.stack([tilt[:, 1], -tilt[:, 0]], axis=1)
    return {
        "tool_offset_error_at_the_ring_um": 1e6 * _rms(radial),
        f"tool_offset_error_{ABOVE * 1e3:.0f}_mm_above_um": 1e6 * _rms(above),
        "tool_direction_error_urad": 1e6 * _rms(tilt),
        "rotation_error_urad": 1e6 * _rms(rotation[:, None]),
    }


def _errors(twin: StageTwin, time: Array, causes: Sequence[Cause]) -> tuple[Array, Array, Array]:
    """Rotation (m,), radial error motion (m, 2) and tilt (m, 2) as estimated, minus as they are."""
    stage, shown = twin.stage, twin.predict(causes)
    heads = [name for name in shown if name.startswith(HEAD)]
    azimuth = np.array([stage.azimuths[name.removeprefix(f"{HEAD}_")] for name in heads])
    readings = remove_graduation(np.column_stack([shown[name] for name in heads]), azimuth, stage.ring)
    layout = HeadLayout(tuple(azimuth.tolist()))
    ring = estimate_ring_pose(layout, stage.ring.disc_radius, readings, np.ones_like(readings))
    theta, radial, tilt = twin.motion(time, causes)
    return (
        ring.theta - theta,
        remove_eccentricity(ring.centre, ring.theta, stage.ring) - radial,
        remove_mirror(shown[AUTOCOLLIMATOR], ring.theta, stage.mirror) - tilt,
    )


def _rms(vectors: Array) -> float:
    return float(np.sqrt(np.mean(np.sum(np.square(vectors), axis=1))))
