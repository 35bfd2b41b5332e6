"""The rotary stage as it is described: ring and read heads, mirror and autocollimator, spindle, further sensors."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rotary_error_monitor.description import schema
from rotary_error_monitor.description.harmonics import AngularHarmonic as AngularHarmonic
from rotary_error_monitor.description.harmonics import PlanarHarmonic as PlanarHarmonic
from rotary_error_monitor.description.harmonics import angular, pair, planar
from rotary_error_monitor.description.listed_sensors import ListedSensor as ListedSensor
from rotary_error_monitor.description.listed_sensors import listed_sensors, name_of
from rotary_error_monitor.description.response import IDEAL, responses_of
from rotary_error_monitor.description.response import Response as Response
from rotary_error_monitor.description.stage_checks import contradictions
from rotary_error_monitor.description.stage_limits import StageLimits, derive_limits
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.resources import config

THERMOMETER = "thermometer"
"""Kind of the listed sensors that measure the temperature of a place."""

TIMING = 2e-6
"""Standard uncertainty of the stamps of one stream against another, s, where the description states none: each of both
set to within a microsecond, as by a fieldbus or PTP, and jittering by as much."""

TIMINGS = ("encoder.timing", "command.timing")
"""Where the section `uncertainty` states it: of the heads against one another, of the command against the heads."""


@dataclass(frozen=True)
class Encoder:
    """Graduated ring and its read heads.

    Attributes:
        disc_radius: radius of the graduation, m.
        noise: standard deviation of a reading before rounding, rad.
        azimuths: azimuth of each head by its letter, rad about +z.
        eccentricity: ring centre in the rotor's frame (x, y), m.
        graduation: orders of the graduation error.
    """

    disc_radius: float
    lines_per_revolution: int
    counts_per_line: int
    noise: float
    azimuths: Mapping[str, float]
    eccentricity: tuple[float, float] = (0.0, 0.0)
    graduation: tuple[AngularHarmonic, ...] = ()

    @property
    def resolution(self) -> float:
        """Size of one count, rad."""
        return 2 * math.pi / (self.lines_per_revolution * self.counts_per_line)


@dataclass(frozen=True)
class Mirror:
    """Mirror on the rotor: tilt (x, y) that turns with it, and the flatness seen over a turn, rad."""

    tilt: tuple[float, float] = (0.0, 0.0)
    flatness: tuple[PlanarHarmonic, ...] = ()


@dataclass(frozen=True)
class Turbulence:
    """Slow part of the autocollimator's noise: standard deviation in rad, correlation time in s."""

    std: float
    correlation_time: float


@dataclass(frozen=True)
class Autocollimator:
    """Autocollimator: measuring range ±`range`, `resolution` and `noise` (standard deviation), rad.

    All three are of readings over the absolute gain: what they are in rad of tilt.
    """

    range: float
    resolution: float
    noise: float
    turbulence: Turbulence | None = None


@dataclass(frozen=True)
class Spindle:
    """Known error motion: radial at the ring and axial (m), tilt (rad), compliances (m/N, rad/N), drift (m/K).

    The rows of `axial` are `cos * cos(order * theta) + sin * sin(order * theta)`.
    """

    radial: tuple[PlanarHarmonic, ...] = ()
    tilt: tuple[PlanarHarmonic, ...] = ()
    radial_compliance: float = 0.0
    tilt_compliance: float = 0.0
    radial_thermal: tuple[float, float] = (0.0, 0.0)
    axial: tuple[AngularHarmonic, ...] = ()


@dataclass(frozen=True)
class Lvdt:
    """Two-axis LVDT on an artefact: height above the ring, noise, eccentricity of the artefact on the rotor, m."""

    height: float
    noise: float
    artefact_eccentricity: tuple[float, float] = (0.0, 0.0)


@dataclass(frozen=True)
class StageDescription:
    """All that is known of a stage: the section `stage` of `config/stage.yaml` or of a digital twin.

    Attributes:
        encoder: that measures the rotation; a stage without one turns as commanded, as far as is known.
        autocollimator: that measures the tilt; a stage without one has tilt error motion as described.
        lvdt: that measures the radial error motion at a height, to compare with.
        sensors: further ones that show how the rotor stands, by the name of their stream, such as `axial_probe_top`.
        stated_limits: limits by name, as in the file; empty where it states none.
        uncertainty: standard uncertainty of parameters by dotted name, as in the file or its calibration, such as
            `encoder.eccentricity` or `sensors.top.gain`. A twin is exact in what is not named; live, eccentricity and
            tilt of the mirror are then as uncertain as the stage shows them.
        responses: of instruments by stream, such as `head_a`; one that is not named reads what the package means.
        inputs: further sensors that measure what acts on the stage, by the name of their stream, such as
            `thermometer_bearing`.
    """

    encoder: Encoder | None = None
    autocollimator: Autocollimator | None = None
    mirror: Mirror = field(default_factory=Mirror)
    spindle: Spindle = field(default_factory=Spindle)
    lvdt: Lvdt | None = None
    sensors: Mapping[str, ListedSensor] = field(default_factory=dict)
    reference_temperature: float = 20.0
    stated_limits: Mapping[str, float] = field(default_factory=dict)
    uncertainty: Mapping[str, float] = field(default_factory=dict)
    responses: Mapping[str, Response] = field(default_factory=dict)
    inputs: Mapping[str, ListedSensor] = field(default_factory=dict)

    @property
    def listed(self) -> Mapping[str, ListedSensor]:
        """All that the file lists under `sensors`, by the name of their stream."""
        both = {**self.sensors, **self.inputs}
        return {stream: both[stream] for stream in sorted(both)}

    @property
    def thermometers(self) -> Mapping[str, str]:
        """Streams of the listed thermometers by their names, which are those of their places."""
        return {name_of(s, sensor): s for s, sensor in self.inputs.items() if sensor.kind == THERMOMETER}

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
    def tilt_instrument(self) -> Autocollimator:
        """The autocollimator, where only a stage that has one makes sense.

        Raises:
            InputError: this stage has none.
        """
        if self.autocollimator is None:
            raise InputError("the stage has no section 'autocollimator'")
        return self.autocollimator

    def response(self, stream: str) -> Response:
        """Response of the instrument behind a stream."""
        return self.responses.get(stream, IDEAL)

    def timing(self, what: str) -> float:
        """Standard uncertainty of the stamps of `what` (encoder: of its heads; command) against the others, s."""
        return self.uncertainty.get(f"{what}.timing", TIMING)

    @property
    def limits(self) -> StageLimits:
        """What the stage can do at most, as stated in the file or else derived from what it describes."""
        spindle = self.spindle
        derived = derive_limits(
            spindle.radial,
            spindle.tilt,
            spindle.radial_compliance,
            spindle.tilt_compliance,
            spindle.radial_thermal,
            spindle.axial,
        )
        return derived.stated(self.stated_limits)


