"""The compiled form of the exact model and of the search for corrections, where it was built; one place that picks it.

`compiled/kernel.c` has the formulas of `error_model` and `correction` for one pose and for a million in the same
operations, so that what a pose gives does not depend on how many there are. It is built with the package
(`machine_kernel` in setup.py) by the C compiler that is there; where there was none, or another kernel is asked for,
numpy computes, with the same results but for rounding.
"""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Iterable
from ctypes import c_double, c_int64, c_void_p
from pathlib import Path
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.libraries import NAME, address, load_library
from rotary_error_monitor.machine.kinematics import Fixtures, MachineModel

MOST_AXES = 16  # as in compiled/model.h
_SOURCES = Path(__file__).with_name("compiled")
_LIBRARY = Path(__file__).with_name(NAME)

_MOST_MULTIPLE = 64
"""Harmonics of a rotary axis up to this order follow from its sine and cosine by as many products at most, each of
which rounds once: as much as the argument of a sine of that order is rounded."""


class PoseRows(NamedTuple):
    """Input of the right shapes, poses first, each in one piece; numbers may be other than finite."""

    positions: Array
    direction: Array | None
    temperature: Array | None
    monitored: Array | None


class KernelCorrections(NamedTuple):
    """Corrections (n, axes), offset (n, 6), and flags (n, 3): converged, position spanned, direction spanned."""

    corrections: Array
    offset: Array
    flags: NDArray[np.bool_]


class _Machine(ctypes.Structure):
    """`machine` of compiled/model.h."""

    _fields_ = (
        *((name, c_int64) for name in ("axes", "tool_count", "workpiece_count", "terms", "wave_count", "table_count")),
        ("monitored", c_int64),
        *((name, c_void_p) for name in ("tool_axes", "workpiece_axes", "rotary")),
        *((name, c_void_p) for name in ("direction", "middle", "half_travel", "poly", "expansion", "reversal")),
        *((f"ideal_{part}", c_void_p) for part in ("axes", "tool", "workpiece")),
        *((f"actual_{part}", c_void_p) for part in ("axes", "tool", "workpiece")),
        *((f"wave_{part}", c_void_p) for part in ("axis", "multiple", "order", "cos", "sin")),
        *((name, c_void_p) for name in ("table_axis", "table_component", "table_size", "tables")),
        ("reference_temperature", c_double),
    )


class _Poses(ctypes.Structure):
    """`poses` of compiled/model.h."""

    _fields_ = (
        ("count", c_int64),
        *((name, c_void_p) for name in ("positions", "added", "direction", "temperature", "monitored", "ideal")),
    )


class _Packed:
    """A machine as the library takes it, and the arrays that it points to."""

    def __init__(self, model: MachineModel) -> None:
        count = len(model.letters)
        self._kept: list[NDArray[np.float64] | NDArray[np.int64]] = []
        self.machine = _Machine(
            axes=count,
            tool_count=len(model.tool_axes),
            workpiece_count=len(model.workpiece_axes),
            terms=len(model.components.poly),
            wave_count=len(model.components.waves),
            table_count=len(model.components.tables),
            monitored=-1 if model.monitored is None else model.monitored,
            tool_axes=self._integers(model.tool_axes),
            workpiece_axes=self._integers(model.workpiece_axes),
            rotary=self._integers(np.isin(np.arange(count), model.rotary)),
            direction=self._reals(model.direction),
            reference_temperature=model.components.reference_temperature,
        )
        self._point("ideal", model.ideal)
        self._point("actual", model.actual)
        self._point_to_components(model)

    def _point(self, name: str, fixtures: Fixtures) -> None:
        for part in ("axes", "tool", "workpiece"):
            setattr(self.machine, f"{name}_{part}", self._reals(getattr(fixtures, part)))

    def _point_to_components(self, model: MachineModel) -> None:
        to, components = self.machine, model.components
        for name in ("middle", "half_travel", "poly", "expansion", "reversal"):
            setattr(to, name, self._reals(getattr(components, name)))
        rotary = set(model.rotary.tolist())
        waves = sorted(components.waves, key=lambda wave: (wave.axis, wave.order))
        whole = [w.axis in rotary and w.order in range(1, _MOST_MULTIPLE + 1) for w in waves]
        to.wave_axis = self._integers([wave.axis for wave in waves])
        to.wave_multiple = self._integers([w.order if is_ else 0 for w, is_ in zip(waves, whole, strict=True)])
        to.wave_order = self._reals([wave.order for wave in waves])
        to.wave_cos = self._reals([wave.cos for wave in waves])
        to.wave_sin = self._reals([wave.sin for wave in waves])
        tables = components.tables
        to.table_axis = self._integers([table.axis for table in tables])
        to.table_component = self._integers([table.component for table in tables])
        to.table_size = self._integers([len(table.positions) for table in tables])
        to.tables = self._reals(
            np.concatenate([np.zeros(0), *(part for t in tables for part in (t.positions, t.forward, t.backward))])
        )

    def _integers(self, values: Iterable[float] | NDArray[np.bool_]) -> int:
        self._kept.append(np.array(values, dtype=np.int64))
        return address(self._kept[-1])

    def _reals(self, values: object) -> int:
        self._kept.append(np.ascontiguousarray(values, dtype=np.float64))
        return address(self._kept[-1])


