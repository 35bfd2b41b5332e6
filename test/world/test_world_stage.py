"""The simulated recordings: against the contract's first-order formulas, reproducible, with their habits switchable."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from rotary_error_monitor.description.sections import from_content
from rotary_error_monitor.description.stage_section import StageSection

from .motion import make_motion
from .noise import Smooth, instrument_noise
from .options import MOTIONS, Options, Seeds
from .recording import AUTOCOLLIMATOR, COMMAND, FORCE, LVDT, TEMPERATURE, Recording, head_topic, samples
from .rotor import Components
from .stage import make_recording
from .stages import random_stage

CONFIG = Path(__file__).parents[2] / "config"
DEFAULT: dict[str, Any] = yaml.safe_load((CONFIG / "stage.yaml").read_text())["stage"]


def described_motion(recording: Recording, pose: Components, times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Radial and tilt error motion, each (n, 2), by the contract."""
    spindle, environment = recording.stage["spindle"], recording.truth.environment
    force, warmth = environment.force(times), environment.warmth(times)
    d = harmonics(spindle["radial"], pose.theta) + spindle["radial_compliance"] * force
    d = d + warmth[:, None] * np.array(spindle["radial_thermal"])
    g = harmonics(spindle["tilt"], pose.theta)
    return d, g + spindle["tilt_compliance"] * np.stack([-force[:, 1], force[:, 0]], axis=1)


def harmonics(rows: list[dict[str, Any]], theta: np.ndarray) -> np.ndarray:
    """(n, 2) the contract's `harm`."""
    total = np.zeros((len(theta), 2))
    for row in rows:
        c, s = np.cos(row["order"] * theta), np.sin(row["order"] * theta)
        total += np.stack([row["x"][0] * c + row["x"][1] * s, row["y"][0] * c + row["y"][1] * s], axis=1)
    return total


def turned(theta: np.ndarray, vector: list[float]) -> np.ndarray:
    """(n, 2) a rotor vector in the base."""
    c, s = np.cos(theta), np.sin(theta)
    return np.stack([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]], axis=1)


def perfect(seed: int, stage: dict[str, Any], **changes: Any) -> Recording:
    """Recording without any noise, step or habit, under force and temperature."""
    options = Options.textbook(motion="s_curves", peak_speed=1.2, force=True, temperature=True, lvdt=True, **changes)
    return make_recording(seed, duration=12.0, stage=stage, options=options)


def stages() -> list[Any]:
    """The default stage and some random ones with all sections."""
    drawn = [stage for stage in map(random_stage, range(40)) if {"lvdt", "mirror"} <= set(stage)]
    return [DEFAULT, *drawn[:6]]


@pytest.mark.parametrize("index", range(7))
def test_readings_are_those_of_the_contract_within_second_order(index):
    stage = stages()[index]
    recording = perfect(index, stage)
    encoder = stage["encoder"]
    for head, place in encoder["heads"].items():
        ns, values = samples(recording.blocks[head_topic(head)])
        pose, phi = recording.truth(ns), place["azimuth"]
        d, _ = described_motion(recording, pose, (ns - recording.start_ns) * 1e-9)
        np.testing.assert_allclose(np.stack([pose.exc, pose.eyc], axis=1), d, atol=1e-15)
        c = d + turned(pose.theta, encoder["eccentricity"])
        psi = phi - pose.theta
        waves = [
            r["cos"] * np.cos(r["order"] * psi) + r["sin"] * np.sin(r["order"] * psi) for r in encoder["graduation"]
        ]
        expected = pose.theta + (-c[:, 0] * np.sin(phi) + c[:, 1] * np.cos(phi)) / encoder["disc_radius"] + sum(waves)
        assert np.abs(values[:, 0] - expected).max() < recording.count
        assert np.abs(values[:, 0] - pose.theta).max() > 2.0 * np.abs(values[:, 0] - expected).max()


@pytest.mark.parametrize("index", range(7))
def test_tilt_and_lvdt_are_those_of_the_contract_within_second_order(index):
    stage = stages()[index]
    stage = {**stage, "autocollimator": {**stage["autocollimator"], "turbulence": {"std": 0, "correlation_time": 1}}}
    recording = perfect(index, stage)
    ns, values = samples(recording.blocks[AUTOCOLLIMATOR])
    pose = recording.truth(ns)
    _, g = described_motion(recording, pose, (ns - recording.start_ns) * 1e-9)
    np.testing.assert_allclose(np.stack([pose.eac, pose.ebc], axis=1), g, atol=1e-15)
    tilt = turned(pose.theta, stage["mirror"]["tilt"]) + g + harmonics(stage["mirror"]["flatness"], pose.theta)
    assert np.abs(values - tilt).max() < 2.0 * np.abs(tilt).max() ** 2 + 1e-10
    ns, values = samples(recording.blocks[LVDT])
    pose, lvdt = recording.truth(ns), stage["lvdt"]
    d, g = described_motion(recording, pose, (ns - recording.start_ns) * 1e-9)
    arm = lvdt["height"] * np.stack([g[:, 1], -g[:, 0]], axis=1)
    radial = d + arm + turned(pose.theta, lvdt["artefact_eccentricity"])
    assert np.abs(values - radial).max() < np.abs(radial).max() ** 2 / 0.0127 + 1e-10


