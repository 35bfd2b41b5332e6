"""What a fault by name is, and the two registers that faults enter themselves in."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar, Self, TypeVar, dataclass_transform

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.plant.scene import Fault

Pair = tuple[float, float]
Reals = Array
_T = TypeVar("_T", bound="Named")

VOCABULARY: dict[str, type[Named]] = {}
"""Faults that the vocabulary of effects names, of stage and machine."""
UNNAMED: dict[str, type[Named]] = {}
"""Faults that no vocabulary names."""


class UnsuitableSeedError(InputError):
    """What a seed draws makes no case of the kind that is wanted; the next seed may."""


SHAPES = frozenset({"order", "phase", "time", "place", "extent", "frequency", "period", "teeth"})
"""Parameters that give a fault its shape; it is as large as its others are."""


@dataclass(frozen=True, kw_only=True)
class Named:
    """A fault with a name, a location (empty where it has none) and, as its other fields, parameters in SI."""

    name: ClassVar[str]
    location: str = ""

    @property
    def parameters(self) -> dict[str, Any]:
        """Parameters by name, vectors as lists."""
        values = {row.name: getattr(self, row.name) for row in fields(self) if row.name != "location"}
        return {name: list(value) if isinstance(value, tuple) else value for name, value in values.items()}

    def scaled(self, factor: float) -> Self:
        """The same fault, `factor` times as large."""
        changes: dict[str, Any] = {}
        for row in fields(self):
            if row.name not in SHAPES | {"location"}:
                value = getattr(self, row.name)
                changes[row.name] = tuple(factor * v for v in value) if isinstance(value, tuple) else factor * value
        return replace(self, **changes)


@dataclass(frozen=True, kw_only=True)
class StageFault(Named, Fault):
    """A named fault of the rotary stage."""


@dataclass_transform(kw_only_default=True, frozen_default=True)
def vocabulary(name: str) -> Callable[[type[_T]], type[_T]]:
    """Enter a class, as a frozen dataclass, as the fault that the vocabulary calls `name`."""
    return _entry(VOCABULARY, name)


@dataclass_transform(kw_only_default=True, frozen_default=True)
def unnamed(name: str) -> Callable[[type[_T]], type[_T]]:
    """Enter a class, as a frozen dataclass, as a fault that the vocabulary does not know."""
    return _entry(UNNAMED, name)


def _entry(register: dict[str, type[Named]], name: str) -> Callable[[type[_T]], type[_T]]:
    def enter(fault: type[_T]) -> type[_T]:
        if name in VOCABULARY or name in UNNAMED:
            raise InputError(f"two faults are called '{name}'; names must differ")
        fault.name = name
        register[name] = dataclass(frozen=True, kw_only=True)(fault)
        return fault

    return enter


def make_fault(name: str, location: str = "", **parameters: float | Sequence[float]) -> Named:
    """Fault by name with its parameters, as a truth file describes it; lists are vectors.

    Raises:
        InputError: there is no such fault, or its parameters are others.
    """
    known = VOCABULARY | UNNAMED
    if name not in known:
        raise InputError(f"no fault '{name}'; there are {', '.join(sorted(known))}")
    values: dict[str, Any] = {
        key: tuple(value) if isinstance(value, Sequence) else value for key, value in parameters.items()
    }
    expected = {row.name for row in fields(known[name])} - {"location"}
    if set(values) != expected:
        raise InputError(f"fault '{name}' has the parameters {sorted(expected)}, not {sorted(values)}")
    return known[name](location=location, **values)
