"""No evaluation of a twin in a fit is beyond the bounds of an effect's parameters, and none is silently not finite."""

from __future__ import annotations

import functools
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from probed_stage import STAGE, WITH_SECOND, blocks_of, recorded
from scipy.optimize import lsq_linear
from simulated_pointings import pointing_file, simulate_pointings

from rotary_error_monitor.blind_check.cases import draw_machine
from rotary_error_monitor.cases.making import make_machine_case, make_stage_case
from rotary_error_monitor.effects.effect import Cause, Parameter, Role
from rotary_error_monitor.effects.library import effect_named, load_effects
from rotary_error_monitor.effects.machine_effect import MachineEffect
from rotary_error_monitor.effects.rotor import StageEffect, effects_of
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.gap.bounded import descend_within, solve_within
from rotary_error_monitor.gap.diagnosis import diagnose
from rotary_error_monitor.gap.fitting import fit_causes
from rotary_error_monitor.gap.hypotheses import HypothesisTable
from rotary_error_monitor.gap.normal import combine
from rotary_error_monitor.gap.sentences import describe_cause
from rotary_error_monitor.gap.verdict import Verdict
from rotary_error_monitor.kinds.machine.problem import MachineProblem
from rotary_error_monitor.kinds.mount.description import MountDescription
from rotary_error_monitor.kinds.mount.effects import MountEffect
from rotary_error_monitor.kinds.mount.pointings import parse_pointings
from rotary_error_monitor.kinds.mount.problem import MountProblem
from rotary_error_monitor.kinds.quadrature.description import QuadratureDescription
from rotary_error_monitor.kinds.quadrature.effects import QuadratureEffect
from rotary_error_monitor.kinds.quadrature.problem import QuadratureProblem
from rotary_error_monitor.kinds.quadrature.twin import QuadratureRecording
from rotary_error_monitor.kinds.stage.problem import StageProblem
from rotary_error_monitor.twin.document import causes_from_rows
from rotary_error_monitor.twin.finite import UnpredictableError
from rotary_error_monitor.twin.machine import MachineRecording
from rotary_error_monitor.twin.recording import record_stage

KINDS = {
    "stage": StageEffect,
    "probed stage": StageEffect,
    "machine": MachineEffect,
    "mount": MountEffect,
    "quadrature": QuadratureEffect,
}
HOOKS = ("amend", "delay", "rotation", "radial", "axial", "tilt", "measured", "turn", "displacement")
PROBED = replace(STAGE, sensors={**STAGE.sensors, **WITH_SECOND.sensors})
EFFECTS = load_effects(StageEffect)
OF_ALL_STAGES = {effect.name for effect in effects_of(replace(STAGE, sensors={}), EFFECTS)}
OF_PROBES = {effect.name for effect in effects_of(PROBED, EFFECTS)} - OF_ALL_STAGES
OF_PACKAGES = {effect.name for effect in EFFECTS} - OF_ALL_STAGES - OF_PROBES  # of kinds of sensors that others add
SHOWN = {"stage": OF_ALL_STAGES, "probed stage": OF_PROBES}
ALL = [
    (kind, effect.name)
    for kind, base in KINDS.items()
    for effect in load_effects(base)
    if effect.name in SHOWN.get(kind, (effect.name,))
]


def made_stage(effects):
    case = make_stage_case(5, "null", duration=13.0)
    recording = record_stage({name: list(blocks) for name, blocks in case.blocks.items()}, "abcd")
    return StageProblem(case.twin, recording, effects)


def made_probed_stage(effects):
    blocks = blocks_of(recorded(5, stage=PROBED))
    return StageProblem(PROBED, record_stage(blocks, "abcd", listed=tuple(PROBED.sensors)), effects)


def made_machine(effects):
    case = make_machine_case(draw_machine(5), 5, "null", rough=True)
    recording = MachineRecording(case.poses.positions, case.poses.directions, case.temperature, case.probe)
    return MachineProblem(case.twin, recording, effects)


def made_mount(effects):
    recording = parse_pointings(pointing_file(simulate_pointings(1)), "made")
    return MountProblem(MountDescription("mount", 5e-6), recording, effects)


