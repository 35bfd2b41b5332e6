"""Causes of a machine that cancel one another: a departure is a part of what they do together."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rotary_error_monitor.blind_check.cases import draw_machine
from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.effects.library import effect_named, load_effects
from rotary_error_monitor.effects.machine_effect import MachineEffect
from rotary_error_monitor.gap.diagnosis import diagnose
from rotary_error_monitor.gap.fitting import fit_causes
from rotary_error_monitor.gap.posterior import times_cancelled
from rotary_error_monitor.gap.verdict import Verdict
from rotary_error_monitor.kinds.machine.problem import PROBE_STD, MachineProblem
from rotary_error_monitor.twin.machine import MachineRecording, predict_probe

EFFECTS = load_effects(MachineEffect)


def scaled(seed, scale):
    """Problem whose X is longer by so many µm/m, given what passed of the recording (n,) and warming (n,), K."""
    machine, draw = draw_machine(seed), np.random.default_rng([seed, 4])
    low, high = np.array([axis.travel for axis in machine.axes]).T
    positions = draw.uniform(low, high, (120, len(low)))
    passed = np.linspace(0, 1, 120)
    warmer = 6 * (1 - np.exp(-4 * passed))
    direction = draw.choice([-1.0, 1.0], positions.shape)
    recording = MachineRecording(positions, direction, 20 + warmer, np.zeros((120, 3)))
    probe = predict_probe(machine, recording) + PROBE_STD * draw.normal(size=(120, 3))
    probe[:, 0] += 1e-6 * positions[:, machine.letters.index("X")] * scale(passed, warmer, draw)
    return MachineProblem(machine, replace(recording, probe=probe), EFFECTS)


def at(*keys):
    """Causes without size."""
    effects = [(effect_named(name, EFFECTS), place) for name, place in keys]
    return [Cause(effect, place, effect.start(place)) for effect, place in effects]


@pytest.mark.parametrize("share", [0.0, 0.5, 0.9])
def test_how_many_times_larger_causes_are_than_both_together(share):
    """An expansion beside a scale of the opposite sign, and a squareness that cancels neither."""
    problem = scaled(400, lambda passed, warmer, draw: 10 * (warmer - share * warmer.mean()))
    causes = at(("thermal_expansion", "X"), ("axis_scale", "X"), ("squareness", "YZ"))
    fit = fit_causes(problem, causes)
    expansion, *_ = fit.causes
    own, both = (np.sum(np.square(problem.shown(some))) for some in ([expansion], fit.causes[:2]))
    found = times_cancelled(fit)
    assert found[0] == pytest.approx(max(1.0, np.sqrt(own / both)), rel=1e-3)
    assert found[2] == pytest.approx(1.0, abs=0.1)


@pytest.mark.long
def test_two_causes_that_cancel_do_not_make_up_a_third():
    """A scale that comes half-way was an expansion that wanders less another scale in five of nine."""
    verdicts = [
        diagnose(scaled(seed, lambda passed, _, draw: 2.5 * (passed > draw.uniform(0.4, 0.6)))).verdict
        for seed in range(403, 412)
    ]
    assert verdicts.count(Verdict.EXPLAINED) <= 2, verdicts
