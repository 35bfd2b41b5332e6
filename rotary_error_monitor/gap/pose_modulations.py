"""What modulations of effects share where recordings are poses, not samples in time."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.effects.effect import Cause, Role
from rotary_error_monitor.gap.departures import (
    Departures,
    Modulation,
    Normaliser,
    Words,
    amplitude_sizes,
    in_proportion,
    modulated,
    modulations_by_size,
    percent,
    settling,
    slow_courses,
    spread_out,
)
from rotary_error_monitor.gap.problem import Rows

Say = Callable[[float, float], str]
"""Words for a relative change of the cause by one standard deviation of a quantity, and that in its own unit."""


@dataclass(frozen=True)
class Quantity:
    """What an effect may depend on.

    Attributes:
        kind: of departure.
        values: (n,) at the poses.
        say: how a departure is told.
        zero: whether the quantity is none where the values are zero, so that an effect may be proportional to it.
    """

    kind: str
    values: Array
    say: Say
    zero: bool = False


@dataclass(frozen=True)
class FormAtPoses:
    """Columns that no modulation of a cause gives.

    Attributes:
        kind: departures of one kind are taken together.
        words: says what it is.
        columns: (c, n, q) of one standard deviation of each, in the channels' units.
    """

    kind: str
    words: Words
    columns: Array


def _modulations_by(quantities: Mapping[str, Quantity], each: bool) -> list[Modulation]:
    """Those quantities that vary over the poses, centred and scaled; `each` as in `Modulation`."""
    norm = Normaliser({name: quantity.values for name, quantity in quantities.items()})
    return [
        Modulation(
            quantity.kind,
            norm(name, quantity.values),
            partial(_said, quantity.say, norm.unit(name)),
            each,
            norm.proportional(name) if quantity.zero else 0.0,
        )
        for name, quantity in quantities.items()
        if norm.unit(name)
    ]


def waves_around(position: Array) -> list[Array]:
    """Waves (n,) of orders 1 and 2 around an axis: with them an order brings those beside it."""
    return [wave(order * position) for order in (1, 2) for wave in (np.cos, np.sin)]


def departures_at_poses(
    place: int,
    cause: Cause,
    rows: Rows,
    units: Mapping[str, float],
    time: Array,
    each: Mapping[str, Quantity],
    together: Mapping[str, Quantity],
    added: Sequence[tuple[FormAtPoses, Rows]] = (),
) -> Departures:
    """Ways in which a cause at poses may depart: by quantities, by its own size, and slowly in time.

    Args:
        place: of the cause among those at work.
        cause: as fitted.
        rows: white rows (n, p) of its amplitudes, by channel.
        units: what one white row is of each channel, all in one unit: what the cause does is compared across channels.
        time: (n,) of each pose, or its number.
        each: quantities on which each amplitude may depend in its own way.
        together: quantities on which all amplitudes depend alike.
        added: forms that are no modulations, with white rows of their columns.
    """
    amplitudes, sizes = cause.values[cause.effect.indices(Role.LINEAR)], amplitude_sizes(cause)
    signature = np.stack([rows[channel] for channel in units], axis=1)
    passed = (time - time.min()) / (float(np.ptp(time)) or 1.0)
    by_all = [*_modulations_by(each, True), *_modulations_by(together, False), settling(passed), *slow_courses(passed)]
    by_all += _by_size((signature @ amplitudes) * np.array(list(units.values())))
    beside = [np.stack([white[channel] for channel in units], axis=1) for _, white in added]
    made = modulated(signature, amplitudes, sizes, by_all, beside)
    columns = {channel: made[:, i] for i, channel in enumerate(units)}
    kinds, words, changes = spread_out(by_all, amplitudes, sizes)
    others = [form for form, _ in added for _ in range(form.columns.shape[2])]
    return Departures(
        place,
        (*kinds, *(form.kind for form in others)),
        (*words, *(form.words for form in others)),
        np.append(changes, np.zeros(len(others))),
        columns,
        proportional=in_proportion(by_all, sizes, len(others)),
    )


def with_direction(letter: str) -> Say:
    """Words for a modulation by the direction in which an axis travelled."""
    return partial(_with_direction, letter)


def _by_size(signal: Array) -> list[Modulation]:
    """Modulations by what the cause does (n, k), beside its root mean square on the component that it moves most."""
    return modulations_by_size(signal, float(np.sqrt(np.max(np.mean(np.square(signal), axis=0)))))


def _said(say: Say, unit: float, change: float) -> str:
    return say(change, unit)


def _with_direction(letter: str, change: float, unit: float) -> str:
    side = "negative" if change > 0 else "positive"
    return f"smaller in the {side} direction of {letter} by {percent(2 * change / unit)}"
