"""Error components of all axes of a machine at many positions: polynomials, harmonics, tables, reversal, expansion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.machine import DIRECTIONS, MachineDescription
from rotary_error_monitor.description.machine_parts import ErrorComponent


@dataclass(frozen=True)
class _Waves:
    """All components of one axis at one order."""

    axis: int
    order: float
    cos: Array
    sin: Array


@dataclass(frozen=True)
class _Table:
    component: int
    axis: int
    positions: Array
    forward: Array
    backward: Array


@dataclass(frozen=True)
class ErrorComponents:
    """The error components of m axes, arranged for evaluation at n positions at once.

    Attributes:
        middle, half_travel: (m, 1) scaling of position to u.
        poly: (degree + 1, 6, m, 1) coefficients in u.
        waves, tables: harmonics and tables of the components that have some.
        expansion, reversal: (m, 1) of each axis.
        positioning: (6, m, 1) the component along or about the axis's own direction.
        reference_temperature: °C.
    """

    middle: Array
    half_travel: Array
    poly: Array
    waves: tuple[_Waves, ...]
    tables: tuple[_Table, ...]
    expansion: Array
    reversal: Array
    positioning: Array
    reference_temperature: float

    def at(self, positions: Array, direction: Array | None, temperature: Array | None) -> Array:
        """(6, m, n) error components in m and rad, in the frames of the moved bodies.

        Args:
            positions: (m, n) axis positions, m or rad.
            direction: (m, n) sign of the travel by which each position was reached, 0 if unknown: then the mean of
                both directions holds; None: all unknown.
            temperature: (n,) °C; None: the reference temperature.
        """
        u = (positions - self.middle) / self.half_travel
        errors = np.broadcast_to(self.poly[-1], (6, *u.shape))
        for coefficients in self.poly[-2::-1]:
            errors = errors * u + coefficients
        errors = np.array(errors)
        self._add_waves(errors, positions)
        self._add_tables(errors, positions, direction)
        along = None if temperature is None else self.expansion * (temperature - self.reference_temperature) * positions
        if direction is not None:
            lag = -0.5 * self.reversal * np.sign(direction)
            along = lag if along is None else along + lag
        if along is not None:
            errors += self.positioning * along
        return errors

    def _add_waves(self, errors: Array, positions: Array) -> None:
        if not self.waves:
            return
        phase = np.stack([wave.order * positions[wave.axis] for wave in self.waves])
        cos, sin = np.cos(phase), np.sin(phase)
        for wave, c, s in zip(self.waves, cos, sin, strict=True):
            errors[:, wave.axis] += wave.cos * c + wave.sin * s

    def _add_tables(self, errors: Array, positions: Array, direction: Array | None) -> None:
        for table in self.tables:
            position = positions[table.axis]
            forward = np.interp(position, table.positions, table.forward)
            backward = np.interp(position, table.positions, table.backward)
            sign = 0.0 if direction is None else np.sign(direction[table.axis])
            errors[table.component, table.axis] += 0.5 * ((1.0 + sign) * forward + (1.0 - sign) * backward)


def arrange_components(machine: MachineDescription) -> ErrorComponents:
    """Error components of a machine, arranged for evaluation."""
    axes = machine.axes
    index = {letter: number for number, letter in enumerate(machine.letters)}
    found = {
        (DIRECTIONS.index(name[1]), index[name[2]]): component for name, component in sorted(machine.errors.items())
    }
    poly = np.zeros((max((len(c.poly) for c in found.values()), default=0) or 1, 6, len(axes), 1))
    for (component, axis), error in found.items():
        poly[: len(error.poly), component, axis, 0] = error.poly
    positioning = np.zeros((6, len(axes), 1))
    for number, axis_ in enumerate(axes):
        first = 0 if axis_.kind == "linear" else 3
        positioning[first : first + 3, number, 0] = axis_.direction
    travel = np.array([axis.travel for axis in axes])
    return ErrorComponents(
        middle=travel.mean(axis=1)[:, None],
        half_travel=0.5 * (travel[:, 1] - travel[:, 0])[:, None],
        poly=poly,
        waves=_waves(found),
        tables=_tables(found),
        expansion=np.array([[axis.expansion] for axis in axes]),
        reversal=np.array([[axis.reversal] for axis in axes]),
        positioning=positioning,
        reference_temperature=machine.reference_temperature,
    )


def _waves(found: dict[tuple[int, int], ErrorComponent]) -> tuple[_Waves, ...]:
    rows: dict[tuple[int, float], tuple[Array, Array]] = {}
    for (component, axis), error in found.items():
        for wave in error.harmonic:
            cos, sin = rows.setdefault((axis, wave.order), (np.zeros((6, 1)), np.zeros((6, 1))))
            cos[component] += wave.cos
            sin[component] += wave.sin
    return tuple(_Waves(axis, order, cos, sin) for (axis, order), (cos, sin) in rows.items())


def _tables(found: dict[tuple[int, int], ErrorComponent]) -> tuple[_Table, ...]:
    return tuple(
        _Table(
            component,
            axis,
            np.array(error.table.positions),
            np.array(error.table.forward),
            np.array(error.table.backward),
        )
        for (component, axis), error in found.items()
        if error.table is not None
    )
