"""Periods of a linear axis: chance finds one as seldom as is named, and none where the axis stood at too few places."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rotary_error_monitor.blind_check.cases import draw_machine
from rotary_error_monitor.effects.library import load_effects
from rotary_error_monitor.effects.machine_effect import MachineEffect
from rotary_error_monitor.gap.diagnosis import diagnose
from rotary_error_monitor.gap.p_values import log_chi_square_tail
from rotary_error_monitor.kinds.machine.periods import FEWEST_PLACES, count_places, find_frequency, find_period
from rotary_error_monitor.kinds.machine.problem import PROBE_STD, MachineProblem
from rotary_error_monitor.twin.machine import MachineRecording, predict_probe

EFFECTS = load_effects(MachineEffect)


def stands_at(places, seed, scale=None):
    """Problem whose Z stands at the given places only, and errs there by micrometres (n,) of what it does at each."""
    machine, draw = draw_machine(seed), np.random.default_rng([seed, 3])
    low, high = np.array([axis.travel for axis in machine.axes]).T
    positions = draw.uniform(low, high, (120, len(low)))
    column = machine.letters.index("Z")
    positions[:, column] = draw.choice(places, 120)
    passed = np.linspace(0, 1, 120)
    recording = MachineRecording(
        positions, draw.choice([-1.0, 1.0], positions.shape), 20 + 4 * passed, np.zeros((120, 3))
    )
    probe = predict_probe(machine, recording) + PROBE_STD * draw.normal(size=(120, 3))
    if scale is not None:
        probe[:, 2] += 1e-6 * scale(positions[:, column], passed)
    return MachineProblem(machine, replace(recording, probe=probe), EFFECTS)


def test_chance_finds_a_period_as_seldom_as_is_named():
    """2.3 times as often while as many periods were paid for as are independent."""
    draw, alarms, tests = np.random.default_rng(5), 0, 39
    for _ in range(300):
        position, signal = draw.uniform(-1, 1, 150), draw.normal(size=150)
        period, trials = find_period(position, signal, tests)
        waves = np.stack([wave(2 * np.pi * position / period) for wave in (np.cos, np.sin)], axis=1)
        taken = float(np.sum(np.square(np.linalg.qr(waves)[0].T @ signal)))
        alarms += log_chi_square_tail(taken, 2) + np.log(trials) < np.log(0.1)
    assert alarms <= 45, alarms


def test_a_wave_is_found_at_places_that_are_evenly_spaced():
    """Where as many waves are an offset everywhere: one of these was found, and what the axis does was left."""
    draw, left = np.random.default_rng(6), []
    for _ in range(20):
        position = draw.choice(np.linspace(-0.9, 0.9, draw.integers(7, 13)), 150)
        wave = 5 * np.cos(2 * np.pi * position / draw.uniform(0.005, 0.05) + draw.uniform(0, 2 * np.pi))
        found = 2 * np.pi * position * find_frequency(position, 5 + wave + draw.normal(size=150), 1 / 0.5, 1 / 2e-3)
        described = np.linalg.qr(np.stack([np.ones(150), np.cos(found), np.sin(found)], axis=1))[0]
        left.append(float(np.std(wave - described @ (described.T @ wave))))
    assert sum(size < 0.5 for size in left) >= 18, left


@pytest.mark.parametrize(("places", "count"), [([0.3], 1), ([0.3, 0.30001, -0.5], 2), ([-0.9, 0.0, 0.2, 0.9], 4)])
def test_places_of_an_axis(places, count):
    assert count_places(np.repeat(places, 5)) == count < FEWEST_PLACES


def test_an_axis_that_stands_still_is_diagnosed():
    """The search for its period ended in an error of the transform."""
    for seed in range(300, 302):
        assert not diagnose(stands_at([0.3], seed)).causes


def test_what_an_axis_does_at_two_places_is_no_wave():
    """A scale that drifts was a wave of 24 mm and 3 mm, and an expansion beside it."""
    named = []
    for seed in range(310, 314):
        problem = stands_at([-0.95, 0.9], seed, lambda z, passed: -60 * z * (1 + 0.06 * z + 0.2 * (passed - 0.5)))
        diagnosis = diagnose(problem)
        named += [found.cause.effect.name for found in diagnosis.causes]
        assert any("Z stood at 2 places" in remark for remark in diagnosis.remarks)
    assert "cyclic_error" not in named
    assert sum(name == "axis_scale" for name in named) >= 3, named