def load_stage(path: Path | str | None = None) -> StageDescription:
    """Stage described in a YAML file, by default the embedded `config/stage.yaml`.

    Raises:
        InputError: the file is missing, breaks the schema or contradicts itself; the message names file, line, value
            and what is expected.
    """
    path = config("stage.yaml") if path is None else Path(path)
    section = schema.load(path, "stage")["stage"]
    for place, problem in contradictions(section):
        raise InputError(f"{schema.locate(path, ['stage', *place])}: {problem}")
    return stage_from_mapping(section)


def stage_from_mapping(stage: Mapping[str, Any]) -> StageDescription:
    """Stage from the content of a `stage` section that is valid by the schema."""
    mirror, spindle, lvdt = stage.get("mirror", {}), stage.get("spindle", {}), stage.get("lvdt")
    listed = listed_sensors(stage.get("sensors", {}))
    return StageDescription(
        encoder=_encoder(stage["encoder"]) if "encoder" in stage else None,
        autocollimator=_autocollimator(stage["autocollimator"]) if "autocollimator" in stage else None,
        mirror=Mirror(pair(mirror.get("tilt", (0.0, 0.0))), planar(mirror.get("flatness", ()))),
        spindle=Spindle(
            radial=planar(spindle.get("radial", ())),
            tilt=planar(spindle.get("tilt", ())),
            radial_compliance=float(spindle.get("radial_compliance", 0.0)),
            tilt_compliance=float(spindle.get("tilt_compliance", 0.0)),
            radial_thermal=pair(spindle.get("radial_thermal", (0.0, 0.0))),
            axial=angular(spindle.get("axial", ())),
        ),
        lvdt=None
        if lvdt is None
        else Lvdt(float(lvdt["height"]), float(lvdt["noise"]), pair(lvdt.get("artefact_eccentricity", (0.0, 0.0)))),
        sensors={stream: sensor for stream, sensor in listed.items() if not sensor.is_input},
        reference_temperature=float(stage.get("environment", {}).get("reference_temperature", 20.0)),
        stated_limits={name: float(value) for name, value in stage.get("limits", {}).items()},
        uncertainty=_calibrated(stage) | {name: float(value) for name, value in stage.get("uncertainty", {}).items()},
        responses=responses_of(stage),
        inputs={stream: sensor for stream, sensor in listed.items() if sensor.is_input},
    )


def _encoder(section: Mapping[str, Any]) -> Encoder:
    return Encoder(
        disc_radius=float(section["disc_radius"]),
        lines_per_revolution=section["lines_per_revolution"],
        counts_per_line=section["counts_per_line"],
        noise=float(section["noise"]),
        azimuths={name: float(head["azimuth"]) for name, head in section["heads"].items()},
        eccentricity=pair(section.get("eccentricity", (0.0, 0.0))),
        graduation=angular(section.get("graduation", ())),
    )


def _autocollimator(section: Mapping[str, Any]) -> Autocollimator:
    air = section.get("turbulence")
    turbulence = None if air is None else Turbulence(**{key: float(value) for key, value in air.items()})
    return Autocollimator(
        **{key: float(section[key]) for key in ("range", "resolution", "noise")}, turbulence=turbulence
    )


def _calibrated(stage: Mapping[str, Any]) -> dict[str, float]:
    """Standard uncertainties of ring and mirror from their calibration; what the file states itself counts before."""
    found = {}
    for part, vector, rows in (("encoder", "eccentricity", "graduation"), ("mirror", "tilt", "flatness")):
        note = stage.get("calibration", {}).get(part, {})
        if "uncertainty" in note:
            found[f"{part}.{vector}"] = float(note["uncertainty"])
        if f"{rows}_uncertainty" in note.get("figures", {}):
            found[f"{part}.{rows}"] = float(note["figures"][f"{rows}_uncertainty"])
    return found
