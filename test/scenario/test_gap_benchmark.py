"""The blind check: what stands out of uncertainty, a solver that cannot look, a second recording at other speeds."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from rotary_error_monitor.cli import main
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.plant.cases import make_machine_case, make_stage_case
from rotary_error_monitor.plant.roughness import MACHINE_UNCERTAINTY, STAGE_UNCERTAINTY
from rotary_error_monitor.scenario.gap_cases import draw_machine, plan_cases, write_case, write_elsewhere
from rotary_error_monitor.scenario.gap_scores import format_scores, score_case
from rotary_error_monitor.scenario.gap_sizes import sizes_beyond_uncertainty
from rotary_error_monitor.scenario.gap_solver import diagnose_case, seal_process

DURATION = 15.0


def test_without_uncertainty_the_size_is_that_over_the_noise():
    case = make_stage_case(3, "single", ["mirror_wobble"], duration=DURATION)
    (size,) = sizes_beyond_uncertainty(case, DURATION)
    assert size == pytest.approx(np.linalg.norm(list(case.truth.snr.values())), rel=0.05)


def test_a_fault_like_an_uncertain_parameter_stands_out_by_its_uncertainty():
    # A long recording tells the mirror's tilt far better than its uncertainty: what stands out is tilt / uncertainty.
    case = make_stage_case(3, "single", ["mirror_wobble"], rough=True, duration=DURATION)
    (size,) = sizes_beyond_uncertainty(case, DURATION)
    tilt = np.linalg.norm(case.truth.faults[0].tilt)
    # Order 1 of the spindle's tilt is uncertain too and looks nearly the same.
    known = np.hypot(STAGE_UNCERTAINTY["mirror.tilt"], STAGE_UNCERTAINTY["spindle.tilt"])
    assert tilt / known * 0.8 < size < tilt / STAGE_UNCERTAINTY["mirror.tilt"] * 1.05
    assert size < 0.2 * np.linalg.norm(list(case.truth.snr.values()))


def test_a_machine_fault_like_an_uncertain_parameter():
    case = make_machine_case(draw_machine(4), 4, "single", ["squareness"], rough=True)
    (size,) = sizes_beyond_uncertainty(case, DURATION)
    assert 0.5 < size / (abs(case.truth.faults[0].angle) / MACHINE_UNCERTAINTY["squareness"]) <= 1.0


def test_no_fault_has_no_size():
    assert sizes_beyond_uncertainty(make_stage_case(3, "null", duration=DURATION), DURATION) == []


SEALED = """
from rotary_error_monitor.scenario.gap_solver import seal_process
seal_process()
for look in (
    lambda: __import__("rotary_error_monitor.plant.cases"),
    lambda: __import__("rotary_error_monitor.scenario.gap_cases"),
    lambda: open(f"/proc/{__import__('os').getppid()}/mem", "rb"),
    lambda: __import__("json.tool"),
):
    try:
        look()
        print("done")
    except PermissionError as error:
        print(error)
"""


def test_the_solver_can_neither_make_cases_nor_look_into_processes():
    told = subprocess.run([sys.executable, "-c", SEALED], capture_output=True, text=True, check=True, timeout=60)
    plant, cases, memory, other = told.stdout.splitlines()
    assert "may not load rotary_error_monitor.plant" in plant
    assert "may not load rotary_error_monitor.scenario.gap_cases" in cases
    assert "may not read /proc/" in memory
    assert other == "done"


def test_a_process_that_makes_cases_cannot_be_sealed():
    with pytest.raises(PermissionError, match=r"has loaded rotary_error_monitor\."):
        seal_process()


def test_causes_hold_at_speeds_never_seen(tmp_path):
    (plan,) = (p for p in plan_cases(11, 6, ("stage",), (False,)) if p.group == "new speed")
    case = make_stage_case(12, "single", ["unbalance"])
    write_case(case, tmp_path / "case")
    write_elsewhere(case, tmp_path / "case", 12)
    content, seconds = diagnose_case(tmp_path / "case")
    assert [row["effect"] for row in content["causes"]] == ["unbalance"]
    assert content["elsewhere"]["after"] == pytest.approx(1.0, abs=0.03)
    assert content["elsewhere"]["before"] > 1.1
    truth = {**case.truth.as_mapping(), "sizes": sizes_beyond_uncertainty(case, 40.0)}
    outcome = score_case(plan, truth, content, seconds)
    assert outcome.right and outcome.lvdt and outcome.elsewhere > 0.98
    assert "Shrink of the gap at speeds never seen" in format_scores([outcome])


def test_cases_of_some_groups_only():
    plans = plan_cases(5, 40, ("stage", "machine"), (False, True), ("null", "weak"))
    assert {plan.group for plan in plans} == {"null", "weak"}
    assert 4 * 40 - 4 <= len(plans) <= 4 * 40 + 4
    with pytest.raises(SystemExit, match="2"):
        main(["gap-benchmark", "--group", "nul"])
    assert main(["gap-benchmark", "--group", "new speed", "--family", "machine"]) == 2


def test_a_machine_has_no_other_speed(tmp_path):
    with pytest.raises(InputError, match="second recording"):
        write_elsewhere(make_machine_case(draw_machine(4), 4, "null"), tmp_path, 1)


def test_effects_too_small_to_be_found_are_counted_on_their_own():
    (plan,) = (p for p in plan_cases(11, 6, ("stage",), (False,)) if p.group == "new speed")
    case = make_stage_case(12, "single", ["unbalance"], duration=DURATION)
    silent = {
        "verdict": "no_gap",
        "causes": [],
        "indistinguishable": [],
        "where": [],
        "gap": {"shrink": 0.0},
        "schema": 1,
    }
    truth = case.truth.as_mapping()
    small = score_case(plan, {**truth, "sizes": [5.0]}, silent, 1.0)
    large = score_case(plan, {**truth, "sizes": [50.0]}, silent, 1.0)
    assert not small.right and not large.right
    head, _, rows = format_scores([small, large, large]).partition("kind")
    assert rows.splitlines()[1].split()[:3] == ["new", "speed", "0/2"]
    assert rows.splitlines()[1].split()[3:5] == ["0/2", "0/1"]


def test_probabilities_count_only_the_cause_itself():
    (plan,) = (p for p in plan_cases(11, 6, ("stage",), (False,)) if p.group == "new speed")
    case = make_stage_case(12, "single", ["encoder_latency"], duration=DURATION)
    truth = {**case.truth.as_mapping(), "sizes": [50.0]}
    alike = [{"effect": name, "location": ""} for name in ("following_error", "encoder_latency")]
    named = {
        "verdict": "explained",
        "causes": [{**alike[0], "probability": 0.5, "parameters": {}}],
        "indistinguishable": [{"effects": alike}],
        "where": [],
        "gap": {"shrink": 1.0},
        "schema": 1,
    }
    outcome = score_case(plan, truth, named, 1.0)
    assert outcome.right and outcome.probabilities == ((0.5, False),)
    named["causes"][0]["effect"] = "encoder_latency"
    assert score_case(plan, truth, named, 1.0).probabilities == ((0.5, True),)
