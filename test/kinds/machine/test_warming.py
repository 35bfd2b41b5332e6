"""Thermometers of machines that expand: they round, scatter and fall silent, which is no gap and hides no fault."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from draws import seeds
from faults.documenting import Row, shows
from scipy.signal import lfilter

from rotary_error_monitor.blind_check.cases import draw_machine
from rotary_error_monitor.cases.making import make_machine_case
from rotary_error_monitor.effects.library import load_effects
from rotary_error_monitor.effects.machine_effect import MachineEffect
from rotary_error_monitor.gap.diagnosis import diagnose
from rotary_error_monitor.gap.verdict import Verdict
from rotary_error_monitor.kinds.machine.problem import MachineProblem
from rotary_error_monitor.twin.machine import MachineRecording, predict_probe

EFFECTS = load_effects(MachineEffect)


def behind(true, poses):
    """(n,) what follows a temperature with a time constant, as warm as that in the beginning."""
    passed = -np.expm1(-1 / poses)
    return lfilter([passed], [1, passed - 1], true - true[0]) + true[0]


READ = {
    "noise of 0.1 K": lambda true, noise: true + 0.1 * noise,
    "noise of 0.3 K": lambda true, noise: true + 0.3 * noise,
    "steps of 0.5 K": lambda true, noise: np.rint(2 * true) / 2,
    "steps of 1 K": lambda true, noise: np.rint(true),
    "a zero that is off": lambda true, noise: true + np.sign(noise[0]) * 0.3,
    "steps of 1 K, cut off": lambda true, noise: np.floor(true),
    "two poses behind": lambda true, noise: behind(true, 2.0) + 0.02 * noise,
    "an hour without": lambda true, noise: np.where(np.abs(np.linspace(0, 1, len(true)) - 0.6) < 0.1, np.nan, true),
}


def expanding(seed, read, kind="null"):
    """Problem and truth of a case whose machine expands as its twin says, and whose temperature is read somehow."""
    case = make_machine_case(draw_machine(seed), seed, kind, None, None, bool(seed % 2))
    draw = np.random.default_rng([seed, 9])
    passed = np.arange(len(case.temperature)) / len(case.temperature)
    swing = draw.uniform(1, 5) * np.sin(2 * np.pi * (draw.uniform(0.3, 1.5) * passed + draw.uniform()))
    true = 20 + draw.uniform(-3, 3) + swing
    twin = case.twin
    for letter in "XYZ":
        twin = twin.with_axis(letter, expansion=draw.uniform(8e-6, 12e-6))
    poses = MachineRecording(case.poses.positions, case.poses.directions, true, case.probe)
    # small errors add up: what expands does so beside all that the case has
    probe = case.probe + predict_probe(twin, poses) - predict_probe(case.twin, poses)
    shown = read(true, draw.normal(size=len(true)))
    return MachineProblem(twin, replace(poses, temperature=shown, probe=probe), EFFECTS), case.truth


@pytest.mark.parametrize("way", READ)
def test_what_a_thermometer_does_is_no_gap(way):
    """Of sixty ten had none, the others were unknown or had a cause; with the true temperatures one of ten alarms."""
    drawn = seeds(12)
    found = [diagnose(expanding(300 + seed, READ[way])[0]) for seed in drawn]
    alarms = [diagnosis for diagnosis in found if diagnosis.verdict is not Verdict.NO_GAP]
    assert len(alarms) <= 2, [(each.verdict, each.causes) for each in alarms]


@cache
def named(seed, way):
    """Whether the fault of a case is named, and it alone."""
    problem, truth = expanding(300 + seed, READ.get(way, lambda true, noise: true), "single")
    causes = [found.cause.key for found in diagnose(problem).causes]
    return causes == [(fault.name, fault.location) for fault in truth.faults]


@pytest.mark.parametrize("way", READ)
def test_a_fault_is_named_beside_it_as_beside_the_true_temperature(way):
    drawn = seeds(12)
    right, sure = sum(named(seed, way) for seed in drawn), sum(named(seed, "true") for seed in drawn)
    assert sure >= 0.6 * len(drawn) and right >= sure - max(1, len(drawn) // 6), (right, sure)


def test_a_temperature_that_was_not_recorded_is_not_known():
    """It was taken for the reference temperature, and the machine had a scale that is wrong in all axes."""
    alarms = 0
    for seed in seeds(12):
        problem, _ = expanding(300 + seed, lambda true, noise: np.full(len(true), np.nan))
        diagnosis = diagnose(problem)
        alarms += diagnosis.verdict is not Verdict.NO_GAP
        assert "temperature: not recorded; what expands by it is not known" in diagnosis.remarks
    assert alarms <= 2


@shows(
    Row(
        "joints",
        "The thermometer of a machine reads what no shop has, or nothing, at some poses of a recording",
        "`diagnose`: how many are beyond `machine.limits.temperature`, the first of them, and how many poses have none",
        "they have the temperature of a smooth course through the others, as uncertain as those leave it; without any, "
        "the reference temperature, uncertain by 3 K",
        "the diagnosis, beside that uncertainty where the machine states an expansion",
        "with the next recording",
    )
)
def test_readings_that_no_shop_has_are_told_and_not_used():
    """Digital thermometers read 85 °C before their first conversion, and -127 °C when they are off the bus."""

    def failing(true, noise):
        read = true + 0.02 * noise
        read[[0, 70]] = 85.0, -127.0
        read[100:103] = np.nan
        return read

    problem, _ = expanding(302, failing)
    sound, _ = expanding(302, lambda true, noise: true)
    off = problem.recording.temperature - sound.recording.temperature
    assert np.max(np.abs(off)) < 0.1
    count = len(off)
    assert problem.remarks({})[:2] == (
        f"temperature: 2 of {count} readings are beyond 5 to 45 °C, the first is 85; not used",
        f"temperature: 3 of {count} poses have none; it is taken from the others",
    )


def test_of_a_machine_that_does_not_expand_no_temperature_is_needed():
    case = make_machine_case(draw_machine(3), 3, "null", None, None, rough=False)
    unread = np.full(len(case.temperature), np.nan)
    poses = MachineRecording(case.poses.positions, case.poses.directions, unread, case.probe)
    problem = MachineProblem(case.twin, poses, EFFECTS)
    assert not [remark for remark in problem.remarks({}) if "temperature" in remark]
    assert problem.nuisance(()) == {} or all(
        rows.shape[1] == len(problem._shifts) for rows in problem.nuisance(()).values()
    )
