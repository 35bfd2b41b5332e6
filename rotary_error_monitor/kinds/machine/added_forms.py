"""What an effect of a machine's axis does beyond modulations of its textbook form: another zero, other periods."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.machine_parts import Axis
from rotary_error_monitor.effects.effect import Cause, Role, Searched
from rotary_error_monitor.effects.machine_effect import LINEAR
from rotary_error_monitor.gap.departures import SHARE, amplitude_sizes
from rotary_error_monitor.gap.pose_modulations import FormAtPoses
from rotary_error_monitor.kinds.machine.table import MachineTable
from rotary_error_monitor.twin.machine import predict_probe

PERIODS = (1 / 3, 1 / 2, 2.0, 3.0)
"""Periods in those of a periodic error that may come with it: of a screw with two threads or a scale read by fields."""

SHIFT = 0.01
"""Part of an axis's travel by which its zero is moved to find what that does: small beside whatever varies along it."""


def added_forms(problem: MachineTable, cause: Cause, axis: Axis) -> list[FormAtPoses]:
    """Those of a cause that sits on a linear axis; none of a rotary one, whose orders tell its zero.

    A scale is fixed somewhere else than at the zero of its axis, a guideway sags about another point than the middle of
    the travel.
    """
    if axis.kind != LINEAR:
        return []
    column = problem.machine.letters.index(axis.letter)
    if cause.effect.searched is Searched.WAVE:
        return [FormAtPoses("other periods", _other_period, _other_periods(problem, cause, column))]
    return [
        FormAtPoses("another zero", _other_zero, _moved(problem, cause, column, SHIFT * float(np.ptp(axis.travel))))
    ]


def _moved(problem: MachineTable, cause: Cause, column: int, by: float) -> Array:
    """(3, n, 1) what another zero of an axis does, as large as a departure: a part of what the cause does."""
    place = problem.recording.positions[:, column]
    here, ahead, behind = (_shown(problem, cause, column, place + way * by) for way in (0, 1, -1))
    return _as_large(ahead - behind, here)[:, :, None]


def _other_periods(problem: MachineTable, cause: Cause, column: int) -> Array:
    """(3, n, q) waves of other periods, cosine and sine each as large as a departure."""
    linear, place = cause.effect.indices(Role.LINEAR), problem.recording.positions[:, column]
    found = []
    for period in PERIODS:
        for index, size in zip(linear, amplitude_sizes(cause), strict=True):
            alone = cause.values.copy()
            alone[linear] = 0.0
            alone[index] = SHARE * size
            found.append(_shown(problem, cause.with_values(alone), column, place / period))
    return np.stack(found, axis=2)


def _shown(problem: MachineTable, cause: Cause, column: int, place: Array) -> Array:
    """(3, n) what a cause would do to the probe, m, if an axis stood at other places (n,)."""
    positions = problem.recording.positions.copy()
    positions[:, column] = place
    poses = replace(problem.recording, positions=positions)
    return np.asarray((predict_probe(problem.machine, poses, (cause,)) - predict_probe(problem.machine, poses)).T)


def _as_large(shown: Array, cause: Array) -> Array:
    """What is shown (3, n) as large as a departure of a cause that shows (3, n); rounding is nothing."""
    size, own = (float(np.sqrt(np.mean(np.square(part)))) for part in (shown, cause))
    return shown * (SHARE * own / size) if size > SHIFT * SHIFT * own else np.zeros_like(shown)


def _other_zero(change: float) -> str:
    return "goes about another point of its axis"


def _other_period(change: float) -> str:
    return "brings waves of other periods"
