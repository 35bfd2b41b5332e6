"""The rotary stage as it is described: ring and read heads, mirror and autocollimator, spindle, further sensors."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from rotary_error_monitor.description.listed_sensors import (
    ListedSensor,
    listed_sensors,
    name_of,
    sensors_section,
    stream_of_sensor,
)
from rotary_error_monitor.description.periodic_tables import PeriodicTable
from rotary_error_monitor.description.quantities import REFERENCE_TEMPERATURE
from rotary_error_monitor.description.response import IDEAL, Response
from rotary_error_monitor.description.sections import extended, narrowed, read, write
from rotary_error_monitor.description.sensor_section import PLACE_TEMPERATURE, SHAFT_FORCE
from rotary_error_monitor.description.spindle_section import Spindle
from rotary_error_monitor.description.stage_limits import StageLimits, derive_limits
from rotary_error_monitor.description.stage_section import (
    CommandSection,
    Encoder,
    EncoderSection,
    Environment,
    Head,
    Mirror,
    StageSection,
    angle_rows,
    command_rows,
)
from rotary_error_monitor.description.streams import AUTOCOLLIMATOR, OWN_REFERENCE, TWO_AXIS
from rotary_error_monitor.description.table_files import with_tables
from rotary_error_monitor.description.targets import before_targets, shared_targets
from rotary_error_monitor.description.two_axis_section import (
    DISTORTIONS,
    RESPONSES,
    Autocollimator,
    AutocollimatorSection,
    RadialReference,
    RadialReferenceSection,
    two_axis_rows,
)
from rotary_error_monitor.description.yaml_files import read_yaml
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.resources import config

TIMING = 2e-6
"""Standard uncertainty of the stamps of one stream against another, s, where the description states none: each of both
set to within a microsecond, as by a fieldbus or PTP, and jittering by as much."""

OWN_THERMOMETER = "environment.thermometer"
"""Where the section `uncertainty` states that of the zero of the stage's own thermometer, K, and with `_timing` behind
it that of how far it is behind the stage, s."""

OWN_LOAD_CELL = "environment.load_cell"
"""Where it states that of the zero of the stage's own load cell, N; with `_gain` behind it that of the force on the
shaft, parts of it, and with `_timing` that of when it is read, s."""

TIMINGS = ("encoder.timing", "command.timing")
"""Where the section `uncertainty` states it: of the heads against one another, of the command against the heads."""


@dataclass(frozen=True)
class StageDescription:
    """All that is known of a stage: the section `stage` of `config/stage.yaml` or of a digital twin.

    Attributes:
        encoder: that measures the rotation; a stage without one turns as commanded, as far as is known.
        autocollimator: that measures the tilt; a stage without one has tilt error motion as described.
        lvdt: that measures the radial error motion at a height, to compare with: the stage's own reference.
        sensors: further ones that show how the rotor stands, by the name of their stream, such as `axial_probe_top`.
        stated_limits: limits by name, as in the file; empty where it states none.
        uncertainty: standard uncertainty of parameters by dotted name, as in the file or its calibration, such as
            `encoder.eccentricity` or `sensors.top.gain`. A twin is exact in what is not named; live, eccentricity and
            tilt of the mirror are then as uncertain as the stage shows them.
        responses: of instruments by stream, such as `head_a`; one that is not named reads what the package means.
        inputs: further sensors that measure what acts on the stage, by the name of their stream, such as
            `thermometer_bearing`.
        force: names of the listed forces that the file names as those on the shaft; empty where it names none.
    """

    encoder: Encoder | None = None
    autocollimator: Autocollimator | None = None
    mirror: Mirror = field(default_factory=Mirror)
    spindle: Spindle = field(default_factory=Spindle)
    lvdt: RadialReference | None = None
    sensors: Mapping[str, ListedSensor] = field(default_factory=dict)
    reference_temperature: float = REFERENCE_TEMPERATURE
    stated_limits: Mapping[str, float] = field(default_factory=dict)
    uncertainty: Mapping[str, float] = field(default_factory=dict)
    responses: Mapping[str, Response] = field(default_factory=dict)
    inputs: Mapping[str, ListedSensor] = field(default_factory=dict)
    force: tuple[str, ...] = ()

    @property
    def listed(self) -> Mapping[str, ListedSensor]:
        """All that the file lists under `sensors`, by the name of their stream."""
        both = {**self.sensors, **self.inputs}
        return {stream: both[stream] for stream in sorted(both)}

    @property
    def thermometers(self) -> Mapping[str, str]:
        """Streams of the listed thermometers by their names, which are those of their places."""
        return {name_of(s, sensor): s for s, sensor in self.inputs.items() if sensor.measures == PLACE_TEMPERATURE}

    @property
    def forces(self) -> Mapping[str, str]:
        """Streams of the listed load cells by their names."""
        return {name_of(s, sensor): s for s, sensor in self.inputs.items() if sensor.measures == SHAFT_FORCE}

    @property
    def shaft_forces(self) -> tuple[str, ...]:
        """Streams of the listed load cells that show the force on the shaft: those that are named, or the only one."""
        return tuple(self.forces[name] for name in self.force) or tuple(self.forces.values())

    @property
    def ring(self) -> Encoder:
        """The encoder, where only a stage that has one makes sense.

        Raises:
            InputError: this stage has none.
        """
        if self.encoder is None:
            raise InputError("the stage has no section 'encoder'")
        return self.encoder

    @property
    def azimuths(self) -> Mapping[str, float]:
        """Azimuth of each read head by its letter, rad about +z; none without an encoder."""
        return {} if self.encoder is None else self.encoder.azimuths

    @property
    def tables(self) -> tuple[PeriodicTable, ...]:
        """Measured curves of ring and mirror, as far as there are some."""
        both = None if self.encoder is None else self.encoder.graduation_table, self.mirror.flatness_table
        return tuple(table for table in both if table is not None)

    @property
    def tilt_instrument(self) -> Autocollimator:
        """The autocollimator, where only a stage that has one makes sense.

        Raises:
            InputError: this stage has none.
        """
        if self.autocollimator is None:
            raise InputError("the stage has no section 'autocollimator'")
        return self.autocollimator

    @property
    def two_axis(self) -> Mapping[str, Autocollimator | RadialReference]:
        """Instruments of two axes with a section of their own, by their streams."""
        both = {AUTOCOLLIMATOR: self.autocollimator, OWN_REFERENCE: self.lvdt}
        return {stream: instrument for stream, instrument in both.items() if instrument is not None}

    @property
    def reference(self) -> RadialReference | None:
        """What the radial error motion is compared with, of what has a section of its own."""
        return self.lvdt

    def with_reference(self, reference: RadialReference | None) -> StageDescription:
        """The stage with another reference of its own, or without one."""
        return replace(self, lvdt=reference)

    def response(self, stream: str) -> Response:
        """Response of the instrument behind a stream."""
        return self.responses.get(stream, IDEAL)

    def timing(self, what: str) -> float:
        """Standard uncertainty of the stamps of `what` (encoder: of its heads; command; sensors.top) against others, s.

        Of autocollimator and listed sensors it is that of their latency, 0 where the file states none.
        """
        name = f"{what}.timing"
        return self.uncertainty.get(name, TIMING if name in TIMINGS else 0.0)

    def zero_uncertainty(self, stream: str) -> float | None:
        """Standard uncertainty of each zero of a listed sensor, in its unit; None where the file states none of it.

        Then that of the sensor is of zero and form, and else of the form alone.
        """
        return self.uncertainty.get(f"sensors.{name_of(stream, self.listed[stream])}.zero")

    @property
    def limits(self) -> StageLimits:
        """What the stage can do at most, as stated in the file or else derived from what it describes."""
        return replace(derive_limits(self.spindle), **self.stated_limits)


def load_stage(path: Path | str | None = None) -> StageDescription:
    """Stage described in a YAML file, by default the embedded `config/stage.yaml`.

    Raises:
        InputError: the file is missing, states what is out of range or contradicts itself; the message names file,
            line, value and what is expected.
    """
    found = read_yaml(Path(config("stage.yaml") if path is None else path))
    return _description(read(StageSection, with_tables(found, "stage"), ("stage",), "stage"))


def stage_mapping(stage: StageDescription) -> dict[str, Any]:
    """Content of a `stage` section: what `load_stage` reads the same stage from."""
    ring, collimator, lvdt = stage.encoder, stage.autocollimator, stage.lvdt
    targets = shared_targets(stage.sensors.values())
    rows = {stream: two_axis_rows(stage.response(stream)) for stream in TWO_AXIS}
    section = StageSection(
        encoder=None if ring is None else extended(EncoderSection, ring, heads=_heads(stage)),
        mirror=stage.mirror,
        autocollimator=None
        if collimator is None
        else extended(AutocollimatorSection, collimator, **rows[AUTOCOLLIMATOR]),
        spindle=stage.spindle,
        lvdt=None if lvdt is None else extended(RadialReferenceSection, lvdt, **rows[OWN_REFERENCE]),
        sensors=sensors_section(stage.listed, {name: stage.response(name).latency for name in stage.listed}, targets),
        targets=targets,
        environment=Environment(stage.reference_temperature, stage.force or None),
        limits=stage.stated_limits,
        command=CommandSection(**command_rows(stage.response("command"))),
        uncertainty=stage.uncertainty,
    )
    content: dict[str, Any] = write(section)
    return content


def _heads(stage: StageDescription) -> dict[str, Head]:
    return {
        letter: Head(azimuth=azimuth, **angle_rows(stage.response(f"head_{letter}")))
        for letter, azimuth in stage.azimuths.items()
    }


def _description(section: StageSection) -> StageDescription:
    listed = before_targets(listed_sensors(section.sensors), section.targets)
    encoder, collimator, lvdt = section.encoder, section.autocollimator, section.lvdt
    place = section.environment
    return StageDescription(
        encoder=None if encoder is None else narrowed(Encoder, encoder),
        autocollimator=None if collimator is None else narrowed(Autocollimator, collimator),
        mirror=section.mirror,
        spindle=section.spindle,
        lvdt=None if lvdt is None else narrowed(RadialReference, lvdt),
        sensors={stream: sensor for stream, sensor in listed.items() if not sensor.is_input},
        reference_temperature=REFERENCE_TEMPERATURE if place is None else place.reference_temperature,
        stated_limits=section.limits,
        uncertainty={**_calibrated(section), **section.uncertainty},
        responses=_responses(section),
        inputs={stream: sensor for stream, sensor in listed.items() if sensor.is_input},
        force=() if place is None else place.force or (),
    )


def _responses(section: StageSection) -> dict[str, Response]:
    """Responses by stream, such as `head_a`; ideal ones left out.

    Of listed sensors only the latency is here: zero and gain are parameters of them that a diagnosis may doubt.
    """
    heads = {} if section.encoder is None else section.encoder.heads
    found = {f"head_{letter}": head.response for letter, head in heads.items()}
    two_axes = zip(TWO_AXIS, (section.autocollimator, section.lvdt), strict=True)
    found |= {name: each.response for name, each in two_axes if each is not None}
    found["command"] = section.command.response
    for name, sensor in section.sensors.items():
        found[stream_of_sensor(name, sensor.kind)] = Response(latency=sensor.latency or 0.0)
    return {stream: response for stream, response in found.items() if not response.is_ideal}


def _calibrated(section: StageSection) -> dict[str, float]:
    """Standard uncertainties from calibrations; what the file states itself counts before."""
    found = {}
    notes = section.calibration
    for part, note, vector, rows in (
        ("encoder", notes.encoder, "eccentricity", "graduation"),
        ("mirror", notes.mirror, "tilt", "flatness"),
    ):
        if note is not None and note.uncertainty is not None:
            found[f"{part}.{vector}"] = note.uncertainty
        if note is not None and f"{rows}_uncertainty" in note.figures:
            found[f"{part}.{rows}"] = note.figures[f"{rows}_uncertainty"]
    if notes.autocollimator is not None:
        figures = notes.autocollimator.figures
        stds = {name: figures.get(f"{name}_uncertainty") for name in (*RESPONSES, *DISTORTIONS)}
        found |= {f"autocollimator.{name}": std for name, std in stds.items() if std is not None}
    return found
