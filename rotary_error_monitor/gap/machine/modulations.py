"""What the signature of a machine's effect may be modulated with: temperature, time, direction, place, its own size."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from rotary_error_monitor.description.machine import Axis
from rotary_error_monitor.effects.effect import Cause, Role
from rotary_error_monitor.effects.machine_effect import LINEAR
from rotary_error_monitor.gap.departures import (
    Departures,
    Modulation,
    Normaliser,
    amplitude_sizes,
    grows,
    modulated,
    modulations_by_size,
    percent,
    spread_out,
    wanders,
)
from rotary_error_monitor.gap.problem import Array

if TYPE_CHECKING:
    from rotary_error_monitor.gap.machine.problem import MachineProblem

COURSES = 4
"""Slow courses over the poses in which an effect may wander: poses of one part of a programme are few."""


def machine_departures(problem: MachineProblem, place: int, causes: Sequence[Cause]) -> Departures:
    """Ways in which the cause at one place among the causes may depart from its textbook form."""
    cause = causes[place]
    linear = cause.effect.indices(Role.LINEAR)
    amplitudes, sizes = cause.values[linear], amplitude_sizes(cause)
    rows = problem.signature(cause, linear, causes)
    signature = np.stack([rows[channel] for channel in problem.channels], axis=1)
    modulations = [*_of_poses(problem, _axes(problem, cause)), *_of_size(signature @ amplitudes)]
    made = modulated(signature, amplitudes, sizes, modulations)
    columns = {channel: made[:, i] for i, channel in enumerate(problem.channels)}
    labels = spread_out(modulations, amplitudes, sizes)
    return Departures(place, *labels, columns)


def _axes(problem: MachineProblem, cause: Cause) -> tuple[Axis, ...]:
    """The axis that an effect sits on, else all."""
    own = [axis for axis in problem.machine.axes if axis.letter == cause.location[-1:] and len(cause.location) != 2]
    return tuple(own) or tuple(problem.machine.axes)


def _of_poses(problem: MachineProblem, axes: Sequence[Axis]) -> list[Modulation]:
    recording, index = problem.recording, problem.index
    quantities: dict[str, tuple[str, Array, Callable[[float, float], str]]] = {
        "temperature": ("temperature", recording.temperature, _with_temperature),
        "time": ("time", index, lambda change, unit: f"{grows(change)} with time"),
    }
    for axis in axes:
        column = problem.machine.letters.index(axis.letter)
        position = recording.positions[:, column]
        quantities[f"direction of {axis.letter}"] = (
            f"direction of {axis.letter}",
            recording.direction[:, column],
            partial(_with_direction, axis.letter),
        )
        for i, shape in enumerate(_shapes(axis, position)):
            quantities[f"place of {axis.letter} {i}"] = f"place on {axis.letter}", shape, partial(_with_place, axis)
    norm = Normaliser({name: values for name, (_, values, _) in quantities.items()})
    found = [
        Modulation(kind, norm(name, values), partial(_said, say, norm.unit(name)), len(axes) == 1)
        for name, (kind, values, say) in quantities.items()
        if norm.unit(name)
    ]
    course = index / max(len(index) - 1, 1)
    waves = (np.sqrt(2) * np.cos(np.pi * order * course) for order in range(2, COURSES + 1))
    return [*found, *(Modulation("course", wave, wanders) for wave in waves)]


def _of_size(signal: Array) -> list[Modulation]:
    """Modulations by what the cause does (n, 3), beside its root mean square on the component that it moves most."""
    return modulations_by_size(signal, float(np.sqrt(np.max(np.mean(np.square(signal), axis=0)))))


def _shapes(axis: Axis, position: Array) -> list[Array]:
    """Shapes along an axis: neighbouring orders of a rotary one, slope and bow of a linear one."""
    if axis.kind == LINEAR:
        scaled = (2 * position - sum(axis.travel)) / np.ptp(axis.travel)
        return [scaled, np.square(scaled)]
    return [wave(order * position) for order in (1, 2) for wave in (np.cos, np.sin)]


def _said(say: Callable[[float, float], str], unit: float, change: float) -> str:
    return say(change, unit)


def _with_temperature(change: float, unit: float) -> str:
    return f"{grows(change)} with temperature by {percent(change / unit)}/K"


def _with_direction(letter: str, change: float, unit: float) -> str:
    side = "negative" if change > 0 else "positive"
    return f"smaller in the {side} direction of {letter} by {percent(2 * change / unit)}"


def _with_place(axis: Axis, change: float, unit: float) -> str:
    return f"differs along {axis.letter}" if axis.kind == LINEAR else f"neighbouring orders of {axis.letter}"
