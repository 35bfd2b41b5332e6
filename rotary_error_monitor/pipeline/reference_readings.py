"""What an instrument that is no input of the estimate shows of the radial error motion: its own, held-out probes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from rotary_error_monitor.arrays import Array, Times
from rotary_error_monitor.description.listed_sensors import name_of
from rotary_error_monitor.description.sections import extended
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.streams import OWN_REFERENCE
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.harmonics import angular_sum
from rotary_error_monitor.sensors.library import listed_kind, sensor_of
from rotary_error_monitor.sensors.sensor import RadialView


@dataclass(frozen=True, kw_only=True)
class Reference(RadialView):
    """What an instrument that sees the radial error motion at one height showed of it.

    Attributes:
        name: of the reference: that of its stream, or of a listed one in the section `sensors`.
        times_ns: (k,) times of its samples.
        readings: (k, p) displacement of the target by zero and gain as described, m.
    """

    name: str
    times_ns: Times
    readings: Array

    def form_at(self, theta: Array) -> Array:
        """(m, p) what the target's form shows at rotations `theta` (m,), m."""
        return np.repeat(angular_sum(self.form, self.azimuth - theta)[:, None], len(self.axes), axis=1)

    def within(self, begin_ns: int, end_ns: int) -> Reference:
        """The same with the samples from `begin_ns` to before `end_ns`."""
        there = (self.times_ns >= begin_ns) & (self.times_ns < end_ns)
        return replace(self, times_ns=self.times_ns[there], readings=self.readings[there])


def _views(stage: StageDescription) -> Mapping[str, tuple[str, RadialView]]:
    """Stream and view of each instrument of a stage that can be a reference, by its name: those with a section first.

    Raises:
        InputError: a listed sensor is of a kind without a class.
    """
    found: dict[str, tuple[str, RadialView]] = {}
    for stream in (*stage.two_axis, *stage.sensors):
        listed = stage.sensors.get(stream)
        view = (sensor_of(stream) if listed is None else listed_kind(listed)).radial_view(stage, stream)
        if view is not None:
            found.setdefault(stream if listed is None else name_of(stream, listed), (stream, view))
    return found


def reference_names(stage: StageDescription) -> tuple[str, ...]:
    """Instruments of a stage that can be a reference: its own by its stream, and radial probes by their names."""
    return tuple(_views(stage))


def without_references(stage: StageDescription, names: tuple[str, ...]) -> StageDescription:
    """The stage without the listed probes of these names: its estimate does not rest on them."""
    held = {stream for name, (stream, _) in _views(stage).items() if name in names}
    left = {stream: each for stream, each in stage.sensors.items() if stream not in held}
    return stage if len(left) == len(stage.sensors) else replace(stage, sensors=left)


def reference_of(stage: StageDescription, name: str, samples: Mapping[str, tuple[Times, Array]]) -> Reference | None:
    """The reference of a name; None where its samples were not recorded.

    Args:
        stage: as described.
        name: as `reference_names` has it.
        samples: times (k,) and values (k, fields) by stream, as the description's latency and response correct them.

    Raises:
        InputError: the stage has no such reference; the message names those that it has.
    """
    views = _views(stage)
    if name not in views:
        have = ", ".join(views) or f"neither a section '{OWN_REFERENCE}' nor a radial probe in 'sensors'"
        raise InputError(f"the stage has no reference '{name}'; it has {have}")
    stream, view = views[name]
    if stream not in samples:
        return None
    times, values = samples[stream]
    return extended(Reference, view, name=name, times_ns=times, readings=(values - view.zero) / view.scale)
