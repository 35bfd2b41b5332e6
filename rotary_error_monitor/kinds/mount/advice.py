"""Pointings that would tell effects of a mount apart, found by predicting them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.effects.effect import Cause, Role
from rotary_error_monitor.gap.telling_apart import advise_best
from rotary_error_monitor.kinds.mount.description import MountGeometry
from rotary_error_monitor.kinds.mount.twin import MountRecording, MountTwin


def mount_advice(twin: MountTwin, geometry: MountGeometry, std: Array, first: Cause, rivals: Sequence[Cause]) -> str:
    """Words for the pointings that tell the first effect apart from its rivals best.

    Args:
        twin: with the pointings that there are.
        geometry: of the mount beside the first effect.
        std: (2,) noise of a pointing along each way, rad.
        first: as fitted.
        rivals: without size.
    """
    scored = [
        (min(_distance(MountTwin(twin.mount, planned, twin.known), geometry, std, first, one) for one in rivals), words)
        for words, planned in _experiments(twin.recording)
    ]
    return advise_best(scored, "no pointings that were tried tell them apart: the best")


def _experiments(recording: MountRecording) -> list[tuple[str, MountRecording]]:
    """Pointings that a person can add: all over the sky, low ones, the poles of both axes, back and forth, later."""
    rng = np.random.default_rng(0)
    count = 120
    hour, declination = recording.readings.T
    spread = np.column_stack([rng.uniform(-np.pi / 2, np.pi / 2, count), rng.uniform(-0.5, 1.5, count)])
    turned = np.where((np.arange(count) % 2 == 0)[:, None], spread, [[np.pi, np.pi]] + spread * [1, -1])
    few = np.tile([[hour.mean(), np.quantile(declination, 0.3)]], (count, 1)) + rng.normal(0, 0.02, (count, 2))
    soon, later = recording.time.max() + 60.0 * np.arange(count), recording.time.max() + 4 * 3600.0
    still = np.zeros((count, 2))
    ways = np.column_stack([rng.choice([-1.0, 1.0], count), rng.choice([-1.0, 1.0], count)])
    return [
        ("point all over the sky, on both sides of the pier", _with(recording, turned, ways, soon)),
        ("point low in the east and west", _with(recording, spread * [1.0, 0.2], ways, soon)),
        ("come to one star from all directions", _with(recording, few, ways, soon)),
        ("point at one star again four hours later", _with(recording, few, still, np.full(count, later))),
    ]


def _with(recording: MountRecording, readings: Array, direction: Array, time: Array) -> MountRecording:
    stars = np.where(np.cos(readings[:, 1:]) < 0, readings * [1, -1] + [-np.pi, np.pi], readings)
    return replace(
        recording,
        readings=np.concatenate([recording.readings, readings]),
        direction=np.concatenate([recording.direction, direction]),
        stars=np.concatenate([recording.stars, stars]),
        time=np.concatenate([recording.time, time]),
    )


def _distance(twin: MountTwin, geometry: MountGeometry, std: Array, first: Cause, rival: Cause) -> float:
    """Standard deviations between the first cause as fitted and the nearest that rival and geometry can do.

    Exact in all rotations: products of a large effect and the geometry must not pass for a difference.
    """
    linear = rival.effect.indices(Role.LINEAR)
    wanted, sizes = twin.error(geometry, (first,)), rival.effect.scales()[linear]

    def misfit(moved: Array) -> Array:
        values = rival.values.copy()
        values[linear] += moved[6:] * sizes
        made = twin.error(geometry.plus(tuple(1e-3 * moved[:6])), (rival.with_values(rival.effect.held(values)),))
        return np.asarray(((made - wanted) / std[:, None]).ravel(), np.float64)

    found = least_squares(misfit, np.zeros(6 + len(linear)), method="lm", x_scale="jac")
    return float(np.sqrt(2 * found.cost))
