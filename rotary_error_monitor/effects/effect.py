"""What every effect declares, whatever machine it acts on: name, parameters, places where it may sit."""

from __future__ import annotations

import enum
import inspect
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, ClassVar, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.errors import InputError, excerpt

Values = NDArray[np.float64]

WITHOUT_BOUND = 1e3
"""Usual sizes that an effect without a bound may have; the package's own bounds are 10 to 10^4 of them."""

Description = TypeVar("Description")
"""What an effect acts on: the description of a stage, of a machine, or of something of a user's own."""


class Role(enum.Enum):
    """How a parameter enters the prediction, which decides how it is found."""

    LINEAR = enum.auto()
    """In proportion near zero: estimated by least squares from its signature at zero."""
    SHAPE = enum.auto()
    """Shapes the signature (a period, an order that is not whole): a search starts it, Gauss-Newton steps refine it."""
    FIXED = enum.auto()
    """Given by the location or by a search: no derivative exists (an order, the moment of a step)."""


class Searched(enum.Enum):
    """What of an effect a search finds in a recording before the rest is fitted."""

    MOMENT = enum.auto()
    """When it begins, once and for all."""
    ORDER = enum.auto()
    """Which whole order it has, up to the bound of its parameter."""
    WAVE = enum.auto()
    """Which wave it is, over the rotation with an order that is not whole, or over a position."""


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect.

    Attributes:
        name: as users and the vocabulary spell it.
        unit: SI unit.
        scale: usual size in that unit: the width of the prior, and the measure of the derivative's step.
        size: number of components; 1 for a scalar.
        role: how it enters the prediction.
        bound: largest magnitude that is physically sensible.
        least: smallest value that is, where that is not minus the bound: a period, say, is positive.
    """

    name: str
    unit: str
    scale: float
    size: int = 1
    role: Role = Role.LINEAR
    bound: float = float("inf")
    least: float | None = None

    @property
    def range(self) -> tuple[float, float]:
        """Least and largest value that are physically sensible."""
        return -self.bound if self.least is None else self.least, self.bound


def wave_of_order(unit: str, scale: float, *, bound: float, highest: int = 100) -> tuple[Parameter, ...]:
    """An order from 1 to `highest`, with cosine and sine of its wave; the rest as `Parameter`."""
    return _order(highest), *(Parameter(name, unit, scale, bound=bound) for name in ("cos", "sin"))


def planar_wave_of_order(unit: str, scale: float, *, bound: float) -> tuple[Parameter, ...]:
    """An order from 1 to 100, with cosine and sine of its wave along x, and those along y."""
    return _order(100), *(Parameter(name, unit, scale, 2, bound=bound) for name in ("x", "y"))


def _order(highest: int) -> Parameter:
    return Parameter("order", "1", 1.0, role=Role.FIXED, bound=highest, least=1)


@dataclass(frozen=True)
class ParameterEstimate:
    """Value and standard deviation of one reported parameter; tuples for vectors."""

    value: float | tuple[float, ...]
    std: float | tuple[float, ...]


class Effect(Generic[Description]):
    """Base of all effects. A concrete effect has a `name`; a class without one is an abstract base.

    Attributes:
        name: as the vocabulary spells it.
        title: a few words for people.
        source: where the physics is described.
        remedy: what to do about it, in a sentence.
        parameters: in the order of the value vector.
        orders: largest order K of a family located at `order_K`, or at `place.order_K` where it has places; 0 for other
            effects.
        falling: whether lower orders are likelier, as in the shape of a part; else all are alike, as with gears.
        lowest: lowest order that has a meaning of its own.
        searched: what a search finds of it beforehand.
        searchable: what a search can find of effects of this kind, and the parameter that it finds.
    """

    name: ClassVar[str] = ""
    title: ClassVar[str] = ""
    source: ClassVar[str] = ""
    remedy: ClassVar[str] = ""
    parameters: ClassVar[tuple[Parameter, ...]] = ()
    orders: ClassVar[int] = 0
    falling: ClassVar[bool] = False
    lowest: ClassVar[int] = 1
    searched: ClassVar[Searched | None] = None
    searchable: ClassVar[Mapping[Searched, str]] = {}

    @classmethod
    def is_concrete(cls) -> bool:
        """Whether the class describes an effect of its own rather than a base."""
        return bool(cls.name) and "name" in cls.__dict__ and not inspect.isabstract(cls)

    def locations(self, machine: Description) -> tuple[str, ...]:
        """Places where the effect may sit on that stage or machine, orders apart; `("",)` when it has no place."""
        return ("",)

    def units(self, location: str) -> dict[str, str]:
        """SI unit of each parameter at one place."""
        return {parameter.name: parameter.unit for parameter in self.parameters}

    def start(self, location: str) -> Values:
        """Values that leave the prediction as it is; a family of orders carries the order of its location."""
        values = np.zeros(self.size)
        if self.orders:
            values[self.slices()["order"]] = order_of(location)
        return values

    def log_prior_of(self, order: int) -> float:
        """Logarithm of the chance of one order of the family: as 1/K^2 where lower orders are likelier, else alike.

        The Fourier coefficients of a shape without kinks fall at least as fast.
        """
        if order < self.lowest:
            return -float(np.log(1e3 * self.orders))
        if not self.falling:
            return -float(np.log(self.orders))
        return -float(2 * np.log(order) + np.log(np.sum(1 / np.arange(self.lowest, self.orders + 1.0) ** 2)))

    @property
    def size(self) -> int:
        """Length of the value vector."""
        return sum(parameter.size for parameter in self.parameters)

    def slices(self) -> dict[str, slice]:
        """Where each parameter stands in the value vector."""
        place, found = 0, {}
        for parameter in self.parameters:
            found[parameter.name] = slice(place, place + parameter.size)
            place += parameter.size
        return found

    def indices(self, *roles: Role) -> list[int]:
        """Indices into the value vector of all parameters of these roles."""
        places = self.slices()
        return [i for p in self.parameters if p.role in roles for i in range(*places[p.name].indices(self.size))]

    def scales(self) -> Values:
        """(size,) usual size of each value."""
        return np.concatenate([np.full(p.size, p.scale) for p in self.parameters]) if self.parameters else np.zeros(0)

    def bounds(self, near: Values | None = None) -> tuple[Values, Values]:
        """Least and largest (size,) of each value.

        Where values between these are none that the effect can have, those of the range of values that `near` is in.
        """
        low, high = np.zeros(self.size), np.zeros(self.size)
        for parameter, place in zip(self.parameters, self.slices().values(), strict=True):
            low[place], high[place] = parameter.range
        return low, high

    def largest(self, location: str) -> Values:
        """Values of the effect as large as it may be, its shape as it starts."""
        values, (_, high) = self.start(location), self.bounds()
        linear = self.indices(Role.LINEAR)
        values[linear] = (
            np.minimum(high, WITHOUT_BOUND * self.scales())[linear] if np.isinf(high).any() else high[linear]
        )
        return self.held(values)

    def held(self, values: Values) -> Values:
        """The values, those beyond their bounds put at them."""
        return np.asarray(np.clip(values, *self.bounds(values)), np.float64)

    def inward(self, values: Values, index: int, step: float) -> float:
        """The step of one value, the other way where it would leave the bounds, larger where it would end between."""
        low, high = (float(bound[index]) for bound in self.bounds(values))
        forward, back = float(values[index]) + step, float(values[index]) - step
        inward = -step if not low <= forward <= high and low <= back <= high else step
        moved = values.copy()
        moved[index] += inward
        reached = float(self.held(moved)[index])
        # to what is held where it began there is no step
        return inward if reached in (moved[index], values[index]) else reached - float(values[index])

    def at_bounds(self, values: Values) -> dict[str, float]:
        """Fitted parameters of which a value is at a bound, with that value."""
        low, high = self.bounds()
        fitted = self.indices(Role.LINEAR, Role.SHAPE)
        places = self.slices()
        found = {}
        for parameter in self.parameters:
            for i in range(*places[parameter.name].indices(self.size)):
                if i in fitted and (values[i] <= low[i] or values[i] >= high[i]):
                    found[parameter.name] = float(values[i])
        return found

    def report(self, values: Values, covariance: NDArray[np.float64]) -> dict[str, ParameterEstimate]:
        """Parameters as the vocabulary names them, with standard deviations, from values and their covariance."""
        std = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        found = {}
        for name, place in self.slices().items():
            value, spread = values[place], std[place]
            found[name] = (
                ParameterEstimate(float(value[0]), float(spread[0]))
                if len(value) == 1
                else ParameterEstimate(tuple(map(float, value)), tuple(map(float, spread)))
            )
        return found

    def values_from(self, parameters: Mapping[str, Any]) -> Values:
        """Value vector from parameters as the vocabulary names them: the inverse of `report`.

        Raises:
            InputError: a parameter is missing, unknown, of another size, or beyond its bounds.
        """
        told = self.numbers(parameters, {parameter.name: parameter.size for parameter in self.parameters})
        return self.checked(np.concatenate(list(told.values())))

    def numbers(self, parameters: Mapping[str, Any], sizes: Mapping[str, int]) -> dict[str, NDArray[np.float64]]:
        """Numbers of each parameter, in the order of `sizes`, which says how many each one has.

        Raises:
            InputError: a parameter is missing, unknown, of another size, or not finite.
        """
        if not isinstance(parameters, Mapping) or set(parameters) != set(sizes):
            names = sorted(map(str, parameters)) if isinstance(parameters, Mapping) else parameters
            raise InputError(f"{self.name}: parameters {excerpt(names)}; expected {sorted(sizes)}")
        found = {}
        for name, size in sizes.items():
            given: NDArray[np.float64] = np.empty(0)
            with suppress(TypeError, ValueError, OverflowError):
                given = np.atleast_1d(np.asarray(parameters[name], dtype=np.float64))
            if given.shape != (size,) or not np.isfinite(given).all():
                raise InputError(f"{self.name}: {name} = {excerpt(parameters[name])}; expected {size} finite number(s)")
            found[name] = given
        return found

    def checked(self, values: Values) -> Values:
        """The values.

        Raises:
            InputError: one is not finite or beyond its bounds.
        """
        for parameter, place in zip(self.parameters, self.slices().values(), strict=True):
            low, high = parameter.range
            if not (np.all(values[place] >= low) and np.all(values[place] <= high)):
                told = ", ".join(f"{value:g}" for value in values[place])
                raise InputError(
                    f"{self.name}: {parameter.name} = {told} {parameter.unit}; "
                    f"physically sensible is {low:g} to {high:g} {parameter.unit}"
                )
        return values


AnyEffect = Effect[Any]


@dataclass(frozen=True)
class Cause:
    """An effect at a place with values: what is added to a twin."""

    effect: AnyEffect
    location: str
    values: Values

    @property
    def key(self) -> tuple[str, str]:
        """Name and location, which identify the cause in reports."""
        return self.effect.name, self.location

    def with_values(self, values: Values) -> Cause:
        """The same cause of another size."""
        return Cause(self.effect, self.location, values)


def values_of(causes: Sequence[Cause]) -> tuple[tuple[str, str, bytes], ...]:
    """Names, locations and values of causes: what is kept of one set of them is kept by these."""
    return tuple((*cause.key, cause.values.tobytes()) for cause in causes)


def among(cause: Cause, others: Sequence[Cause]) -> tuple[Cause, ...]:
    """The others with the cause in the place of that of its name and location, else behind them.

    The place matters where one effect distorts what another adds.
    """
    if all(other.key != cause.key for other in others):
        return (*others, cause)
    return tuple(cause if other.key == cause.key else other for other in others)


def order_location(order: int, place: str = "") -> str:
    """Location of one member of a family of orders, which may have such a family at each of several places."""
    return f"{place}.order_{order}" if place else f"order_{order}"


def place_of(location: str) -> str:
    """Place of a location without the order that it may name."""
    place, _, order = location.rpartition(".")
    return place if order.startswith("order_") else location


def order_of(location: str) -> int:
    """Order that a location names.

    Raises:
        InputError: the location is not of the form order_K or place.order_K.
    """
    prefix, _, digits = location.rpartition(".")[2].partition("_")
    if prefix != "order" or not digits.isdigit():
        raise InputError(f"location '{location}' names no order; expected order_K with a whole number K")
    return int(digits)
