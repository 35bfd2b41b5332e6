"""Smooth errors that any machine may have: what is left is tested against them, and outliers are told beside them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammainc

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.description.machine_parts import Axis
from rotary_error_monitor.effects.machine_effect import LINEAR, positioning_error
from rotary_error_monitor.gap.options import FALSE_ALARMS
from rotary_error_monitor.gap.p_values import chi_square_median, log_f_tail
from rotary_error_monitor.gap.problem import StructureTest
from rotary_error_monitor.gap.slow_noise import cosines, in_all
from rotary_error_monitor.twin.machine import MachineRecording, predict_probe

OUTLIER = 5.0
"""A pose further than this many standard deviations from every smooth machine is an outlier of the tracker."""

MOST_OUTLIERS = 0.1
"""Part of the poses that may be outliers: of a tracker that fails more often nothing can be told, and what seems to lie
far out at more poses is an error of the machine that is not smooth."""

MOST_STEPS, SETTLED = 12, 1e-3
"""Steps of a robust fit, and the change of a weight from which on another one changes nothing."""

DRIFT = 5.0
"""Amplitude of the first order of a slow drift of the probe, in its noise, at which it is lightly held: those of a few
orders are free, up to the eighth with a hundred poses or more, and what changes within a few poses is none."""

_LEVER = 1e-5
"""Size of an error component, m or rad, by which its lever at a pose is found: above rounding, below curvature."""


class SmoothMachine:
    """Every smooth error that the axes of a machine can have, at the poses of a recording.

    Args:
        machine: the description.
        recording: the poses.
        probe_std: (3,) standard deviation of the probe's components, m.
        warmed: (3, n, j) change of the probe, m, by each way in which the temperature may be wrong.
    """

    def __init__(
        self, machine: MachineDescription, recording: MachineRecording, probe_std: Array, warmed: Array
    ) -> None:
        self._tables = _tables(machine, recording, probe_std)
        warm = (warmed / probe_std[:, None, None]).reshape(3 * warmed.shape[1], warmed.shape[2])
        table = np.concatenate([*(columns for _, _, columns in self._tables), warm], axis=1)
        self.columns = table / np.maximum(np.linalg.norm(table, axis=0), 1e-12) * np.sqrt(len(table))
        """White columns (3 n, p), components one after the other, each with a mean square of one."""

        passed = np.linspace(-1, 1, len(recording.positions))
        sides = [
            (2 * q - sum(a.travel)) / np.ptp(a.travel) for a, q in zip(machine.axes, recording.positions.T, strict=True)
        ]
        self.factors = np.column_stack([recording.direction, passed, np.sign(passed), *sides, *map(np.sign, sides)])
        """(n, k) what an error may go with: directions, time, its halves, positions and halves of the travel."""

        self._drift = _slow_courses(len(passed))

        # As they were probed, and along each axis.
        self._orders = [np.arange(len(passed)), *np.argsort(recording.positions, axis=0, kind="stable").T]

    def findings(self, white: Array, kept: NDArray[np.bool_], noise_dof: float) -> list[StructureTest]:
        """The smooth error of each axis that white rows (3 n,), zero where not `kept` (n,), show most of.

        The level of their noise is known with so many degrees of freedom.
        """
        findings = []
        for axis, names, table in self._tables:
            own = table * np.tile(kept, 3)[:, None]
            gains = np.square(own.T @ white) / np.maximum(np.sum(np.square(own), axis=0), 1e-300)
            best = int(np.argmax(gains))
            chance = min(0.0, log_f_tail(float(gains[best]), 1, noise_dof) + float(np.log(len(names))))
            findings.append(
                StructureTest("probe", f"axis {axis}", chance, max(0.0, float(gains[best]) - 1), names[best])
            )
        return findings

    def inliers(self, white: Array) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Poses (n,) that count, and (n,) those of them whose white rows (n, 3) a smooth machine can explain, by a fit
        that hardly weighs distant ones: these tell the noise.

        Every smooth error of every axis and a slow drift of the probe take part, lightly held, so that an effect,
        however large, is no outlier and hides none. Nor are poses that stand together, in time or along an axis: what
        disturbs a probe knows nothing of its neighbours, and what happens to some of them in turn is the machine's.
        """
        distance, spread = _robust_fit(self.columns, white)
        if spread > 1:
            drift, dof = self._drift
            beside_drift, least = _robust_fit(np.hstack([self.columns, drift]), white)
            # a drift is there where it is worth its degrees of freedom (BIC)
            if 2 * white.size * np.log(spread / least) > dof * np.log(white.size):
                distance, spread = beside_drift, least
        outlying: NDArray[np.bool_] = np.asarray(distance > OUTLIER * spread, bool)
        if outlying.mean() > MOST_OUTLIERS:
            outlying &= distance >= np.quantile(distance, 1 - MOST_OUTLIERS)
        alone = outlying
        for order in self._orders:
            alone = alone & ~_together(outlying, order, FALSE_ALARMS / len(self._orders))
        return ~alone, ~outlying


