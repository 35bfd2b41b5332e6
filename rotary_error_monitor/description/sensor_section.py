"""What a stage's file says of one sensor of its list: what all kinds share.

Each kind is a file of `sensor_kinds/`, or an entry point of another package.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from types import MappingProxyType
from typing import Annotated, Any, ClassVar

import rotary_error_monitor.description.sensor_kinds as folder
from rotary_error_monitor.description.definition_files import own_columns
from rotary_error_monitor.description.expected import Expected
from rotary_error_monitor.description.harmonics import Waves
from rotary_error_monitor.description.quantities import Latency, Noise, Range, Reading, Resolution, Short
from rotary_error_monitor.description.sections import Place, Section, WrongError
from rotary_error_monitor.description.streams import AUTOCOLLIMATOR, COMMAND, OWN_REFERENCE, TWO_AXIS
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.plugins import classes_in, modules_in, plugged_classes

ENTRY_POINTS = "rotary_error_monitor.sensor_sections"
"""Group of the sections of kinds of sensors of other packages: the name of an entry point is that of the kind."""

READ_HEAD = "read_head"
OWN_KINDS = {READ_HEAD: ("encoder", "heads"), **{name: (name,) for name in (*TWO_AXIS, COMMAND)}}
"""Section of a stage's file for kinds that a file may list as well; heads stand there by their names."""

_OWN_STREAMS = ("head", *OWN_KINDS, "temperature", "error_motion")
"""First words of streams that are of no listed kind, or that a file may list under a name of its own."""

POSE_UNITS = ("m", "rad")
"""Units of what shows how the rotor stands."""

_OWN_UNITS = {READ_HEAD: "rad", AUTOCOLLIMATOR: "rad", OWN_REFERENCE: "m", COMMAND: "rad"}

_PROBE = "axial_probe"
"""Kind whose samples are like those of any displacement probe."""

SHAFT_FORCE = "force on the shaft"
PLACE_TEMPERATURE = "temperature of a place"

PROBE_WIDTH = 3e-3
"""Width, m, below which hardly a displacement probe has its body: the smallest capacitive and eddy current probes.
Inductive ones and most others are 8 mm and more, but a file does not say of which make its probes are."""

LARGEST_ARTEFACT = 1.0
"""Radius, m, that no artefact exceeds before which radial probes stand: a file does not state its own."""

Uncertainty = Annotated[float, Expected("standard uncertainty of zero and form in m or rad", 1e-10, 0.001)]


def check_unit(row: Mapping[str, Any]) -> None:
    """Hold the unit that a row of the list states, if it does, against that of its kind.

    Samples travel in SI units: the node of a driver that tells others turns them into these.

    Raises:
        WrongError: it is another one.
    """
    kind, unit = row["kind"], row.get("unit")
    known = _OWN_UNITS.get(kind) or listed_kinds()[kind].unit
    if "unit" in row and unit != known:
        driver = "where a driver tells another one, the parameters of its node say so"
        raise WrongError(("unit",), f"{unit!r} is no unit of kind {kind}", f"{known}; {driver}", unit)


