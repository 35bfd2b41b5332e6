"""What an effect of a machine tool changes: the description of the machine, in the words of ISO 230-1."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import ClassVar

import numpy as np

from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.description.machine_parts import Displacement, Harmonic
from rotary_error_monitor.effects.effect import Effect, Searched, Values

LINEAR = "linear"
ROTARY = "rotary"


class MachineEffect(Effect[MachineDescription]):
    """An effect of a machine: puts itself into the machine's description, whatever its tree of bodies.

    Attributes:
        axes: kind of the axes at each of which it may sit; empty for an effect with one place, or places of its own.
    """

    axes: ClassVar[str] = ""
    searchable: ClassVar[Mapping[Searched, str]] = {Searched.ORDER: "order", Searched.WAVE: "period"}

    def locations(self, machine: MachineDescription) -> tuple[str, ...]:
        """Each axis of its kind, if it names one."""
        return axes_of(machine, self.axes) if self.axes else super().locations(machine)

    def amend(self, machine: MachineDescription, values: Values, location: str) -> MachineDescription:
        """The description with the effect in it."""
        raise TypeError(f"{type(self).__name__} does not say what it changes")


def axes_of(machine: MachineDescription, kind: str) -> tuple[str, ...]:
    """Letters of the axes of one kind."""
    return tuple(axis.letter for axis in machine.axes if axis.kind == kind)


def positioning_error(machine: MachineDescription, letter: str) -> str:
    """Name of the error component along or about the axis's own direction, such as EXX or ECC."""
    axis = machine.axis(letter)
    along = "XYZ" if axis.kind == LINEAR else "ABC"
    return f"E{along[int(np.argmax(np.abs(axis.direction)))]}{letter}"


def sign_of(machine: MachineDescription, letter: str) -> float:
    """1 if the axis moves positively along or about the coordinate of its `positioning_error`, -1 if negatively."""
    return math.copysign(1.0, max(machine.axis(letter).direction, key=abs))


def with_positioning_error(
    machine: MachineDescription, letter: str, *, poly: Sequence[float] = (), harmonic: Sequence[Harmonic] = ()
) -> MachineDescription:
    """The machine with a polynomial or harmonics added to the error along or about an axis's own direction.

    It points to where the largest share of that direction is positive, as the component `positioning_error` does.
    """
    sign = sign_of(machine, letter)
    for name, share in machine.axis(letter).positioning_shares.items():
        part = sign * share
        waves = [Harmonic(wave.order, part * wave.cos, part * wave.sin) for wave in harmonic]
        machine = machine.with_error(name, poly=[part * term for term in poly], harmonic=waves)
    return machine


def moved(machine: MachineDescription, body: str, shift: Values, rotation: Values) -> MachineDescription:
    """The machine with one body displaced on its parent."""
    x, y, z = (float(value) for value in shift)
    a, b, c = (float(value) for value in rotation)
    return machine.with_location_error(body, Displacement((x, y, z), (a, b, c)))
