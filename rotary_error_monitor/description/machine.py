"""A machine as it is described: a tree of bodies, its axes, and their errors in the words of ISO 230-1."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

from rotary_error_monitor.description.machine_limits import MachineLimits
from rotary_error_monitor.description.machine_parts import (
    Axis,
    Body,
    BodySection,
    Displacement,
    ErrorComponent,
    Harmonic,
    PoseSection,
    Vector,
)
from rotary_error_monitor.description.machine_section import (
    ComponentSection,
    MachineSection,
    ParameterSection,
    TableSection,
    TreeSection,
)
from rotary_error_monitor.description.machine_tree import BASE
from rotary_error_monitor.description.quantities import REFERENCE_TEMPERATURE
from rotary_error_monitor.description.sections import from_content, load, write
from rotary_error_monitor.errors import InputError, excerpt
from rotary_error_monitor.files import exists
from rotary_error_monitor.resources import config, share

T = TypeVar("T")

THERMOMETER = "thermometer"
"""Name of the zero of the machine's thermometer, K, in its section `uncertainty`."""

SHIFT_UNCERTAINTY = "shift_uncertainty"
"""Figure under `calibration` that says how sure the place of an axis is, m."""

VOLUMETRIC, WHOLE_MACHINE = "volumetric_uncertainty", "machine"
"""Figure under `calibration` of a part that an identification has left, and name of the whole."""

POSE_TERM = "volumetric_term_"
"""Begin of the names of figures there that say how that uncertainty depends on the pose."""

DIRECTIONS = "XYZABC"
"""Second letter of an error component: shift along x, y, z in m, then rotation about x, y, z in rad."""


@dataclass(frozen=True)
class MachineDescription:
    """All that is known of a machine: the section `machine` of a file in `config/machines/` or of a digital twin.

    Attributes:
        bodies: a parent before its children; the base is not listed.
        axes: in the order in which positions are given as columns.
        errors: components by name: E, direction (X Y Z shifts, A B C rotations), letter of the axis.
        tool: name of the body whose origin is the tool tip and whose z axis is the tool axis.
        workpiece: name of the body in whose frame offsets are told.
        spindle: name of the body whose z axis is the spindle's axis of rotation; none where the file names none.
        monitored: letter of the rotary axis whose six error components are measured live; none for a table only.
        limits: of its temperature.
        uncertainty: standard uncertainty of parameters by dotted name, as in the file; empty for an exact description.
        probe_noise: standard deviation of each component of what probes the tool, m; none where nobody has stated it.
        calibrated: standard uncertainty of calibrated parts by their names under `calibration`, m or rad; that of a
            place by the name with `.shift`, m.
        pose_terms: how that of the whole machine depends on the pose (`machine/pose_uncertainty.py`), m; empty where it
            is told alike at all poses.
    """

    name: str
    bodies: tuple[Body, ...]
    axes: tuple[Axis, ...]
    errors: Mapping[str, ErrorComponent]
    tool: str
    workpiece: str
    monitored: str | None = None
    reference_temperature: float = REFERENCE_TEMPERATURE
    limits: MachineLimits = field(default_factory=MachineLimits)
    uncertainty: Mapping[str, float] = field(default_factory=dict)
    spindle: str | None = None
    probe_noise: Vector | None = None
    calibrated: Mapping[str, float] = field(default_factory=dict)
    pose_terms: Mapping[str, float] = field(default_factory=dict)

    @property
    def letters(self) -> tuple[str, ...]:
        """Letters of the axes, in the order of the columns of positions."""
        return tuple(axis.letter for axis in self.axes)

    def axis(self, letter: str) -> Axis:
        """The axis of that letter.

        Raises:
            InputError: the machine has none of it.
        """
        return _named(self.axes, letter, lambda axis: axis.letter, f"axis of machine {self.name}")

    def body(self, name: str) -> Body:
        """The body of that name.

        Raises:
            InputError: the machine has none of it.
        """
        return _named(self.bodies, name, lambda body: body.name, f"body of machine {self.name}")

    def body_of(self, letter: str) -> Body:
        """The body that the axis of that letter moves.

        Raises:
            InputError: the machine has no such axis.
        """
        return _named(self.bodies, letter, lambda body: body.axis, f"axis of machine {self.name}")

    def with_location_error(self, body: str, added: Displacement) -> MachineDescription:
        """The machine with one more error of location at that body.

        Raises:
            InputError: the machine has no such body.
        """
        changed = self.body(body)
        changed = replace(changed, location_error=changed.location_error.plus(added))
        return replace(self, bodies=tuple(changed if old.name == body else old for old in self.bodies))

    def with_axis(self, letter: str, *, expansion: float = 0.0, reversal: float = 0.0) -> MachineDescription:
        """The machine with thermal expansion or reversal added to one axis.

        Raises:
            InputError: the machine has no such axis.
        """
        old = self.axis(letter)
        new = replace(old, expansion=old.expansion + expansion, reversal=old.reversal + reversal)
        return replace(self, axes=tuple(new if axis is old else axis for axis in self.axes))

    def with_error(
        self, name: str, *, poly: Sequence[float] = (), harmonic: Sequence[Harmonic] = ()
    ) -> MachineDescription:
        """The machine with a polynomial or harmonics added to the error component `name`, such as EAA.

        Raises:
            InputError: the name is none, or the machine has no such axis.
        """
        if len(name) != 3 or name[0] != "E" or name[1] not in DIRECTIONS:
            raise InputError(f"'{name}' names no error component; expected E, one of {DIRECTIONS}, letter of an axis")
        self.axis(name[2])
        old = self.errors.get(name, ErrorComponent())
        size = max(len(old.poly), len(poly))
        both = (tuple(terms) + (0.0,) * (size - len(terms)) for terms in (old.poly, poly))
        new = replace(old, poly=tuple(a + b for a, b in zip(*both, strict=True)), harmonic=(*old.harmonic, *harmonic))
        return replace(self, errors={**self.errors, name: new})


