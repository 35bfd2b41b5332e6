"""What an effect of the rotary stage may see and touch: the rotor at the sample times of one stream."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar, Self, TypeVar

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.harmonics import PlanarHarmonic
from rotary_error_monitor.description.listed_sensors import ListedSensor
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.streams import COMMAND, OWN_REFERENCE, TWO_AXIS
from rotary_error_monitor.effects.effect import Effect, Parameter, Searched, Values

HEAD = "head"
LISTED = "listed"
"""Stands for every sensor that a stage lists by name, of whatever kind."""

DISPLACEMENT = (OWN_REFERENCE, LISTED)
"""What shows a displacement of the rotor at a height, or may show it."""

_BY_SECTION = (HEAD, *TWO_AXIS, COMMAND)
"""What has a section of its own in a stage's description: all else is listed."""

AT_REST = 1e-9
"""Speed, rad/s, below which the rotor is at rest: that is rounding.

An angle of a thousand turns is known to 1e-12 rad in double precision, and its slope over a millisecond to 1e-9 rad/s.
"""

_SMALL_TURN = 1e-4
"""Phase, rad, up to which a second-order expansion of a harmonic errs by less than 1e-12."""

_KEPT_TABLES = 6
"""Tables of harmonics that a state keeps: those of the description itself come first and are used over and over."""

_LARGEST_TABLE = 2**18
"""Instants of a table: those of a longer recording would fill the memory."""


