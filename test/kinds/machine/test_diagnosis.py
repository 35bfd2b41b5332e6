"""Machines from the plant: verdicts, derivatives, periods, scatter, and poses that tell effects apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rotary_error_monitor.blind_check.cases import draw_machine
from rotary_error_monitor.cases.making import make_machine_case
from rotary_error_monitor.effects.effect import Cause, Role
from rotary_error_monitor.effects.library import effect_named, load_effects
from rotary_error_monitor.effects.machine_effect import MachineEffect
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.gap.diagnosis import diagnose
from rotary_error_monitor.gap.verdict import Verdict
from rotary_error_monitor.kinds.machine.periods import find_frequency
from rotary_error_monitor.kinds.machine.problem import PROBE_STD, MachineProblem
from rotary_error_monitor.twin.machine import MachineRecording, predict_probe

EFFECTS = load_effects(MachineEffect)


@pytest.fixture
def machine_problem():
    """Function that gives the problem and the truth of a case of the plant."""

    def make(seed, kind, effects=None, snr=None, rough=False, lacking=(), probe_std=PROBE_STD):
        case = make_machine_case(draw_machine(seed), seed, kind, effects, snr, rough)
        recording = MachineRecording(case.poses.positions, case.poses.directions, case.temperature, case.probe)
        known = [effect for effect in EFFECTS if effect.name not in lacking]
        return MachineProblem(case.twin, recording, known, probe_std), case.truth

    return make


@pytest.mark.parametrize("rough", [False, True])
@pytest.mark.parametrize("name", ["squareness", "cyclic_error", "setup_offset"])
def test_a_single_effect_is_named_and_sized(name, rough, machine_problem):
    problem, truth = machine_problem(31, "single", [name], (100.0, 150.0), rough)
    diagnosis = diagnose(problem)
    assert diagnosis.verdict is Verdict.EXPLAINED
    (found,) = diagnosis.causes
    (fault,) = truth.faults
    assert found.cause.key == (fault.name, fault.location)
    for parameter, estimate in found.parameters.items():
        off = np.abs(np.subtract(estimate.value, fault.parameters[parameter]))
        assert np.all(off <= 4 * np.maximum(estimate.std, 1e-12)), parameter
    assert diagnosis.gap.shrink > 0.9


def test_no_gap_is_no_gap(machine_problem):
    assert diagnose(machine_problem(32, "null", rough=True)[0]).verdict is Verdict.NO_GAP


def test_what_merely_resembles_an_unknown_effect_is_not_named(machine_problem):
    problem, _ = machine_problem(33, "single", ["pivot_offset"], (120.0, 150.0), lacking=("pivot_offset",))
    diagnosis = diagnose(problem)
    assert diagnosis.verdict is Verdict.UNKNOWN and not diagnosis.causes


@pytest.mark.parametrize("name", ["cyclic_error", "axis_orientation", "tool_length"])
def test_derivatives_are_those_of_the_exact_machine(name, machine_problem):
    """Against differences of the exact prediction over steps a thousand times as large, central and extrapolated."""
    problem, _ = machine_problem(35, "null")
    effect = effect_named(name, EFFECTS)
    place = effect.locations(problem.machine)[0]
    values = effect.start(place) + 0.3 * effect.scales()
    if name == "cyclic_error":
        values[effect.slices()["period"]] = 0.02
    cause = Cause(effect, place, values)
    indices = list(range(len(values)))
    columns = problem.signature(cause, indices)

    def moved(index, step):
        shifted = values.copy()
        shifted[index] += step
        return predict_probe(problem.machine, problem.recording, (cause.with_values(shifted),))

    shapes = effect.indices(Role.SHAPE)
    for index in indices:
        size = 1e-6 * values[index] if index in shapes else effect.scales()[index]
        coarse = (moved(index, 2 * size) - moved(index, -2 * size)) / (4 * size)
        fine = (moved(index, size) - moved(index, -size)) / (2 * size)
        exact = (4 * fine - coarse) / 3 / problem.probe_std
        found = np.stack([columns[channel][:, index] for channel in problem.channels], axis=1)
        np.testing.assert_allclose(found, exact, rtol=0, atol=1e-4 * np.abs(exact).max())


def test_uncertain_parameters_look_the_same_beside_a_cause(machine_problem):
    """What makes it right to compute them once: beside an effect of usual size they differ by parts in 10^5."""
    problem, _ = machine_problem(36, "null", rough=True)
    droop = Cause(effect_named("head_droop", EFFECTS), "", np.array([5e-5]))
    columns = problem.nuisance((droop,))
    shift = problem._shifts[5]
    exact = predict_probe(shift.machine, problem.recording, (droop,))
    exact = (exact - predict_probe(problem.machine, problem.recording, (droop,))) / problem.probe_std
    found = np.stack([columns[channel][:, 5] for channel in problem.channels], axis=1)
    kept = problem.kept[:, None]
    np.testing.assert_allclose(found, exact * kept, rtol=0, atol=1e-3 * np.abs(exact).max())


@pytest.mark.parametrize("period", [0.01, 0.0161, 0.3])
def test_a_period_is_found_among_uneven_positions(period):
    draw = np.random.default_rng(1)
    position = draw.uniform(-1.5, 1.5, 240)
    signal = 0.8 * np.cos(2 * np.pi * position / period + 0.4) + draw.normal(size=240)
    found = find_frequency(position, signal, 1 / 0.5, 1 / 2e-3)
    assert found == pytest.approx(1 / period, abs=0.1 / np.ptp(position))


def test_effects_that_look_alike_are_a_group_with_poses_as_advice(machine_problem):
    problem, _ = machine_problem(37, "single", ["head_droop"], (100.0, 120.0))
    diagnosis = diagnose(problem)
    assert diagnosis.verdict is Verdict.EXPLAINED
    group = next(group for group in diagnosis.indistinguishable if ("head_droop", "") in group.effects)
    assert ("rotary_harmonic", "A") in group.effects
    assert "standard deviations" in group.advice


def test_where_it_lands_is_told_at_the_poses(machine_problem):
    problem, _ = machine_problem(31, "single", ["axis_scale"], (100.0, 150.0))
    diagnosis = diagnose(problem)
    (found,) = diagnosis.causes
    column = problem.machine.letters.index(found.cause.location)
    moved = found.parameters["relative"].value * problem.recording.positions[:, column]
    assert diagnosis.figures["tool_offset_error_um"] == pytest.approx(1e6 * np.sqrt(np.mean(moved**2)), rel=1e-3)


@pytest.mark.parametrize(("off", "refused"), [(2e-3, False), (2.0, True), (1e3, True)])
def test_a_nominal_machine_is_refused_only_beyond_all_known_effects(machine_problem, off, refused):
    """2 mm are how the part was set up; metres are another machine, or a probe in another unit."""
    problem, _ = machine_problem(32, "null")
    nominal = replace(problem.machine, errors={})
    given = problem.recording
    probe = given.probe + off * np.array([1.0, -1.0, 1.0])
    shifted = MachineRecording(given.positions, given.direction, given.temperature, probe)
    shifted_problem = MachineProblem(nominal, shifted, EFFECTS)
    if refused:
        with pytest.raises(
            InputError, match=r"off by \S+ mm at the median.*known effects make \S+ mm at most.*probe in m"
        ):
            diagnose(shifted_problem)
    else:
        diagnosis = diagnose(shifted_problem)
        assert diagnosis.verdict is not Verdict.NO_GAP
        assert sum(share.share for share in diagnosis.where) == pytest.approx(1.0)


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("name", "modulation", "words"),
    [
        ("tool_length", lambda recording, axis: 0.08 * standard(recording.temperature), "with temperature by"),
        ("axis_backlash", lambda recording, axis: 0.15 * standard(recording.positions[:, axis]), "differs along"),
        ("squareness", lambda recording, axis: 0.1 * standard(recording.temperature), "with temperature by"),
    ],
)
def test_a_departure_is_told(name, modulation, words, machine_problem):
    """Poses to which a part of what the effect does is added: the cause is named, its departure in words."""
    told = []
    for seed in range(61, 66):
        problem, truth = machine_problem(seed, "single", [name], (250.0, 350.0))
        (fault,) = truth.faults
        effect = effect_named(name, EFFECTS)
        cause = Cause(effect, fault.location, effect.values_from(fault.parameters))
        plain = predict_probe(problem.machine, problem.recording)
        moved = predict_probe(problem.machine, problem.recording, (cause,)) - plain
        letters = problem.machine.letters
        axis = letters.index(fault.location) if fault.location in letters else 0
        more = modulation(problem.recording, axis)[:, None] * moved
        recording = replace(problem.recording, probe=problem.recording.probe + more)
        diagnosis = diagnose(MachineProblem(problem.machine, recording, EFFECTS))
        named = next((found for found in diagnosis.causes if found.cause.effect.name == name), None)
        right = diagnosis.verdict is Verdict.EXPLAINED and named is not None
        told.append(right and any(words in row.pattern for row in named.departures))
    assert sum(told) >= 4


def standard(values):
    return (values - values.mean()) / values.std()


@pytest.mark.long
@pytest.mark.parametrize("name", ["axis_scale", "pivot_offset", "squareness"])
def test_outliers_do_not_hide_in_a_departure(name, machine_problem):
    """What a cause does in one direction only is far from smooth; poses at which the probe errs are told beside it."""
    right = []
    for seed in range(71, 76):
        plain, truth = machine_problem(seed, "single", [name], (900.0, 1500.0))
        (fault,) = truth.faults
        true = effect_named(name, EFFECTS)
        cause = Cause(true, fault.location or "", true.values_from(fault.parameters))
        recording, draw = plain.recording, np.random.default_rng(seed)
        moved = predict_probe(plain.machine, recording, (cause,)) - predict_probe(plain.machine, recording)
        probe = recording.probe + 0.25 * recording.direction[:, :1] * moved
        wrong = draw.choice(len(probe), 5, replace=False)
        probe[wrong] += 30 * PROBE_STD * draw.choice([-1.0, 1.0], (5, 3))
        problem = MachineProblem(plain.machine, replace(recording, probe=probe), EFFECTS)
        diagnosis = diagnose(problem)
        named = [found.cause.key for found in diagnosis.causes]
        alone = diagnosis.verdict is Verdict.EXPLAINED and named == [cause.key]
        left_out = set(np.flatnonzero(~problem.kept))
        right.append(alone and left_out >= set(wrong) and len(left_out) <= 2 * len(wrong))
    assert sum(right) >= 4, right
