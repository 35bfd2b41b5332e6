"""Displacement probes of the world: geometry found by a search, the contract's first-order sums, habits and faults."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq
from scipy.spatial.transform import Rotation

from rotary_error_monitor.description.sections import from_content
from rotary_error_monitor.description.stage_section import StageSection

from .fault import Injected
from .faults import FAULTS
from .faults_probes import PROBE_FAULTS
from .options import Options
from .probes import CYLINDER, probe_reading, with_probes, with_probes_alone
from .recording import Recording, samples
from .rotor import Components
from .stage import make_recording
from .stages import random_stage
from .test_world_geometry import orientation, pose
from .test_world_stage import DEFAULT

FORM = [{"order": 1, "cos": 4e-4, "sin": -2e-4}, {"order": 3, "cos": -1e-4, "sin": 3e-4}]


def form(psi: np.ndarray, rows: list[dict[str, Any]]) -> np.ndarray:
    """Height of a target's form at the angle `psi` on it."""
    return np.asarray(sum(r["cos"] * np.cos(r["order"] * psi) + r["sin"] * np.sin(r["order"] * psi) for r in rows))


def on_rotor(at: Components, point: np.ndarray) -> np.ndarray:
    """A point of the base as the rotor sees it."""
    return orientation(at).inv().apply(point - np.array([at.exc[0], at.eyc[0], at.ezc[0]]))


@pytest.mark.parametrize("seed", range(8))
def test_an_axial_probe_meets_the_hills_of_the_face(seed):
    rng = np.random.default_rng(seed)
    at, azimuth, radius = pose(rng.uniform(-40.0, 40.0), seed), rng.uniform(-6.0, 6.0), rng.uniform(0.03, 0.1)
    section = {"kind": "axial_probe", "radius": radius, "azimuth": azimuth, "form": FORM, "zero": 0.2, "gain": -3.0}

    def above(z: float) -> float:
        x, y, height = on_rotor(at, np.array([radius * np.cos(azimuth), radius * np.sin(azimuth), z]))
        return height - form(np.arctan2(y, x), FORM)

    expected = brentq(above, -0.1, 0.1, xtol=1e-15)
    assert abs(expected) > 1e-4
    assert abs(probe_reading(at, section)[0] - (0.2 - 3.0 * expected)) < 2e-7  # of a form of 0.5 mm


@pytest.mark.parametrize("seed", range(8))
def test_a_radial_probe_meets_the_form_of_the_artefact(seed):
    rng = np.random.default_rng(seed)
    at, azimuth, height = pose(rng.uniform(-40.0, 40.0), seed), rng.uniform(-6.0, 6.0), rng.uniform(-0.02, 0.03)
    section = {"kind": "radial_probe", "height": height, "azimuth": azimuth, "form": FORM}

    def outside(way: float) -> float:
        point = np.array([way * np.cos(azimuth), way * np.sin(azimuth), height])
        x, y, _ = on_rotor(at, point)
        return np.hypot(x, y) - CYLINDER - form(np.arctan2(y, x), FORM)

    expected = brentq(outside, 0.002, 0.06, xtol=1e-15) - CYLINDER
    assert abs(expected) > 1e-4
    assert abs(probe_reading(at, section)[0] - expected) < 2e-6  # of a form of 0.5 mm


def test_a_plane_face_and_a_round_artefact_are_met_exactly():
    at = Components(*np.array([[0.7], [1e-3], [-2e-3], [5e-4], [0.1], [-0.05], [0.0]]))
    normal = Rotation.from_rotvec([0.1, -0.05, 0.0]).apply([0.0, 0.0, 1.0])
    foot, away = np.array([1e-3, -2e-3, 5e-4]), np.array([0.04, 0.0, 0.0])
    height = foot[2] - normal[:2] @ (away - foot)[:2] / normal[2]
    assert abs(probe_reading(at, {"kind": "axial_probe", "radius": 0.04})[0] - height) < 1e-16
    start = np.cross(normal, np.array([0.0, 0.0, 0.01]) - foot)  # distance of a line from the axis: |n x (p - foot)|
    along = np.cross(normal, [0.0, 1.0, 0.0])
    roots = np.roots([along @ along, 2 * start @ along, start @ start - CYLINDER**2])
    section = {"kind": "radial_probe", "azimuth": np.pi / 2, "height": 0.01}
    assert abs(probe_reading(at, section)[0] - (roots.max() - CYLINDER)) < 1e-15


