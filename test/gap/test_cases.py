"""The gap cases that were made by another program, where they are at hand: verdict, cause, place, shrink."""

from __future__ import annotations

import pytest
import yaml

from rotary_error_monitor.gap.diagnosis import diagnose
from rotary_error_monitor.gap.loading import load_problem, load_twin


def diagnosed(case):
    diagnosis = diagnose(load_problem(case / "bag", load_twin(case / "twin.yaml")))
    return diagnosis.as_mapping(), yaml.safe_load((case / "truth.yaml").read_text(encoding="utf-8"))


def check_explained(case):
    content, truth = diagnosed(case)
    wanted = sorted((row["effect"], row["location"] or "") for row in truth["effects"])
    assert content["verdict"] == "explained"
    assert sorted((row["effect"], row["location"]) for row in content["causes"]) == wanted
    assert content["gap"]["shrink"] > 0.9
    topic = content["where"][0]["channel"]
    top = max(truth["snr"].values())
    moved = {name for name, value in truth["snr"].items() if value > 0.3 * top}
    assert topic.startswith("/stage/command") or any(topic.startswith(name) for name in moved)


@pytest.mark.cases("open", "stage", "null")
def test_clean_stage_without_a_gap(case):
    assert diagnosed(case)[0]["verdict"] == "no_gap"


@pytest.mark.cases("rough_open", "stage", "null", most=2)
def test_rough_stage_without_a_gap(case):
    assert diagnosed(case)[0]["verdict"] == "no_gap"


@pytest.mark.cases("open", "machine", "null")
def test_machine_without_a_gap(case):
    assert diagnosed(case)[0]["verdict"] == "no_gap"


@pytest.mark.few(2)
@pytest.mark.cases("open", "stage", "single", most=3)
def test_clean_stage_with_one_effect(case):
    check_explained(case)


@pytest.mark.few(2)
@pytest.mark.cases("rough_open", "stage", "single", most=3)
def test_rough_stage_with_one_effect(case):
    check_explained(case)


@pytest.mark.few(1)
@pytest.mark.cases("open", "stage", "pair", most=2)
def test_clean_stage_with_two_effects(case):
    check_explained(case)


@pytest.mark.few(1)
@pytest.mark.cases("open", "stage", "unknown", most=2)
def test_clean_stage_with_something_unknown(case):
    assert diagnosed(case)[0]["verdict"] == "unknown"


@pytest.mark.few(1)
@pytest.mark.cases("rough_open", "stage", "unknown", most=2)
def test_rough_stage_with_something_unknown(case):
    assert diagnosed(case)[0]["verdict"] == "unknown"


@pytest.mark.cases("open", "machine", "single", most=4)
def test_clean_machine_with_one_effect(case):
    check_explained(case)


@pytest.mark.cases("rough_open", "machine", "single")
def test_rough_machine_with_one_effect(case):
    check_explained(case)


@pytest.mark.cases("open", "machine", "pair")
def test_machine_with_two_effects(case):
    check_explained(case)


@pytest.mark.cases("open", "machine", "unknown")
def test_machine_with_something_unknown(case):
    assert diagnosed(case)[0]["verdict"] == "unknown"