def round_signals(seed=3, gain=0.0):
    rng = np.random.default_rng(seed)
    phase = rng.uniform(-np.pi, np.pi, 6000)
    noise = 0.6 * rng.normal(size=(2, 6000))
    return (1 + gain / 2) * 505 * np.cos(phase) + noise[0] + 1j * ((1 - gain / 2) * 505 * np.sin(phase) + noise[1])


def made_quadrature(effects, gain=0.0):
    twin = QuadratureDescription("signals", 3.164e-7, 500.0, 50.0, 0.29)
    return QuadratureProblem(twin, QuadratureRecording(round_signals(gain=gain)), effects)


MAKE = {
    "stage": made_stage,
    "probed stage": made_probed_stage,
    "machine": made_machine,
    "mount": made_mount,
    "quadrature": made_quadrature,
}


@functools.cache
def problem_of(kind):
    return MAKE[kind](load_effects(KINDS[kind]))


@contextmanager
def watched(effects):
    """Values beyond their bounds with which a hook of an effect is called, by name of the effect."""
    beyond = []

    def watching(effect, hook):
        def called(*arguments):
            values = arguments[1] if hook == "amend" else arguments[0]
            if not np.array_equal(effect.held(values), values):
                beyond.append((effect.name, hook, values.copy()))
            return hook_of(*arguments)

        hook_of = getattr(effect, hook)
        return called

    for effect in effects:
        for hook in HOOKS:
            if hasattr(effect, hook):
                setattr(effect, hook, watching(effect, hook))
    try:
        yield beyond
    finally:
        for effect in effects:
            for hook in HOOKS:
                vars(effect).pop(hook, None)


class Pushed:
    """A problem with data that ask for effects of any size."""

    def __init__(self, problem, rows):
        self._problem, self._rows = problem, rows

    def __getattr__(self, name):
        return getattr(self._problem, name)

    def residual(self, causes):
        left = self._problem.residual(causes)
        return {channel: rows + self._rows.get(channel, 0.0) for channel, rows in left.items()}


def candidate_of(problem, name, place):
    """A proposed candidate of that effect: one of its places."""
    rest = problem.residual(())
    found = [candidate for candidate in problem.candidates(rest, ()) if candidate.effect.name == name]
    return found[place % len(found)] if found else None


def pushed(problem, candidate, factors):
    """The problem with data in which that candidate would have to be so many times its bounds large."""
    linear = candidate.linear
    largest = candidate.effect.bounds()[1][linear]
    at_zero = candidate.cause(np.zeros(len(linear)))
    columns = problem.signature(at_zero, linear)
    amplitudes = largest * np.resize(factors, len(linear))
    return Pushed(problem, combine(problem, [columns], [amplitudes]) if columns else {}), columns


@pytest.mark.parametrize(("kind", "name"), [*ALL, *(("stage", name) for name in sorted(OF_PACKAGES))])
def test_every_parameter_has_bounds_that_hold_its_usual_size(kind, name):
    effect = effect_named(name, load_effects(KINDS[kind]))
    low, high = effect.bounds()
    assert np.isfinite(low).all() and np.isfinite(high).all() and np.all(low < high)
    linear = effect.indices(Role.LINEAR)
    assert np.all(low[linear] <= -effect.scales()[linear]) and np.all(effect.scales() <= high)
    for parameter in effect.parameters:
        if parameter.role is Role.SHAPE:
            assert parameter.range[0] > 0, "a shape of no length has no prediction"


FACTORS = st.lists(st.floats(-30, 30, allow_nan=False), min_size=1, max_size=4)