class MachineKernel:
    """The library, called with the package's own arrays."""

    def __init__(self, library: ctypes.CDLL) -> None:
        """Kernel of a library that was built of these sources."""
        self._offsets, self._corrections = library.rem_offsets, library.rem_corrections
        self._offsets.argtypes = [c_void_p, c_void_p, c_void_p]
        self._corrections.argtypes = [c_void_p, c_void_p, c_double, c_int64, c_double, c_void_p, c_void_p, c_void_p]
        self._offsets.restype = self._corrections.restype = c_int64
        self._packed: WeakKeyDictionary[MachineModel, _Packed] = WeakKeyDictionary()

    def offsets(
        self, model: MachineModel, rows: PoseRows, added: Array | None = None, ideal: Array | None = None
    ) -> Array | None:
        """(n, 6) offset at the positions, and `added` (n, axes) to them, against the ideal machine at the positions.

        None where the input has a number that is not finite, or the machine has more axes than there is room for.

        Args:
            model: the machine.
            rows: the poses.
            added: corrections of the positions, in one piece.
            ideal: (3, 4, n) tool in workpiece of the ideal machine, where it is known from before, in one piece.
        """
        if len(model.letters) > MOST_AXES:
            return None
        offset = np.empty((len(rows.positions), 6))
        machine, poses = self._machine(model), _poses(rows, added, ideal)
        wrong = self._offsets(ctypes.addressof(machine), ctypes.addressof(poses), address(offset))
        return None if wrong >= 0 else offset

    def corrections(
        self, model: MachineModel, rows: PoseRows, least_reach: float, most_steps: int, last_step: float
    ) -> KernelCorrections | None:
        """What `solve_axis_corrections` finds; None as for `offsets`."""
        if len(model.letters) > MOST_AXES:
            return None
        count = len(rows.positions)
        corrections, offset = np.empty((count, len(model.letters))), np.empty((count, 6))
        flags = np.empty((count, 3), dtype=np.bool_)
        machine, poses = self._machine(model), _poses(rows)
        wrong = self._corrections(
            ctypes.addressof(machine),
            ctypes.addressof(poses),
            least_reach,
            most_steps,
            last_step,
            address(corrections),
            address(offset),
            address(flags),
        )
        return None if wrong >= 0 else KernelCorrections(corrections, offset, flags)

    def _machine(self, model: MachineModel) -> _Machine:
        packed = self._packed.get(model)
        if packed is None:
            packed = self._packed[model] = _Packed(model)
        return packed.machine


@functools.cache
def load_kernel() -> tuple[MachineKernel | None, str]:
    """The kernel that computes, None for numpy, and in that case why.

    Raises:
        InputError: the environment asks for a kernel that is not there.
    """
    library, reason = load_library(_LIBRARY, _SOURCES)
    return None if library is None else MachineKernel(library), reason


def chosen_kernel() -> MachineKernel | None:
    """The compiled kernel; None where numpy computes."""
    return load_kernel()[0]


def describe_kernel() -> str:
    """That the machine model is computed by numpy, and why; empty where it is compiled."""
    reason = load_kernel()[1]
    return f"the machine model is computed by numpy, which is slower: {reason}" if reason else ""


def _poses(rows: PoseRows, added: Array | None = None, ideal: Array | None = None) -> _Poses:
    arrays = (rows.positions, added, rows.direction, rows.temperature, rows.monitored, ideal)
    return _Poses(len(rows.positions), *(None if array is None else address(array) for array in arrays))
