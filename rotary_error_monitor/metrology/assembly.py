"""Assembly errors of ring and mirror from a recording of the shaft between centres (Lou et al. 2019, Figure 3).

Between centres the shaft has no error motion of its own, so all that the heads disagree in is eccentricity and
graduation of the ring, and all that the autocollimator sees is tilt and flatness of the mirror. Both are linear in the
unknown coefficients and solved by least squares; what the recording cannot determine is refused, not guessed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.description.stage import AngularHarmonic, PlanarHarmonic, StageDescription
from rotary_error_monitor.errors import InputError

SMALLEST_TURN = 2 * np.pi
"""Rotation that a recording must cover, rad."""

SEEN = 1e-6
"""Smallest singular value of a scaled design matrix whose unknown counts as determined."""


@dataclass(frozen=True)
class ShaftRecording:
    """Simultaneous samples of the shaft between centres, at m times.

    Attributes:
        heads: letters of the heads that were read.
        readings: (m, h) of the heads, rad.
        reading_variances: (m, h) rad².
        speed: (m,) of rotation, rad/s.
        tilt: (m, 2) of the autocollimator, rad; None without one.
        tilt_variances: (m, 2) rad².
    """

    heads: tuple[str, ...]
    readings: NDArray[np.float64]
    reading_variances: NDArray[np.float64]
    speed: NDArray[np.float64]
    tilt: NDArray[np.float64] | None = None
    tilt_variances: NDArray[np.float64] | None = None


@dataclass(frozen=True)
class RingAssembly:
    """Eccentricity (m) and graduation (rad) of the ring, with standard uncertainties.

    Attributes:
        head_offsets: reading of each head at zero less that of their mean, rad.
        hidden_orders: orders up to the highest asked for that these heads cannot see; they are not among `graduation`.
        noise_ratio: root mean square of the residual over what noise and resolution explain.
    """

    eccentricity: tuple[float, float]
    eccentricity_std: tuple[float, float]
    graduation: tuple[AngularHarmonic, ...]
    graduation_std: tuple[tuple[float, float], ...]
    head_offsets: tuple[float, ...]
    hidden_orders: tuple[int, ...]
    noise_ratio: float


@dataclass(frozen=True)
class MirrorAssembly:
    """Tilt and flatness of the mirror, rad, with standard uncertainties.

    Attributes:
        line_of_sight: constant reading of the autocollimator, rad: how it is set up, not an error of the mirror.
        delay: age of the autocollimator's values at their stamps, s.
        noise_ratio: root mean square of the residual over what noise and resolution explain.
    """

    tilt: tuple[float, float]
    tilt_std: tuple[float, float]
    flatness: tuple[PlanarHarmonic, ...]
    flatness_std: tuple[float, ...]
    line_of_sight: tuple[float, float]
    delay: float
    delay_std: float
    noise_ratio: float


def estimate_ring_assembly(stage: StageDescription, recording: ShaftRecording, highest_order: int = 8) -> RingAssembly:
    """Eccentricity and graduation orders 2 to `highest_order` from what the heads disagree in.

    The rotation at each time is unknown and drops out, and with it every order that all heads see alike.

    Raises:
        InputError: less than two heads, less than a whole turn, or heads that stand at one place.
    """
    if len(recording.heads) < 2:
        raise InputError(
            f"{len(recording.heads)} read head in the recording; the eccentricity of the ring needs at least 2, opposed"
        )
    azimuths = np.array([stage.encoder.azimuths[name] for name in recording.heads])
    theta = recording.readings.mean(axis=1)
    _check_whole_turn(theta)
    visible = [k for k in range(1, highest_order + 1) if _is_seen(azimuths, k)]
    if 1 not in visible:
        raise InputError(
            f"heads at azimuths {azimuths.tolist()} rad stand at one place; opposed heads see eccentricity"
        )
    psi = azimuths - theta[:, None]
    offsets = np.broadcast_to(np.eye(len(azimuths))[:, 1:], (len(theta), len(azimuths), len(azimuths) - 1))
    waves = [wave(k * psi) for k in visible for wave in (np.cos, np.sin)]
    design = np.concatenate([np.stack(waves, axis=-1), offsets], axis=-1)
    solution, covariance, ratio = _solve_differences(design, recording.readings, recording.reading_variances)
    std = np.sqrt(np.diag(covariance))
    radius = stage.encoder.disc_radius
    # eccentricity e reads (-e_x sin psi + e_y cos psi) / r: it is order 1 of the graduation
    shifts = np.concatenate([[0.0], solution[2 * len(visible) :]])
    return RingAssembly(
        eccentricity=(-radius * float(solution[1]), radius * float(solution[0])),
        eccentricity_std=(radius * float(std[1]), radius * float(std[0])),
        graduation=tuple(
            AngularHarmonic(k, float(solution[2 * i]), float(solution[2 * i + 1]))
            for i, k in enumerate(visible)
            if k > 1
        ),
        graduation_std=tuple((float(std[2 * i]), float(std[2 * i + 1])) for i, k in enumerate(visible) if k > 1),
        head_offsets=tuple((shifts - shifts.mean()).tolist()),
        hidden_orders=tuple(k for k in range(1, highest_order + 1) if k not in visible),
        noise_ratio=ratio,
    )


def estimate_mirror_assembly(
    recording: ShaftRecording, orders: Sequence[int] = (2, 3), delay: float | None = None
) -> MirrorAssembly:
    """Tilt of the mirror and its flatness of the given orders.

    A delay of the autocollimator turns the mirror's apparent direction by speed times delay. It is estimated with the
    rest, which takes both directions or two speeds, unless a known `delay` (s) is given.

    Raises:
        InputError: no autocollimator, less than a whole turn, or one speed only without a known delay.
    """
    if recording.tilt is None or recording.tilt_variances is None:
        raise InputError("the recording holds no autocollimator samples; the mirror's tilt cannot be determined")
    theta = recording.readings.mean(axis=1)
    _check_whole_turn(theta)
    if delay is None and np.ptp(recording.speed) < 0.1 * np.abs(recording.speed).max():
        raise InputError(
            f"one speed and direction only ({recording.speed.mean():.3g} rad/s): the autocollimator's delay cannot "
            "be told from the mirror's direction; record both directions, or give the delay"
        )
    seen = theta if delay is None else theta - recording.speed * delay
    solution, std, ratio = _fit_mirror(recording, seen, orders, None)
    found, found_std = (delay or 0.0), 0.0
    if delay is None:
        for _ in range(3):  # the delay enters through theta - speed * delay: Gauss-Newton, almost linear
            solution, std, ratio = _fit_mirror(recording, theta - recording.speed * found, orders, solution)
            found, found_std = found + float(solution[-1]), float(std[-1])
    rows = [solution[4 + 4 * i : 8 + 4 * i] for i in range(len(orders))]
    return MirrorAssembly(
        tilt=(float(solution[0]), float(solution[1])),
        tilt_std=(float(std[0]), float(std[1])),
        flatness=tuple(
            PlanarHarmonic(k, (float(r[0]), float(r[1])), (float(r[2]), float(r[3])))
            for k, r in zip(orders, rows, strict=True)
        ),
        flatness_std=tuple(float(std[4 + 4 * i : 8 + 4 * i].max()) for i in range(len(orders))),
        line_of_sight=(float(solution[2]), float(solution[3])),
        delay=found,
        delay_std=found_std,
        noise_ratio=ratio,
    )


def _fit_mirror(
    recording: ShaftRecording,
    theta: NDArray[np.float64],
    orders: Sequence[int],
    previous: NDArray[np.float64] | None,
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Tilt, line of sight, flatness and, around a `previous` solution, the change of the delay."""
    assert recording.tilt is not None and recording.tilt_variances is not None
    cos, sin, one, zero = np.cos(theta), np.sin(theta), np.ones(len(theta)), np.zeros(len(theta))
    x, y = [cos, -sin, one, zero], [sin, cos, zero, one]
    slope_x, slope_y = [-sin, -cos, zero, zero], [cos, -sin, zero, zero]
    for k in orders:
        c, s = np.cos(k * theta), np.sin(k * theta)
        x, y = [*x, c, s, zero, zero], [*y, zero, zero, c, s]
        slope_x, slope_y = [*slope_x, -k * s, k * c, zero, zero], [*slope_y, zero, zero, -k * s, k * c]
    if previous is not None:
        known = previous[: len(slope_x)]
        x.append(-recording.speed * (np.stack(slope_x, 1) @ known))
        y.append(-recording.speed * (np.stack(slope_y, 1) @ known))
    design = np.concatenate([np.stack(x, 1), np.stack(y, 1)])
    measured = np.concatenate([recording.tilt[:, 0], recording.tilt[:, 1]])
    std = np.sqrt(np.concatenate([recording.tilt_variances[:, 0], recording.tilt_variances[:, 1]]))
    solution, covariance, ratio = _solve(design / std[:, None], measured / std)
    return solution, np.sqrt(np.diag(covariance)), ratio