def _robust_fit(table: Array, white: Array) -> tuple[Array, float]:
    """Distance of each pose (n,) from what white columns (3 n, p) make of rows (n, 3), and the usual one, 1 or more."""
    rows, weight = white.T.ravel(), np.ones(len(white))
    for _ in range(MOST_STEPS):
        tripled = np.tile(weight, 3)
        gram = table.T @ (tripled[:, None] * table) + np.eye(table.shape[1])
        left = rows - table @ np.linalg.solve(gram, table.T @ (tripled * rows))
        distance = np.sqrt(np.mean(np.square(left.reshape(3, -1)), axis=0))
        spread = max(1.0, float(np.median(distance)) / np.sqrt(chi_square_median(3) / 3))
        # Weights of Student's t, three degrees of freedom: a distant pose counts with the inverse of its square.
        before, weight = weight, np.minimum(4.0 / (3.0 + np.square(distance / spread)), 1.0)
        if np.max(np.abs(weight - before)) < SETTLED:
            break
    return distance, spread


def _slow_courses(count: int) -> tuple[Array, float]:
    """White columns (3 n, q) of slow courses of each component of the probe, and the degrees of freedom that they have.

    A course that steps at each of its moments from one rate to another has amplitudes that fall with the order squared.
    """
    slow = cosines((np.arange(count) + 0.5) / count)
    slow *= DRIFT / np.maximum(np.arange(slow.shape[1]), 1) ** 2
    held = np.sum(np.square(slow), axis=0)
    return in_all(slow, np.ones((3, count))), 3 * float(np.sum(held / (1 + held)))


def _together(outlying: NDArray[np.bool_], order: NDArray[np.intp], least: float) -> NDArray[np.bool_]:
    """Those of the outlying poses (n,) that have another beside them in an order, if chance puts together so many.

    Of k among n that are independent k (k - 1) / n pairs are neighbours, nearly Poisson's number of them.

    Args:
        outlying: (n,) by number.
        order: (n,) numbers of poses.
        least: probability below which it is no chance.
    """
    ordered, count = outlying[order], int(outlying.sum())
    pairs = ordered[1:] & ordered[:-1]
    if gammainc(max(int(pairs.sum()), 1), count * (count - 1) / len(ordered)) >= least:
        return np.zeros(len(outlying), bool)
    beside = np.zeros(len(outlying), bool)
    beside[order[1:][pairs]] = beside[order[:-1][pairs]] = True
    return beside


def _tables(
    machine: MachineDescription, recording: MachineRecording, probe_std: Array
) -> list[tuple[str, list[str], Array]]:
    """For each axis, names and white columns (3 n, p) of smooth errors: powers, harmonics, reversal, warmth.

    To first order a component's effect is its value times where that axis stands at the pose: one prediction for
    each component gives that lever, and every shape is a multiple of it.
    """
    base = predict_probe(machine, recording)
    warming = recording.temperature - machine.reference_temperature
    tables = []
    for column, axis in enumerate(machine.axes):
        position, direction = recording.positions[:, column], recording.direction[:, column]
        shapes = _shapes(position, axis)
        names, columns = [], []
        for about in "XYZABC":
            component = f"E{about}{axis.letter}"
            lever = predict_probe(machine.with_error(component, poly=(_LEVER,)), recording) - base
            own = component == positioning_error(machine, axis.letter)
            found = {**shapes, "direction": direction, "temperature": warming * position} if own else shapes
            for words, shape in found.items():
                names.append(f"pose: {component}, {words} of {axis.letter}")
                columns.append((lever * shape[:, None] / probe_std).T.ravel())
        tables.append((axis.letter, names, np.stack(columns, axis=1)))
    return tables


def _shapes(position: Array, axis: Axis) -> dict[str, Array]:
    """Smooth functions of an axis's position, by their names: powers of a linear one, harmonics of a rotary one."""
    if axis.kind == LINEAR:
        scaled = (2 * position - sum(axis.travel)) / np.ptp(axis.travel)
        return {f"power {k}": scaled**k for k in range(6)}
    waves = {f"order {k}, {wave.__name__}": wave(k * position) for k in range(1, 5) for wave in (np.cos, np.sin)}
    return {"order 0": np.ones(len(position)), **waves}
