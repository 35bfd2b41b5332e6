"""What an instrument that is no input of the estimate shows of the radial error motion: its own, held-out probes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from rotary_error_monitor.arrays import Array, Times
from rotary_error_monitor.description.harmonics import AngularHarmonic
from rotary_error_monitor.description.listed_sensors import ListedSensor, name_of
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.streams import OWN_REFERENCE
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.harmonics import angular_sum
from rotary_error_monitor.sensors.library import listed_kind

ECCENTRIC = 1
"""Order of a target's form that is its eccentricity: a shift of a circle (e_x, e_y) is e_x cos(psi) + e_y sin(psi)."""


@dataclass(frozen=True)
class Reference:
    """An instrument that shows the radial error motion at one height.

    Attributes:
        name: `lvdt`, or that of the probe in the section `sensors`.
        stream: name of its samples' stream, such as `radial_probe_low`.
        axes: p names of its directions: `x` and `y`, or that of the probe's azimuth.
        directions: (p, 2) unit vectors in the plane of the stage.
        height: above the ring as described, m.
        times_ns: (k,) times of its samples.
        readings: (k, p) displacement of the target by zero and gain as described, m.
        form: form of the target by orders of the place on it, m; its eccentricity left out.
        azimuth: at which the form is seen, rad.
        eccentricity: of the target as described (x, y) in the rotor's frame, m.
        noise: standard deviation of a sample before rounding, m.
        resolution: step of a sample, m; 0 where none is stated.
        gain, roll, place: stated standard uncertainty of the gain (of 1), the directions (rad), the height (m).
        lasting: variance of what is the same in each turn, such as the stated form, m².
    """

    name: str
    stream: str
    axes: tuple[str, ...]
    directions: Array
    height: float
    times_ns: Times
    readings: Array
    form: tuple[AngularHarmonic, ...]
    azimuth: float
    eccentricity: tuple[float, float]
    noise: float
    resolution: float
    gain: float
    roll: float
    place: float
    lasting: float

    def form_at(self, theta: Array) -> Array:
        """(m, p) what the target's form shows at rotations `theta` (m,), m."""
        return np.repeat(angular_sum(self.form, self.azimuth - theta)[:, None], len(self.axes), axis=1)

    def within(self, begin_ns: int, end_ns: int) -> Reference:
        """The same with the samples from `begin_ns` to before `end_ns`."""
        there = (self.times_ns >= begin_ns) & (self.times_ns < end_ns)
        return replace(self, times_ns=self.times_ns[there], readings=self.readings[there])


def is_reference(sensor: ListedSensor) -> bool:
    """Whether a listed sensor shows the radial error motion at a height and nothing else."""
    return "height" in sensor.place and not listed_kind(sensor).rows(sensor)[:, 2].any()


def reference_names(stage: StageDescription) -> tuple[str, ...]:
    """Instruments of a stage that can be a reference: the OWN_REFERENCE, and radial probes by their names."""
    probes = [name_of(stream, sensor) for stream, sensor in stage.sensors.items() if is_reference(sensor)]
    return (*(() if stage.reference is None else (OWN_REFERENCE,)), *probes)


def without_references(stage: StageDescription, names: tuple[str, ...]) -> StageDescription:
    """The stage without the listed probes of these names: its estimate does not rest on them."""
    left = {s: each for s, each in stage.sensors.items() if not (is_reference(each) and name_of(s, each) in names)}
    return stage if len(left) == len(stage.sensors) else replace(stage, sensors=left)


def reference_of(stage: StageDescription, name: str, samples: Mapping[str, tuple[Times, Array]]) -> Reference | None:
    """The reference of a name; None where its samples were not recorded.

    Args:
        stage: as described.
        name: `lvdt`, or that of a listed radial probe.
        samples: times (k,) and values (k, fields) by stream, as the description's latency and response correct them.

    Raises:
        InputError: the stage has no such reference; the message names those that it has.
    """
    names = reference_names(stage)
    if name not in names:
        have = (
            f"it has {', '.join(names)}" if names else "it has neither a section 'lvdt' nor a radial probe in 'sensors'"
        )
        raise InputError(f"the stage has no reference '{name}'; {have}")
    if name == OWN_REFERENCE:
        return None if OWN_REFERENCE not in samples else _lvdt(stage, *samples[OWN_REFERENCE])
    stream = next(s for s, each in stage.sensors.items() if is_reference(each) and name_of(s, each) == name)
    return None if stream not in samples else _probe(stage, name, stream, *samples[stream])


def _lvdt(stage: StageDescription, times: Times, values: Array) -> Reference:
    lvdt, stated = stage.reference, stage.uncertainty
    assert lvdt is not None  # who asks has seen it
    gain = abs(stage.response(OWN_REFERENCE).gain)
    return Reference(
        OWN_REFERENCE,
        OWN_REFERENCE,
        ("x", "y"),
        np.eye(2),
        lvdt.height,
        times,
        values,
        (),
        0.0,
        lvdt.artefact_eccentricity,
        lvdt.noise,
        0.0,
        stated.get("lvdt.gain", 0.0) / gain,
        stated.get("lvdt.roll", 0.0),
        stated.get("lvdt.height", 0.0),
        0.0,
    )


def _probe(stage: StageDescription, name: str, stream: str, times: Times, values: Array) -> Reference:
    sensor, stated = stage.sensors[stream], stage.uncertainty
    azimuth, size = sensor.place["azimuth"], abs(sensor.gain)
    (rows,) = sensor.forms
    once = [(row.cos, row.sin) for row in rows if row.order == ECCENTRIC]
    form = tuple(row for row in rows if row.order != ECCENTRIC)
    return Reference(
        name,
        stream,
        (f"{np.degrees(azimuth):.0f}deg",),
        listed_kind(sensor).rows(sensor)[:, :2],
        sensor.place["height"],
        times,
        (values - np.array(sensor.zeros)) / sensor.gain,
        form,
        azimuth,
        (sum(cos for cos, _ in once), sum(sin for _, sin in once)),
        sensor.noise / size,
        sensor.resolution / size,
        stated.get(f"sensors.{name}.gain", 0.0) / size,
        stated.get(f"sensors.{name}.azimuth", 0.0),
        stated.get(f"sensors.{name}.height", 0.0),
        len(form) * sensor.uncertainty**2,
    )