@pytest.mark.parametrize(("kind", "name"), ALL)
@settings(max_examples=3, deadline=None, suppress_health_check=list(HealthCheck), derandomize=True)
@given(place=st.integers(0, 30), factors=FACTORS, start=FACTORS)
def test_no_evaluation_in_a_fit_is_beyond_bounds(kind, name, place, factors, start):
    problem = problem_of(kind)
    candidate = candidate_of(problem, name, place)
    assert candidate is not None
    with watched(problem.effects) as beyond:
        loud, columns = pushed(problem, candidate, factors)
        effect = candidate.effect
        low, high = effect.bounds()
        table = HypothesisTable(loud, loud.residual(()), loud.nuisance(()), [candidate], [columns])
        for hypothesis in table.singles():
            (estimate,) = table.causes(hypothesis)
            assert np.all((low <= estimate.values) & (estimate.values <= high))
            assert np.isfinite(hypothesis.log_evidence) and hypothesis.reduction >= 0
        values = candidate.start.copy()
        values[candidate.linear] = high[candidate.linear] * np.resize(start, len(candidate.linear))
        fit = fit_causes(loud, [Cause(effect, candidate.location, values)])
        assert np.all((low <= fit.causes[0].values) & (fit.causes[0].values <= high))
        assert np.isfinite(fit.squares) and np.isfinite(fit.covariances[0]).all()
    assert beyond == []


@pytest.mark.parametrize("kind", ["stage", "machine", "quadrature"])
def test_no_evaluation_in_a_diagnosis_is_beyond_bounds(kind):
    problem = MAKE[kind](load_effects(KINDS[kind]))
    name = {"stage": "disc_scale", "machine": "axis_scale", "quadrature": "unequal_gain"}[kind]
    candidate = candidate_of(problem, name, 0)
    loud, _ = pushed(problem, candidate, [-2.00002])
    problem.residual = loud.residual
    loud._problem = MAKE[kind](problem.effects)
    with watched(problem.effects) as beyond:
        diagnosis = diagnose(problem)
    assert beyond == []
    for found in diagnosis.causes:
        low, high = found.cause.effect.bounds()
        assert np.all((low <= found.cause.values) & (found.cause.values <= high))


def test_a_result_at_its_bound_is_said_to_be_there():
    gain = [effect for effect in load_effects(QuadratureEffect) if effect.name == "unequal_gain"]
    diagnosis = diagnose(made_quadrature(gain, gain=0.9))
    (found,) = diagnosis.causes
    assert diagnosis.verdict is not Verdict.EXPLAINED
    assert found.cause.values == pytest.approx([0.5], abs=0)
    assert found.as_mapping()["at_bounds"] == {"relative": 0.5}
    assert "relative at the bound of what is physically sensible" in describe_cause(found)
    assert any("unequal_gain: relative is at its bound, 0.5 1" in remark for remark in diagnosis.remarks)
    within = diagnose(made_quadrature(gain, gain=0.04)).causes[0]
    assert not within.at_bounds and "at_bounds" not in within.as_mapping()


class Explodes(StageEffect):
    """An effect of a user's that gives numbers only up to some size."""

    name = "explodes"
    parameters = (Parameter("offset", "rad", 1e-6, bound=1.0),)
    acts_on = ("autocollimator",)
    largest = 0.0

    def measured(self, values, location, state, ideal):
        return ideal + (values[0] if abs(values[0]) <= self.largest else np.nan)


def test_a_candidate_that_cannot_be_predicted_is_dropped_and_counted(stage_problem):
    effects = [*load_effects(StageEffect), Explodes()]
    problem, truth = stage_problem(5, "single", ["mirror_wobble"], (150.0, 300.0), stage_effects=effects)
    diagnosis = diagnose(problem)
    assert diagnosis.verdict is Verdict.EXPLAINED
    assert [found.cause.key for found in diagnosis.causes] == [("mirror_wobble", "")]
    assert [remark for remark in diagnosis.remarks if "not finite: explodes" in remark and remark.startswith("1 cand")]


