"""A machine as it is described: a tree of bodies, its axes, and their errors in the words of ISO 230-1."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, TypeVar

from rotary_error_monitor.description import schema
from rotary_error_monitor.description.machine_checks import BASE, contradictions
from rotary_error_monitor.description.machine_limits import FASTEST, QUICKEST, MachineLimits, limits_from_mapping
from rotary_error_monitor.errors import InputError, excerpt
from rotary_error_monitor.files import exists
from rotary_error_monitor.resources import config, share

Vector = tuple[float, float, float]
T = TypeVar("T")

ZERO: Vector = (0.0, 0.0, 0.0)
DIRECTIONS = "XYZABC"
"""Second letter of an error component: shift along x, y, z in m, then rotation about x, y, z in rad."""


@dataclass(frozen=True)
class Displacement:
    """Shift (m), then rotation by a rotation vector (rad): `p -> shift + Rot(rotation) p`."""

    shift: Vector = ZERO
    rotation: Vector = ZERO

    def plus(self, other: Displacement) -> Displacement:
        """Sum component by component: both as small errors, or one of them zero."""
        return Displacement(_sum(self.shift, other.shift), _sum(self.rotation, other.rotation))


@dataclass(frozen=True)
class Harmonic:
    """One wave of an error component: `cos * cos(order * q) + sin * sin(order * q)` in m or rad.

    `order` counts waves per revolution of a rotary axis; of a linear axis it is in rad/m, `2 pi / period`.
    """

    order: float
    cos: float
    sin: float


@dataclass(frozen=True)
class ErrorTable:
    """Error at rising axis `positions` for travel in `forward` (+) and `backward` (-) direction, linear between."""

    positions: tuple[float, ...]
    forward: tuple[float, ...]
    backward: tuple[float, ...]


@dataclass(frozen=True)
class ErrorComponent:
    """One error component of an axis: the sum of a polynomial, harmonics and a table.

    Attributes:
        poly: `c0 + c1*u + …`, with `u` the position scaled so that the travel is -1 … 1.
        harmonic: waves in the position.
        table: measured values.
    """

    poly: tuple[float, ...] = ()
    harmonic: tuple[Harmonic, ...] = ()
    table: ErrorTable | None = None


@dataclass(frozen=True)
class Axis:
    """One axis of motion.

    Attributes:
        letter: its name, such as X.
        kind: linear (positions in m) or rotary (rad).
        direction: unit vector along or about which it moves, in the frame of its body.
        travel: lowest and highest position.
        expansion: thermal expansion of its scale, 1/K: adds `expansion * dT * q` to its positioning error.
        reversal: width of its reversal error (ISO 230-2, B): half of it is missing in the direction of travel.
        speed, acceleration: fastest that it moves, m/s and m/s², or rad/s and rad/s²; none where the file states none.
    """

    letter: str
    kind: Literal["linear", "rotary"]
    direction: Vector
    travel: tuple[float, float]
    expansion: float = 0.0
    reversal: float = 0.0
    speed: float | None = None
    acceleration: float | None = None

    @property
    def fastest(self) -> float:
        """Speed that it does not exceed, as stated or else as the fastest machines reach, m/s or rad/s."""
        return FASTEST[self.kind] if self.speed is None else self.speed

    @property
    def quickest(self) -> float:
        """Acceleration that it does not exceed, m/s² or rad/s²."""
        return QUICKEST[self.kind] if self.acceleration is None else self.acceleration


@dataclass(frozen=True)
class Body:
    """One body of the tree.

    Attributes:
        name: its name.
        parent: name of the body that carries it, `base` for the base.
        pose: where it stands on its parent at axis position zero (Tp of Pan et al. 2013, Equation 9).
        location_error: how it stands otherwise than that (ΔTp), squareness errors included.
        axis: letter of the axis that moves it; none for a fixed body.
    """

    name: str
    parent: str
    pose: Displacement = Displacement()
    location_error: Displacement = Displacement()
    axis: str | None = None


@dataclass(frozen=True)
class MachineDescription:
    """All that is known of a machine: the section `machine` of a file in `config/machines/` or of a digital twin.

    Attributes:
        bodies: a parent before its children; the base is not listed.
        axes: in the order in which positions are given as columns.
        errors: components by name: E, direction (X Y Z shifts, A B C rotations), letter of the axis.
        tool: name of the body whose origin is the tool tip and whose z axis is the tool axis.
        workpiece: name of the body in whose frame offsets are told.
        monitored: letter of the rotary axis whose six error components are measured live; none for a table only.
        limits: of its temperature.
        uncertainty: standard uncertainty of parameters by dotted name, as in the file; empty for an exact description.
    """

    name: str
    bodies: tuple[Body, ...]
    axes: tuple[Axis, ...]
    errors: Mapping[str, ErrorComponent]
    tool: str
    workpiece: str
    monitored: str | None = None
    reference_temperature: float = 20.0
    limits: MachineLimits = field(default_factory=MachineLimits)
    uncertainty: Mapping[str, float] = field(default_factory=dict)

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
    path = machine_path(path_or_name)
    section = schema.load(path, "machine")["machine"]
    for place, problem in contradictions(section):
        raise InputError(f"{schema.locate(path, ['machine', *place])}: {problem}")
    return machine_from_mapping(section)


def machine_from_mapping(section: Mapping[str, Any]) -> MachineDescription:
    """Machine from the content of a `machine` section that is valid by the schema."""
    return _from_tree(section) if "bodies" in section else _from_parameters(section)


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


def _from_tree(section: Mapping[str, Any]) -> MachineDescription:
    axes = {
        letter: Axis(
            letter,
            row["kind"],
            _vector(row["direction"]),
            _pair(row["travel"]),
            float(row.get("expansion", 0.0)),
            float(row.get("reversal", 0.0)),
            _optional(row, "speed"),
            _optional(row, "acceleration"),
        )
        for letter, row in section["axes"].items()
    }
    return MachineDescription(
        name=section["name"],
        bodies=tuple(_body(row, axes) for row in section["bodies"]),
        axes=tuple(axes.values()),
        errors=_errors(section),
        tool=section["tool"],
        workpiece=section["workpiece"],
        monitored=section.get("monitored"),
        reference_temperature=float(section.get("reference_temperature", 20.0)),
        limits=limits_from_mapping(section.get("limits", {})),
        uncertainty=_uncertainty(section),
    )


def _body(row: Mapping[str, Any], axes: Mapping[str, Axis]) -> Body:
    pose, error = row.get("pose", {}), row.get("location_error", {})
    location_error = Displacement(_vector(error.get("shift", ZERO)), _vector(error.get("rotation", ZERO)))
    for letter, angle in row.get("squareness", {}).items():
        # Turning this axis about the common normal by +a brings it nearer to the other, so the angle shrinks by a.
        normal = _cross(axes[row["axis"]].direction, axes[letter].direction)
        rotation = (-angle * normal[0], -angle * normal[1], -angle * normal[2])
        location_error = location_error.plus(Displacement(rotation=rotation))
    return Body(
        name=row["name"],
        parent=row["parent"],
        pose=Displacement(_vector(pose.get("position", ZERO)), _vector(pose.get("rotation", ZERO))),
        location_error=location_error,
        axis=row.get("axis"),
    )


def _from_parameters(section: Mapping[str, Any]) -> MachineDescription:
    """The TTTRR machine (Pan et al. 2013, Figure 5, bodies 1-9) with the parameters of a digital twin."""
    square = {"XY": 0.0, "XZ": 0.0, "YZ": 0.0, **section.get("squareness", {})}
    orientation = {"C": (0.0, 0.0), "A": (0.0, 0.0), **section.get("orientation", {})}
    tilt_c, tilt_a = _pair(orientation["C"]), _pair(orientation["A"])
    expansion, travel = section.get("expansion", {}), section["travel"]
    along: dict[str, Vector] = {"X": (1.0, 0.0, 0.0), "Y": (0.0, 1.0, 0.0), "Z": (0.0, 0.0, 1.0)}
    about: dict[str, Vector] = {"C": (0.0, 0.0, 1.0), "A": (1.0, 0.0, 0.0)}
    linear = (
        Axis(letter, "linear", direction, _pair(travel[letter]), float(expansion.get(letter, 0.0)))
        for letter, direction in along.items()
    )
    rotary = (Axis(letter, "rotary", direction, _pair(travel[letter])) for letter, direction in about.items())
    bodies = (
        Body("workpiece", BASE),
        Body("gantry", BASE, axis="Y"),
        Body("carriage", "gantry", location_error=_turn(0.0, 0.0, -square["XY"]), axis="X"),
        Body("ram", "carriage", location_error=_turn(-square["YZ"], square["XZ"], 0.0), axis="Z"),
        Body("swivel_head", "ram", location_error=_turn(*tilt_c, 0.0), axis="C"),
        Body(
            "rotary_head",
            "swivel_head",
            location_error=Displacement(_vector(section.get("pivot_offset", ZERO)), (0.0, *tilt_a)),
            axis="A",
        ),
        Body("spindle", "rotary_head", Displacement((0.0, 0.0, -float(section["head_length"])))),
        Body("tool_holder", "spindle"),
        Body("tool", "tool_holder", Displacement((0.0, 0.0, -float(section["tool_length"])))),
    )
    return MachineDescription(
        name="pan2013",
        bodies=bodies,
        axes=(*linear, *rotary),
        errors=_errors(section),
        tool="tool",
        workpiece="workpiece",
        monitored="C",
        reference_temperature=float(section.get("reference_temperature", 20.0)),
        limits=limits_from_mapping(section.get("limits", {})),
        uncertainty=_uncertainty(section),
    )


def _turn(x: float, y: float, z: float) -> Displacement:
    return Displacement(rotation=(float(x), float(y), float(z)))


def _errors(section: Mapping[str, Any]) -> dict[str, ErrorComponent]:
    return {name: _component(row) for name, row in section.get("errors", {}).items()}


def _component(row: Mapping[str, Any]) -> ErrorComponent:
    table = row.get("table")
    return ErrorComponent(
        poly=_numbers(row.get("poly", ())),
        harmonic=tuple(
            Harmonic(float(wave["order"]), float(wave["cos"]), float(wave["sin"])) for wave in row.get("harmonic", ())
        ),
        table=None
        if table is None
        else ErrorTable(
            _numbers(table["positions"]),
            _numbers(table.get("forward", table.get("values"))),
            _numbers(table.get("backward", table.get("values"))),
        ),
    )


def _uncertainty(section: Mapping[str, Any]) -> dict[str, float]:
    return {name: float(value) for name, value in section.get("uncertainty", {}).items()}


def _named(items: Iterable[T], wanted: str, name: Callable[[T], str | None], kind: str) -> T:
    for item in items:
        if name(item) == wanted:
            return item
    raise InputError(f"no {kind} is called '{wanted}'; it has {', '.join(filter(None, map(name, items)))}")


def _numbers(values: Iterable[float]) -> tuple[float, ...]:
    return tuple(float(value) for value in values)


def _optional(row: Mapping[str, Any], name: str) -> float | None:
    return float(row[name]) if name in row else None


def _pair(values: Iterable[float]) -> tuple[float, float]:
    first, second = values
    return float(first), float(second)


def _vector(values: Iterable[float]) -> Vector:
    x, y, z = values
    return float(x), float(y), float(z)


def _sum(a: Vector, b: Vector) -> Vector:
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


def _cross(a: Vector, b: Vector) -> Vector:
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