@pytest.mark.parametrize("seed", range(8))
def test_a_tilt_sensor_sees_the_image_of_a_ray_in_its_turned_picture(seed):
    """The mirror of the rotor by rotations of scipy; the ray meets the picture at a distance of 1."""
    rng = np.random.default_rng(seed)
    at, roll = pose(rng.uniform(-40.0, 40.0), seed), rng.uniform(-3.0, 3.0)
    slope = rng.uniform(-0.05, 0.05, (2, 2))
    section = {
        "kind": "tilt_sensor", "roll": roll, "zero": [0.1, -0.2], "gain": -2.0,
        "form": [{"order": 2, "x": slope[0].tolist(), "y": slope[1].tolist()}],
    }  # fmt: skip
    wave = np.array([np.cos(2 * at.theta[0]), np.sin(2 * at.theta[0])])
    lean = Rotation.from_rotvec([at.eac[0], at.ebc[0], 0.0]) * Rotation.from_rotvec([*(slope @ wave), 0.0])
    normal = lean.apply([0.0, 0.0, 1.0])
    back = np.array([0.0, 0.0, -1.0]) + 2.0 * normal[2] * normal
    image = 0.5 * back / back[2]
    expected = Rotation.from_rotvec([0.0, 0.0, roll]).apply([-image[1], image[0], 0.0])[:2]
    found = probe_reading(at, section)[0]
    np.testing.assert_allclose(found, [0.1, -0.2] - 2.0 * expected, rtol=0, atol=1e-14)
    assert np.abs(expected).max() > 1e-3


def test_a_probe_on_the_axis_shows_the_form_by_where_it_stands():
    theta = np.linspace(-3.0, 9.0, 40)
    still = Components(theta, *np.zeros((6, 40)))
    section = {"kind": "axial_probe", "radius": 0.0, "azimuth": 0.8, "form": FORM}
    np.testing.assert_allclose(probe_reading(still, section), form(0.8 - theta, FORM), atol=1e-15)


def perfect(seed: int, stage: dict[str, Any]) -> Recording:
    """A recording without noise, steps and habits, under force and temperature."""
    options = Options.textbook(motion="s_curves", peak_speed=1.5, force=True, temperature=True)
    return make_recording(seed, duration=8.0, stage=stage, options=options)


@pytest.mark.parametrize("index", range(5))
def test_readings_are_those_of_the_contract_within_second_order(index):
    stage = with_probes(random_stage(index) if index else DEFAULT, index)
    recording = perfect(index, stage)
    assert len(recording.probes) == 4
    for topic, section in recording.probes.items():
        ns, values = samples(recording.blocks[topic])
        at, phi = recording.truth(ns), section.get("azimuth", 0.0)
        if section["kind"] == "axial_probe":
            x, y = section["radius"] * np.cos(phi), section["radius"] * np.sin(phi)
            moved = at.ezc + y * at.eac - x * at.ebc
        else:
            moved = np.cos(phi) * (at.exc + section["height"] * at.ebc)
            moved += np.sin(phi) * (at.eyc - section["height"] * at.eac)
        expected = section["zero"] + section["gain"] * (moved + form(phi - at.theta, section.get("form", [])))
        expected = np.clip(expected, -section["range"], section["range"])
        most = np.abs([at.exc, at.eyc]).max()
        second = most * np.abs([at.eac, at.ebc]).max() + most**2 / CYLINDER + 1e-3 * np.abs(moved).max()
        assert np.abs(values[:, 0] - expected).max() < 5.0 * second + 1e-12
        assert values.shape[1] == 1
        assert recording.blocks[topic][0].names == ("t", "displacement")