@dataclass(frozen=True)
class RotorState:
    """The rotor at `n` instants.

    Attributes:
        time: (n,) s since the recording's first stamp.
        command: (n,) commanded rotation, rad.
        omega: (n,) commanded speed, rad/s.
        theta: (n,) rotation that the twin assumes, rad.
        force: (n, 2) force on the shaft, N.
        warming: (n,) temperature above the reference, K.
        command_at: commanded rotation at any times (m,).
        lines: graduation lines per revolution; 0 without a ring.
        observed: (n,) what the sensor itself read, rad; only heads have it. It carries the phase of errors within a
            line, far finer than the command knows the rotation.
        age: how long before `time` the sensor saw the rotor, s; all but `time` is of then.
        warmings: (n,) temperature above the reference of each place with a thermometer of its own, K.
        inputs: (n, k) what further listed inputs measured, in their units, by the names of the sensors.
        place: whose warming `warming` is: the name of a thermometer; empty for the stage's.
    """

    time: Array
    command: Array
    omega: Array
    theta: Array
    force: Array
    warming: Array
    command_at: Callable[[Array], Array]
    lines: int
    observed: Array | None = None
    age: float = 0.0
    warmings: Mapping[str, Array] = field(default_factory=dict)
    inputs: Mapping[str, Array] = field(default_factory=dict)
    place: str = ""
    _harmonics: dict[float, Array] = field(default_factory=dict, repr=False, compare=False)
    _unturned: tuple[RotorState, float] | None = field(default=None, repr=False, compare=False)
    _tables: dict[tuple[int, ...], Array] = field(default_factory=dict, repr=False, compare=False)
    _kept: dict[str, tuple[object, Array]] = field(default_factory=dict, repr=False, compare=False)

    @property
    def unturned(self) -> RotorState | None:
        """The state that this one was turned from."""
        return None if self._unturned is None else self._unturned[0]

    @property
    def direction(self) -> Array:
        """(n,) direction of travel: 1, -1, or 0 at rest, where interpolation leaves the speed a little off zero."""
        return np.sign(np.where(np.abs(self.omega) > AT_REST, self.omega, 0.0))

    def harmonic(self, order: float) -> tuple[Array, Array]:
        """Cosine and sine of `order * theta`, kept because many effects share them."""
        cos, sin = self._wave(order)
        return cos, sin

    def _wave(self, order: float) -> Array:
        """(2, n) cosine and sine of `order * theta`."""
        if order not in self._harmonics:
            self._harmonics[order] = self._evaluated(order)
        return self._harmonics[order]

    def _evaluated(self, order: float) -> Array:
        if self._unturned is not None:
            before, ahead = self._unturned
            if abs(order) * ahead < _SMALL_TURN:
                cos, sin = before.harmonic(order)
                small = order * (self.theta - before.theta)
                shrunk = 1 - 0.5 * np.square(small)
                waves = shrunk * before._wave(order)
                waves[0] -= small * sin
                waves[1] += small * cos
                return waves
        angle = order * self.theta
        waves = np.empty((2, len(angle)))
        np.cos(angle, out=waves[0])
        np.sin(angle, out=waves[1])
        return waves

    def planar(self, coefficients: Mapping[int, tuple[float, float, float, float]]) -> Array:
        """(n, 2) sum of plane harmonics given as order: (x cos, x sin, y cos, y sin)."""
        orders = tuple(coefficients)
        weights = _planar_weights(coefficients)
        table = self._table(orders)
        done = len(table)
        total = weights[:, :done] @ table
        for place, order in enumerate(orders[done // 2 :], done // 2):
            total += weights[:, 2 * place : 2 * place + 2] @ self._wave(order)
        return np.asarray(total.T, np.float64)

    def harmonics(self, rows: Sequence[PlanarHarmonic]) -> Array:
        """(n, 2) sum of a description's plane harmonics; rows of one order are summed first."""
        if not rows:
            return np.zeros((len(self.theta), 2))
        sums: dict[int, tuple[float, float, float, float]] = {}
        for row in rows:
            old = sums.get(row.order, (0.0, 0.0, 0.0, 0.0))
            sums[row.order] = (old[0] + row.x[0], old[1] + row.x[1], old[2] + row.y[0], old[3] + row.y[1])
        return self.planar(sums)

    def _table(self, orders: tuple[int, ...]) -> Array:
        """(2 k, n) waves of the first k of the orders, one below the other, as far as such a table is kept."""
        if orders not in self._tables and len(self._tables) < _KEPT_TABLES and len(self.theta) <= _LARGEST_TABLE:
            self._tables[orders] = np.concatenate([np.empty((0, len(self.theta))), *map(self._wave, orders)])
        first = (orders[:count] for count in range(len(orders), 0, -1))
        kept = next((found for found in first if found in self._tables), None)
        return np.empty((0, len(self.theta))) if kept is None else self._tables[kept]

    def turned(self, vector: Array | tuple[float, float]) -> Array:
        """(n, 2) a vector fixed on the rotor, in the base: `Rz(theta) @ vector`."""
        x, y = float(vector[0]), float(vector[1])
        return self.planar({1: (x, -y, y, x)})

    def keep(self, what: str, of: object, make: Callable[[], Array]) -> Array:
        """What `make` gives; kept for the first that it is asked `of`, which is the description's own part."""
        if what not in self._kept:
            self._kept[what] = of, make()
        owner, found = self._kept[what]
        return found if owner is of or owner == of else make()

    def warmed_at(self, place: str) -> RotorState:
        """The same instants with the warming of the place of a thermometer, 0 where nobody measured it."""
        if place == self.place:
            return self
        return replace(self, warming=self.warmings.get(place, np.zeros(len(self.time))), place=place, _kept={})

    def rotated(self, by: Array) -> RotorState:
        """The same instants with the true rotation ahead of this one by `by` (n,) rad."""
        most = float(np.max(np.abs(by), initial=0.0))
        return replace(self, theta=self.theta + by, _harmonics={}, _tables={}, _kept={}, _unturned=(self, most))


def _planar_weights(coefficients: Mapping[int, tuple[float, float, float, float]]) -> Array:
    """(2, 2 k) what x and y hold of each wave."""
    rows = np.array(list(coefficients.values())).reshape(-1, 2, 2)
    return np.asarray(rows.transpose(1, 0, 2).reshape(2, -1), np.float64)


class StageEffect(Effect[StageDescription]):
    """An effect of the rotary stage: overrides the hooks that it needs, the others leave everything as it is.

    The twin evaluates, for the samples of each stream: `delay`, then `rotation`, then `amend` of the description, then
    `radial`, `axial` and `tilt` error motion, then `measured` for what the sensor makes of it.

    Attributes:
        acts_on: streams that it can move, `head` standing for all heads, a kind such as `axial_probe` for all of that
            kind, `listed` for all sensors that the stage lists; a location `head_I` narrows it to that head.
        stands_out_in: where its order shows if it is one of a family: `head` for what differs between heads, `command`
            for what they share, and the other streams.
        rescales: whether it changes a signal in proportion to what the signal shows, other causes included.
        displaces_instrument: whether the instrument itself is elsewhere than stated: as it creeps, its zero may wander.
        listed_unit: SI unit of the listed sensors that alone have it; empty where the unit does not matter.
        listed_fields: how many fields the listed sensors have that alone have it; 0 where that does not matter.
        warms: whether it goes with the warming of a place: the stage's thermometer, location '', and each thermometer
            that the stage lists are such a place, and hooks get a state with the `warming` of that one.
    """

    acts_on: ClassVar[tuple[str, ...]] = (HEAD, *TWO_AXIS, LISTED)
    stands_out_in: ClassVar[tuple[str, ...]] = (HEAD, COMMAND, *TWO_AXIS, LISTED)
    rescales: ClassVar[bool] = False
    displaces_instrument: ClassVar[bool] = False
    listed_unit: ClassVar[str] = ""
    listed_fields: ClassVar[int] = 0
    warms: ClassVar[bool] = False
    searchable: ClassVar[Mapping[Searched, str]] = {Searched.MOMENT: "time", Searched.WAVE: "order"}

    def seen_in(self, stage: StageDescription, apart: float) -> Self:
        """The effect with the bounds that its values have in a recording of a stage: itself as a rule.

        Args:
            stage: whose recording it is.
            apart: least distance of an order from a whole one in which the recording tells it from that one.
        """
        return self

    def locations(self, machine: StageDescription) -> tuple[str, ...]:
        """Places where the effect may sit: one without a name, and with `warms` each thermometer that is listed."""
        return ("", *machine.thermometers) if self.warms else ("",)

    @property
    def moves_rotor(self) -> bool:
        """Whether it has the hook `delay` or `rotation`: the sensor then sees the rotor elsewhere."""
        own = type(self)
        return own.delay is not StageEffect.delay or own.rotation is not StageEffect.rotation

    def touches(self, location: str, stream: str) -> bool:
        """Whether the effect there can move the prediction of that stream (`head_a`, …, `autocollimator`)."""
        if location.startswith(f"{HEAD}_"):
            return stream == location
        return is_among(stream.rpartition("_")[0] or stream, self.acts_on)

    def amend(self, stage: StageDescription, values: Values, location: str) -> StageDescription:
        """The description with the effect in its parameters."""
        return stage

    def delay(self, values: Values, location: str) -> float:
        """Age of the samples at their stamp, s."""
        return 0.0

    def rotation(self, values: Values, state: RotorState) -> Array | None:
        """(n,) part of the true rotation beyond the command, rad."""
        return None

    def radial(self, values: Values, state: RotorState) -> Array | None:
        """(n, 2) part of the radial error motion at the ring, m."""
        return None

    def axial(self, values: Values, state: RotorState) -> Array | None:
        """(n,) part of the axial error motion, m."""
        return None

    def tilt(self, values: Values, state: RotorState) -> Array | None:
        """(n, 2) part of the tilt error motion, a rotation vector in rad."""
        return None

    def measured(self, values: Values, location: str, state: RotorState, ideal: Array) -> Array:
        """What the touched sensor says instead of `ideal`: (n,) of one field, (n, 2) of two."""
        return ideal


class ComponentGain(StageEffect):
    """Base of the effects that scale one component of an instrument of two."""

    parameters = (Parameter("relative", "1", 1e-2, bound=2.0),)
    rescales = True
    components: ClassVar[Mapping[str, int]] = {"x": 0, "y": 1}

    def locations(self, machine: StageDescription) -> tuple[str, ...]:
        """Each component."""
        return tuple(self.components)

    def measured(self, values: Values, location: str, state: RotorState, ideal: Array) -> Array:
        """Scale that component."""
        scaled = ideal.copy()
        scaled[:, self.components[location]] *= 1 + values[0]
        return scaled


def is_among(kind: str, named: Collection[str]) -> bool:
    """Whether a kind of sensor is one of those that are named."""
    return kind in named or (LISTED in named and kind not in _BY_SECTION)


def fits(effect: StageEffect, sensor: ListedSensor) -> bool:
    """Whether a listed sensor has the unit and the number of fields that an effect asks for."""
    return effect.listed_unit in ("", sensor.unit) and effect.listed_fields in (0, len(sensor.fields))


Known = TypeVar("Known", bound=StageEffect)


def effects_of(stage: StageDescription, effects: Iterable[Known]) -> tuple[Known, ...]:
    """The effects but those that show only in listed sensors, or heads, of which a stage has none: it has them not."""

    def shows_in(effect: StageEffect, kind: str) -> bool:
        if kind == HEAD:
            return bool(stage.azimuths)
        if kind in _BY_SECTION:
            return True
        return any(fits(effect, sensor) for sensor in stage.sensors.values())

    return tuple(effect for effect in effects if any(shows_in(effect, kind) for kind in effect.acts_on))
