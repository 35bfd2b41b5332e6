"""How far a fault departs from the textbook form that fits it best."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.cases.departures.departure import AnyFault, Varied
from rotary_error_monitor.cases.faults import Named

Channels = Mapping[str, Array]

FITTED_SHAPES: Mapping[tuple[str, str], float] = {
    ("bearing_asynchronous", "order"): 1e-5,
    ("bearing_asynchronous", "phase"): 1e-4,
    ("cyclic_error", "period"): 1e-9,
}
"""Shapes that a fit of the textbook form finds as it does sizes, with the step, in their unit, of the derivative."""

STEP = 1e-3
"""Step of the derivative by the size of a parameter, times its own."""


@dataclass(frozen=True)
class TextbookFit:
    """The textbook form with the parameters that bring it nearest to a varied fault.

    Attributes:
        parameters: fitted.
        off: by channel, root of the summed squares of what is left over the noise, standard deviations.
        share: root of the summed squares of all that is left over that of the varied fault.
    """

    parameters: dict[str, Any]
    off: dict[str, float]
    share: float


def fit_textbook(varied: Varied, channels: Callable[[tuple[AnyFault, ...]], Channels]) -> TextbookFit:
    """Least squares of the plant's own textbook signals, which are linear in the parameters but for `FITTED_SHAPES`.

    Args:
        varied: the fault.
        channels: gives by channel how far faults move a recording, over the noise.
    """
    target, textbook = channels((varied,)), channels((varied.textbook,))
    names, stacked = list(target), np.concatenate(list(target.values()))
    base = np.concatenate([textbook[name] for name in names])
    places = _places(varied.textbook)
    table = []
    for name, index, step in places:
        stepped = channels((_stepped(varied.textbook, name, index, step),))
        table.append((np.concatenate([stepped[key] for key in names]) - base) / step)
    columns = np.stack(table, axis=1)
    norms = np.linalg.norm(columns, axis=0)
    norms[norms == 0] = 1.0
    change = np.linalg.lstsq(columns / norms, stacked - base, rcond=None)[0]
    left = stacked - base - (columns / norms) @ change
    fitted = varied.textbook
    for (name, index, _), value in zip(places, (change / norms).tolist(), strict=True):
        fitted = _stepped(fitted, name, index, value)
    ends = np.cumsum([len(target[name]) for name in names])[:-1]
    off = {name: float(np.linalg.norm(part)) for name, part in zip(names, np.split(left, ends), strict=True)}
    return TextbookFit(fitted.parameters, off, float(np.linalg.norm(left) / np.linalg.norm(stacked)))


def _places(fault: Named) -> list[tuple[str, int, float]]:
    """Parameters that a fit finds: name, index in a vector, step of the derivative."""
    shapeless = fault.scaled(2.0)
    found = []
    for row in fields(fault):
        value = getattr(fault, row.name)
        shape = FITTED_SHAPES.get((fault.name, row.name))
        if row.name != "location" and (shape is not None or value != getattr(shapeless, row.name)):
            values = np.atleast_1d(value)
            found += [(row.name, i, shape or STEP * float(np.linalg.norm(values))) for i in range(len(values))]
    return found


def _stepped(fault: Named, name: str, index: int, step: float) -> Named:
    value = getattr(fault, name)
    changed: dict[str, Any] = {name: value + step if not isinstance(value, tuple) else _added(value, index, step)}
    return replace(fault, **changed)


def _added(vector: tuple[float, ...], index: int, step: float) -> tuple[float, ...]:
    return (*vector[:index], vector[index] + step, *vector[index + 1 :])
