"""What the section `machine` of a file states: a tree of bodies, or the parameters of the TTTRR machine.

Errors are in the words of ISO 230-1. Where a file has it otherwise than `MachineDescription`, the part for a file ends
in `Section`.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any

from rotary_error_monitor.description.expected import Expected
from rotary_error_monitor.description.machine_limits import MachineLimits
from rotary_error_monitor.description.machine_parts import (
    ZERO,
    Axis,
    BodySection,
    ErrorTable,
    Expansion,
    Smooth,
    wrong_travel,
)
from rotary_error_monitor.description.machine_tree import wrong_tree
from rotary_error_monitor.description.provenance import Calibrated
from rotary_error_monitor.description.quantities import (
    REFERENCE_TEMPERATURE,
    Deviation,
    Displacements,
    Letter,
    Name,
    NotNegative,
    Position,
    Temperature,
    Tilt,
    TiltPair,
    Travel,
)
from rotary_error_monitor.description.sections import Place, Section

ToolSide = Annotated[float, Expected("a length in m from 0 to 10 m", 0, 10)]
Values = Annotated[tuple[Deviation, ...], Expected("errors in m or rad, one for each position", count=(2, math.inf))]
ErrorName = Annotated[
    str, Expected("E, one of X Y Z A B C, and the letter of an axis, such as EXX", pattern="^E[XYZABC][A-Z]$")
]
Uncertain = Annotated[
    str,
    Expected(
        pattern=r"^((errors|location|reversal)\.(linear|angular)|squareness|orientation|pivot_offset|head_length|"
        r"tool_length|expansion|thermometer)$"
    ),
]
Linear = Annotated[str, Expected("one of X, Y, Z", pattern="^[XYZ]$")]
Rotary = Annotated[str, Expected("one of C, A", pattern="^[CA]$")]
Both = Annotated[str, Expected("one of X, Y, Z, C, A", pattern="^[XYZCA]$")]
Pair = Annotated[str, Expected("one of XY, XZ, YZ", pattern="^(XY|XZ|YZ)$")]


@dataclass(frozen=True)
class TableSection(Section):
    """Measured values of an error component, of both directions of travel alike or of each."""

    positions: Annotated[tuple[Position, ...], Expected("rising axis positions in m or rad", count=(2, math.inf))]
    values: Values | None = None
    forward: Values | None = None
    backward: Values | None = None

    @property
    def described(self) -> ErrorTable:
        """The values by direction of travel."""
        forward, backward = self.forward or self.values, self.backward or self.values
        assert forward is not None and backward is not None
        return ErrorTable(self.positions, forward, backward)

    def contradictions(self) -> Iterator[tuple[Place, str]]:
        """Other columns than these, positions that do not rise, or not a value for each."""
        columns = {"values": self.values, "forward": self.forward, "backward": self.backward}
        found = {name: column for name, column in columns.items() if column is not None}
        if set(found) not in ({"values"}, {"forward", "backward"}):
            what = ", ".join(found) or "no values"
            yield (), f"{what}; expected {{positions, values}} or, by direction, {{positions, forward, backward}}"
        if any(after <= before for before, after in itertools.pairwise(self.positions)):
            yield ("positions",), f"{list(self.positions)} do not rise; expected rising positions"
        for name, column in found.items():
            if len(column) != len(self.positions):
                counts = f"{len(column)} values at {len(self.positions)} positions"
                yield (name,), f"{counts}; expected one for each"


@dataclass(frozen=True)
class ComponentSection(Smooth):
    """An error component."""

    table: TableSection | None = None


PROBE_NOISE = (
    "standard deviation of one component of the probe or tracker in m, from 1e-9 to 0.001, or of [x, y, z] where they "
    "differ"
)

ProbeNoise = Annotated[float, Expected(PROBE_NOISE, 1e-9, 1e-3)]


@dataclass(frozen=True)
class MachineSection(Section):
    """What both forms of the section state."""

    reference_temperature: Temperature = REFERENCE_TEMPERATURE
    probe_noise: Annotated[tuple[ProbeNoise, ProbeNoise, ProbeNoise] | None, Expected(PROBE_NOISE)] = None
    errors: Annotated[
        Mapping[
            ErrorName,
            Annotated[
                ComponentSection,
                Expected("one error component: poly, harmonic and table are added up", count=(1, math.inf)),
            ],
        ],
        Expected("error components by ISO 230-1 name: E, direction (X Y Z, or A B C about them), moving axis"),
    ] = field(default_factory=dict)
    limits: MachineLimits = field(default_factory=MachineLimits)
    uncertainty: Annotated[
        Mapping[Uncertain, NotNegative],
        Expected(
            "standard uncertainty of parameters by name, such as errors.linear: 8.0e-07, or thermometer: 0.1 for its "
            "zero in K"
        ),
    ] = field(default_factory=dict)
    calibration: Annotated[Mapping[str, Calibrated], Expected("where calibrated sections are from, by their names")] = (
        field(default_factory=dict)
    )

    @classmethod
    def variant(cls, content: Mapping[str, Any]) -> type[Any]:
        """A tree where it has bodies or axes."""
        return TreeSection if {"bodies", "axes"} & set(content) else ParameterSection

    @classmethod
    def arranged(cls, content: Mapping[str, Any]) -> tuple[Mapping[str, Any], Mapping[Place, Place]]:
        """Noise of the probe by component, where the file states it of one."""
        name, noise = "probe_noise", content.get("probe_noise")
        if not isinstance(noise, int | float):
            return content, {}
        return {**content, name: [noise] * 3}, {(name, i): (name,) for i in range(3)}

    def _out_of_place(self, travels: Mapping[str, tuple[float, float]]) -> Iterator[tuple[Place, str]]:
        """Errors of axes that there are not, tables far beyond a travel, and a temperature that there is not."""
        for name, row in self.errors.items():
            if name[2] not in travels:
                yield ("errors", name), f"there is no axis {name[2]}; the axes are {', '.join(travels)}"
                continue
            low, high = travels[name[2]]
            beyond = max(low - row.table.positions[0], row.table.positions[-1] - high) if row.table else 0.0
            if row.table is not None and beyond > high - low > 0.0:
                yield (
                    ("errors", name, "table", "positions"),
                    f"from {row.table.positions[0]:g} to {row.table.positions[-1]:g} they are beyond the travel of "
                    f"axis {name[2]}, {low:g} to {high:g}; expected positions in m or rad",
                )
        low, high = self.limits.temperature
        if low < high and not low <= self.reference_temperature <= high:
            yield (
                ("reference_temperature",),
                f"{self.reference_temperature:g} °C is outside limits.temperature: expected {low:g} to {high:g}",
            )


@dataclass(frozen=True, kw_only=True)
class TreeSection(MachineSection):
    """A tree of bodies."""

    name: Name
    tool: Name
    workpiece: Name
    monitored: Annotated[
        Letter | None, Expected("letter of the rotary axis whose error motion is measured live, or null", null=True)
    ] = None
    spindle: Annotated[
        Name | None, Expected("name of the body whose z is the axis of the spindle, or null", null=True)
    ] = None
    axes: Annotated[Mapping[Letter, Axis], Expected("axes by their letters", count=(1, math.inf))]
    bodies: Annotated[
        tuple[BodySection, ...], Expected("from 1 to 100 bodies, a parent before its children", count=(1, 100))
    ]

    def contradictions(self) -> Iterator[tuple[Place, str]]:
        """What is out of place, or a tree that does not hold together."""
        yield from self._out_of_place({letter: axis.travel for letter, axis in self.axes.items()})
        yield from wrong_tree(self)


@dataclass(frozen=True, kw_only=True)
class ParameterSection(MachineSection):
    """Parameters of the TTTRR machine."""

    names_as = "a tree of bodies (name, tool, workpiece, axes, bodies), or the parameters of the TTTRR machine:"
    travel: Annotated[Mapping[Both, Travel], Expected("travel of each of X, Y, Z, C, A", count=(5, 5))]
    squareness: Mapping[Pair, Tilt] = field(default_factory=dict)
    orientation: Mapping[Rotary, Annotated[TiltPair, Expected("two angles in rad, each at most 10 mrad")]] = field(
        default_factory=dict
    )
    pivot_offset: Displacements = ZERO
    head_length: ToolSide
    tool_length: ToolSide
    expansion: Mapping[Linear, Expansion] = field(default_factory=dict)

    def contradictions(self) -> Iterator[tuple[Place, str]]:
        """A travel that does not rise, or what is out of place."""
        for letter, travel in self.travel.items():
            if problem := wrong_travel("linear" if letter in "XYZ" else "rotary", travel):
                yield ("travel", letter), problem
        yield from self._out_of_place(self.travel)