def load_machine(path_or_name: Path | str) -> MachineDescription:
    """Machine described in a YAML file; a bare name such as `pan2013` means one in `config/machines/`.

    The section `machine` is either a tree of bodies or, as in a digital twin, the parameters of the TTTRR machine.

    Raises:
        InputError: the file is missing or wrong; the message names file, line, value and what is expected.
    """
    return _description(load(machine_path(path_or_name), "machine", MachineSection))


def machine_from_mapping(content: Mapping[str, Any]) -> MachineDescription:
    """Machine from the content of a `machine` section.

    Raises:
        InputError: as `load_machine`, without file and line.
    """
    return _description(from_content(MachineSection, content, "machine"))


def machine_mapping(machine: MachineDescription) -> dict[str, Any]:
    """Content of a `machine` section as a tree of bodies, whatever form it was read from."""
    section = TreeSection(
        name=machine.name,
        tool=machine.tool,
        workpiece=machine.workpiece,
        monitored=machine.monitored,
        spindle=machine.spindle,
        reference_temperature=machine.reference_temperature,
        probe_noise=machine.probe_noise,
        axes={axis.letter: axis for axis in machine.axes},
        bodies=tuple(
            BodySection(
                body.name, body.parent, PoseSection(body.pose.shift, body.pose.rotation), body.location_error, body.axis
            )
            for body in machine.bodies
        ),
        errors={name: component_section(error) for name, error in machine.errors.items() if error != ErrorComponent()},
        limits=machine.limits,
        uncertainty=machine.uncertainty,
    )
    content: dict[str, Any] = write(section)
    return content


def component_section(component: ErrorComponent) -> ComponentSection:
    """An error component as a file states it."""
    table = component.table
    section = None if table is None else TableSection(table.positions, None, table.forward, table.backward)
    return ComponentSection(component.poly, component.harmonic, section)


def machine_path(path_or_name: Path | str) -> Path:
    """File of a machine that is given by its path, or by the name of one that ships.

    Raises:
        InputError: no machine of that name ships.
    """
    path = Path(path_or_name)
    if path.suffix or len(path.parts) > 1 or exists(path):
        return path
    known = sorted(file.stem for file in (share() / "config" / "machines").glob("*.yaml"))
    if path.name not in known:
        raise InputError(
            f"no machine '{excerpt(path_or_name)}'; give the path of a YAML file or one of {', '.join(known)}"
        )
    return config(f"machines/{path.name}.yaml")


