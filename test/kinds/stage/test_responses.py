"""Diagnosis of stages whose instruments have zero, sign, gain, axes and delay of their own, from files on."""

from __future__ import annotations

from dataclasses import replace

import pytest
import yaml
from pipeline.test_responses import RESPONSES

from rotary_error_monitor.blind_check.cases import write_case
from rotary_error_monitor.cases.making import make_stage_case
from rotary_error_monitor.description.response import Response
from rotary_error_monitor.gap.diagnosis import diagnose
from rotary_error_monitor.gap.loading import load_problem, load_twin
from rotary_error_monitor.gap.verdict import Verdict

DURATION = 20.0


def written(folder, seed, kind="null", effects=None, known=RESPONSES):
    """Case of the plant with such instruments, and a twin that knows of them what is `known`."""
    case = make_stage_case(seed, kind, effects, duration=DURATION)
    plant = replace(case.plant, description=replace(case.plant.description, responses=RESPONSES))
    blocks = {
        stream: [plant.samples(stream, 0, plant.index_at(stream, plant.epoch_ns + round(DURATION * 1e9)))]
        for stream in plant.streams
    }
    write_case(replace(case, plant=plant, blocks=blocks, twin=replace(case.twin, responses=known)), folder)
    return folder / "bag", folder / "twin.yaml"


@pytest.mark.parametrize("seed", [31, 32])
def test_a_healthy_recording_has_no_gap(seed, tmp_path):
    bag, twin = written(tmp_path / "case", seed)
    diagnosis = diagnose(load_problem(bag, load_twin(twin)))
    assert diagnosis.verdict is Verdict.NO_GAP
    assert diagnosis.gap.before == pytest.approx(1.0, abs=0.03)


def test_a_fault_is_named_as_behind_ideal_instruments(tmp_path):
    bag, twin = written(tmp_path / "case", 5, "single", ["mirror_wobble"])
    diagnosis = diagnose(load_problem(bag, load_twin(twin)))
    assert [found.cause.effect.name for found in diagnosis.causes] == ["mirror_wobble"]


@pytest.mark.parametrize("stated", [{"gain": 0.01}, {"roll": 0.01}, {}], ids=["gain", "roll", "nothing"])
def test_what_an_autocollimator_may_be_off_by_is_no_gap(stated, tmp_path):
    """Gain by 1.5 and roll by 1.3 standard uncertainties, as a twin that states none of them would call a fault."""
    right = RESPONSES["autocollimator"]
    wrong = replace(right, gain=right.gain + 0.015, roll=right.roll + 0.013 * ("gain" not in stated))
    wrong = replace(wrong, gain=right.gain) if "roll" in stated else wrong
    bag, twin = written(tmp_path / "case", 33, known={**RESPONSES, "autocollimator": wrong})
    content = yaml.safe_load(twin.read_text(encoding="utf-8"))
    content["stage"]["uncertainty"] = {f"autocollimator.{name}": std for name, std in stated.items()}
    twin.write_text(yaml.safe_dump(content), encoding="utf-8")
    assert (diagnose(load_problem(bag, load_twin(twin))).verdict is Verdict.NO_GAP) is bool(stated)


def test_a_head_whose_sign_is_not_described_is_told(tmp_path):
    bag, twin = written(tmp_path / "case", 31, known={**RESPONSES, "head_b": Response((-1.9,))})
    content = yaml.safe_load(twin.read_text(encoding="utf-8"))
    assert content["stage"]["encoder"]["heads"]["b"]["sign"] == 1
    diagnosis = diagnose(load_problem(bag, load_twin(twin)))
    assert diagnosis.verdict is Verdict.UNKNOWN and diagnosis.where[0].channel == "/stage/head_b/samples.angle"
