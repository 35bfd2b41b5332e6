"""What the section `stage` of a file states: ring, mirror, autocollimator, spindle, reference, further sensors, limits.

Where a file has it otherwise than `StageDescription`, the part for a file is derived from that in the description and
ends in `Section`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Annotated, Any, Literal

from rotary_error_monitor.description.expected import Expected, Stated, entries
from rotary_error_monitor.description.harmonics import PlaneWaves, Waves
from rotary_error_monitor.description.listed_sensors import listed_sensor
from rotary_error_monitor.description.periodic_tables import AngularTable, PlanarTable
from rotary_error_monitor.description.provenance import Calibrated
from rotary_error_monitor.description.quantities import (
    Angle,
    DisplacementPair,
    Latency,
    Noise,
    NotNegative,
    Short,
    Temperature,
    TiltPair,
)
from rotary_error_monitor.description.response import Response
from rotary_error_monitor.description.sections import Place, Section, WrongError, check_names, stated
from rotary_error_monitor.description.sensor_places import heads_at_one_place, sensors_at_one_place
from rotary_error_monitor.description.sensor_section import (
    OWN_KINDS,
    PLACE_TEMPERATURE,
    READ_HEAD,
    SensorSection,
    check_unit,
    listed_kinds,
)
from rotary_error_monitor.description.shaft_force import force_contradictions
from rotary_error_monitor.description.spindle_section import Spindle
from rotary_error_monitor.description.stage_limits import StageLimits
from rotary_error_monitor.description.targets import Target, target_contradictions
from rotary_error_monitor.description.two_axis_section import (
    DISTORTIONS,
    RESPONSES,
    Autocollimator,
    AutocollimatorSection,
    RadialReference,
    RadialReferenceSection,
    folded,
)

MOST_STREAMS = 51
"""Heads and listed sensors but inputs: with autocollimator and command as many bits as a float64, in which masks
travel, holds."""

Count = Annotated[int, Expected("a whole number from 1", 1, 100_000_000)]


@dataclass(frozen=True)
class Encoder:
    """Graduated ring and its read heads.

    Attributes:
        noise: standard deviation of a reading before rounding, rad.
        azimuths: azimuth of each head by its letter, rad about +z.
        eccentricity: ring centre in the rotor's frame (x, y), m.
        graduation: orders of the graduation error.
        graduation_table: that error as a curve over the ring, of which `graduation` is what comes on top.
    """

    disc_radius: Annotated[float, Expected("radius of the graduated ring in m, from 1 mm to 10 m", 0.001, 10)]
    lines_per_revolution: Annotated[Count, Expected("a whole number of graduation lines")]
    counts_per_line: Annotated[Count, Expected("a whole number of counts per line")]
    noise: Annotated[Noise, Expected("standard deviation of one reading in rad, at most 1 mrad")]
    azimuths: Mapping[str, float]
    eccentricity: DisplacementPair = (0.0, 0.0)
    graduation: Annotated[Waves, Expected("at most 500 rows {order, cos, sin} in rad")] = ()
    graduation_table: Annotated[
        AngularTable | None,
        Expected("a curve over the ring: {file: NAME.csv} or {angles, values, uncertainties} in rad"),
    ] = None

    @property
    def resolution(self) -> float:
        """Size of one count, rad."""
        return 2 * math.pi / (self.lines_per_revolution * self.counts_per_line)


@dataclass(frozen=True)
class Mirror:
    """Mirror on the rotor: tilt (x, y) that turns with it, and the flatness seen over a turn, rad.

    Attributes:
        flatness_table: what is seen over a turn as a curve, of which `flatness` is what comes on top.
    """

    tilt: TiltPair = (0.0, 0.0)
    flatness: Annotated[PlaneWaves, Expected("at most 500 rows {order, x: [cos, sin], y: [cos, sin]} in rad")] = ()
    flatness_table: Annotated[
        PlanarTable | None,
        Expected("a curve over the rotation: {file: NAME.csv} or {angles, x, y, uncertainties} in rad"),
    ] = None


Sign = Literal[1, -1]


@dataclass(frozen=True, kw_only=True)
class AngleSection:
    """How an angle is counted and stamped; what is left out has the default of `Response`."""

    zero: Annotated[
        Angle | None, Expected("reading at rotation 0 of a perfect stage in rad; whole turns do not count")
    ] = None
    sign: Annotated[Sign | None, Expected("1, or -1 for a head that counts the other way")] = None
    latency: Latency | None = None

    @property
    def response(self) -> Response:
        """Of an instrument that reads the angle."""
        return Response((self.zero or 0.0,), float(self.sign or 1), latency=self.latency or 0.0)


@dataclass(frozen=True, kw_only=True)
class Head(AngleSection):
    """A read head."""

    azimuth: Annotated[Angle, Expected("angle of the head about +z in rad")]


@dataclass(frozen=True, kw_only=True)
class CommandSection(AngleSection):
    """How the controller tells the command."""

    zero: Annotated[Angle | None, Expected("command at rotation 0 in rad; whole turns do not count")] = None
    sign: Annotated[Sign | None, Expected("1, or -1 for a controller that counts the other way")] = None
    gain: Annotated[
        float | None,
        Expected("angle that is told per rotation, such as the ratio of a gear before the stage", 1e-6, 1e6),
    ] = None

    @property
    def response(self) -> Response:
        """Of an angle and its speed, which has sign and gain, but no zero."""
        of_angle = super().response
        gain = 1.0 if self.gain is None else self.gain
        return replace(of_angle, zero=(*of_angle.zero, 0.0), gain=of_angle.gain * gain)


@dataclass(frozen=True, kw_only=True)
class EncoderSection(Encoder):
    """The encoder with heads that answer each in its own way."""

    azimuths: Mapping[str, float] = field(init=False)
    heads: Annotated[
        Mapping[Short, Head], Expected("read heads by their letter, from 1 to 51", count=(1, MOST_STREAMS))
    ]

    def __post_init__(self) -> None:
        """Azimuths are those of the heads."""
        object.__setattr__(self, "azimuths", {letter: head.azimuth for letter, head in self.heads.items()})


@dataclass(frozen=True)
class Environment:
    """Where the stage stands, and what acts on it."""

    reference_temperature: Temperature
    force: Annotated[
        tuple[Short, ...] | None,
        Expected("names of the sensors of kind force that show the force on the shaft", count=(1, 4), unique=True),
    ] = None


@dataclass(frozen=True, kw_only=True)
class Calibrations(Section):
    """Where ring, mirror and the answers of the autocollimator are from."""

    is_open = True
    encoder: Calibrated | None = None
    mirror: Calibrated | None = None
    autocollimator: Calibrated | None = None


Uncertain = Annotated[
    str,
    Expected(
        pattern=r"^(encoder|mirror|autocollimator|spindle|lvdt|command|environment|sensors\.[a-z][a-z0-9]*)\.[a-z_]+$"
    ),
]


def own_places(listed: object) -> dict[Place, Place]:
    """Where a file's list `sensors` has what has a section of its own, by the place in that section.

    Raises:
        WrongError: the list has more than one autocollimator, reference or command.
    """
    found: dict[Place, Place] = {}
    for name, row in listed.items() if isinstance(listed, Mapping) else ():
        kind = row.get("kind") if isinstance(row, Mapping) else None
        if not isinstance(kind, str) or kind not in OWN_KINDS:
            continue
        place = (*OWN_KINDS[kind], name) if kind == READ_HEAD else OWN_KINDS[kind]
        if place in found:
            further = [name for name, each in listed_kinds().items() if each.further == kind]
            more = f"a further one is of kind {' or '.join(further)}" if further else "a stage has one at most"
            raise WrongError(("sensors", name), f"'{found[place][1]}' is of kind {kind} already; {more}")
        found[place] = ("sensors", name)
    return found


_OWN_SECTIONS = dict(zip(OWN_KINDS, (Head, AutocollimatorSection, RadialReferenceSection, CommandSection), strict=True))


def _own_row(row: Mapping[str, Any], place: Place) -> dict[str, Any]:
    """What a file lists of a head, autocollimator, reference or command at a place, as the section of its own has it.

    Raises:
        WrongError: its unit is another one, or it states what that section does not have.
    """
    try:
        check_unit(row)
    except WrongError as error:
        raise error.at((*place, *error.place)) from None
    known = ("kind", "unit", *_names(_OWN_SECTIONS[row["kind"]]))
    check_names(row, known, place, f"of kind {row['kind']}: {', '.join(known)}")
    return {name: value for name, value in row.items() if name not in ("kind", "unit")}


@dataclass(frozen=True, kw_only=True)
class StageSection(Section):
    """The section `stage`."""

    encoder: EncoderSection | None = None
    mirror: Mirror = field(default_factory=Mirror)
    autocollimator: AutocollimatorSection | None = None
    spindle: Spindle = field(default_factory=Spindle)
    lvdt: RadialReferenceSection | None = None
    sensors: Annotated[
        Mapping[Short, SensorSection],
        Expected("further sensors by name: {kind, noise, resolution, range, uncertainty, …}", count=(0, 40)),
    ] = field(default_factory=dict)
    targets: Annotated[
        Mapping[Short, Target], Expected("targets by name, each seen by some of the sensors: {form}", count=(0, 40))
    ] = field(default_factory=dict)
    environment: Environment | None = None
    limits: Annotated[
        Mapping[str, float], Expected("what the stage can do at most; what is left out is derived"), Stated(StageLimits)
    ] = field(default_factory=dict)
    command: CommandSection = CommandSection()
    uncertainty: Annotated[
        Mapping[Uncertain, NotNegative],
        Expected(
            "standard uncertainty of parameters by name, such as encoder.eccentricity: 5.0e-08, sensors.top.gain: "
            "0.01 or sensors.top.zero, beside which that of the sensor is of its form alone; of stamps in s: "
            "encoder.timing (of heads against one another) and command.timing, 2.0e-06 each unless stated, "
            "autocollimator.timing and sensors.top.timing; environment.thermometer, of its zero in K, unless stated "
            "that of class B of IEC 60751, and environment.thermometer_timing, of how far it is behind the stage in "
            "s, 5.0 each unless stated, as sensors.bearing.timing of a listed one; environment.load_cell, of its zero "
            "in N, environment.load_cell_gain and environment.load_cell_timing, of the force on the shaft in parts of "
            "it and of its stamps in s, unless stated up to 1 % of the rated output, and a sample"
        ),
    ] = field(default_factory=dict)
    calibration: Annotated[
        Calibrations,
        Expected("where ring (encoder) and mirror come from: {date, source, sha256, uncertainty, figures, history}"),
    ] = Calibrations()

    @classmethod
    def arranged(cls, content: Mapping[str, Any]) -> tuple[Mapping[str, Any], Mapping[Place, Place]]:
        """Heads, autocollimator, reference and command in sections of their own, also those that the file lists."""
        moved = own_places(content.get("sensors"))
        if not moved:
            return content, moved
        own = {stands[1] for stands in moved.values()}
        arranged: dict[str, Any] = {
            **content,
            "sensors": {name: row for name, row in content["sensors"].items() if name not in own},
        }
        for place, stands in moved.items():
            row = _own_row(content["sensors"][stands[1]], stands)
            above, (*outer, name) = arranged, map(str, place)
            for step in outer:
                above[step] = dict(above.get(step) or {})
                above = above[step]
            if name in above:
                raise WrongError(stands, f"there is one in '{'.'.join((*outer, name))}' already; keep one of both")
            above[name] = row
        return arranged, moved

    def contradictions(self) -> Iterator[tuple[Place, str]]:
        """Whether the parts fit one another."""
        return _contradictions(self)


def angle_rows(response: Response) -> dict[str, Any]:
    """Fields of `AngleSection`; none of an ideal response."""
    if response.is_ideal:
        return {}
    zero, sign = response.zero[0], round(math.copysign(1.0, response.gain))
    return {"zero": zero, "sign": sign, "latency": response.latency}


def command_rows(response: Response) -> dict[str, Any]:
    """Fields of `CommandSection`; none of an ideal response."""
    gain = abs(response.gain)
    return angle_rows(response) | ({} if gain == 1.0 else {"gain": gain})


def _names(part: type[Any], *more: str, without: Sequence[str] = ()) -> tuple[str, ...]:
    return (*(each.name for each in entries(part) if each.name not in without), *more)


PARAMETERS: Mapping[str, tuple[str, ...]] = {
    "encoder": _names(Encoder, "azimuth", "timing", without=("azimuths", "graduation_table")),
    "mirror": _names(Mirror, without=("flatness_table",)),
    "autocollimator": _names(Autocollimator, *RESPONSES, *DISTORTIONS, "timing", without=("turbulence",)),
    "spindle": _names(Spindle),
    "lvdt": _names(RadialReference, *RESPONSES),
    "command": ("timing",),
    "environment": ("thermometer", "thermometer_timing", "load_cell", "load_cell_gain", "load_cell_timing"),
}
"""What the section `uncertainty` may name of each section, whether a stage has that section or not.

