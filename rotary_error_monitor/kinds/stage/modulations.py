"""What the signature of a stage's effect may be modulated with: temperature, time, motion, load, place, its size."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.effects.effect import Cause, Role, order_location, order_of, place_of
from rotary_error_monitor.effects.rotor import RotorState, StageEffect
from rotary_error_monitor.gap.departures import (
    SHARE,
    Modulation,
    Normaliser,
    amplitude_sizes,
    by_rate,
    grows,
    modulations_by_size,
    over_time,
    percent,
    settling,
    slow_courses,
    unlike_components,
)
from rotary_error_monitor.kinds.stage.lagging import LAGS, late
from rotary_error_monitor.kinds.stage.play import Play
from rotary_error_monitor.sensors.library import instrument_of
from rotary_error_monitor.twin.stage import Signals, StageInputs, StageTwin

LOOKS = 2000
"""Instants of a recording from which the size of a modulation is told."""

NEIGHBOURS = 3
"""Orders on each side of an order that it may bring with it."""

SOFT = (1 / 128, 1 / 32, 1 / 8)
"""Speeds, in parts of the highest one, below which an effect may be another than at speed: four-fold steps."""

IN_PLACE_OF_JUMPS = frozenset({"low speed", "after reversals"})
"""Kinds in which an effect that jumps where the rotor turns back may depart as a whole: no real thing jumps."""

COMPONENTS = 2
"""Of an instrument that shows a plane."""

_HELD = 0.01
"""Part of the power of what differs around the turn up to which neighbouring orders describe it."""

_SLOW = ("temperature", "time")

_WITH_ZERO = ("temperature", "speed", "square of speed", "velocity", "load")
"""Quantities that are none at zero: a cause may be proportional to them. Temperature is counted from the reference."""


class StageModulations:
    """Modulations of the effects of one recording; those of its stretches are cut out of the same functions."""

    def __init__(self, twin: StageTwin, duration: float, play: Play) -> None:
        self._duration = duration
        self._time = np.linspace(0.0, duration, LOOKS)
        state = twin.state_at(self._time)
        self._top = float(np.max(np.abs(state.omega))) or 1.0
        self._norm = Normaliser(self._quantities(state))
        self._play = play
        self._late = [late(twin.inputs.warming, duration, lag * duration) for lag in LAGS]
        self._size: tuple[tuple[str, str, bytes, str], float] | None = None
        self._around: dict[tuple[str, str], tuple[int, ...]] = {}
        self._twin, self._few = (
            StageTwin(twin.stage, twin.inputs, dict.fromkeys(twin.times, time), known=twin.known)
            for time in (self._time, self._time[::8])
        )

    def of_state(self, state: RotorState, around: Sequence[int], jumps: bool, slow: bool = True) -> list[Modulation]:
        """Those that follow from the rotor's state.

        Args:
            state: the rotor.
            around: orders of the rotation with which it may differ.
            jumps: whether the textbook form jumps where the rotor turns back. No real thing does: near standstill all
                of it may be missing.
            slow: whether it may go with time or temperature in any slow course.
        """
        peak = 1 / SHARE if jumps else 1.0
        norm, unit, found = self._norm, self._norm.unit, self._quantities(state)
        words = self._words()
        rows = [
            Modulation(
                name.replace("square of ", "").replace("velocity", "speed"),
                norm(name, found[name]),
                say,
                True,
                norm.proportional(name) if name in _WITH_ZERO else 0.0,
            )
            for name, say in words.items()
            if unit(name) and (slow or name not in _SLOW)
        ]
        for part in SOFT:
            name = f"below {part * self._top:.2g} rad/s"
            if unit(name):
                size = peak * unit(name)
                rows.append(Modulation("low speed", size * norm(name, found[name]), partial(_soft, name)))
        rows += self._play.yielding(state, peak) if jumps else []
        for order in around:
            for wave in state.harmonic(order):
                rows.append(Modulation(f"place {order}", np.sqrt(2) * wave, _around, True))
        course = np.clip(state.time / self._duration, 0, 1)
        late = [*self._lagging(state), settling(course, self._duration), *slow_courses(course)]
        return [*rows, *(late if slow else ())]

    def _lagging(self, state: RotorState) -> list[Modulation]:
        """What follows the temperature late, or in part at once and in part late."""
        unit, courses = self._norm.unit("temperature"), (self._twin.inputs.warming, *self._late)
        rows = []
        for lag, course in zip((0.0, *LAGS), courses, strict=True) if unit else ():
            values = (course(state.time) - np.mean(course(self._time))) / unit
            rows.append(Modulation("lagging temperature", values, partial(_late, lag * self._duration), True))
        return rows

    def _words(self) -> dict[str, Callable[[float], str]]:
        """What a relative change of a cause by one standard deviation of each quantity is, in words."""
        unit, span, duration = self._norm.unit, self._norm.span, self._duration

        def rate(name: str, change: float, per: str, size: float = 1.0) -> str:
            return by_rate(change / unit(name), span(name), per, size)

        return {
            "temperature": lambda c: f"{grows(c)} with temperature {rate('temperature', c, 'K')}",
            "time": lambda c: over_time(c / unit("time") * duration, duration),
            "direction": lambda c: (
                f"smaller in the {'negative' if c > 0 else 'positive'} direction by "
                f"{percent(2 * c / unit('direction'))}"
            ),
            "speed": lambda c: f"{grows(c)} with speed {rate('speed', c, 'rad/s')}",
            "square of speed": lambda c: f"{grows(c)} with the square of speed",
            "velocity": lambda c: f"{grows(c)} with velocity {rate('velocity', c, 'rad/s')}",
            "load": lambda c: f"{grows(c)} with the force on the shaft {rate('load', c, '100 N', 100.0)}",
        }

    def may_wander(self, cause: Cause) -> bool:
        """Whether a cause may depart in any slow course.

        What goes with a place that no thermometer reads goes with another place in such a course: where several places
        are read, one that is not is likelier than that.
        """
        effect = cause.effect
        return not (isinstance(effect, StageEffect) and effect.warms and self._twin.stage.thermometers)

    def around(self, cause: Cause, neighbours: Sequence[Cause]) -> tuple[int, ...]:
        """Orders of the rotation with which a cause may differ otherwise than its neighbouring orders do.

        A wave that differs around the turn is one of neighbouring orders, which a twin can hold, where one instrument
        shows it. Several heads see each mark of a ring one after the other: what differs with the rotation is no mark.
        """
        orders = tuple(range(1, NEIGHBOURS + 1))
        if not neighbours:
            return orders
        if cause.key not in self._around:
            effect, few = cause.effect, self._few
            assert isinstance(effect, StageEffect)
            streams = tuple(name for name in few.times if effect.touches(cause.location, name))
            plain = self._moved(few, cause, streams)
            sizes = {name: float(np.sqrt(np.mean(np.square(values)))) or 1.0 for name, values in plain.items()}
            alone = one_by_one(neighbours, amplitude_sizes(cause))
            near = np.column_stack([_joined(self._moved(few, other, streams), sizes) for other in alone])

            def beside(order: int) -> Array:
                waves = {name: few.state(name).harmonic(order) for name in streams}
                pair = [{name: waves[name][i][:, None] * plain[name] for name in streams} for i in (0, 1)]
                return np.column_stack([_joined(own, sizes) for own in pair])

            self._around[cause.key] = tuple(order for order in orders if _left_of(beside(order), near) > _HELD)
        return self._around[cause.key]

    def of_size(self, cause: Cause, signal: Array, stream: str) -> list[Modulation]:
        """Those that follow from what the cause does (n, k) to a stream."""
        return modulations_by_size(signal, self.size(cause, stream))

    @staticmethod
    def of_components(cause: Cause, signatures: Signals) -> Callable[[int], list[Modulation]]:
        """Of so many samples those of the components, where a cause of one amplitude acts on two of an instrument."""
        single = len(cause.effect.indices(Role.LINEAR)) == 1
        alone = len({instrument_of(name) for name in signatures}) == 1
        if single and alone and all(rows.shape[1] == COMPONENTS for rows in signatures.values()):
            return lambda samples: [unlike_components(samples)]
        return lambda samples: []

    def size(self, cause: Cause, stream: str) -> float:
        """What a cause does to a stream and to those of the same instrument, root mean square over the recording."""
        name = instrument_of(stream)
        key = (*cause.key, cause.values.tobytes(), name)
        if self._size is None or self._size[0] != key:
            alike = [other for other in self._twin.times if instrument_of(other) == name]
            moved = self._moved(self._twin, cause, tuple(alike))
            size = float(np.sqrt(np.mean([np.mean(np.square(values)) for values in moved.values()])))
            self._size = key, size
        return self._size[1]

    def slow(self, state: RotorState) -> Array:
        """(n, q) slow courses: none, with temperature, with time, and cosines as of a random walk."""
        found = self._quantities(state)
        rows = [np.ones(len(state.time)), *(self._norm(name, found[name]) for name in _SLOW if self._norm.unit(name))]
        rows += [course.values for course in slow_courses(np.clip(state.time / self._duration, 0, 1))]
        return np.column_stack(rows)

    def jumps(self, cause: Cause) -> bool:
        """Whether what an effect does depends on the sign of the speed and not on its size."""
        inputs = self._twin.inputs
        change = [
            self._changed(self._twin, cause, replace(inputs, omega=partial(_scaled, inputs.omega, factor)))
            for factor in (-1.0, 2.0)
        ]
        return change[0] > 1.0 and change[1] < 1e-3

    def goes_with_force(self, cause: Cause) -> bool:
        """Whether what an effect does is in proportion to the force on the shaft."""
        inputs, few = self._few.inputs, self._few
        if not np.any(inputs.force(self._time)):
            return False
        return abs(self._changed(few, cause, replace(inputs, force=partial(_scaled, inputs.force, 2.0))) - 1) < 1e-3

    def _changed(self, twin: StageTwin, cause: Cause, inputs: StageInputs) -> float:
        """Power of what other inputs change of what a cause does, as a part of that."""
        effect = cause.effect
        assert isinstance(effect, StageEffect)
        streams = tuple(name for name in twin.times if effect.touches(cause.location, name))
        plain, other = self._moved(twin, cause, streams), self._moved(twin.driven_by(inputs), cause, streams)
        size = sum(float(np.sum(np.square(values))) for values in plain.values())
        change = sum(float(np.sum(np.square(other[name] - plain[name]))) for name in streams)
        return change / max(size, np.finfo(np.float64).tiny)

    @staticmethod
    def _moved(twin: StageTwin, cause: Cause, streams: tuple[str, ...]) -> dict[str, Array]:
        moved, base = twin.predict((cause,), streams), twin.predict((), streams)
        return {name: moved[name] - base[name] for name in streams}

    def _quantities(self, state: RotorState) -> dict[str, Array]:
        speed = np.abs(state.omega)
        soft = {f"below {part * self._top:.2g} rad/s": np.exp(-speed / (part * self._top)) for part in SOFT}
        return {
            "temperature": state.warming,
            "time": state.time,
            "direction": state.direction,
            "speed": speed,
            "square of speed": np.square(speed),
            "velocity": state.omega,
            "load": np.hypot(*state.force.T),
            **soft,
        }


def _joined(signals: Mapping[str, Array], sizes: Mapping[str, float]) -> Array:
    """All signals one after the other, each over its size."""
    return np.concatenate([(values / sizes[name]).ravel() for name, values in signals.items()])


def _left_of(columns: Array, others: Array) -> float:
    """Part of the power of columns (n, p) that others (n, q) do not describe."""
    left = columns - others @ np.linalg.lstsq(others, columns)[0]
    return float(np.sum(np.square(left)) / max(float(np.sum(np.square(columns))), np.finfo(np.float64).tiny))


def _scaled(function: Callable[[Array], Array], factor: float, time: Array) -> Array:
    return np.asarray(factor * function(time), np.float64)


def _soft(speed: str, change: float) -> str:
    return f"{'softer' if change < 0 else 'larger'} at low speed ({speed})"


def _late(lag: float, change: float) -> str:
    return f"{grows(change)} with temperature" + (f", some {lag:.2g} s behind the thermometer" if lag else "")


def _around(change: float) -> str:
    return "differs around the turn"


def next_order(place: str, change: float) -> str:
    """Words for an order beside that of an effect."""
    return f"neighbouring orders (order {order_of(place)})"


def neighbouring(cause: Cause) -> list[Cause]:
    """An effect of one order at the orders beside it and at twice its order, without size."""
    effect = cause.effect
    if not effect.orders:
        return []
    order, place = order_of(cause.location), place_of(cause.location)
    near = {*range(order - NEIGHBOURS, order + NEIGHBOURS + 1), 2 * order} - {order}
    places = [order_location(k, place) for k in sorted(near) if effect.lowest <= k <= effect.orders]
    return [Cause(effect, place, effect.start(place)) for place in places]


def goes_by_another_name(cause: Cause) -> bool:
    """Whether an effect is of an order that another effect makes: what departs then departs from that one."""
    return bool(cause.effect.orders) and order_of(cause.location) < cause.effect.lowest


def one_by_one(causes: Sequence[Cause], sizes: Array) -> list[Cause]:
    """Each cause, which has no size, once for each of its amplitudes (p,), with that one alone."""
    found = []
    for cause in causes:
        for index, size in zip(cause.effect.indices(Role.LINEAR), sizes, strict=True):
            values = cause.values.copy()
            values[index] = size
            found.append(cause.with_values(values))
    return found


def linear_values(cause: Cause) -> tuple[list[int], Array]:
    """Indices of the amplitudes, and the amplitudes."""
    linear = cause.effect.indices(Role.LINEAR)
    return linear, np.asarray(cause.values[linear], np.float64)