@pytest.mark.parametrize("index", range(3))
def test_the_truth_has_the_described_axial_motion_and_a_little_more(index):
    stage = with_probes(DEFAULT, index)
    rows = stage["spindle"]["axial"]
    plain = perfect(index, stage)
    times = np.linspace(0.0, 8.0, 2000)
    at = plain.truth.at(times)
    np.testing.assert_allclose(at.ezc, form(at.theta, rows), atol=1e-18)
    options = Options(motion="steady", peak_speed=2.5, asynchronous=0.0, force=False, temperature=False)
    at = make_recording(index, duration=8.0, stage=stage, options=options).truth.at(times)
    more = (at.ezc - form(at.theta, rows)).std() / form(at.theta, rows).std()
    assert 0.02 < more < 0.1


def test_other_streams_and_other_motion_are_the_same_with_and_without_probes():
    plain = make_recording(3, duration=3.0, stage=DEFAULT)
    probed = make_recording(3, duration=3.0, stage={**DEFAULT, "sensors": with_probes(DEFAULT, 3)["sensors"]})
    assert set(probed.blocks) == {*plain.blocks, *probed.probes}
    for topic, blocks in plain.blocks.items():
        for one, other in zip(samples(blocks), samples(probed.blocks[topic]), strict=True):
            assert np.array_equal(one, other)
        assert np.array_equal(plain.arrivals[topic], probed.arrivals[topic])


def test_probes_have_rates_noise_and_steps_of_their_own():
    sizes, rates, roundings = [], [], set()
    for seed in range(6):
        recording = make_recording(seed, duration=3.0, stage=with_probes(DEFAULT, seed))
        for topic, section in recording.probes.items():
            ns, values = samples(recording.blocks[topic])
            assert np.all(np.diff(ns) > 0)
            # the last step before the end of the range is whole where the range is not
            inner = values[np.abs(values) < section["range"] - section["resolution"]] / section["resolution"]
            assert np.allclose(inner, np.rint(inner), atol=1e-6)
            rates.append(recording.drawn["streams"][topic]["rate"])
            roundings.add(recording.drawn["streams"][topic]["rounding"])
            noise = values[:, 0] - probe_reading(recording.truth(ns), section)
            if section["noise"] > 2.0 * section["resolution"]:
                sizes.append(noise.std() / section["noise"])
    assert len(roundings) > 1
    assert 250.0 < min(rates) < 0.5 * max(rates)
    assert 0.6 < min(sizes) < 0.95 < 1.05 < max(sizes) < 1.6


def test_drawn_probes_are_valid_and_differ():
    drawn = [with_probes(random_stage(seed), seed) for seed in range(20)]
    for stage in drawn:
        assert from_content(StageSection, stage, "stage").sensors.keys() == stage["sensors"].keys()
    assert with_probes(random_stage(5), 5) == drawn[5]
    assert "sensors" not in random_stage(5)
    assert drawn[5]["sensors"]["low"] != drawn[6]["sensors"]["low"]


@functools.cache
def healthy() -> Recording:
    """A short recording of a stage with probes."""
    options = Options(motion="steady", peak_speed=2.5, start_ns=10**18, block_period=0.03, lost_blocks=0.0)
    return make_recording(1, duration=6.0, stage=with_probes(DEFAULT, 1), options=options)


def put(name: str, seed: int = 0, **fixed: Any) -> Injected:
    """A fault in the healthy recording."""
    return PROBE_FAULTS[name](healthy(), np.random.default_rng(seed), **fixed)


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", PROBE_FAULTS)
def test_a_fault_changes_one_probe_from_its_begin_on(name, seed):
    injected = put(name, seed)
    (topic,) = injected.topics
    assert injected.acts and topic in healthy().probes
    assert injected.recording.truth is healthy().truth
    times, before = samples(healthy().blocks[topic])
    new, after = samples(injected.recording.blocks[topic])
    early = int(np.sum(times < injected.begin_ns))
    assert np.array_equal(new[:early], times[:early]) and np.array_equal(after[:early], before[:early])
    assert all(
        injected.recording.blocks[other] is healthy().blocks[other] for other in healthy().blocks if other != topic
    )
    again = put(name, seed)
    assert (again.size, again.begin_ns) == (injected.size, injected.begin_ns)
    assert np.array_equal(samples(again.recording.blocks[topic])[1], after)