def _description(section: MachineSection) -> MachineDescription:
    if isinstance(section, TreeSection):
        found = _from_tree(section)
    else:
        assert isinstance(section, ParameterSection)
        found = _from_parameters(section)
    errors = {
        name: ErrorComponent(row.poly, row.harmonic, None if row.table is None else row.table.described)
        for name, row in section.errors.items()
        if row != ComponentSection()
    }
    return replace(
        found,
        errors=errors,
        reference_temperature=section.reference_temperature,
        probe_noise=section.probe_noise,
        limits=section.limits,
        uncertainty=section.uncertainty,
        calibrated=dict(_calibrated(section)),
        pose_terms=_pose_terms(section, found.letters),
    )


def _pose_terms(section: MachineSection, letters: Sequence[str]) -> dict[str, float]:
    """Terms of the uncertainty by pose that an identification has left, of axes that the machine has."""
    whole = section.calibration.get(WHOLE_MACHINE)
    named = (
        {}
        if whole is None
        else {name.removeprefix(POSE_TERM): size for name, size in whole.figures.items() if name.startswith(POSE_TERM)}
    )
    return named if all(set(name) <= {*letters, "0"} for name in named) else {}


def _calibrated(section: MachineSection) -> Iterator[tuple[str, float]]:
    """Uncertainties that calibrations have left."""
    for name, part in section.calibration.items():
        if part.uncertainty is not None:
            # of an identification it is that of the tool's place, whatever part of the machine it replaced
            yield (WHOLE_MACHINE if VOLUMETRIC in part.figures else name), part.uncertainty
        if SHIFT_UNCERTAINTY in part.figures:
            yield f"{name}.shift", part.figures[SHIFT_UNCERTAINTY]


def _from_tree(section: TreeSection) -> MachineDescription:
    return MachineDescription(
        name=section.name,
        bodies=tuple(_body(row, section.axes) for row in section.bodies),
        axes=tuple(section.axes.values()),
        errors={},
        tool=section.tool,
        workpiece=section.workpiece,
        monitored=section.monitored,
        spindle=section.spindle,
    )


def _body(row: BodySection, axes: Mapping[str, Axis]) -> Body:
    pose = Displacement(row.pose.position, row.pose.rotation)
    return Body(row.name, row.parent, pose, row.whole_location_error(axes), row.axis)


def _from_parameters(section: ParameterSection) -> MachineDescription:
    """The TTTRR machine (Pan et al. 2013, Figure 5, bodies 1-9) with the parameters of a digital twin."""
    square = {"XY": 0.0, "XZ": 0.0, "YZ": 0.0, **section.squareness}
    orientation = {"C": (0.0, 0.0), "A": (0.0, 0.0), **section.orientation}
    along: dict[str, Vector] = {"X": (1.0, 0.0, 0.0), "Y": (0.0, 1.0, 0.0), "Z": (0.0, 0.0, 1.0)}
    about: dict[str, Vector] = {"C": (0.0, 0.0, 1.0), "A": (1.0, 0.0, 0.0)}
    linear = (
        Axis(letter, "linear", direction, section.travel[letter], section.expansion.get(letter, 0.0))
        for letter, direction in along.items()
    )
    rotary = (Axis(letter, "rotary", direction, section.travel[letter]) for letter, direction in about.items())
    bodies = (
        Body("workpiece", BASE),
        Body("gantry", BASE, axis="Y"),
        Body("carriage", "gantry", location_error=_turn(0.0, 0.0, -square["XY"]), axis="X"),
        Body("ram", "carriage", location_error=_turn(-square["YZ"], square["XZ"], 0.0), axis="Z"),
        Body("swivel_head", "ram", location_error=_turn(*orientation["C"], 0.0), axis="C"),
        Body(
            "rotary_head",
            "swivel_head",
            location_error=Displacement(section.pivot_offset, (0.0, *orientation["A"])),
            axis="A",
        ),
        Body("spindle", "rotary_head", Displacement((0.0, 0.0, -section.head_length))),
        Body("tool_holder", "spindle"),
        Body("tool", "tool_holder", Displacement((0.0, 0.0, -section.tool_length))),
    )
    return MachineDescription(
        "pan2013",
        bodies,
        (*linear, *rotary),
        {},
        tool="tool",
        workpiece="workpiece",
        monitored="C",
        spindle="spindle",
    )


def _turn(x: float, y: float, z: float) -> Displacement:
    return Displacement(rotation=(x, y, z))


def _named(items: Iterable[T], wanted: str, name: Callable[[T], str | None], kind: str) -> T:
    for item in items:
        if name(item) == wanted:
            return item
    raise InputError(f"no {kind} is called '{wanted}'; it has {', '.join(filter(None, map(name, items)))}")