def test_a_fit_takes_smaller_steps_where_the_twin_gives_no_numbers(stage_problem):
    effect = Explodes()
    effect.largest = 2e-6
    problem, _ = stage_problem(5, "null", stage_effects=[effect])
    columns = problem.signature(Cause(effect, "", np.zeros(1)), [0])
    loud = Pushed(problem, combine(problem, [columns], [np.array([1e-5])]))
    fit = fit_causes(loud, [Cause(effect, "", np.array([1e-5]))])
    assert 1e-6 < fit.causes[0].values[0] <= 2e-6
    assert np.isfinite(fit.squares)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_what_is_not_finite_never_leaves_a_twin_silently(value, stage_problem):
    problem, _ = stage_problem(5, "null")

    class Broken(StageEffect):
        name = "broken"
        parameters = (Parameter("offset", "rad", 1e-6, bound=1.0),)

        def measured(self, values, location, state, ideal):
            return np.where(np.arange(len(ideal)) == 3, value, ideal.T).T

    with pytest.raises(
        UnpredictableError, match=r"head_a gets values that are not finite.* with broken of offset 1e-06"
    ):
        problem.twin.predict((Cause(Broken(), "", np.array([1e-6])),), ["head_a"])
    # The range of the autocollimator would hide what is infinite.
    with pytest.raises(UnpredictableError, match="autocollimator gets values that are not finite"):
        problem.twin.predict((Cause(Broken(), "", np.array([1e-6])),), ["autocollimator"])


def test_a_twin_that_cannot_be_predicted_is_refused_with_what_is_wrong(stage_problem):
    problem, _ = stage_problem(5, "null")
    eccentric = effect_named("disc_eccentricity", problem.effects)
    stage = eccentric.amend(problem.stage, np.array([0.2, 0.0]), "")
    with pytest.raises(
        InputError, match=r"head_a gets values that are not finite.*eccentricity than the ring's radius"
    ):
        StageProblem(stage, problem.recording, problem.effects)


@pytest.mark.parametrize(
    ("name", "parameters"),
    [("disc_scale", {"relative": -1.00001}), ("head_latency", {"delay": 2.0}), ("disc_scale", {"relative": 1e300})],
)
def test_a_known_effect_beyond_its_bounds_is_refused(name, parameters):
    rows = [{"effect": name, "location": "", "parameters": parameters}]
    with pytest.raises(InputError, match=rf"{name}: \w+ = \S+ .*physically sensible is -\S+ to"):
        causes_from_rows(rows, load_effects(StageEffect), "twin.yaml")


def test_derivatives_at_a_bound_are_taken_inward():
    effect = effect_named("disc_scale", load_effects(StageEffect))
    assert effect.inward(np.array([0.5]), 0, 1e-5) == -1e-5
    assert effect.inward(np.array([-0.5]), 0, 1e-5) == 1e-5
    problem = problem_of("stage")
    at, below = (problem.signature(Cause(effect, "", np.array([v])), [0]) for v in (0.5, 0.49999))
    for channel, rows in at.items():
        np.testing.assert_allclose(rows, below[channel], rtol=0, atol=2e-3 * np.abs(rows).max())


SQUARE = st.integers(1, 7).flatmap(
    lambda n: st.tuples(st.just(n), st.integers(0, 2**32 - 1), st.floats(-3, 1), st.floats(-2, 2))
)


@settings(max_examples=200, deadline=None)
@given(drawn=SQUARE)
def test_least_squares_within_bounds_is_that_of_scipy(drawn):
    size, seed, noise, width = drawn
    rng = np.random.default_rng(seed)
    table = rng.normal(size=(4 * size, size)) + rng.normal(size=(4 * size, 1))
    data = 3 * rng.normal(size=4 * size)
    low, high = -(10.0**width) * rng.random(size), 10.0**width * rng.random(size)
    gram, moment = table.T @ table, table.T @ data
    free = np.linalg.solve(gram, moment)
    best = lsq_linear(table, data, (low, high), method="bvls", tol=1e-14)
    found = solve_within(gram, moment, low, high, free)
    assert np.all((low <= found) & (found <= high))
    cost = np.sum(np.square(table @ found - data)) - np.sum(np.square(table @ best.x - data))
    assert cost <= 1e-9 * np.sum(np.square(data))
    many = descend_within(gram[None], moment[None], low[None], high[None], free[None])[0]
    assert np.all((low <= many) & (many <= high))
    assert np.sum(np.square(table @ many - data)) <= np.sum(np.square(table @ best.x - data)) + 0.05