@dataclass(frozen=True, kw_only=True)
class SensorSection(Section):
    """A sensor of the list. What a kind states beside this base are numbers of its place, with `zero`, `gain`, `form`.

    What may be left out is None: its default is that of `ListedSensor` and `Response`.

    Attributes:
        fields: of a sample; without any it has that of displacement probes.
        unit: SI unit of the fields, or °C.
        is_input: whether the kind measures what acts on the stage, and nothing of how the rotor stands.
        is_slow: whether it samples about once a second, as thermometers do.
        or_else: what a file may state, beside another place, of two of the kind that are no contradiction at one place.
        further: section of a stage's file with the first sensor of a sort, of which this kind has further ones.
        measures: what an input measures for the twin: `SHAFT_FORCE`, `PLACE_TEMPERATURE`, or something else, which
            effects of its own find in `RotorState.inputs`.
        kind: of sensor: name of its file in `sensor_kinds/`, or of the entry point of another package.
    """

    fields: ClassVar[tuple[str, ...]] = ()
    unit: ClassVar[str] = "m"
    is_input: ClassVar[bool] = False
    is_slow: ClassVar[bool] = False
    measures: ClassVar[str] = ""
    or_else: ClassVar[str] = ""
    further: ClassVar[str] = ""
    beside = ("unit",)

    kind: str
    noise: Annotated[Noise, Expected("standard deviation of one reading in m")]
    resolution: Annotated[Resolution, Expected("step of a reading in m")]
    range: Annotated[Range, Expected("half of the measuring range in m")]
    uncertainty: Annotated[Uncertainty, Expected("standard uncertainty of zero and form in m, 0.1 nm or more")]
    latency: Latency | None = None

    @property
    def body(self) -> tuple[float, float, float] | None:
        """A point of the sensor, m: two of the kind with these nearer than `PROBE_WIDTH` would be one in the other.

        None of a kind of which any number may be at one place, as of thermometers, or before one mirror.
        """
        return None

    def __init_subclass__(cls) -> None:
        """Call a kind by its file."""
        cls.names_as = f"of kind {cls.__module__.rpartition('.')[2]}:"

    @classmethod
    def sample_fields(cls) -> tuple[str, ...]:
        """Fields of a sample: its own, or that of displacement probes."""
        return cls.fields or own_columns(_PROBE)

    @classmethod
    def arranged(cls, content: Mapping[str, Any]) -> tuple[Mapping[str, Any], Mapping[Place, Place]]:
        """Without the unit, which is that of the kind."""
        check_unit(content)
        return {name: value for name, value in content.items() if name not in cls.beside}, {}

    @classmethod
    def variant(cls, content: Mapping[str, Any]) -> type[Any]:
        """The kind that the content says: without it nothing else of a sensor can be judged."""
        known, found = ", ".join((*OWN_KINDS, *listed_kinds())), content.get("kind")
        if found is None:
            raise WrongError((), "'kind' is a required property", f"one of {known}")
        if not isinstance(found, str) or found not in listed_kinds():
            raise WrongError(("kind",), f"{found!r} is no kind of sensor", f"one of {known}", found)
        return listed_kinds()[found]


@dataclass(frozen=True, kw_only=True)
class ProbeSection(SensorSection):
    """What displacement probes share."""

    zero: Annotated[Reading | None, Expected("reading of a perfect axis in m")] = None
    gain: Annotated[
        float | None,
        Expected(
            "reading per displacement, at least 1.0e-06 in size; negative for a sensor that counts the other way",
            -1000,
            1000,
            size=1e-6,
        ),
    ] = None
    form: Annotated[
        Waves | None, Expected("what the target shows of itself over a turn: at most 500 rows {order, cos, sin} in m")
    ] = None
    target: Annotated[Short | None, Expected("name of one of the 'targets', whose form it sees")] = None

    @property
    def track(self) -> tuple[float, ...]:
        """Where it sees its target, but for the azimuth: what probes of one target have in common."""
        return ()


@cache
def listed_kinds() -> Mapping[str, type[SensorSection]]:
    """The kinds of listed sensors by name: one class in one file of `sensor_kinds/` each, then those of other packages.

    Raises:
        InputError: what another package registers cannot be a kind.
    """
    own = (kind for module in modules_in(folder) for kind in classes_in(module, SensorSection))
    found: dict[str, type[SensorSection]] = {kind.__module__.rpartition(".")[2]: kind for kind in own}
    for name, kind, origin in plugged_classes(ENTRY_POINTS, SensorSection):
        _check_plugged(name, kind, origin, (*found, *_OWN_STREAMS))
        kind.names_as = f"of kind {name}:"
        found[name] = kind
    return MappingProxyType(found)


def _check_plugged(name: str, kind: type[SensorSection], origin: str, known: Iterable[str]) -> None:
    """Hold the kind of another package against what a kind has to be.

    Raises:
        InputError: its name makes no topic, or streams that could be of another kind; the class is no section of a
            sensor.
    """
    if not re.fullmatch(r"[a-z][a-z0-9]*(_[a-z0-9]+)*", name):
        raise InputError(f"{origin}: '{name}' makes no topic name; expected small letters, digits and '_' between them")
    for other in known:
        if f"{name}_".startswith(f"{other}_") or f"{other}_".startswith(f"{name}_"):
            raise InputError(
                f"{origin}: the topics of kind '{name}' cannot be told from those of '{other}'; choose another name"
            )
    if "__dataclass_params__" not in vars(kind):
        raise InputError(f"{origin}: {kind.__name__} is no dataclass; expected @dataclass(frozen=True, kw_only=True)")
    if not kind.is_input and kind.unit not in POSE_UNITS:
        raise InputError(
            f"{origin}: unit {kind.unit!r} of kind '{name}'; expected m or rad, or is_input = True of a sensor that "
            "shows nothing of how the rotor stands"
        )