A measured curve states its uncertainty itself, at each angle.
"""


def _contradictions(section: StageSection) -> Iterator[tuple[Place, str]]:
    """Where a section contradicts itself, and what would be right."""
    heads = {} if section.encoder is None else section.encoder.heads
    poses = [name for name, sensor in section.sensors.items() if not sensor.is_input]
    if not (heads or poses or section.autocollimator):
        yield (), "nothing measures the rotor; expected a section 'encoder', 'autocollimator' or 'sensors'"
    if len(heads) + len(poses) > MOST_STREAMS:
        yield (
            ("sensors",),
            f"{len(poses)} sensors beside {len(heads)} heads; a mask of streams has place for {MOST_STREAMS} of both",
        )
    radius = 0.0 if section.encoder is None else section.encoder.disc_radius
    yield from ((("encoder", *place), told) for place, told in heads_at_one_place(heads, radius))
    yield from ((("sensors", *place), told) for place, told in sensors_at_one_place(section.sensors))
    yield from target_contradictions(section.sensors, section.targets)
    for name, sensor in section.sensors.items():
        read = listed_sensor(sensor)
        for limit, values in (("noise", (read.noise,)), ("resolution", (read.resolution,)), ("zero", read.zeros)):
            if max(map(abs, values)) >= read.range:
                said = values[0] if len(values) == 1 else list(values)
                yield ("sensors", name, limit), f"{said} is beyond the range of {read.range} {read.unit}"
    if section.autocollimator is not None:
        yield from folded(section.autocollimator)
    named = () if section.environment is None else section.environment.force or ()
    yield from force_contradictions(section.sensors, named)
    yield from _unknown(section)


def _unknown(section: StageSection) -> Iterator[tuple[Place, str]]:
    """What `uncertainty` and `calibration` name and the stage does not have."""
    named = {"uncertainty": tuple(section.uncertainty), "calibration": tuple(stated(section.calibration))}
    for part, names in named.items():
        for name in names:
            if section.encoder is None and name.partition(".")[0] == "encoder":
                yield (part, name), "the stage has no section 'encoder'; expected that section, or nothing about it"
    for name in section.uncertainty:
        part, _, parameter = name.rpartition(".")
        known = _parameters(section, part)
        if not known:
            listed = [place for place in map("sensors.{}".format, section.sensors) if _parameters(section, place)]
            yield (
                ("uncertainty", name),
                f"there is no part '{part}'; expected one of {', '.join([*PARAMETERS, *listed])}",
            )
        elif parameter not in known:
            yield ("uncertainty", name), f"{part} has no '{parameter}'; expected one of {', '.join(known)}"


def _parameters(section: StageSection, part: str) -> tuple[str, ...]:
    """What may be uncertain of one part of a stage; nothing where there is no such part."""
    head, _, listed = part.partition(".")
    if head != "sensors":
        return PARAMETERS.get(part, ())
    sensor = section.sensors.get(listed)
    if sensor is None:
        return ()
    if sensor.is_input:
        return ("timing",) if sensor.measures == PLACE_TEMPERATURE else ()
    return ("gain", *listed_sensor(sensor).place, "zero", "timing")
