"""Whole-machine identification on cases made by another program, and on poses that see too little."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import yaml

from rotary_error_monitor.calibration.identification import (
    ProbedPoses,
    check_held_out,
    choose_further_poses,
    identify_machine,
    rank_with_longer_tool,
)
from rotary_error_monitor.calibration.machine_poses import read_probed_poses
from rotary_error_monitor.calibration.parameters import (
    Orders,
    apply_parameters,
    list_parameters,
    value_of,
    without_errors,
)
from rotary_error_monitor.calibration.verdict import judge_calibration
from rotary_error_monitor.calibration.volume import sample_volume
from rotary_error_monitor.description.machine import MachineDescription, load_machine
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.machine.error_model import predict_tool_offset
from rotary_error_monitor.machine.kinematics import arrange_machine

CASES = Path(__file__).parents[3] / "shared" / "cases" / "open"
NOISE = 1.5e-6


def cases(kind: str, effect: str | None = None) -> Iterator[tuple[Path, dict[str, object]]]:
    for path in sorted(CASES.glob("*/truth.yaml")):
        truth = yaml.safe_load(path.read_text(encoding="utf-8"))
        if truth["family"] != "machine" or truth["kind"] != kind:
            continue
        if effect is None or [found["effect"] for found in truth["effects"]] == [effect]:
            yield path.parent, truth


def case(kind: str, effect: str) -> tuple[MachineDescription, ProbedPoses, dict[str, object]]:
    found = next(cases(kind, effect), None)
    if found is None:
        pytest.skip(f"no case with {effect} in {CASES}")
    folder, truth = found
    machine = load_machine(folder / "twin.yaml")
    return machine, read_probed_poses(folder / "bag", machine, NOISE), truth["effects"][0]


def simulated(machine: MachineDescription, positions: np.ndarray, seed: int = 0, noise: float = NOISE) -> ProbedPoses:
    rng = np.random.default_rng(seed)
    direction = rng.choice([-1.0, 1.0], size=positions.shape)
    temperature = np.full(len(positions), machine.reference_temperature)
    offset = predict_tool_offset(arrange_machine(machine), positions, direction=direction, temperature=temperature)
    deviations = offset[:, :3] + noise * rng.normal(size=(len(positions), 3))
    return ProbedPoses(positions, direction, temperature, deviations, noise)


def test_parameters_of_the_null_cases_are_recovered() -> None:
    """From an ideal machine to the twin's parameters: within 3 standard uncertainties in 95 %, all in one fit."""
    folders = [folder for folder, _ in cases("null")]
    if not folders:
        pytest.skip(f"no null cases in {CASES}")
    errors = []
    for folder in folders:
        truth = load_machine(folder / "twin.yaml")
        poses = read_probed_poses(folder / "bag", truth, NOISE)
        parameters = list_parameters(truth)
        start = without_errors(truth)
        found = identify_machine(start, parameters, poses)
        expected = np.array([value_of(truth, parameter) for parameter in parameters])
        known = found.determined
        errors.append(((found.values - expected) / found.standard_uncertainty)[known])
        assert known.sum() >= 50
        assert found.residual_ratio == pytest.approx(1.0, abs=0.1)
        # Prediction of poses that were not used: at the tracker's noise.
        check = check_held_out(start, parameters, poses)
        assert check.ratio <= check.limit
        assert check.error <= 1.2 * NOISE
    everything = np.concatenate(errors)
    assert np.mean(np.abs(everything) <= 3) >= 0.95
    assert 0.8 <= np.sqrt(np.mean(everything**2)) <= 1.2


def test_what_a_tool_tip_cannot_see_is_named() -> None:
    machine = without_errors(load_machine("pan2013"))
    poses = simulated(machine, sample_volume(machine, 200))
    found = identify_machine(machine, list_parameters(machine), poses)
    texts = [str(combination) for combination in found.unseen]
    assert found.rank + len(found.unseen) == len(found.parameters)
    # A spin about the tool's own axis moves no tip; a tilt of the head is a shift of it, half a metre further on.
    assert "+1.00 ECA.harmonic.1.cos" in texts
    names = [parameter.name for parameter in found.parameters]
    for change in (
        {"EAA.harmonic.1.sin": 1.0, "EYA.harmonic.1.sin": -0.5},
        {"rotary_head.rotation.z": 1.0, "EXA.harmonic.1.sin": 0.5},
        {"EBC.harmonic.1.cos": 1.0, "swivel_head.rotation.y": -1.0, "EAC.harmonic.1.sin": 1.0},
    ):
        vector = np.zeros(len(names))
        vector[[names.index(name) for name in change]] = list(change.values())
        np.testing.assert_allclose(found.hidden.T @ (found.hidden @ vector), vector, atol=0.05)
    assert np.isinf(found.standard_uncertainty[[p.name for p in found.parameters].index("ECA.harmonic.1.cos")])
    assert found.rank < rank_with_longer_tool(found, poses) <= len(found.parameters) - 2


