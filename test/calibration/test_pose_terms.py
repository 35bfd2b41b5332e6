"""The stated uncertainty of the tool by pose, in corners and inside, of machines that the plant probes."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from calibration.simulated_machine import CALIBRATIONS, NOISE, tool

from rotary_error_monitor.calibration.identification import ProbedPoses, check_held_out, identify_machine
from rotary_error_monitor.calibration.parameters import apply_parameters, list_parameters, without_errors
from rotary_error_monitor.calibration.verdict import judge_calibration
from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.machine.budget import offset_covariance
from rotary_error_monitor.machine.pose_uncertainty import MIDDLE, pose_term, position_uncertainty
from rotary_error_monitor.resources import config


@pytest.mark.few(1)
@pytest.mark.parametrize("kind", CALIBRATIONS)
def test_errors_in_corners_are_as_large_as_the_uncertainty_there_says(kind: str) -> None:
    """Of the mean over the volume, which was stated at all poses, they were up to three times as large."""
    case = CALIBRATIONS[kind]
    ideal = without_errors(load_machine(case.machine))
    parameters = list_parameters(ideal, case.orders)
    low, high = np.array([axis.travel for axis in ideal.axes]).T
    corners = np.array(list(product(*zip(low, high, strict=True))))
    ratios: dict[str, list[np.ndarray]] = {"corners": [], "inside": [], "corners over the mean": []}
    for seed in range(12):
        rng = np.random.default_rng([seed, 9])
        truth = apply_parameters(ideal, parameters, 1e-5 * rng.normal(size=len(parameters)))
        positions = rng.uniform(low, high, size=(case.poses, low.size))
        direction, warming = rng.choice([-1.0, 1.0], size=positions.shape), rng.uniform(-3, 3, size=case.poses)
        off = tool(truth, positions, direction, warming) + NOISE * rng.normal(size=(case.poses, 3))
        poses = ProbedPoses(positions, direction, ideal.reference_temperature + warming, off, NOISE)
        found = identify_machine(ideal, parameters, poses)
        verdict = judge_calibration(found, check_held_out(ideal, parameters, poses), poses, required=1e-5)
        stated = replace(
            found.machine,
            calibrated={"machine": verdict.uncertainty},
            pose_terms=verdict.pose_terms,
            uncertainty={},
            axes=tuple(replace(axis, repeatability=None) for axis in found.machine.axes),
        )
        inside = rng.uniform(low, high, size=(64, low.size))
        for name, places in (("corners", corners), ("inside", inside)):
            still = np.zeros_like(places), np.zeros(len(places))
            missed = np.linalg.norm(tool(truth, places, *still) - tool(found.machine, places, *still), axis=1)
            covariance = offset_covariance(stated, places)
            assert covariance is not None
            spread = np.sqrt(np.trace(covariance[:, :3, :3], axis1=1, axis2=2))
            ratios[name].append(missed / spread)
        ratios["corners over the mean"].append(missed_over(ratios["corners"][-1], stated, corners, verdict.uncertainty))
    rms = {name: float(np.sqrt(np.mean(np.square(np.concatenate(each))))) for name, each in ratios.items()}
    assert 0.75 < rms["corners"] < 1.25 and 0.75 < rms["inside"] < 1.25, rms
    assert rms["corners over the mean"] > 1.5
    # the distance over its standard uncertainty exceeds 2 in a twentieth where all is in one direction, else less
    assert np.mean(np.concatenate(ratios["corners"]) > 2) < 0.06


def missed_over(ratio: np.ndarray, machine, places: np.ndarray, mean: float) -> np.ndarray:
    """Errors over the mean of the volume, from those over the uncertainty at the places."""
    return np.asarray(ratio * position_uncertainty(machine, machine.pose_terms, places) / mean)


def test_terms_come_back_from_the_file(tmp_path: Path) -> None:
    text = config("machines/pan2013.yaml").read_text(encoding="utf-8")
    note = (
        '  calibration:\n    machine: {date: "2026-11-26", source: poses.csv, sha256: '
        + "a" * 64
        + ", uncertainty: 2.0e-06,\n"
        "      figures: {volumetric_uncertainty: 2.0e-06, volumetric_term_0: 1.0e-06, volumetric_term_XXY: 3.0e-06}}\n"
    )
    path = tmp_path / "machine.yaml"
    path.write_text(text.rstrip() + "\n" + note, encoding="utf-8")
    machine = load_machine(path)
    assert machine.pose_terms == {MIDDLE: 1e-6, "XXY": 3e-6}
    places = np.array([[0.0, 0, 0, 0, 0], [3.0, 1, 0, 0, 0], [-3.0, 0.5, 1, 1, 1]])
    np.testing.assert_allclose(pose_term(machine, "XXY", places), [0.0, 1.0, 0.25])
    expected = 1e-6 * np.sqrt([1.0, 10.0, 1 + 9 * 0.25])
    np.testing.assert_allclose(position_uncertainty(machine, machine.pose_terms, places), expected)
    path.write_text(path.read_text(encoding="utf-8").replace("XXY", "QQ"), encoding="utf-8")
    assert load_machine(path).pose_terms == {}
