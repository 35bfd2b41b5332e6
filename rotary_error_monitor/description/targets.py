"""Targets on the rotor, each seen by several displacement probes: an artefact, a shaft, the balls of a test mandrel.

What a target shows of itself over a turn is the same for all probes that look at it, each at its own azimuth. So it
stands in the file once, and what is wrong about it is one mistake and not one for each probe.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Annotated

from rotary_error_monitor.description.expected import Expected
from rotary_error_monitor.description.harmonics import Waves
from rotary_error_monitor.description.listed_sensors import ListedSensor
from rotary_error_monitor.description.sections import Place
from rotary_error_monitor.description.sensor_section import ProbeSection, SensorSection


@dataclass(frozen=True)
class Target:
    """What a target shows of itself over a turn, in m by orders of the place on it, `azimuth - theta`; order 1 is that
    it is off centre, or askew.
    """

    form: Annotated[
        Waves, Expected("what it shows of itself over a turn: at most 500 rows {order, cos, sin} in m")
    ] = ()


def target_contradictions(
    sensors: Mapping[str, SensorSection], targets: Mapping[str, Target]
) -> Iterator[tuple[Place, str]]:
    """Places in a stage's file where probes and targets do not go together, and what would be right."""
    first: dict[str, tuple[str, ProbeSection]] = {}
    for name, probe in sensors.items():
        if not isinstance(probe, ProbeSection) or probe.target is None:
            continue
        if probe.target not in targets:
            known = f"one of {', '.join(targets)}" if targets else "it in the section 'targets'"
            yield ("sensors", name, "target"), f"there is no target '{probe.target}'; expected {known}"
        if probe.form is not None:
            told = f"the target '{probe.target}' has a form of its own; expected the form in one of both places"
            yield ("sensors", name, "form"), told
        other, before = first.setdefault(probe.target, (name, probe))
        if (before.kind, before.track) != (probe.kind, probe.track):
            yield (
                ("sensors", name, "target"),
                f"'{other}' sees another part of '{probe.target}'; expected probes of one kind before one turn of a "
                "target, which differ in azimuth alone",
            )
    for name in targets:
        if name not in first:
            yield ("targets", name), "no probe names it; expected 'target' of a sensor, or no such target"


def before_targets(sensors: Mapping[str, ListedSensor], targets: Mapping[str, Target]) -> dict[str, ListedSensor]:
    """Sensors by their stream, each with the form of the target that it names."""
    return {
        stream: replace(sensor, form=targets[sensor.target].form) if sensor.target else sensor
        for stream, sensor in sensors.items()
    }


def shared_targets(sensors: Iterable[ListedSensor]) -> dict[str, Target]:
    """Targets by name, as long as all that name one say the same of its form."""
    forms: dict[str, set[tuple[object, ...]]] = {}
    found: dict[str, Target] = {}
    for sensor in sensors:
        if sensor.target:
            forms.setdefault(sensor.target, set()).add(sensor.form)
            found[sensor.target] = Target(sensor.forms[0])
    return {name: target for name, target in found.items() if len(forms[name]) == 1}
