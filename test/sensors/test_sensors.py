"""Kinds of sensor: what each shows of the rotor by a closed form, and that the wire contract says the same of it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import filterfalse

import numpy as np
import pytest

from rotary_error_monitor.description.harmonics import PlanarHarmonic
from rotary_error_monitor.description.listed_sensors import is_input, quantity
from rotary_error_monitor.description.sensor_section import listed_kinds
from rotary_error_monitor.description.stage import StageDescription, load_stage
from rotary_error_monitor.description.two_axis_section import Turbulence
from rotary_error_monitor.description.wire import load_wire
from rotary_error_monitor.effects.rotor import RotorState
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.plant.instruments import geometries
from rotary_error_monitor.sensors.library import input_kinds, kind_of, sensor_kinds, sensor_of
from rotary_error_monitor.sensors.listed import ListedKind
from rotary_error_monitor.sensors.listed_input import ListedInput
from rotary_error_monitor.sensors.sensor import Sensor

STAGE = load_stage()
COUNT = 40


@dataclass(frozen=True)
class Posed:
    """A rotor that stands as it is told."""

    stage: StageDescription
    state: RotorState
    moved: np.ndarray
    leaning: np.ndarray

    def radial(self):
        return self.moved.copy()

    def tilt(self):
        return self.leaning.copy()


@pytest.fixture
def pose():
    """Function that poses the rotor of a stage, with error motion far larger than any real one."""
    rng = np.random.default_rng(5)
    theta = rng.uniform(-40.0, 40.0, COUNT)

    def posed(stage):
        zero = np.zeros(COUNT)
        state = RotorState(zero, theta, zero, theta, np.zeros((COUNT, 2)), zero, lambda time: time, 100)
        return Posed(stage, state, rng.normal(size=(COUNT, 2)) * 1e-3, rng.normal(size=(COUNT, 2)) * 1e-3)

    return posed


def turned(vector, theta):
    return np.array([[np.cos(t), -np.sin(t)] for t in theta]) @ vector, np.array(
        [[np.sin(t), np.cos(t)] for t in theta]
    ) @ vector


def test_kinds_are_those_of_the_room():
    assert set(sensor_kinds()) == {"head", "autocollimator", "lvdt", *filterfalse(is_input, listed_kinds())}
    assert set(input_kinds()) == {*filter(is_input, listed_kinds())}
    assert {"axial_probe", "radial_probe", "tilt_sensor", "thermometer"} <= set(listed_kinds())
    assert kind_of("head_a") == "head" and kind_of("lvdt.x") == "lvdt"
    assert sensor_of("head_c") is sensor_kinds()["head"]


@pytest.mark.parametrize("kind", sorted(sensor_kinds()))
def test_the_wire_has_the_fields_and_the_unit_of_each_stream(kind):
    sensor = sensor_kinds()[kind]
    for stream in sensor.streams(STAGE):
        topic = load_wire(tuple(STAGE.encoder.azimuths)).named(f"/stage/{stream}/samples")
        assert topic.columns == sensor.fields
        assert {field.unit for field in topic.fields} == {sensor.unit}
        assert topic.frame == stream
    assert sensor.small_unit == f"µ{sensor.unit}"


@pytest.mark.parametrize("kind", sorted(listed_kinds()))
def test_all_that_a_listed_kind_is_written_down_in_says_the_same_of_it(kind):
    """Its class, its section and its topics; nothing else has to name a kind but the geometry of the plant."""
    sensor, stream = (sensor_kinds() | input_kinds())[kind], f"{kind}_a"
    assert isinstance(sensor, ListedInput if is_input(kind) else ListedKind)
    assert quantity(kind) == (sensor.fields, sensor.unit)
    wire = load_wire(("a", "b"), sensors=(stream,))
    samples, (people,) = wire.of_stream(stream), [t for t in wire if t.frame == stream and not t.is_sample_block]
    assert samples.columns == sensor.fields and people.publishers == samples.publishers == ("listed_sensor",)
    told = [field for field in (*samples.fields, *people.fields) if field.name not in ("variance", "wrench.torque")]
    assert {field.unit for field in told} == {sensor.unit}
    assert (kind in geometries()) is not is_input(kind)
    assert ("error_estimator" in samples.subscribers) is not is_input(kind)
    assert {"gap_monitor", "recorder"} <= set(samples.subscribers)


def test_the_masks_of_an_estimate_have_no_bits_of_inputs():
    topic = load_wire(("a", "b"), sensors=("axial_probe_top", "thermometer_bearing")).topic("error_motion_samples")
    assert topic.field("streams").bits == ("head_a", "head_b", "autocollimator", "command", "axial_probe_top")
    alone = load_wire(("a", "b"), sensors=("thermometer_bearing",)).topic("error_motion_samples")
    assert alone == load_wire(("a", "b")).topic("error_motion_samples")


def test_a_head_sees_where_its_sight_line_cuts_the_ring(pose):
    stage = replace(STAGE, encoder=replace(STAGE.encoder, graduation=()))
    posed = pose(stage)
    theta = posed.state.theta
    ex, ey = turned(np.array(stage.encoder.eccentricity), theta)
    for letter, azimuth in stage.encoder.azimuths.items():
        across = -(posed.moved[:, 0] + ex) * np.sin(azimuth) + (posed.moved[:, 1] + ey) * np.cos(azimuth)
        expected = theta + np.arcsin(across / stage.encoder.disc_radius)
        np.testing.assert_allclose(sensor_of("head").shown(f"head_{letter}", posed), expected, rtol=0, atol=1e-13)


def test_an_autocollimator_sees_tilt_of_rotor_and_mirror_within_its_range(pose):
    flat = (PlanarHarmonic(2, (1e-5, 2e-5), (-3e-5, 4e-5)),)
    stage = replace(STAGE, mirror=replace(STAGE.mirror, flatness=flat))
    posed = pose(stage)
    theta = posed.state.theta
    tx, ty = turned(np.array(stage.mirror.tilt), theta)
    wave = np.stack([np.cos(2 * theta), np.sin(2 * theta)])
    expected = posed.leaning + np.stack([tx + [1e-5, 2e-5] @ wave, ty + [-3e-5, 4e-5] @ wave], axis=1)
    shown = sensor_of("autocollimator").shown("autocollimator", posed)
    np.testing.assert_allclose(shown, expected, rtol=0, atol=1e-15)
    held = sensor_of("autocollimator").within_range(stage, "autocollimator", shown)
    limit = stage.autocollimator.range
    assert np.abs(held).max() == limit < np.abs(shown).max()
    np.testing.assert_array_equal(held[np.abs(shown) < limit], shown[np.abs(shown) < limit])


def test_an_lvdt_sees_the_artefact_at_its_height(pose):
    posed = pose(STAGE)
    lvdt = STAGE.lvdt
    ax, ay = turned(np.array(lvdt.artefact_eccentricity), posed.state.theta)
    eac, ebc = posed.leaning.T
    expected = posed.moved + np.stack([ax + lvdt.height * ebc, ay - lvdt.height * eac], axis=1)
    np.testing.assert_allclose(sensor_of("lvdt").shown("lvdt", posed), expected, rtol=0, atol=1e-15)
    assert sensor_of("lvdt").streams(replace(STAGE, lvdt=None)) == ()


def test_noise_is_that_of_one_sample_with_its_rounding():
    encoder, collimator = STAGE.encoder, STAGE.autocollimator
    expected = {
        "head": np.sqrt(encoder.noise**2 + encoder.resolution**2 / 12),
        "autocollimator": np.sqrt(collimator.noise**2 + collimator.resolution**2 / 12),
        "lvdt": STAGE.lvdt.noise,
    }
    assert {
        kind: sensor.noise(STAGE, stream) for kind, sensor in sensor_kinds().items() for stream in sensor.streams(STAGE)
    } == pytest.approx(expected)
    slow = Turbulence(1e-6, 2.0)
    airy = replace(STAGE, autocollimator=replace(collimator, turbulence=slow))
    assert {kind: sensor.turbulence(airy) for kind, sensor in sensor_kinds().items() if sensor.streams(airy)} == {
        "head": None,
        "autocollimator": slow,
        "lvdt": None,
    }


def test_a_kind_that_no_file_can_state_is_refused_where_it_is_written():
    with pytest.raises(InputError, match="is of sensor kind 'corner_probe'; there are axial_probe"):

        class CornerProbe(ListedKind):
            kind = "corner_probe"


def test_a_kind_that_does_not_say_what_it_shows_cannot_be_made():
    class Half(Sensor):
        kind = "half"

        def streams(self, stage):
            return ("half",)

    with pytest.raises(TypeError, match="abstract methods noise, shown"):
        Half()