@pytest.mark.parametrize(
    ("name", "size"), [("probe_stuck", 1.0), ("probe_stepped", 4e-6), ("probe_drifts", 1e-6), ("probe_noisy", 40.0),
                       ("probe_saturated", -1.0), ("probe_gain_double", 2.0)]
)  # fmt: skip
def test_a_fault_does_what_its_name_promises(name, size):
    topic = next(iter(healthy().probes))
    section = healthy().probes[topic]
    injected = put(name, begin=2.0, size=size, topic=topic)
    times, before = samples(healthy().blocks[topic])
    after = samples(injected.recording.blocks[topic])[1]
    acting = times >= injected.begin_ns
    seconds = (times - injected.begin_ns)[acting] * 1e-9
    old, new = before[acting, 0], after[acting, 0]
    room = 1.01 * section["resolution"]
    expected = {
        "probe_stuck": np.full_like(old, before[~acting][-1, 0]),
        "probe_stepped": old + 4e-6,
        "probe_drifts": old + 1e-6 * seconds,
        "probe_saturated": np.full_like(old, -section["range"]),
        "probe_gain_double": 2.0 * old,
    }
    if name == "probe_noisy":
        extra = np.sqrt(40.0**2 - 1.0) * section["noise"]
        assert np.isclose((new - old).std(), extra, rtol=0.1)
    else:
        assert np.abs(new - expected[name]).max() < room


def test_faults_of_probes_are_no_faults_of_every_recording():
    """Of those some are put into recordings that have no probe."""
    assert not set(FAULTS) & set(PROBE_FAULTS)
    assert all(fault.streams == "probe" for fault in PROBE_FAULTS.values())
    assert all(fault.sentence.endswith(".") for fault in PROBE_FAULTS.values())


@pytest.mark.parametrize("seed", range(4))
def test_a_stage_of_probes_alone_has_no_other_sensor_and_sees_one_artefact(seed):
    """Three at 120°: the mean of what they see is the artefact's third order, whatever the axis does."""
    section = with_probes_alone(random_stage(seed), seed)
    recording = make_recording(seed, duration=1.0, stage=section, options=Options.textbook(motion="steady"))
    topics = {name for name in recording.blocks if "lvdt" not in name}
    assert topics == {"/stage/command/samples", *recording.probes} and not recording.head_topics
    times = np.linspace(0.0, 1.0, 200)
    at = recording.truth.at(times)
    probes = list(section["sensors"].values())
    seen = [(probe_reading(at, probe) - probe["zero"]) / probe["gain"] for probe in probes]
    (third,) = [row for row in probes[0]["form"] if row["order"] == 3]
    expected = form(probes[0]["azimuth"] - at.theta, [third])
    np.testing.assert_allclose(np.mean(seen, axis=0), expected, atol=3e-9)


def test_the_rotor_stands_off_its_command_and_follows_it_late_as_told():
    options = Options.textbook(motion="steady", peak_speed=3.0, following_error=4e-4, drive_lag=2e-4)
    rotor = make_recording(3, duration=2.0, stage=DEFAULT, options=options).truth
    times = np.linspace(0.5, 1.5, 50)
    speed = rotor.motion.velocity(times)
    at = rotor.at(times)
    np.testing.assert_allclose(at.ecc, 4e-4 - 2e-4 * speed, atol=1e-9)
    np.testing.assert_allclose(at.theta - rotor.motion.angle(times), at.ecc, atol=1e-12)
    assert np.abs(speed).max() > 1.0