def test_poses_with_one_axis_at_rest_see_less_and_further_poses_move_it() -> None:
    machine = load_machine("pan2013")
    positions = sample_volume(machine, 150)
    parameters = list_parameters(without_errors(machine))
    everything = identify_machine(without_errors(machine), parameters, simulated(machine, positions))
    positions[:, 0] = 0.5
    poses = simulated(machine, positions)
    resting = identify_machine(without_errors(machine), parameters, poses)
    assert resting.rank < everything.rank - 8
    assert any("EXX.poly.1" in str(combination) for combination in resting.unseen)
    candidates = sample_volume(machine, 60)
    chosen = candidates[choose_further_poses(resting, candidates, poses)]
    assert len(np.unique(chosen, axis=0)) == 5
    assert np.ptp(chosen[:, 0]) > 3.0
    both = np.concatenate([positions, np.repeat(chosen, 3, axis=0)])
    assert identify_machine(without_errors(machine), parameters, simulated(machine, both)).rank > resting.rank + 4


def test_an_error_outside_the_parameters_fails_the_verdict_and_inside_is_found() -> None:
    """The twin lacks a backlash: without reversal among the parameters the calibration is not good, with it, it is."""
    twin, poses, truth = case("single", "axis_backlash")
    limits = {letter: (0.9 * low, 0.9 * high) for letter, (low, high) in ((a.letter, a.travel) for a in twin.axes)}
    verdicts = []
    for orders in (Orders(), Orders(reversal=True)):
        parameters = list_parameters(twin, orders)
        found = identify_machine(twin, parameters, poses)
        check = check_held_out(twin, parameters, poses)
        verdicts.append(judge_calibration(found, check, poses, required=3e-6, limits=limits))
    assert not verdicts[0].good
    assert "not good" in verdicts[0].sentence
    assert "more than" in verdicts[0].sentence
    assert verdicts[1].good
    names = [parameter.name for parameter in found.parameters]
    at = names.index(f"{truth['location']}.reversal")
    assert found.determined[at]
    width = truth["parameters"]["width"]  # type: ignore[index]
    assert abs(found.values[at] - width) <= 3 * found.standard_uncertainty[at]
    assert found.standard_uncertainty[at] < 0.1 * width


def test_thermal_expansion_is_found() -> None:
    twin, poses, truth = case("single", "thermal_expansion")
    parameters = list_parameters(twin, Orders(expansion=True))
    found = identify_machine(twin, parameters, poses)
    at = [parameter.name for parameter in parameters].index(f"{truth['location']}.expansion")
    error = found.values[at] - twin.axis(str(truth["location"])).expansion - truth["parameters"]["coefficient"]  # type: ignore[index]
    assert abs(error) <= 3 * found.standard_uncertainty[at]


def test_setup_of_the_workpiece_is_found() -> None:
    twin, poses, truth = case("single", "setup_offset")
    parameters = list_parameters(twin, Orders(positioning=(), straightness=(), angular=(), harmonic=(), setup=True))
    found = identify_machine(twin, parameters, poses)
    given = truth["parameters"]
    expected = dict(zip("xyz", given["shift"], strict=True))  # type: ignore[index]
    # The probe's frame stands on the displaced workpiece: shift and rotation come back as they were put in.
    for letter, value in expected.items():
        at = [parameter.name for parameter in parameters].index(f"workpiece.shift.{letter}")
        assert abs(found.values[at] - value) <= 3 * found.standard_uncertainty[at] + 1e-9


@pytest.mark.parametrize("name", ["xyzac_trt", "grinder_zhou2023"])
def test_other_machines_are_identified_as_well(name: str) -> None:
    shipped = load_machine(name)
    ideal = without_errors(shipped)
    parameters = list_parameters(ideal)
    truth = apply_parameters(ideal, parameters, 5e-6 * np.random.default_rng(3).normal(size=len(parameters)))
    poses = simulated(truth, sample_volume(truth, 200), seed=4)
    found = identify_machine(ideal, parameters, poses)
    expected = np.array([value_of(truth, parameter) for parameter in parameters])
    known = found.determined
    assert known.any()
    assert np.mean(np.abs((found.values - expected)[known]) <= 3 * found.standard_uncertainty[known]) >= 0.95
    assert found.residual_ratio == pytest.approx(1.0, abs=0.1)


def test_values_are_added_where_they_belong() -> None:
    machine = load_machine("xyzac_trt")
    parameters = list_parameters(machine, Orders(reversal=True, expansion=True, setup=True, harmonic=(1, 2)))
    assert len({parameter.name for parameter in parameters}) == len(parameters)
    before = np.array([value_of(machine, parameter) for parameter in parameters])
    added = 1e-6 * np.arange(1, len(parameters) + 1)
    after = np.array([value_of(apply_parameters(machine, parameters, added), parameter) for parameter in parameters])
    np.testing.assert_allclose(after - before, added, atol=1e-18)
    with pytest.raises(InputError, match="expected one for each"):
        apply_parameters(machine, parameters, added[:-1])


def test_bad_poses_are_refused() -> None:
    machine = load_machine("pan2013")
    parameters = list_parameters(machine)
    poses = simulated(machine, sample_volume(machine, 4))
    with pytest.raises(InputError, match="needs at least 5"):
        check_held_out(machine, parameters, poses)
    with pytest.raises(InputError, match="no parameter"):
        identify_machine(machine, (), poses)
    with pytest.raises(InputError, match="above 0"):
        identify_machine(machine, parameters, simulated(machine, sample_volume(machine, 4), noise=0.0))
    poses.deviations[2, 1] = math.nan
    with pytest.raises(InputError, match="pose 3 is not finite"):
        identify_machine(machine, parameters, poses)
    with pytest.raises(InputError, match="not within its travel"):
        sample_volume(machine, 4, {"X": (-4.0, 1.0)})
