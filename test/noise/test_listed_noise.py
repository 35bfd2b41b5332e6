"""Noise of sensors that a stage lists: each has its own, of one kind or not."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest
from draws import seeds
from probed_stage import HIGH, LOW, SECONDS, STAGE, TOP, Withheld, blocks_of, recorded

from rotary_error_monitor.effects.library import load_effects
from rotary_error_monitor.effects.rotor import StageEffect
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.gap.diagnosis import diagnose
from rotary_error_monitor.gap.noise_level import LOUDEST
from rotary_error_monitor.gap.verdict import Verdict
from rotary_error_monitor.kinds.stage.problem import StageProblem
from rotary_error_monitor.noise.channels import channels_of, noise_std
from rotary_error_monitor.noise.stage_noise import StageNoise
from rotary_error_monitor.sensors.library import instrument_of, is_listed
from rotary_error_monitor.twin.recording import record_stage

EFFECTS = load_effects(StageEffect)


def problem_of(streams, stage=STAGE):
    return StageProblem(stage, record_stage(blocks_of(streams), "abcd", listed=tuple(stage.sensors)), EFFECTS)


def test_an_instrument_is_a_kind_or_a_listed_sensor():
    channels = ("head_a", "head_c", "autocollimator.x", "lvdt.y", TOP, LOW, HIGH, "command")
    assert [instrument_of(name) for name in channels] == (
        ["head", "head", "autocollimator", "lvdt", TOP, LOW, HIGH, "command"]
    )
    assert [name for name in channels if is_listed(name)] == [TOP, LOW, HIGH]
    assert channels_of(TOP) == (TOP,) and channels_of("lvdt") == ("lvdt.x", "lvdt.y")


def test_each_listed_sensor_has_the_noise_that_is_stated_of_it():
    std = noise_std(STAGE)
    for name, (noise, resolution) in {TOP: (8e-9, 1e-9), LOW: (1e-8, 1e-9), HIGH: (3e-8, 1e-9)}.items():
        assert std[name] == pytest.approx(np.sqrt(noise**2 + resolution**2 / 12))
    assert std["head"] == pytest.approx(np.sqrt(9e-14 + (2 * np.pi / (31488 * 400)) ** 2 / 12)) and std["lvdt"] == 0.0


@pytest.mark.parametrize("seed", range(3))
def test_rows_of_two_probes_of_one_kind_are_white_with_their_own_noise(seed):
    rng = np.random.default_rng(seed)
    recording = problem_of(recorded(seed)).recording
    drawn = {name: rng.normal(size=recording.streams[name].values.shape) for name in (TOP, LOW, HIGH)}
    std = {TOP: 8e-9, LOW: 1e-8, HIGH: 3e-8}
    residual = {name: np.zeros(recording.streams[name].values.shape) for name in recording.sensors}
    residual |= {name: std[name] * values for name, values in drawn.items()}
    residual[HIGH][500] = 4 * 3e-8  # no spike of this one, but it would be one of the other
    residual[LOW][700] = 4 * 3e-8
    noise = StageNoise(STAGE, recording, residual)
    rows = noise.whiten({name: values[:, :, None] for name, values in residual.items()})
    assert {name for name in rows if is_listed(name)} == {TOP, LOW, HIGH} <= set(noise.channels)
    for name in (TOP, LOW, HIGH):
        ordinary = np.delete(rows[name][:, 0], [500, 700])
        assert np.sqrt(np.mean(ordinary**2)) == pytest.approx(1.0, abs=0.05)
        assert not np.any(noise.expected()[name][noise.spikes[name][:, 0]])
    assert noise.spikes[LOW][700, 0] and rows[LOW][700, 0] == 0.0 and not noise.spikes[HIGH][500, 0]
    noise.with_levels({LOW: 2.0})
    after = noise.whiten({name: values[:, :, None] for name, values in residual.items()})
    np.testing.assert_allclose(after[LOW], rows[LOW] / 2)
    np.testing.assert_array_equal(after[HIGH], rows[HIGH])


@pytest.mark.parametrize("seed", range(3))
def test_a_level_is_learnt_of_the_sensor_that_has_it(seed):
    problem = problem_of(recorded(seed, Withheld(noise={LOW: 2.0})))
    diagnosis = diagnose(problem)
    assert diagnosis.verdict is Verdict.NO_GAP
    assert problem.noise.levels[LOW] == pytest.approx(2.0, rel=0.15) and problem.noise.levels[HIGH] == 1.0
    (told,) = (remark for remark in diagnosis.remarks if "noise is" in remark)
    assert re.match(rf"{LOW}: noise is (1\.9|2\.0|2\.1)", told), told


def test_what_is_louder_than_an_instrument_is_wrong_with_it_and_no_noise():
    """A loose or disturbed probe shows a white error; the shape of a target and of an axis are told beside it."""
    told = []
    for seed in seeds(9, 40):
        rng = np.random.default_rng(seed)
        name = str(rng.choice([TOP, LOW, HIGH]))
        radial = ((3, (2e-7, -1e-7), (1e-7, 2e-7)),) if rng.random() < 0.5 else ()
        level = float(rng.uniform(1.15, 4.0)) * LOUDEST
        problem = problem_of(recorded(seed, Withheld(noise={name: level}, radial=radial)))
        diagnosis = diagnose(problem)
        expected = Verdict.PARTLY_EXPLAINED if radial else Verdict.UNKNOWN
        named = [found.cause.key for found in diagnosis.causes] == [("spindle_radial", "order_3")] * bool(radial)
        remark = next((each for each in diagnosis.remarks if each.startswith(f"{name}: noise is")), "")
        right = diagnosis.verdict is expected and named and name in diagnosis.where[0].channel and bool(remark)
        told.append((right, seed, name, level, diagnosis.verdict, remark))
        assert problem.noise.levels[name] == 1.0
    assert sum(right for right, *_ in told) >= len(told) - 1, told


@pytest.mark.parametrize("seed", range(3))
def test_a_target_off_centre_is_no_noise(seed):
    """It moves a probe by as much between two samples as the noise does, but evenly."""
    sensors = {name: replace(sensor, uncertainty=3e-6) for name, sensor in STAGE.sensors.items()}
    stage = replace(STAGE, sensors=sensors)
    problem = problem_of(recorded(seed, stage=stage), stage)
    problem.learn_noise(())
    assert set(problem.noise.levels.values()) == {1.0}
    assert sum(problem.spikes().values()) == 0, "where the rotor turns back it does so within a sample"


def test_slow_noise_is_learnt_of_the_sensor_that_has_it():
    """A random walk that turns back, of half the white noise, which a stage that had one noise a kind gave to both."""
    found = []
    for seed in range(4):
        streams, rng = recorded(seed), np.random.default_rng(100 + seed)
        time, fields, values = streams[HIGH]
        orders = np.arange(1, 100)
        slow = np.cos(np.pi * np.outer(time / SECONDS, orders)) @ (rng.normal(size=99) / np.sqrt(orders))
        streams[HIGH] = time, fields, values + 2.5e-8 * (slow / slow.std())[:, None]
        problem = problem_of(streams)
        diagnosis = diagnose(problem)
        remarks = [remark for remark in diagnosis.remarks if "slow noise" in remark]
        found.append(diagnosis.verdict is Verdict.NO_GAP and all(remark.startswith(HIGH) for remark in remarks))
        assert remarks or diagnosis.verdict is not Verdict.NO_GAP
    assert sum(found) >= 3, found


def test_a_listed_sensor_without_noise_is_refused_by_its_name():
    silent = replace(STAGE.sensors[HIGH], noise=0.0, resolution=0.0)
    with pytest.raises(InputError, match=r"stage\.sensors\.high: noise and resolution together are 0 m"):
        problem_of(recorded(0), replace(STAGE, sensors={**STAGE.sensors, HIGH: silent}))
