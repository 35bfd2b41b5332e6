"""The two forms of what has a library, compiled and numpy, and machines drawn to hold them against each other."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest
from numpy.typing import NDArray

from rotary_error_monitor.description.machine import DIRECTIONS, MachineDescription
from rotary_error_monitor.description.machine_parts import (
    Axis,
    Body,
    Displacement,
    ErrorComponent,
    ErrorTable,
    Harmonic,
)
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.libraries import VARIABLE, room_library
from rotary_error_monitor.machine.kernel import load_kernel
from rotary_error_monitor.metrology.kernel import chosen_kernel as metrology_kernel
from rotary_error_monitor.pipeline.kernel import chosen_kernel as pipeline_kernel
from rotary_error_monitor.signals.kernel import chosen_kernel as signals_kernel

Array = NDArray[np.float64]
FORMS = ("compiled", "numpy")
CHOICES = (load_kernel, signals_kernel, metrology_kernel, pipeline_kernel)
"""Which form computes, of each room that has a library."""


def is_built() -> bool:
    """Whether the compiled form is there at all."""
    try:
        with computing_by("compiled"):
            return True
    except InputError:
        return False


@contextmanager
def computing_by(form: str) -> Iterator[None]:
    """Have all that has a library computed by one of FORMS."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(os.environ, VARIABLE, form)
        forget_kernels()
        try:
            for load in CHOICES:
                load()
            yield
        finally:
            forget_kernels()


def forget_kernels() -> None:
    """Have each room look for its library again."""
    for load in (room_library, *CHOICES):
        load.cache_clear()


def drawn_machine(rng: np.random.Generator, size: float = 1.0, angle: float = 1e-4) -> MachineDescription:
    """A machine of 1 to 9 axes in any directions, in two branches, with every kind of error; `angle` is their size."""
    letters = [*"XYZUVWABC"[: rng.integers(1, 10)]]
    rng.shuffle(letters)
    axes = tuple(_axis(rng, letter, size) for letter in letters)
    carrying = {"tool": "base", "workpiece": "base"}
    bodies = []
    for letter in rng.permutation(letters).tolist():
        branch = rng.choice(["tool", "workpiece"])
        where, error = _displacement(rng, size, 2.0), _displacement(rng, 1e-4, angle)
        bodies.append(Body(f"body {letter}", carrying[branch], where, error, letter))
        carrying[branch] = bodies[-1].name
    for branch, parent in carrying.items():
        bodies.append(Body(branch, parent, _displacement(rng, size, 2.0), _displacement(rng, 1e-4, angle)))
    errors = {
        f"E{d}{axis.letter}": _component(rng, axis, 1e-4 if d in "XYZ" else angle)
        for axis in axes
        for d in DIRECTIONS
        if rng.random() < 0.7
    }
    rotary = [axis.letter for axis in axes if axis.kind == "rotary"]
    monitored = str(rng.choice(rotary)) if rotary and rng.random() < 0.7 else None
    return MachineDescription("drawn", tuple(bodies), axes, errors, "tool", "workpiece", monitored)


def drawn_poses(rng: np.random.Generator, machine: MachineDescription, count: int) -> tuple[Array, dict[str, Array]]:
    """Positions (count, axes), beyond the travel as well, and some of what else `predict_tool_offset` takes."""
    travel = np.array([axis.travel for axis in machine.axes])
    positions = rng.uniform(1.2 * travel[:, 0], 1.2 * travel[:, 1], (count, len(travel)))
    live = rng.normal(size=(count, 6)) * 1e-5
    live[rng.random(live.shape) < 0.2] = np.nan
    known = {
        "direction": rng.choice([-1.0, 0.0, 0.5, 1.0], positions.shape),
        "temperature": rng.uniform(15.0, 30.0, count),
        "monitored": live,
    }
    left_out = {name for name in known if rng.random() < 0.3} | (set() if machine.monitored else {"monitored"})
    return positions, {name: value for name, value in known.items() if name not in left_out}


def _axis(rng: np.random.Generator, letter: str, size: float) -> Axis:
    rotary = letter in "ABC"
    direction = rng.normal(size=3) if rng.random() < 0.5 else np.eye(3)[rng.integers(3)] * rng.choice([-1.0, 1.0])
    x, y, z = (direction / np.linalg.norm(direction)).tolist()
    reach = 4.0 if rotary else size
    return Axis(
        letter,
        "rotary" if rotary else "linear",
        (x, y, z),
        (-reach * float(rng.uniform(0.5, 1.0)), reach * float(rng.uniform(0.5, 1.0))),
        expansion=float(rng.normal() * 1e-5),
        reversal=float(abs(rng.normal()) * 1e-5),
    )


def _displacement(rng: np.random.Generator, shift: float, angle: float) -> Displacement:
    if rng.random() < 0.3:
        return Displacement(shift=tuple((shift * rng.normal(size=3)).tolist()))
    return Displacement(tuple((shift * rng.normal(size=3)).tolist()), tuple((angle * rng.normal(size=3) / 2).tolist()))


def _component(rng: np.random.Generator, axis: Axis, size: float) -> ErrorComponent:
    poly = tuple((size * rng.normal(size=rng.integers(0, 5))).tolist())
    orders = rng.choice([0.5, 1.0, 2.0, 3.0, 17.0, 64.0, 65.0, 628.3], rng.integers(0, 4), replace=False)
    waves = tuple(Harmonic(float(k), *(size / k * rng.normal(size=2)).tolist()) for k in orders)
    table = None
    if rng.random() < 0.4:
        places = np.unique(rng.uniform(*axis.travel, rng.integers(2, 40)))
        forward, backward = (size * rng.normal(size=(2, len(places)))).tolist()
        table = ErrorTable(tuple(places.tolist()), tuple(forward), tuple(backward))
    return ErrorComponent(poly=poly, harmonic=waves, table=table)
