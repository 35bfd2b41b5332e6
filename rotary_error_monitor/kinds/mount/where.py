"""What pointings may depend on, how far a mount's gap shrinks in arcseconds, and what to point at next."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import least_squares

from rotary_error_monitor.effects.effect import Cause, Role
from rotary_error_monitor.gap.problem import Array
from rotary_error_monitor.gap.table import Shapes
from rotary_error_monitor.gap.telling_apart import advise_best
from rotary_error_monitor.kinds.mount.twin import MountRecording, MountTwin

if TYPE_CHECKING:
    from rotary_error_monitor.kinds.mount.problem import MountProblem

ARCSEC = np.degrees(1.0) * 3600
WAYS = {"hour": "/mount/pointing.hour_angle", "declination": "/mount/pointing.declination"}
"""Channels of rows as the diagnosis names them: on the sky, along the way of each axis."""

ORDERS = 4


def mount_shapes(recording: MountRecording, upward: Array) -> Shapes:
    """Smooth functions of what a pointing may depend on, with their names, grouped by that."""
    hour, declination = recording.readings.T
    time = (recording.time - recording.time.mean()) / max(float(np.ptp(recording.time)), 1.0)
    waves = [
        [(f"order {k}, {wave.__name__}", wave(k * angle)) for k in range(1, ORDERS + 1) for wave in (np.cos, np.sin)]
        for angle in (hour, declination)
    ]
    products = [
        (f"{a.__name__} of hour angle, {b.__name__} of declination", a(hour) * b(declination))
        for a in (np.cos, np.sin)
        for b in (np.cos, np.sin)
    ]
    side = np.where(np.cos(declination) < 0, 1.0, -1.0)
    return {
        "pose, hour angle": waves[0],
        "pose, declination": waves[1],
        "pose, both axes": products,
        "pose, side of the pier": [("step", side), ("slope", side * hour)],
        "pose, altitude": [("sine", upward), ("cosine", np.sqrt(np.maximum(1 - upward**2, 0)))],
        "time": [(f"power {k}", time**k) for k in (1, 2, 3)],
        "direction": [
            (f"of {name}", recording.direction[:, i]) for i, name in enumerate(("hour axis", "declination axis"))
        ],
    }


def mount_quantities(problem: MountProblem) -> Mapping[str, Array]:
    """(n,) hour angle, declination, altitude and time of each pointing, in the units that people use."""
    recording = problem.recording
    return {
        "hour axis, °": np.degrees(recording.readings[:, 0]),
        "declination axis, °": np.degrees(recording.readings[:, 1]),
        "altitude, °": np.degrees(np.arcsin(problem.twin.seen[2])),
        "time, h": (recording.time - recording.time.min()) / 3600,
    }


def mount_figures(problem: MountProblem, causes: Sequence[Cause]) -> Mapping[str, float]:
    """Root mean squares on the sky, arcsec, of patches predicted from all others; noise; and the geometry itself.

    Sums of squares of both ways, as pointing analysis gives its `sky RMS`; outliers are left out.
    """
    table = problem.geometry_columns(causes)
    own = [problem.signature(cause, cause.effect.indices(Role.LINEAR), causes) for cause in causes]
    effects = [
        np.concatenate([rows[c] * std for c, std in zip(problem.channels, problem.std, strict=True)]) for rows in own
    ]
    alone = np.concatenate(list(problem.twin.error(problem.geometry(causes), causes)))
    sizes = np.concatenate([c.values[c.effect.indices(Role.LINEAR)] for c in causes]) if causes else np.zeros(0)
    columns = np.concatenate([table, *effects], axis=1)
    without = np.concatenate(list(problem.error(())))
    plain = problem.geometry_columns(())
    indices = problem.mount.geometry.plus((*problem.geometry(()).as_tuple()[:2], 0.0, 0.0, 0.0, 0.0))
    synchronised = np.concatenate(list(problem.twin.error(indices)))
    found = {
        "held_out_indices_arcsec": _held_out(problem, synchronised, plain[:, :2]),
        "held_out_geometry_arcsec": _held_out(problem, without, plain),
    }
    if causes:
        found["held_out_causes_arcsec"] = _held_out(problem, alone + columns[:, 6:] @ sizes, columns)
    found["noise_arcsec"] = float(np.hypot(*problem.std) * ARCSEC)
    names = ("hour_index", "declination_index", "orthogonality", "collimation", "polar_tilt_x", "polar_tilt_y")
    angles = np.array(problem.geometry(causes).as_tuple()) * ARCSEC
    return found | {f"{name}_arcsec": float(angle) for name, angle in zip(names, angles, strict=True)}


def _held_out(problem: MountProblem, values: Array, columns: Array) -> float:
    """Root mean square on the sky, arcsec, of `values` (2 n,) less what columns do, fitted on the other patches.

    Both ways count alike, as they do in the figure.
    """
    kept = np.tile(problem.kept, 2)
    scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    table, left = columns / scale, np.zeros(len(values))
    for label in np.unique(problem.labels):
        test = np.tile(problem.labels == label, 2)
        train = kept & ~test
        fitted, *_ = np.linalg.lstsq(table[train], values[train], rcond=None)
        left[test] = (values - table @ fitted)[test]
    return float(np.sqrt(np.sum(np.square(left[kept])) / problem.kept.sum()) * ARCSEC)


def mount_advice(problem: MountProblem, keys: Sequence[tuple[str, str]], causes: Sequence[Cause]) -> str:
    """Words for the pointings that tell the first of these effects apart from the others best."""
    first = next(cause for cause in causes if cause.key == tuple(keys[0]))
    rivals = [problem.at_zero(key) for key in keys[1:]]
    scored = [
        (min(_distance(problem, first, rival, planned) for rival in rivals), words)
        for words, planned in _experiments(problem.recording)
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


def _distance(problem: MountProblem, first: Cause, rival: Cause, planned: MountRecording) -> float:
    """Standard deviations between the first cause as fitted and the nearest that rival and geometry can do.

    Exact in all rotations: products of a large effect and the geometry must not pass for a difference.
    """
    twin = MountTwin(problem.mount, planned, problem.known)
    geometry, linear = problem.geometry((first,)), rival.effect.indices(Role.LINEAR)
    wanted, sizes = twin.error(geometry, (first,)), rival.effect.scales()[linear]

    def misfit(moved: Array) -> Array:
        values = rival.values.copy()
        values[linear] += moved[6:] * sizes
        made = twin.error(geometry.plus(tuple(1e-3 * moved[:6])), (rival.with_values(rival.effect.held(values)),))
        return np.asarray(((made - wanted) / problem.std[:, None]).ravel(), np.float64)

    found = least_squares(misfit, np.zeros(6 + len(linear)), method="lm", x_scale="jac")
    return float(np.sqrt(2 * found.cost))
