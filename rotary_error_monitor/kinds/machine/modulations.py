"""What the signature of a machine's effect may be modulated with: temperature, time, direction, place, its own size."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.machine_parts import Axis
from rotary_error_monitor.effects.effect import Cause, Role, Searched
from rotary_error_monitor.effects.machine_effect import LINEAR
from rotary_error_monitor.gap.departures import Departures, by_rate, grows
from rotary_error_monitor.gap.pose_modulations import Quantity, departures_at_poses, waves_around, with_direction
from rotary_error_monitor.kinds.machine.added_forms import added_forms
from rotary_error_monitor.kinds.machine.table import MachineTable


def machine_departures(problem: MachineTable, place: int, causes: Sequence[Cause]) -> Departures:
    """Ways in which the cause at one place among the causes may depart from its textbook form.

    Of an effect that sits on an axis each amplitude may depend on that axis in its own way, on the others all alike.
    """
    cause, recording, axes = causes[place], problem.recording, problem.machine.axes
    rows = problem.signature(cause, cause.effect.indices(Role.LINEAR), causes)
    units = dict(zip(problem.channels, problem.std.tolist(), strict=True))
    warming = recording.temperature - problem.machine.reference_temperature
    always = {
        "temperature": Quantity("temperature", warming, partial(_with_temperature, float(np.ptp(warming))), zero=True),
        "time": Quantity("time", problem.index, lambda change, unit: f"{grows(change)} with time"),
    }
    own = [axis for axis in axes if axis.letter == cause.location[-1:] and len(cause.location) != 2]
    others = _of_axes(problem, [axis for axis in axes if axis not in own])
    waves = cause.effect.searched is Searched.WAVE
    each, together = ({**always, **_of_axes(problem, own, waves)}, others) if own else ({}, {**always, **others})
    added = [(form, problem.white(form.columns)) for axis in own for form in added_forms(problem, cause, axis)]
    return departures_at_poses(place, cause, rows, units, problem.index, each, together, added)


def _of_axes(problem: MachineTable, axes: Sequence[Axis], waves: bool = False) -> dict[str, Quantity]:
    """Direction and place of axes; those of a wave along them with the periods beside its own."""
    found = {}
    for axis in axes:
        letter, column = axis.letter, problem.machine.letters.index(axis.letter)
        direction, position = problem.recording.direction[:, column], problem.recording.positions[:, column]
        found[f"direction of {letter}"] = Quantity(f"direction of {letter}", direction, with_direction(letter))
        for i, shape in enumerate(_shapes(axis, position, waves)):
            found[f"place on {letter} {i}"] = Quantity(f"place on {letter}", shape, partial(_with_place, axis, waves))
    return found


def _shapes(axis: Axis, position: Array, waves: bool) -> list[Array]:
    """Shapes along an axis: neighbouring orders of a rotary one, slope and bow of a linear one.

    With a wave along a linear axis neighbours are waves of one and two periods more or fewer over the travel.
    """
    if axis.kind != LINEAR:
        return waves_around(position)
    scaled = (2 * position - sum(axis.travel)) / np.ptp(axis.travel)
    return [scaled, np.square(scaled), *(waves_around(np.pi * scaled) if waves else ())]


def _with_temperature(span: float, change: float, unit: float) -> str:
    return f"{grows(change)} with temperature {by_rate(change / unit, span, 'K')}"


def _with_place(axis: Axis, waves: bool, change: float, unit: float) -> str:
    if axis.kind != LINEAR:
        return f"neighbouring orders of {axis.letter}"
    return f"differs along {axis.letter}, or neighbouring periods" if waves else f"differs along {axis.letter}"