def test_command_is_the_rotation_without_jitter():
    recording = perfect(3, DEFAULT, jitter=1.0)
    ns, values = samples(recording.blocks[COMMAND])
    pose = recording.truth(ns)
    assert np.allclose(pose.theta - pose.ecc, values[:, 0], atol=1e-8)
    assert 5e-7 < pose.ecc.std() < 5e-6
    slope = np.gradient(values[:, 0], (ns - ns[0]) * 1e-9)
    assert np.abs(slope - values[:, 1])[1:-1].max() < 1e-2


@pytest.mark.parametrize("name", MOTIONS)
def test_velocity_is_the_derivative_of_the_angle(name):
    times = np.linspace(0.0, 20.0, 400)
    options = Options(motion=name, peak_speed=1.0, start_angle=-40.0)
    _, motion = make_motion(Seeds(5), 20.0, options)
    slope = (motion.angle(times + 1e-5) - motion.angle(times - 1e-5)) / 2e-5
    assert np.allclose(slope, motion.velocity(times), atol=1e-6)
    assert abs(motion.angle(np.zeros(1))[0] + 40.0) < 1e-9
    assert np.abs(motion.velocity(times)).max() <= 1.0 + 1e-12


def test_one_seed_gives_one_recording_and_another_seed_another():
    first, second, other = (make_recording(seed, duration=3.0, stage=DEFAULT) for seed in (7, 7, 8))
    assert first.blocks.keys() == second.blocks.keys()
    for topic, blocks in first.blocks.items():
        assert [b.stamp_ns for b in blocks] == [b.stamp_ns for b in second.blocks[topic]]
        assert np.array_equal(samples(blocks)[1], samples(second.blocks[topic])[1])
        assert np.array_equal(first.arrivals[topic], second.arrivals[topic])
    assert first.start_ns != other.start_ns


def test_a_habit_switched_off_leaves_the_others_as_they_are():
    with_force = make_recording(4, duration=3.0, stage=DEFAULT, options=Options(force=True, motion="steady"))
    without = make_recording(4, duration=3.0, stage=DEFAULT, options=Options(force=False, motion="steady"))
    for topic in without.blocks:
        assert np.array_equal(samples(with_force.blocks[topic])[0], samples(without.blocks[topic])[0])
    assert FORCE in with_force.blocks
    assert FORCE not in without.blocks
    assert np.array_equal(samples(with_force.blocks[COMMAND])[1], samples(without.blocks[COMMAND])[1])


@pytest.mark.parametrize("seed", range(20))
def test_a_recording_is_within_the_contract(seed):
    stage = random_stage(seed) if seed % 2 else DEFAULT
    recording = make_recording(seed, duration=4.0, stage=stage)
    assert set(recording.blocks) >= {*recording.head_topics, AUTOCOLLIMATOR, COMMAND}
    for topic, blocks in recording.blocks.items():
        ns, values = samples(blocks)
        assert np.all(np.diff(ns) > 0)
        assert np.isfinite(values).all()
        assert np.all(np.diff(recording.arrivals[topic]) >= 0)
        last = np.array([block.times_ns[-1] for block in blocks])
        assert np.all(recording.arrivals[topic] > last - 20_000)
        assert all(block.names[0] == "t" and block.rows[0, 0] >= 0.0 for block in blocks)
        assert all(1 <= len(block.rows) <= 200 for block in blocks)
        assert all(len(b.rows) == 1 or b.rows[-1, 0] - b.rows[0, 0] <= 0.2 for b in blocks)
    timeline = recording.timeline()
    assert [row[0] for row in timeline] == sorted(row[0] for row in timeline)


def test_readings_come_in_steps():
    recording = make_recording(2, duration=2.0, stage=DEFAULT)
    for topic in recording.head_topics:
        counts = samples(recording.blocks[topic])[1] / recording.count
        assert np.allclose(counts, np.rint(counts), atol=1e-6)
    section = DEFAULT["autocollimator"]
    tilts = samples(recording.blocks[AUTOCOLLIMATOR])[1]
    assert np.allclose(tilts / section["resolution"], np.rint(tilts / section["resolution"]), atol=1e-6)
    assert np.abs(tilts).max() <= section["range"] + section["resolution"]


