"""Search for what an effect's location or shape leaves open: orders, moments of a step, orders that are not whole.

The search looks at white rows that are left when all that is already known has been taken out. It only proposes: each
proposal is then weighed by its exact signature, and pays for the number of places that were searched.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.harmonics import AngularHarmonic, PlanarHarmonic
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.streams import COMMAND
from rotary_error_monitor.effects.effect import AnyEffect, Searched, order_location
from rotary_error_monitor.effects.rotor import StageEffect, effects_of, is_among
from rotary_error_monitor.gap.departures import SHARE
from rotary_error_monitor.gap.options import FALSE_ALARMS
from rotary_error_monitor.gap.orders import order_spectrum, trials_of_waves
from rotary_error_monitor.gap.problem import Candidate, Rows
from rotary_error_monitor.kinds.stage.rows import StageRows
from rotary_error_monitor.metrology.periodic_curves import doubted_orders
from rotary_error_monitor.sensors.library import instrument_of, is_listed, kind_of
from rotary_error_monitor.twin.recording import StageRecording

PROPOSED_ORDERS = 3
"""Orders proposed by each group of channels."""

LINES = 200
"""Highest order of a line that is kept out of the estimate of the jitter."""

LOWEST_ORDERS = (1, 2)
"""Orders that are always weighed: many effects resemble them."""

WHOLE = 0.02
"""Orders closer to a whole number than this are left to the families of whole orders."""


def effects_in(
    stage: StageDescription, recording: StageRecording, effects: Sequence[StageEffect]
) -> tuple[StageEffect, ...]:
    """The effects that a stage can show, with the bounds that their values have in a recording.

    A wave of nearly a whole order drifts from that one's phase, evenly over the rotation. Where that is no more than
    a departure of a synchronous motion may be, `SHARE` root mean square, it is one.
    """
    rotation = float(np.ptp(recording.streams[COMMAND].values[:, 0]))
    apart = SHARE * float(np.sqrt(12)) / max(rotation, np.finfo(np.float64).tiny)
    return tuple(effect.seen_in(stage, apart) for effect in effects_of(stage, effects))


class StageSearch:
    """Proposes candidates of a stage problem."""

    def __init__(self, problem: StageRows) -> None:
        self._problem = problem

    def candidates(self, rest: Rows) -> tuple[Candidate, ...]:
        """Every effect at every place; families of orders at the orders that stand out in `rest`."""
        groups = self._orders(rest, kind_of)
        listed = self._orders({channel: rows for channel, rows in rest.items() if is_listed(channel)}, instrument_of)
        found: list[Candidate] = []
        for effect in self._problem.effects:
            if effect.orders:
                alike = {order for kind in groups if is_among(kind, effect.stands_out_in) for order in groups[kind]}
                for place in effect.locations(self._problem.stage):
                    found += self._of_orders(effect, place, set(listed.get(place, ())) if place else alike)
            elif effect.searched is Searched.MOMENT:
                found += self._steps(effect, rest)
            elif effect.searched is Searched.WAVE:
                found += self._waves(effect, rest)
            else:
                places = effect.locations(self._problem.stage)
                prior = -float(np.log(len(places)))
                found += [Candidate(effect, place, effect.start(place), prior) for place in places]
        return tuple(found)

    def motion_basis(self, time: Array) -> Array:
        """(n, p) slow functions of the commanded motion: offset, speed, direction, acceleration, low orders, play."""
        inputs = self._problem.twin.inputs
        command, omega = inputs.command(time), inputs.omega(time)
        top = float(np.max(np.abs(omega))) or 1.0
        columns = [np.ones(len(time)), time / time[-1], omega / top, np.sign(omega) * (np.abs(omega) > 1e-6 * top)]
        columns += [np.gradient(omega, time) / top, np.square(omega / top)]
        for order in range(1, 5):
            columns += [np.cos(order * command), np.sin(order * command)]
        # Few of play: what is as slow as the jitter takes a part of the jitter along with every column.
        return np.column_stack([*columns, self._problem.play.taken(time)])

    def _of_orders(self, effect: AnyEffect, part: str, standing_out: set[int]) -> Iterator[Candidate]:
        """An effect of one order at one place: at orders that stand out there, and those that are always weighed."""
        among = -float(np.log(len(effect.locations(self._problem.stage))))
        for order in sorted(standing_out | {*LOWEST_ORDERS, *self._described_orders()}):
            if order <= effect.orders:
                place = order_location(order, part)
                yield Candidate(effect, place, effect.start(place), effect.log_prior_of(order) + among)

    def _angle(self, channel: str) -> Array:
        """(m,) commanded rotation at the rows of a channel."""
        return np.asarray(self._problem.twin.inputs.command(self._problem.times(channel)), np.float64)

    def _orders(self, rest: Rows, group_of: Callable[[str], str]) -> dict[str, list[int]]:
        """Orders that stand out, for each group of channels."""
        most = max((effect.orders for effect in self._problem.effects), default=0)
        groups: dict[str, Array] = {}
        for channel, rows in rest.items():
            group = group_of(channel)
            power = order_spectrum(self._angle(channel), rows[:, 0], most)
            groups[group] = groups.get(group, 0.0) + power
        return {
            group: [int(order) for order in np.argsort(power)[::-1][:PROPOSED_ORDERS] + 1]
            for group, power in groups.items()
        }

    def _described_orders(self) -> set[int]:
        """Orders that the twin describes with some uncertainty: an effect of the same order hides in its parameters."""
        stage = self._problem.stage
        described: dict[str, Sequence[AngularHarmonic | PlanarHarmonic]] = {
            "spindle.radial": stage.spindle.radial,
            "spindle.tilt": stage.spindle.tilt,
            "spindle.axial": stage.spindle.axial,
            "mirror.flatness": stage.mirror.flatness,
            "encoder.graduation": () if stage.encoder is None else stage.encoder.graduation,
        }
        uncertain = [rows for name, rows in described.items() if stage.uncertainty.get(name)]
        uncertain += [sensor.form for sensor in stage.sensors.values() if sensor.uncertainty]
        measured = {order for table in stage.tables if table.uncertainty for order in doubted_orders(table)[0]}
        return {row.order for rows in uncertain for row in rows} - {0} | measured

    def _steps(self, effect: AnyEffect, rest: Rows) -> list[Candidate]:
        found = []
        for place in effect.locations(self._problem.stage):
            if place not in rest:
                continue
            moment, _ = find_step(self._problem.times(place), rest[place][:, 0])
            start = effect.start(place)
            start[effect.slices()["time"]] = moment
            found.append(Candidate(effect, place, start, -float(np.log(trials_of_steps(len(rest[place]))))))
        return found

    def _waves(self, effect: AnyEffect, rest: Rows) -> list[Candidate]:
        angle = {channel: self._angle(channel) for channel in rest if channel != "command"}
        rows = {channel: rest[channel][:, 0] for channel in angle}
        order, independent = find_wave(angle, rows)
        start = effect.start("")
        start[effect.slices()["order"]] = order
        alarming = float(np.log(0.5 * FALSE_ALARMS / (independent * len(self._problem.effects))))
        return [Candidate(effect, "", start, -float(np.log(trials_of_waves(independent, alarming))))]


def find_step(time: Array, rows: Array) -> tuple[float, float]:
    """Moment, s, of the step that explains most of white rows whose mean is already known to be zero, and how much.

    The matched filter of a step at each sample, from cumulative sums: `(sum after)^2 / (number after)`, the mean of
    all rows taken out beforehand so that an offset does not look like a step at the beginning.
    """
    count = len(rows)
    after = np.cumsum((rows - rows.mean())[::-1])[::-1]
    samples = np.arange(count, 0, -1)
    gain = np.square(after) * count / (samples * np.maximum(count - samples, 1))
    inner = slice(max(1, count // 200), count - max(1, count // 200))
    index = int(np.argmax(gain[inner])) + inner.start
    return float(0.5 * (time[index - 1] + time[index])), float(gain[index])


def trials_of_steps(rows: int) -> int:
    """Independent moments among so many rows: steps less than a few samples apart cannot be told apart."""
    return 4 * max(rows // 20, 1)


def find_wave(angle: dict[str, Array], rows: dict[str, Array], highest: float = 24.0) -> tuple[float, int]:
    """Order that is not whole with the most power over all channels, and how many independent orders were searched.

    Rows are first summed over short arcs of the unwrapped rotation (64 arcs a turn hold orders up to 24 with little
    loss), which keeps the transform small however long the recording.
    """
    arcs = 64
    low = min(float(a.min()) for a in angle.values())
    high = max(float(a.max()) for a in angle.values())
    turns = max((high - low) / (2 * np.pi), 0.25)
    cells = int(turns * arcs) + 1
    length = int(2 ** np.ceil(np.log2(4 * cells)))
    power = np.zeros(length // 2 + 1)
    over_arcs = []
    for channel, values in rows.items():
        cell = ((angle[channel] - low) / (2 * np.pi) * arcs).astype(np.intp)
        over_arcs.append(np.bincount(cell, values, minlength=cells) / np.sqrt(max(len(values), 1)))
        power += np.abs(np.fft.rfft(over_arcs[-1], length)) ** 2
    order = np.arange(len(power)) * arcs / length
    apart = np.abs(order - np.round(order)) > np.maximum(WHOLE, 0.6 / turns)
    allowed: NDArray[np.bool_] = apart & (order > max(0.1, 1 / turns)) & (order < highest)
    if not allowed.any():
        return 0.5, 1
    best = float(order[int(np.argmax(np.where(allowed, power, -1.0)))])

    sums, middles = np.stack(over_arcs), (np.arange(cells) + 0.5) * 2 * np.pi / arcs

    def missing(value: float) -> float:
        return -float(np.sum(np.abs(sums @ np.exp(-1j * value * middles)) ** 2))

    reach = 1.5 * arcs / length
    refined = minimize_scalar(missing, bounds=(best - reach, best + reach), method="bounded", options={"xatol": 1e-6})
    return float(refined.x), max(int(np.count_nonzero(allowed) * cells / length), 1)