def _solve_differences(
    design: NDArray[np.float64], readings: NDArray[np.float64], variances: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Least squares with an unknown rotation at every time, which a weighted mean over the heads removes."""
    weight = 1.0 / variances
    share = weight / weight.sum(axis=1, keepdims=True)
    scale = np.sqrt(weight)
    rows = (design - (share[:, :, None] * design).sum(axis=1, keepdims=True)) * scale[:, :, None]
    relative = readings - readings[:, :1]
    residual = (relative - (share * relative).sum(axis=1, keepdims=True)) * scale
    return _solve(rows.reshape(-1, rows.shape[-1]), residual.ravel(), dropped=len(readings))


def _solve(
    design: NDArray[np.float64], measured: NDArray[np.float64], dropped: int = 0
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Solution, covariance and residual ratio; `dropped` degrees of freedom were removed before.

    The covariance is scaled by the residual where that is larger than the stated noise.
    """
    size = np.linalg.norm(design, axis=0)
    _, singular, right = np.linalg.svd(design / size, full_matrices=False)
    if singular[-1] < SEEN * singular[0]:
        raise InputError("the recording does not determine all assembly errors: rotate over more of a turn, both ways")
    solution = np.linalg.lstsq(design / size, measured, rcond=None)[0] / size
    residual = measured - design @ solution
    freedom = max(1, len(measured) - dropped - design.shape[1])
    ratio = float(np.sqrt(residual @ residual / freedom))
    inverse = (right.T / singular**2) @ right / np.outer(size, size)
    return solution, np.asarray(inverse * max(1.0, ratio) ** 2), ratio


def _check_whole_turn(theta: NDArray[np.float64]) -> None:
    covered = float(np.ptp(theta))
    if covered < SMALLEST_TURN:
        raise InputError(
            f"the recording covers {np.degrees(covered):.1f}° of rotation; a whole turn (360°) tells the orders apart"
        )


def _is_seen(azimuths: NDArray[np.float64], order: int) -> bool:
    """Whether heads differ in this order of the graduation; what all see alike passes for rotation."""
    wave = np.exp(1j * order * azimuths)
    return bool(np.abs(wave - wave.mean()).max() > 1e-3)
