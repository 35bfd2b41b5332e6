"""Listed sensors of the true stage: the contract's first-order sums, and closed forms for errors far too large."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from rotary_error_monitor.description.harmonics import AngularHarmonic, PlanarHarmonic
from rotary_error_monitor.description.listed_sensors import ListedSensor
from rotary_error_monitor.description.spindle_section import Spindle
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.stage_section import Encoder
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.plant.clocks import stage_clocks
from rotary_error_monitor.plant.listed.radial_probe import ARTEFACT_RADIUS
from rotary_error_monitor.plant.scene import Fault, Scene
from rotary_error_monitor.plant.stage import StagePlant

Array = NDArray[np.float64]
TIME = np.linspace(0, 20, 2001)
ENCODER = Encoder(0.1, 31488, 100, 3e-7, {"a": 0.0, "b": np.pi})
SPINDLE = Spindle(
    radial=(PlanarHarmonic(1, (-2.3e-7, 3e-7), (-3.3e-6, -4.5e-6)),),
    tilt=(PlanarHarmonic(2, (-1.3e-5, 9.2e-6), (1.7e-5, -2.4e-5)),),
    radial_compliance=2e-8,
    axial=(AngularHarmonic(1, 4e-7, -9e-7), AngularHarmonic(3, 2e-7, 5e-8)),
)
FORM = (AngularHarmonic(2, 3e-7, -1e-7), AngularHarmonic(5, -4e-8, 6e-8))


def probe(kind: str, form: tuple[AngularHarmonic, ...] = (), **given: float) -> ListedSensor:
    common = {"noise": 0.0, "resolution": 0.0, "range": 1e-3, "uncertainty": 1e-7, "zero": 0.0, "gain": 1.0}
    own = {name: given.pop(name) for name in tuple(given) if name not in common}
    return ListedSensor(kind, **(common | given), place=own, form=form)


def plant_with(spindle: Spindle = SPINDLE, **sensors: ListedSensor) -> StagePlant:
    named = {f"{sensor.kind}_{name}": sensor for name, sensor in sensors.items()}
    stage = StageDescription(ENCODER, spindle=spindle, sensors=named)
    return StagePlant(stage, 3, clocks=stage_clocks("ab", sensors=tuple(named)))


def waves(rows: tuple[AngularHarmonic, ...], angle: Array) -> Array:
    return np.asarray(sum(r.cos * np.cos(r.order * angle) + r.sin * np.sin(r.order * angle) for r in rows))


def motion(theta: Array) -> tuple[Array, Array, Array, Array, Array]:
    """Exc, eyc, ezc, eac, ebc of the spindle above."""
    (radial,), (tilt,) = SPINDLE.radial, SPINDLE.tilt
    once, twice = (np.cos(theta), np.sin(theta)), (np.cos(2 * theta), np.sin(2 * theta))
    planar = [
        np.dot(row, parts) for row, parts in ((radial.x, once), (radial.y, once), (tilt.x, twice), (tilt.y, twice))
    ]
    return planar[0], planar[1], waves(SPINDLE.axial, theta), planar[2], planar[3]


@pytest.mark.parametrize(("azimuth", "radius"), [(0.0, 0.0), (0.0, 0.04), (1.1, 0.06), (-2.0, 0.05)])
def test_an_axial_probe_sees_axial_motion_and_what_tilt_adds_beside_the_axis(azimuth: float, radius: float) -> None:
    sensor = probe("axial_probe", FORM, azimuth=azimuth, radius=radius, zero=2e-5, gain=-1.5)
    plant = plant_with(top=sensor)
    theta = plant.scene(TIME).theta
    _, _, ezc, eac, ebc = motion(theta)
    x, y = radius * np.cos(azimuth), radius * np.sin(azimuth)
    expected = 2e-5 - 1.5 * (ezc + y * eac - x * ebc + waves(FORM, azimuth - theta))
    shown = plant.signal("axial_probe_top", TIME)
    assert shown.shape == (len(TIME), 1)
    # of second order: displacement times slope of the face, some 1e-5 m times 1e-5
    assert np.abs(shown[:, 0] - expected).max() < 2e-9
    assert np.ptp(expected) > 1e-6


@pytest.mark.parametrize(("azimuth", "height"), [(0.0, 0.0), (0.0, 0.06), (np.pi / 2, 0.06), (2.5, -0.03)])
def test_a_radial_probe_sees_radial_motion_at_its_height(azimuth: float, height: float) -> None:
    plant = plant_with(low=probe("radial_probe", FORM, azimuth=azimuth, height=height, zero=-1e-5, gain=2.0))
    theta = plant.scene(TIME).theta
    exc, eyc, _, eac, ebc = motion(theta)
    outwards = np.cos(azimuth) * (exc + height * ebc) + np.sin(azimuth) * (eyc - height * eac)
    expected = -1e-5 + 2.0 * (outwards + waves(FORM, azimuth - theta))
    assert np.abs(plant.signal("radial_probe_low", TIME)[:, 0] - expected).max() < 5e-9


def constant(**values: float) -> Spindle:
    """A rotor that stays out of place however it turns."""
    exc, eyc, ezc, eac, ebc = (values.get(name, 0.0) for name in ("exc", "eyc", "ezc", "eac", "ebc"))
    return Spindle(
        radial=(PlanarHarmonic(0, (exc, 0.0), (eyc, 0.0)),),
        tilt=(PlanarHarmonic(0, (eac, 0.0), (ebc, 0.0)),),
        axial=(AngularHarmonic(0, ezc, 0.0),),
    )


def test_a_face_that_leans_far_is_met_where_the_line_of_the_probe_pierces_it() -> None:
    # about the x axis by 0.2 rad, after a shift by 3 mm along y: the face rises by the tangent
    plant = plant_with(constant(eyc=3e-3, ezc=1e-3, eac=0.2), top=probe("axial_probe", azimuth=np.pi / 2, radius=0.05))
    expected = 1e-3 + (0.05 - 3e-3) * np.tan(0.2)
    np.testing.assert_allclose(plant.signal("axial_probe_top", TIME)[:, 0], expected, rtol=0, atol=1e-15)


def test_a_round_artefact_far_aside_is_met_at_its_chord() -> None:
    # a circle of radius R about (0, d) seen along x
    plant = plant_with(constant(eyc=4e-3), low=probe("radial_probe", azimuth=0.0, height=0.03))
    expected = np.sqrt(ARTEFACT_RADIUS**2 - 4e-3**2) - ARTEFACT_RADIUS
    np.testing.assert_allclose(plant.signal("radial_probe_low", TIME)[:, 0], expected, rtol=0, atol=1e-15)


def test_an_artefact_that_leans_far_is_cut_across_its_axis() -> None:
    # about y by 0.3 rad: in the plane of the tilt the surface x cos - z sin = R stands at (R + h sin) / cos
    plant = plant_with(constant(ebc=0.3, ezc=5e-3), low=probe("radial_probe", azimuth=0.0, height=0.03))
    expected = (ARTEFACT_RADIUS + (0.03 - 5e-3) * np.sin(0.3)) / np.cos(0.3) - ARTEFACT_RADIUS
    np.testing.assert_allclose(plant.signal("radial_probe_low", TIME)[:, 0], expected, rtol=0, atol=1e-15)


def test_a_head_sees_axial_motion_of_a_leaning_ring() -> None:
    # about y by 0.1 rad and 5 mm up: the axis passes the height of the heads by so much less far along x
    plant = plant_with(constant(ezc=5e-3, ebc=0.1))
    plant = replace(plant, description=replace(plant.description, encoder=replace(ENCODER, azimuths={"a": np.pi / 2})))
    expected = plant.scene(TIME).theta + np.arcsin(5e-3 * np.sin(0.1) / ENCODER.disc_radius)
    np.testing.assert_allclose(plant.signal("head_a", TIME)[:, 0], expected, rtol=0, atol=1e-12)


def test_the_form_is_that_of_the_place_that_is_met() -> None:
    # a rotor that strayed by 1 mm across shows another place of its face: the angle of it as seen from its axis
    form = (AngularHarmonic(1, 1e-6, 0.0),)
    plant = plant_with(constant(eyc=1e-3), top=probe("axial_probe", form, azimuth=0.0, radius=0.05))
    theta = plant.scene(TIME).theta
    expected = 1e-6 * np.cos(np.arctan2(-1e-3, 0.05) - theta)
    np.testing.assert_allclose(plant.signal("axial_probe_top", TIME)[:, 0], expected, rtol=0, atol=1e-18)


def tilt_sensor(form: tuple[PlanarHarmonic, ...] = (), roll: float = 0.0, **given: Any) -> ListedSensor:
    place, fields = {"roll": roll}, ("tilt_x", "tilt_y")
    return ListedSensor("tilt_sensor", 0.0, 0.0, 0.5, 1e-7, place=place, form=form, fields=fields, unit="rad", **given)


@pytest.mark.parametrize("roll", [0.0, 0.6, -2.5])
def test_a_tilt_sensor_sees_the_tilt_of_rotor_and_mirror_along_its_axes(roll: float) -> None:
    form = (PlanarHarmonic(1, (3e-5, -1e-5), (1e-5, 3e-5)), PlanarHarmonic(3, (1e-6, 2e-6), (-2e-6, 1e-6)))
    plant = plant_with(second=tilt_sensor(form, roll, zero=(2e-5, -3e-5), gain=-1.5))
    theta = plant.scene(TIME).theta
    _, _, _, eac, ebc = motion(theta)
    x = eac + waves((AngularHarmonic(1, 3e-5, -1e-5), AngularHarmonic(3, 1e-6, 2e-6)), theta)
    y = ebc + waves((AngularHarmonic(1, 1e-5, 3e-5), AngularHarmonic(3, -2e-6, 1e-6)), theta)
    expected = [2e-5 - 1.5 * (np.cos(roll) * x - np.sin(roll) * y), -3e-5 - 1.5 * (np.sin(roll) * x + np.cos(roll) * y)]
    shown = plant.signal("tilt_sensor_second", TIME)
    assert shown.shape == (len(TIME), 2)
    assert np.abs(shown - np.stack(expected, axis=1)).max() < 1e-8  # second order: products of tilts of 1e-4
    block = plant.samples("tilt_sensor_second", 5, 7)
    assert block.names == ("t", "tilt_x", "tilt_y")


def test_a_mirror_that_leans_far_sends_the_ray_back_by_twice_its_tilt() -> None:
    plant = plant_with(constant(eac=0.2), second=tilt_sensor())
    np.testing.assert_allclose(plant.signal("tilt_sensor_second", TIME), [[0.2, 0.0]] * len(TIME), rtol=0, atol=1e-15)


def test_axial_motion_is_part_of_the_truth() -> None:
    truth = plant_with().scene(TIME)
    np.testing.assert_allclose(truth.error_motion[:, 2], motion(truth.theta)[2], rtol=0, atol=1e-18)


def test_readings_have_noise_limits_and_steps() -> None:
    noisy = probe("axial_probe", radius=0.0, noise=5e-8, resolution=1e-8, range=8e-7)
    plant = plant_with(top=noisy)
    block = plant.samples("axial_probe_top", 0, 20_000)
    assert block.names == ("t", "displacement")
    reading = block.column("displacement")
    steps = reading / 1e-8
    np.testing.assert_allclose(steps, np.rint(steps), rtol=0, atol=1e-6)
    shown = plant.signal("axial_probe_top", block.times_ns * 1e-9)[:, 0]
    within = np.abs(shown) < 5e-7
    assert (reading - shown)[within].std() == pytest.approx(np.hypot(5e-8, 1e-8 / np.sqrt(12)), rel=0.03)
    assert np.abs(reading).max() == pytest.approx(8e-7)
    assert np.abs(shown).max() > 9e-7
    unstepped = plant_with(top=replace(noisy, resolution=0.0)).samples("axial_probe_top", 0, 500)
    assert len(np.unique(unstepped.column("displacement"))) > 250


def test_samples_do_not_depend_on_how_they_are_asked_for() -> None:
    plant = plant_with(top=probe("axial_probe", radius=0.01, noise=3e-8))
    whole = plant.samples("axial_probe_top", -3, 300).rows[:, 1:]
    pieces = [
        plant.samples("axial_probe_top", first, count).rows[:, 1:] for first, count in ((-3, 4), (1, 96), (97, 200))
    ]
    np.testing.assert_array_equal(np.concatenate(pieces), whole)


def test_other_streams_are_the_same_with_and_without_listed_sensors() -> None:
    plain, listed = plant_with(), plant_with(top=probe("axial_probe", radius=0.0, noise=1e-8))
    assert listed.streams == (*plain.streams, "axial_probe_top")
    for stream in plain.streams:
        np.testing.assert_array_equal(listed.samples(stream, 0, 400).rows, plain.samples(stream, 0, 400).rows)


def test_clocks_of_listed_sensors_are_their_own() -> None:
    names = [f"axial_probe_s{i}" for i in range(40)]
    for rate in (None, 10_000.0):
        clocks = stage_clocks("abcd", rate, names)
        assert {clocks[name].rate for name in names} == {rate or 1000.0}
        period = round(clocks[names[0]].period_ns)
        phases = {name: int(clock.times_ns(0, 1)[0]) % period for name, clock in clocks.items()}
        listed = [phases.pop(name) for name in names]
        assert len(set(listed)) == len(listed)
        assert not set(listed) & set(phases.values())
    assert list(stage_clocks("abcd", None, names))[:9] == list(stage_clocks("abcd"))


def test_a_kind_that_the_plant_does_not_know_is_refused() -> None:
    plant = plant_with(x=probe("strain_gauge"))
    with pytest.raises(InputError, match=r"strain_gauge_x: the plant has no geometry of kind 'strain_gauge'"):
        plant.signal("strain_gauge_x", TIME)


@dataclass(frozen=True)
class Sagging(Fault):
    """The rotor lies lower, and one probe reads too much by half."""

    def lift(self, axial: Array, scene: Scene) -> Array:
        return axial - 2e-6

    def sense(self, reading: Array, stream: str, scene: Scene) -> Array:
        return 1.5 * reading if stream == "axial_probe_top" else reading


def test_faults_change_axial_motion_and_what_a_sensor_reads() -> None:
    plain = plant_with(top=probe("axial_probe", radius=0.0), second=probe("axial_probe", radius=0.0, gain=2.0))
    faulty = replace(plain, faults=(Sagging(),))
    before = {stream: plain.signal(stream, TIME)[:, 0] for stream in plain.stage.sensors}
    after = {stream: faulty.signal(stream, TIME)[:, 0] for stream in plain.stage.sensors}
    moved = faulty.scene(TIME).error_motion - plain.scene(TIME).error_motion
    np.testing.assert_allclose(moved, np.tile([0, 0, -2e-6, 0, 0, 0], (len(TIME), 1)), rtol=0, atol=1e-18)
    np.testing.assert_allclose(after["axial_probe_top"], 1.5 * (before["axial_probe_top"] - 2e-6), rtol=0, atol=2e-11)
    np.testing.assert_allclose(after["axial_probe_second"], before["axial_probe_second"] - 4e-6, rtol=0, atol=2e-11)
