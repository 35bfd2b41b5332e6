"""Listed sensors joined to the estimate: right within the stated covariance, judged beside it, the same bits again."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from motion_numbers import assert_same_bits, decisions_of
from pipeline.test_estimation import NAMES, SPEED, STAGE, START, in_order, true_motion, values
from pushed_inputs import push_block

from rotary_error_monitor.codec.error_motion_blocks import block_from_error_motion, error_motion_from_block
from rotary_error_monitor.description.harmonics import AngularHarmonic, PlanarHarmonic
from rotary_error_monitor.description.listed_sensors import ListedSensor
from rotary_error_monitor.description.wire import load_wire
from rotary_error_monitor.metrology.error_motion import COMPONENTS, ErrorMotion
from rotary_error_monitor.pipeline.estimation import Estimator
from rotary_error_monitor.pipeline.estimator_settings import EstimatorSettings
from rotary_error_monitor.pipeline.observability import possible_components, unchecked_sensors
from rotary_error_monitor.pipeline.repetition import OTHERS
from rotary_error_monitor.signals.blocks import block_from_samples

NOISE, STEP = 2e-8, 1e-8
STAMPS = {"encoder.timing": 1e-9, "command.timing": 1e-9}
FORM = (AngularHarmonic(1, 3e-6, -1e-6), AngularHarmonic(3, 2e-7, 1e-7))


def probe(kind: str, gain: float = 1.0, zero: float = 0.0, **place: float) -> ListedSensor:
    return ListedSensor(kind, NOISE, STEP, 5e-5, 1e-8, zero, gain, place, FORM)


AXIAL = {"axial_probe_top": probe("axial_probe", radius=0.0, zero=4e-6)}
RADIAL = {
    f"radial_probe_{name}": probe("radial_probe", azimuth=azimuth, height=height, gain=gain)
    for name, azimuth, height, gain in (
        ("x1", 0.0, 0.05, 1.0),
        ("x2", 0.0, 0.25, -1.0),
        ("y1", np.pi / 2, 0.05, 1.0),
        ("y2", np.pi / 2, 0.25, 2.0),
    )
}
FACE = {f"axial_probe_f{k}": probe("axial_probe", azimuth=2.0 * k, radius=0.08) for k in range(3)}
SECOND = {
    "tilt_sensor_second": ListedSensor(
        "tilt_sensor",
        *(3e-7, 1e-7, 5e-4, 1e-7),
        (2e-5, -1e-5),
        -1.0,
        {"roll": 0.7},
        (PlanarHarmonic(1, (4e-5, -1e-5), (1e-5, 4e-5)),),
        fields=("tilt_x", "tilt_y"),
        unit="rad",
    )
}


def truth(t: np.ndarray) -> np.ndarray:
    """(n, 6)"""
    theta, exc, eyc, eac, ebc = true_motion(t)
    return np.stack([exc, eyc, 4e-7 * np.cos(2 * theta) + 1e-7 * np.sin(5 * t), eac, ebc, theta - SPEED * t], 1)


def displacement(name: str, sensor: ListedSensor, t: np.ndarray) -> np.ndarray:
    """(n, k) by the geometry of a rigid body, without noise."""
    theta = true_motion(t)[0]
    exc, eyc, ezc, eac, ebc, _ = truth(t).T
    if sensor.unit == "rad":
        x, y = eac + 4e-5 * np.cos(theta) - 1e-5 * np.sin(theta), ebc + 1e-5 * np.cos(theta) + 4e-5 * np.sin(theta)
        cos, sin = np.cos(sensor.place["roll"]), np.sin(sensor.place["roll"])
        return np.array(sensor.zero) + sensor.gain * np.stack([cos * x - sin * y, sin * x + cos * y], axis=1)
    phi = sensor.place.get("azimuth", 0.0)
    if name.startswith("axial"):
        x, y = sensor.place["radius"] * np.cos(phi), sensor.place["radius"] * np.sin(phi)
        moved = ezc + y * eac - x * ebc
    else:
        height = sensor.place["height"]
        moved = (exc + height * ebc) * np.cos(phi) + (eyc - height * eac) * np.sin(phi)
    psi = phi - theta
    form = 3e-6 * np.cos(psi) - 1e-6 * np.sin(psi) + 2e-7 * np.cos(3 * psi) + 1e-7 * np.sin(3 * psi)
    return (sensor.zero + sensor.gain * (moved + form))[:, None]


def recorded(sensors, seed=0, duration=4.0, fault=None, tilt=True, rate=1000.0):
    """Pairs of stream and block with noise and steps, in the order of their ends; `fault(name, t, readings)` spoils."""
    draw, made = np.random.default_rng(seed), {}
    for number, name in enumerate((*(n for n in NAMES if tilt or n != "autocollimator"), *sensors)):
        times = np.arange(round(duration * rate)) * round(1e9 / rate) + 9000 * number
        t = times * 1e-9
        if name in sensors:
            own = sensors[name]
            readings = displacement(name, own, t)
            readings = readings + abs(own.gain) * draw.normal(size=readings.shape) * own.noise
            readings = np.round(readings / own.resolution) * own.resolution
            fields = own.fields
        else:
            fields = ("tilt_x", "tilt_y") if name == "autocollimator" else ("angle",)
            readings = values(name, t)
            if name != "command":
                readings = readings + draw.normal(size=readings.shape) * (5e-7 if len(fields) == 2 else 3e-7)
                step = 5e-7 if len(fields) == 2 else 2 * np.pi / 3148800
                readings = np.round(readings / step) * step
        if fault is not None:
            readings = fault(name, t, readings, draw)
        made[name] = [
            block_from_samples(START + times[i : i + 20], fields, readings[i : i + 20]) for i in range(0, len(t), 20)
        ]
    return in_order(made)


def described(sensors, tilt=True, **changes):
    limits = {"axial": 5e-6, "axial_rate": 5e-5, "radial": 1.5e-5, "radial_rate": 4e-5, "tilt": 1e-4, "tilt_rate": 1e-4}
    stage = dataclasses.replace(STAGE, sensors=sensors, stated_limits=limits, uncertainty=STAMPS, **changes)
    return stage if tilt else dataclasses.replace(stage, autocollimator=None)


def run(pairs, stage, **options):
    estimator = Estimator(stage, EstimatorSettings(), **options)
    doubted, out = {}, []
    for name, block in pairs:
        out += push_block(estimator, name, block)
        doubted |= {what: why for what, why in estimator.reasons if what not in doubted}
    return estimator, ErrorMotion.joined([*out, *estimator.finish()]), doubted


def off(motion):
    """(m, 6) in stated standard deviations, nan where not observable; times (m,) in s."""
    t = (motion.times_ns - START) * 1e-9
    std = np.sqrt(np.diagonal(motion.covariance, axis1=1, axis2=2))
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(motion.observable, (motion.components - truth(t)) / std, np.nan), t


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(
    ("sensors", "tilt", "gained"),
    [
        (AXIAL, True, {"ezc"}),
        (RADIAL, False, {"eac", "ebc"}),
        (FACE, False, {"ezc", "eac", "ebc"}),
        (AXIAL | RADIAL | FACE, True, {"ezc"}),
        (SECOND, False, {"eac", "ebc"}),
        (AXIAL | SECOND, True, {"ezc"}),
    ],
)
def test_what_sensors_add_is_right_within_its_covariance(seed, sensors, tilt, gained):
    pairs = recorded(sensors, seed, tilt=tilt)
    estimator, result, doubted = run(pairs, described(sensors, tilt))
    assert not doubted
    found, t = off(result)
    late = t > 2.5  # after the first turn, from which on the description is verified
    assert {name for name, seen in zip(COMPONENTS, np.isfinite(found[late]).all(axis=0), strict=True) if seen} >= gained
    assert np.nanmax(np.abs(found)) < 6.0
    places = [COMPONENTS.index(name) for name in gained]
    spread = np.sqrt(np.mean(found[late][:, places] ** 2, axis=0))
    assert (spread < 1.3).all(), spread
    assert set(estimator.inputs) >= set(sensors)


def test_the_standard_deviation_is_that_of_the_probe():
    """On the axis a probe shows the axial error motion alone: its noise, a step, what is stated of its form."""
    _, result, _ = run(recorded(AXIAL), described(AXIAL))
    late = (result.times_ns - START) > 2.5e9
    std = np.sqrt(result.covariance[late, 2, 2])
    expected = np.sqrt(NOISE**2 + STEP**2 / 12 + 1e-8**2)
    assert 0.7 * expected < np.median(std) < 1.2 * expected


def test_heads_and_autocollimator_stay_what_they_are():
    """To the last bit, whatever the probes show: also one that is described upside down."""
    wrong = {"radial_probe_x1": dataclasses.replace(RADIAL["radial_probe_x1"], gain=-1.0)}
    sensors = AXIAL | RADIAL
    pairs = recorded(sensors)
    _, alone, _ = run([pair for pair in pairs if pair[0] not in sensors], described({}))
    _, beside, _ = run(pairs, described(sensors | wrong))
    assert beside.observable[:, 2].all() and not alone.observable[:, 2].any()
    beside.hide(np.ones(len(beside.theta), np.bool_), [2])
    assert_same_bits(without_sensors(beside, alone), alone)


def without_sensors(beside, alone):
    """The same, but for what it says of the listed sensors themselves."""
    of_sensors = {name: getattr(alone, name) for name in ("streams", "sensor_scale", "sensor_conflict")}
    return dataclasses.replace(beside, **of_sensors)


@pytest.mark.parametrize("seed", range(3))
def test_probes_that_contradict_one_another_are_as_uncertain_as_that(seed):
    """Without autocollimator nothing says which is wrong: off by 1 µm, a hundred times what is stated."""
    sensors = FACE | {"axial_probe_nose": AXIAL["axial_probe_top"]}
    wrong = dataclasses.replace(sensors["axial_probe_f1"], zero=1e-6)
    pairs = recorded(sensors, seed, tilt=False)
    estimator, result, doubted = run(pairs, described(sensors | {"axial_probe_f1": wrong}, tilt=False))
    assert not doubted and estimator.sensor_conflict > 20.0
    found, t = off(result)
    assert (np.abs(found[t > 0.2]) > 6.0).any(axis=1).mean() <= 0.002
    right, _, _ = run(pairs, described(sensors, tilt=False))
    assert right.sensor_conflict == 1.0


def test_columns_are_those_of_the_contract():
    _, result, _ = run(recorded(AXIAL, duration=0.3), described(AXIAL))
    topic = load_wire(sensors=tuple(AXIAL)).topic("error_motion_samples")
    block = block_from_error_motion(result, topic.columns)
    assert block.names[1:] == topic.columns
    assert topic.field("streams").bits == (*NAMES, *AXIAL)
    assert result.streams[-1] == topic.field("streams").mask((*NAMES, *AXIAL))
    assert load_wire().topic("error_motion_samples").columns == topic.columns[: len(topic.columns) - 15]


@pytest.mark.parametrize("sensors", [AXIAL, RADIAL, FACE, SECOND])
def test_on_the_wire_it_is_the_same_to_the_last_bit(sensors):
    """Both halves of the covariance: one of them is sent."""
    _, result, _ = run(recorded(sensors, duration=0.3, tilt=False), described(sensors, tilt=False))
    columns = load_wire(sensors=tuple(sensors)).topic("error_motion_samples").columns
    assert_same_bits(error_motion_from_block(block_from_error_motion(result, columns)), result)


def test_what_a_stage_can_determine_and_what_it_cannot_check():
    none = described({}), described({}, tilt=False)
    assert [possible_components(stage) for stage in none] == [
        ("exc", "eyc", "eac", "ebc", "ecc"),
        ("exc", "eyc", "ecc"),
    ]
    assert possible_components(described(AXIAL)) == COMPONENTS
    assert possible_components(described(RADIAL, tilt=False)) == ("exc", "eyc", "eac", "ebc", "ecc")
    assert possible_components(described(FACE, tilt=False)) == COMPONENTS
    assert unchecked_sensors(described(AXIAL | RADIAL)) == ("axial_probe_top",)
    assert unchecked_sensors(described(FACE, tilt=False)) == tuple(FACE)
    assert unchecked_sensors(described(FACE | AXIAL, tilt=False)) == ()


def in_blocks(pairs, draw):
    """The same blocks, several handed over before each reckoning."""
    return np.split(np.arange(len(pairs)), np.unique(draw.integers(1, len(pairs), 60)))


def test_a_replay_gives_the_same_bits_however_blocks_come():
    sensors = AXIAL | RADIAL
    stage = described(sensors)
    pairs = recorded(sensors, seed=5, duration=1.5, fault=jumping("axial_probe_top", 0.6, 5e-6))
    _, live, doubted = run(pairs, stage)
    assert set(doubted) == {"axial_probe_top"}
    assert_repeated(pairs, stage, live)


def assert_repeated(pairs, stage, live):
    """That the same blocks, however they come, give the rows of a live run to the last bit."""
    estimator, out = Estimator(stage, EstimatorSettings(), decisions_of(live)), []
    for chosen in in_blocks(pairs, np.random.default_rng(1)):
        for i in chosen:
            estimator.accept(*pairs[i])
        out += estimator.advance()
    assert_same_bits(ErrorMotion.joined([*out, *estimator.finish()]), live)


def test_a_description_without_the_sensors_of_the_live_run_does_not_repeat_it():
    pairs = recorded(AXIAL, duration=0.5)
    _, live, _ = run(pairs, described(AXIAL))
    again = Estimator(described({}), EstimatorSettings(), decisions_of(live))
    for name, block in pairs:
        if name not in AXIAL:
            push_block(again, name, block)
    again.finish()
    assert again.unrepeated.keys() == {OTHERS} and len(np.concatenate(again.unrepeated[OTHERS])) > 300


def jumping(which, when, by):
    return lambda name, t, readings, draw: readings + by * (t > when)[:, None] if name == which else readings


def stuck(which, when):
    def spoil(name, t, readings, draw):
        if name == which:
            readings = readings.copy()
            readings[t > when] = readings[np.searchsorted(t, when)]
        return readings

    return spoil


def drifting(which, when, speed):
    return lambda name, t, readings, draw: (
        readings + speed * np.maximum(t - when, 0.0)[:, None] if name == which else readings
    )


def noisy(which, when, std):
    return lambda name, t, readings, draw: (
        readings + std * draw.normal(size=readings.shape) * (t > when)[:, None] if name == which else readings
    )


def scaled(which, by):
    return lambda name, t, readings, draw: readings * by if name == which else readings


def spoilt(which, when, value):
    return lambda name, t, readings, draw: np.where(t[:, None] > when, value, readings) if name == which else readings


FAULTS = {
    "a step of 5 µm": lambda which, when: jumping(which, when, 5e-6),
    "a step back of 1 µm": lambda which, when: jumping(which, when, -1e-6),
    "stuck": stuck,
    "ten times the noise": lambda which, when: noisy(which, when, 10 * NOISE),
    "a hundred times the noise": lambda which, when: noisy(which, when, 100 * NOISE),
    "in millimetres": lambda which, when: scaled(which, 1e3),
    "not a number": lambda which, when: spoilt(which, when, np.nan),
    "infinite": lambda which, when: spoilt(which, when, np.inf),
    "at the end of its range": lambda which, when: spoilt(which, when, 5e-5),
    "huge": lambda which, when: spoilt(which, when, 1e30),
}


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("which", ["axial_probe_top", "radial_probe_x1", "radial_probe_y2"])
def test_a_sensor_that_fails_makes_nothing_wrong(fault, which):
    """From 100 ms after it begins at most 0.2 % of what is published is beyond six stated standard deviations."""
    sensors = AXIAL | RADIAL
    wrong = total = 0
    for seed in range(3):
        when = 2.4 + 0.37 * seed
        pairs = recorded(sensors, seed, duration=when + 1.0, fault=FAULTS[fault](which, when))
        _, result, doubted = run(pairs, described(sensors))
        found, t = off(result)
        after = t > when + 0.1
        beyond = np.abs(found[after]) > 6.0
        wrong, total = wrong + int(beyond.any(axis=1).sum()), total + int(after.sum())
        assert set(doubted) <= {which}, doubted
    assert total > 2000
    assert wrong <= 0.002 * total


@pytest.mark.parametrize("seed", range(3))
def test_a_drift_of_one_of_several_is_told(seed):
    """1 µm/s on a probe beside heads that see the same: what is said and left out once it is beyond what is stated."""
    sensors = RADIAL
    pairs = recorded(sensors, seed, duration=4.0, fault=drifting("radial_probe_x2", 2.4, 1e-6))
    _, result, doubted = run(pairs, described(sensors))
    assert set(doubted) == {"radial_probe_x2"}
    found, t = off(result)
    assert (np.abs(found[t > 2.5]) > 6.0).any(axis=1).mean() <= 0.002


def test_a_sensor_mounted_the_other_way_is_told():
    """Gain of the opposite sign: the ring contradicts it within the first turn."""
    sensors = dict(RADIAL)
    wrong = described({**sensors, "radial_probe_x1": dataclasses.replace(sensors["radial_probe_x1"], gain=-1.0)})
    _, result, doubted = run(recorded(sensors), wrong)
    assert "radial_probe_x1" in doubted
    found, t = off(result)
    assert (np.abs(found[t > 2.5]) > 6.0).any(axis=1).mean() <= 0.002


def test_a_sensor_that_comes_back_is_believed_again():
    def spoil(name, t, readings, draw):
        return readings + 5e-6 * ((t > 2.4) & (t < 2.7))[:, None] if name == "axial_probe_top" else readings

    estimator, result, doubted = run(recorded(AXIAL, fault=spoil), described(AXIAL))
    assert set(doubted) == {"axial_probe_top"} and not dict(estimator.reasons)
    seen = result.observable[:, 2]
    t = (result.times_ns - START) * 1e-9
    assert not seen[(t > 2.45) & (t < 2.69)].any()
    assert seen[t > 3.7].all()


def test_reset_believes_again():
    estimator, _, doubted = run(recorded(AXIAL, fault=stuck("axial_probe_top", 2.4)), described(AXIAL))
    assert dict(estimator.reasons).keys() == {"axial_probe_top"} == set(doubted)
    estimator.reset()
    assert not dict(estimator.reasons)


def test_a_sensor_that_is_silent_is_done_without():
    pairs = [(name, block) for name, block in recorded(AXIAL) if name != "axial_probe_top"]
    estimator, result, doubted = run(pairs, described(AXIAL))
    assert estimator.status.absent == ("axial_probe_top",) and not doubted
    assert not result.observable[:, 2].any()
    assert len(result.times_ns) > 3800
