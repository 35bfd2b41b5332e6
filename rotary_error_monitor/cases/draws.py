"""Seeded draws: stages, machines and faults such as builders have them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from rotary_error_monitor.cases.faults import UNNAMED, VOCABULARY, Named, make_fault
from rotary_error_monitor.cases.faults.axes import AxisFault
from rotary_error_monitor.description.harmonics import AngularHarmonic, PlanarHarmonic
from rotary_error_monitor.description.spindle_section import Spindle
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.stage_section import Encoder, Mirror
from rotary_error_monitor.description.two_axis_section import Autocollimator, RadialReference

ARCSEC = np.pi / 180 / 3600
DURATION = 40.0  # s, of a recording

LOCATIONS: dict[str, Sequence[str]] = {
    "autocollimator_gain": "xy",
    "lvdt_gain": "xy",
    "squareness": ("XY", "XZ", "YZ"),
    "axis_scale": "XYZ",
    "thermal_expansion": "XYZ",
    "axis_backlash": "XYZCA",
    "axis_straightness": ("EYX", "EZX", "EXY", "EZY", "EXZ", "EYZ"),
    "axis_angular": ("EAX", "EBX", "ECX", "EAY", "EBY", "ECY", "EAZ", "EBZ", "ECZ"),
    "cyclic_error": "XYZ",
    "rotary_harmonic": "CA",
    "axis_orientation": "CA",
}
"""Where a fault may sit, for those that sit at one of several places other than a head or an order."""

ORDERS: dict[str, tuple[int, int]] = {
    "graduation_error": (1, 12),
    "mirror_flatness": (2, 6),
    "spindle_radial": (2, 9),
    "spindle_tilt": (2, 9),
    "drive_cyclic_error": (20, 90),
    "rotary_harmonic": (2, 4),
}
"""Lowest and highest order of the faults that have one."""

AT_A_HEAD = frozenset(
    {"subdivisional_error", "head_misplacement", "head_latency", "head_missed_counts", "head_tilt_sensitivity"}
)
ORDERED_PLACES = frozenset(ORDERS) - {"rotary_harmonic"}

SHAPE_DRAWS: dict[str, Callable[[np.random.Generator], float]] = {
    "phase": lambda draw: float(draw.uniform(0, 2 * np.pi)),
    "time": lambda draw: float(draw.uniform(0.25, 0.75)),  # of the duration
    "place": lambda draw: float(draw.uniform(0, 2 * np.pi)),
    "extent": lambda draw: float(draw.uniform(0.02, 0.06)),
    "frequency": lambda draw: float(draw.uniform(2.0, 9.0)),
    "period": lambda draw: float(draw.choice([0.01, 0.016, 0.02, 0.04])),
    "teeth": lambda draw: int(draw.integers(30, 80)),
}

MAGNITUDES: dict[str, dict[str, float]] = {
    "bearing_asynchronous": {"radial": 4e-7, "tilt": 4e-6},
    "load_compliance": {"radial": 4e-9, "tilt": 1e-8},
    "setup_offset": {"shift": 1e-5, "rotation": 1e-5},
}
"""Sizes of parameters against one another, where a fault has several of different units; elsewhere all are alike."""


def stage_faults(named: bool = True) -> tuple[str, ...]:
    """Names of the faults of a stage: those of the vocabulary, or the others."""
    return tuple(name for name, kind in _register(named).items() if not issubclass(kind, AxisFault))


def machine_faults(named: bool = True) -> tuple[str, ...]:
    """Names of the faults of a machine: those of the vocabulary, or the others."""
    return tuple(name for name, kind in _register(named).items() if issubclass(kind, AxisFault))


def draw_fault(
    name: str, draw: np.random.Generator, heads: Sequence[str] = "abcd", duration: float = DURATION
) -> Named:
    """Fault `name` at a drawn place, with drawn shape and direction; its size is arbitrary, to be scaled.

    What begins at a moment begins in the middle half of the recording's `duration` (s).

    Raises:
        InputError: there is no such fault.
    """
    kind = (VOCABULARY | UNNAMED).get(name)
    if kind is None:
        return make_fault(name)  # which says what there is
    location = str(draw.choice(list(LOCATIONS[name]))) if name in LOCATIONS else ""
    if name in AT_A_HEAD:
        location = f"head_{draw.choice(list(heads))}"
    sizes = MAGNITUDES.get(name, {})
    parameters: dict[str, Any] = {}
    for row in fields(kind):
        if row.name == "order":
            parameters["order"] = _order(name, draw)
        elif row.name in SHAPE_DRAWS:
            parameters[row.name] = SHAPE_DRAWS[row.name](draw)
        elif row.name != "location":
            size = {"Pair": 2, "Vector": 3}.get(str(row.type), 1)
            values = (draw.normal(size=size) * sizes.get(row.name, 1e-6)).tolist()
            parameters[row.name] = values if size > 1 else values[0]
    if "time" in parameters:
        parameters["time"] *= duration
    for positive in {"delay", "width"} & set(parameters):
        parameters[positive] = abs(parameters[positive])
    if "phase" in parameters and parameters["radial"] < 0:  # an orbit has a size and a phase, and no sign
        parameters |= {"radial": -parameters["radial"], "phase": parameters["phase"] + np.pi}
    if name in ORDERED_PLACES:
        location = f"order_{parameters['order']}"
    return make_fault(name, location, **parameters)


def draw_stage(draw: np.random.Generator) -> StageDescription:
    """Stage as in Lou et al. 2019 (RESM20-USA200, four heads, quadrant autocollimator) with drawn errors."""
    heads = {"a": 0.0, "b": np.pi, "c": np.pi / 2, "d": 3 * np.pi / 2}

    def planar(orders: Sequence[int], std: float) -> tuple[PlanarHarmonic, ...]:
        return tuple(PlanarHarmonic(order, _pair(draw, std), _pair(draw, std)) for order in orders)

    return StageDescription(
        encoder=Encoder(
            disc_radius=0.1,
            lines_per_revolution=31488,
            counts_per_line=100,
            noise=3e-7,
            azimuths=heads,
            eccentricity=_pair(draw, 2e-5),
            graduation=tuple(AngularHarmonic(order, *_pair(draw, 1.5e-6)) for order in (2, 3)),
        ),
        autocollimator=Autocollimator(range=100 * ARCSEC, resolution=0.1 * ARCSEC, noise=0.1 * ARCSEC),
        mirror=Mirror(_pair(draw, 10 * ARCSEC), planar((2, 3), 0.6 * ARCSEC)),
        spindle=Spindle(
            radial=planar((1,), 2.5e-6) + planar((2, 3, 5), 8e-7),
            tilt=planar((1,), 4 * ARCSEC) + planar((2, 3), 2 * ARCSEC),
            radial_compliance=2e-8,
            tilt_compliance=5e-8,
            radial_thermal=_pair(draw, 3e-7),
        ),
        lvdt=RadialReference(0.06, 5e-8, _pair(draw, 5e-6)),
    )


def _register(named: bool) -> dict[str, type[Named]]:
    return VOCABULARY if named else UNNAMED


def _order(name: str, draw: np.random.Generator) -> float:
    if name == "bearing_asynchronous":
        return float(draw.uniform(2.1, 7.9) // 1 + draw.uniform(0.2, 0.8))
    low, high = ORDERS[name]
    return int(draw.integers(low, high + 1))


def _pair(draw: np.random.Generator, std: float) -> tuple[float, float]:
    x, y = draw.normal(size=2) * std
    return float(x), float(y)