def test_a_healthy_recording_fits_its_truth():
    for seed in range(12):
        recording = make_recording(seed, duration=5.0, stage=DEFAULT)
        for topic in recording.head_topics:
            ns, values = samples(recording.blocks[topic])
            # eccentricity, spindle and graduation: some 300 µrad in all
            assert np.abs(values[:, 0] - recording.truth(ns).theta).max() < 5e-4
        ns, values = samples(recording.blocks[COMMAND])
        pose = recording.truth(ns)
        assert np.abs(values[:, 0] - pose.theta + pose.ecc).max() < 3e-5


def test_error_motion_is_the_described_one_and_a_little_more():
    options = Options(motion="steady", peak_speed=2.0, force=False, temperature=False)
    recording = make_recording(1, duration=10.0, stage=DEFAULT, options=options)
    times = np.linspace(0.0, 10.0, 4000)
    pose = recording.truth.at(times)
    d, g = described_motion(recording, pose, times)
    more = np.stack([pose.exc, pose.eyc], axis=1) - d
    assert 2e-8 < more.std() < 0.1 * d.std()
    assert 0.01 * g.std() < (np.stack([pose.eac, pose.ebc], axis=1) - g).std() < 0.1 * g.std()
    assert 1e-8 < pose.ezc.std() < 1e-6


def test_noise_has_its_size_and_its_habits():
    sizes = []
    for seed in range(40):
        noise = instrument_noise(np.random.default_rng(seed), 20_000, 2.0, shaped=True)
        sizes.append(noise.std() / 2.0)
        assert np.abs(noise).max() <= 2.0 * 1.3 * 8.0
    assert 0.65 < min(sizes) < 0.8
    assert 1.2 < max(sizes) < 1.36
    white = instrument_noise(np.random.default_rng(0), 20_000, 2.0, shaped=False)
    assert abs(white.std() - 2.0) < 0.05


def test_smooth_functions_have_unit_size_and_keep_to_their_band():
    times = np.arange(0.0, 200.0, 0.005)
    values = Smooth(np.random.default_rng(0), 200.0, 10.0)(times)[:, 0]
    power = np.abs(np.fft.rfft(values * np.hanning(len(values)))) ** 2
    frequency = np.fft.rfftfreq(len(values), 0.005)
    assert abs(values.std() - 1.0) < 0.05
    assert power[frequency > 20.0].sum() < 1e-4 * power.sum()


def test_blocks_get_lost_at_the_wanted_rate():
    options = Options(lost_blocks=0.2, block_period=0.005)
    recording = make_recording(6, duration=10.0, stage=DEFAULT, options=options)
    gaps = 0.0
    for topic in recording.head_topics:
        ns, _ = samples(recording.blocks[topic])
        gaps += 1.0 - len(ns) / (10.0 * recording.drawn["streams"][topic]["rate"])
    assert 0.1 < gaps / 4.0 < 0.3


def test_clocks_err_as_wanted():
    plain = perfect(9, DEFAULT)
    for changes, least, most in (
        ({"clock_offset": 1e-6}, 1e-9, 5e-6),
        ({"clock_wander": 1e-6}, 1e-9, 2e-6),
        ({"stamp_jitter": 1e-6}, 1e-6, 6e-6),
        ({"clock_drift": 1e-5}, 1e-7, 5e-4),
    ):
        other = perfect(9, DEFAULT, **changes)
        for topic in plain.head_topics:
            error = (samples(other.blocks[topic])[0] - samples(plain.blocks[topic])[0]) * 1e-9
            assert least < np.abs(error).max() < most
            assert np.array_equal(samples(other.blocks[topic])[1], samples(plain.blocks[topic])[1])


def test_absent_streams_mean_that_nothing_acts():
    options = Options.textbook(motion="standstill", lvdt=False)
    recording = make_recording(0, duration=2.0, stage=DEFAULT, options=options)
    assert set(recording.blocks) == {*recording.head_topics, AUTOCOLLIMATOR, COMMAND}
    assert TEMPERATURE not in recording.blocks
    assert np.ptp(recording.truth.at(np.linspace(0.0, 2.0, 50)).exc) == 0.0


@pytest.mark.parametrize("changes", [{"motion": "dance"}, {"rounding": "up"}])
def test_unknown_choices_are_refused(changes):
    with pytest.raises(ValueError, match="must be one of"):
        Options(**changes)


def test_random_stages_are_valid_and_differ():
    drawn = [random_stage(seed) for seed in range(60)]
    for stage in drawn:
        from_content(StageSection, stage, "stage")
        assert 0.02 <= stage["encoder"]["disc_radius"] <= 0.2
    assert {len(stage["encoder"]["heads"]) for stage in drawn} == {2, 3, 4, 5, 6}
    assert random_stage(5) == drawn[5]
