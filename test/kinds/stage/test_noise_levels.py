"""Noise that is quieter or louder than a stage states it, beside noise that was made of another size."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rotary_error_monitor.cases.making import make_stage_case
from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.effects.library import load_effects
from rotary_error_monitor.effects.rotor import StageEffect
from rotary_error_monitor.gap.fitting import fit_causes
from rotary_error_monitor.kinds.stage.problem import StageProblem
from rotary_error_monitor.twin.recording import record_stage

EFFECTS = load_effects(StageEffect)
INSTRUMENTS = ("head", "autocollimator", "lvdt")


def stated(stage, factor):
    """A stage whose noise, before rounding, is stated so many times as large as it is."""
    return replace(
        stage,
        encoder=replace(stage.encoder, noise=factor * stage.encoder.noise),
        autocollimator=replace(stage.autocollimator, noise=factor * stage.autocollimator.noise),
        lvdt=replace(stage.lvdt, noise=factor * stage.lvdt.noise),
    )


def problem_of(case, factor):
    blocks = {stream: list(found) for stream, found in case.blocks.items()}
    recording = record_stage(blocks, sorted(case.twin.encoder.azimuths))
    return StageProblem(stated(case.twin, factor), recording, EFFECTS)


def true_levels(stage, factor):
    """Closed form: rounding adds a twelfth of the squares of a step to both."""
    parts = {"head": stage.encoder, "autocollimator": stage.autocollimator}
    found = {}
    for name, part in parts.items():
        step = part.resolution**2 / 12
        found[name] = np.sqrt((part.noise**2 + step) / ((factor * part.noise) ** 2 + step))
    return {**found, "lvdt": 1 / factor}


@pytest.mark.parametrize("seed", [31, 32])
@pytest.mark.parametrize("factor", [0.6, 1.0, 1.3, 2.0])
def test_the_level_of_noise_is_found_to_a_few_per_cent(seed, factor):
    """Louder and quieter; what is as stated stays so. Errors of rounding that repeat make it louder than they are."""
    case = make_stage_case(seed, "null", duration=13.0)
    problem = problem_of(case, factor)
    problem.learn_noise(())
    for name, level in true_levels(case.twin, factor).items():
        assert 0.96 * level < problem.noise.levels[name] < 1.08 * level, name


@pytest.mark.few(2)
@pytest.mark.parametrize("form", ["tails", "flicker"])
@pytest.mark.parametrize("seed", [41, 42])
def test_noise_of_another_form_is_not_quieter(seed, form):
    """Of the same standard deviation, with more in what is slow, or in its tails, whose ends are left out as spikes."""
    case = make_stage_case(seed, "null", duration=13.0, noise=form)
    problem = problem_of(case, 1.0)
    problem.learn_noise(())
    assert min(problem.noise.levels[name] for name in INSTRUMENTS) > 0.9


@pytest.mark.parametrize("seed", [51, 52])
def test_noise_is_no_quieter_beside_a_fault_than_without_it(seed):
    case = make_stage_case(seed, "single", ["lvdt_artefact"], (60.0, 120.0), duration=13.0)
    problem, fault = problem_of(case, 1.5), case.truth.faults[0]
    problem.learn_noise(())
    beside = problem.noise.levels["lvdt"]
    effect = next(effect for effect in problem.effects if effect.name == fault.name)
    problem.learn_noise((Cause(effect, "", np.array(fault.shift)),))
    assert beside > problem.noise.levels["lvdt"] and 0.96 / 1.5 < problem.noise.levels["lvdt"] < 1.08 / 1.5


def test_errors_of_what_is_fitted_are_as_stated_beside_quieter_noise():
    """Root mean square of twelve errors over their standard deviations: within four of its own scatter of 0.2."""
    apart = []
    for seed in range(61, 67):
        case = make_stage_case(seed, "single", ["disc_eccentricity"], (60.0, 120.0), duration=10.0)
        problem, truth = problem_of(case, 2.0), np.array(case.truth.faults[0].shift)
        effect = next(effect for effect in problem.effects if effect.name == "disc_eccentricity")
        problem.learn_noise((Cause(effect, "", truth),))
        fit = fit_causes(problem, [Cause(effect, "", truth)])
        apart += ((fit.causes[0].values - truth) / np.sqrt(np.diag(fit.covariances[0]))).tolist()
    assert 0.5 < np.sqrt(np.mean(np.square(apart))) < 1.8
