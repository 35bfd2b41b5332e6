"""How sensors say that the estimate can be held against them, beside what they show of the rotor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from sensors.test_sensors import Posed

from rotary_error_monitor.description.harmonics import AngularHarmonic
from rotary_error_monitor.description.listed_sensors import ListedSensor
from rotary_error_monitor.description.stage import StageDescription, load_stage
from rotary_error_monitor.effects.rotor import RotorState
from rotary_error_monitor.pipeline.reference_readings import reference_names, reference_of, without_references
from rotary_error_monitor.sensors.library import listed_kind, sensor_kinds, sensor_of
from rotary_error_monitor.sensors.listed import ListedKind

COUNT = 50


def probe(rng: np.random.Generator) -> ListedSensor:
    form = tuple(AngularHarmonic(order, *(1e-6 * rng.normal(size=2))) for order in (1, 2, 5))
    place = {"azimuth": float(rng.uniform(-3, 3)), "height": float(rng.uniform(0, 0.3))}
    gain, zero = float(rng.choice([-1, 1]) * rng.uniform(0.2, 3)), float(1e-5 * rng.normal())
    return ListedSensor("radial_probe", 1e-8, 5e-9, 1e-3, 2e-8, zero, gain, place, form)


def posed(rng: np.random.Generator, stage: StageDescription) -> Posed:
    theta, zero = rng.uniform(-40.0, 40.0, COUNT), np.zeros(COUNT)
    state = RotorState(zero, theta, zero, theta, np.zeros((COUNT, 2)), zero, lambda time: time, 100)
    return Posed(stage, state, 1e-5 * rng.normal(size=(COUNT, 2)), 1e-4 * rng.normal(size=(COUNT, 2)))


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("name", ["lvdt", "low"])
def test_what_is_read_is_error_motion_and_target_along_the_directions_of_the_view(name, seed):
    """Whatever a sensor is called: no caller knows what it is."""
    rng = np.random.default_rng(seed)
    plain = load_stage()
    own = replace(plain.lvdt, artefact_eccentricity=tuple(4e-6 * rng.normal(size=2)), height=float(rng.uniform(0, 0.3)))
    stage = replace(plain, lvdt=own, sensors={"radial_probe_low": probe(rng)})
    pose, stream = posed(rng, stage), {"lvdt": "lvdt", "low": "radial_probe_low"}[name]
    shown = sensor_of(stream).shown(stream, pose).reshape(COUNT, -1)
    reference = reference_of(stage, name, {stream: (np.arange(COUNT), shown)})
    theta, (ex, ey) = pose.state.theta, reference.eccentricity
    centre = np.stack([np.cos(theta) * ex - np.sin(theta) * ey, np.sin(theta) * ex + np.cos(theta) * ey], axis=1)
    lever = reference.height * np.stack([pose.leaning[:, 1], -pose.leaning[:, 0]], axis=1)
    seen = (pose.moved + lever + centre) @ reference.directions.T + reference.form_at(theta)
    np.testing.assert_allclose(reference.readings, seen, rtol=0, atol=1e-14)


def test_other_kinds_are_no_reference():
    stage = replace(load_stage(), sensors={"radial_probe_low": probe(np.random.default_rng(0))})
    views = {
        kind: [sensor.radial_view(stage, stream) is not None for stream in sensor.streams(stage)]
        for kind, sensor in sensor_kinds().items()
    }
    assert views["lvdt"] == views["radial_probe"] == [True]
    assert not any(any(there) for kind, there in views.items() if kind not in ("lvdt", "radial_probe"))
    assert views["head"] == [False] * 4 and views["autocollimator"] == [False]


class TwoFields(ListedKind):
    """Sees radial error motion along two directions at a height, as a sensor of another package may."""

    def sensitivity(self, place):
        """Along x and y."""
        return np.array([[1.0, 0, 0, 0, place["height"], 0], [0, 1.0, 0, -place["height"], 0, 0]])


def test_a_sensor_of_several_fields_is_no_reference_unless_it_says_how():
    sensor = ListedSensor("two", 1e-8, 0.0, 1e-3, 2e-8, place={"height": 0.1}, fields=("a", "b"))
    assert TwoFields().radial_view(replace(load_stage(), sensors={"two_low": sensor}), "two_low") is None


def test_a_listed_probe_may_be_called_as_the_reference_with_a_section_of_its_own():
    sensor = probe(np.random.default_rng(3))
    both = replace(load_stage(), sensors={"radial_probe_lvdt": sensor})
    assert reference_names(both) == ("lvdt",)
    assert without_references(both, ("lvdt",)) is both
    alone = replace(both, lvdt=None)
    samples = {"radial_probe_lvdt": (np.arange(3), np.full((3, 1), sensor.zeros[0]))}
    assert reference_of(alone, "lvdt", samples).height == sensor.place["height"]
    assert without_references(alone, ("lvdt",)).sensors == {}
    assert listed_kind(sensor).radial_view(alone, "radial_probe_lvdt").scale == sensor.gain
