"""Diagnoses in a process of their own, without ROS: outcomes, time limits, an end that leaves nothing behind."""

from __future__ import annotations

import os
import time

import pytest
import yaml

from rotary_error_monitor.cases.making import make_stage_case
from rotary_error_monitor.description.stage import stage_mapping
from rotary_error_monitor.description.wire import load_wire
from rotary_error_monitor.nodes.diagnosis_process import LATEST, DiagnosisProcess

PATIENCE = 60.0


@pytest.fixture(scope="module")
def case():
    return make_stage_case(5, "null", duration=14.0)


@pytest.fixture
def blocks(case):
    return {name: list(found) for name, found in case.blocks.items()}


@pytest.fixture
def make(case, tmp_path):
    made = []

    def process(patience=PATIENCE, twin=None):
        path = tmp_path / "twin.yaml"
        path.write_text(yaml.safe_dump({"stage": stage_mapping(case.twin)}), encoding="utf-8")
        folder = tmp_path / "kept"
        folder.mkdir()
        made.append(DiagnosisProcess(load_wire(), ["--twin", str(twin or path)], patience, folder))
        return made[-1]

    yield process
    for each in made:
        each.stop()


def outcome_of(process):
    end = time.monotonic() + PATIENCE
    while (outcome := process.take()) is None:
        assert time.monotonic() < end, "no outcome"
        assert process.is_running
        time.sleep(0.02)
    return outcome


def test_a_verdict_and_what_is_kept(make, blocks, tmp_path):
    process = make()
    assert process.take() is None and not process.is_running and process.pid is None
    process.start(blocks)
    with pytest.raises(RuntimeError, match="still running"):
        process.start(blocks)
    outcome = outcome_of(process)
    assert outcome.content["verdict"] == "no_gap" and outcome.sentence.startswith("No gap")
    assert 0 < outcome.duration < PATIENCE
    assert not process.is_running and process.pid is None
    assert [path.name for path in (tmp_path / "kept").iterdir()] == [LATEST]
    assert {path.name for path in (tmp_path / "kept" / LATEST).iterdir()} == {"bag", "out"}


def test_what_is_wrong_is_told_without_a_verdict(make, blocks, tmp_path):
    process = make(twin="nowhere.yaml")
    process.start(blocks)
    outcome = outcome_of(process)
    assert outcome.content is None
    assert outcome.sentence.startswith("no verdict: nowhere.yaml: cannot be read")
    assert list((tmp_path / "kept").iterdir()) == []


def test_a_diagnosis_that_takes_too_long_is_ended(make, blocks):
    process = make(patience=0.05)
    process.start(blocks)
    assert outcome_of(process).sentence == "no verdict: ended after 0.05 s without a result"
    process.start(blocks)
    assert outcome_of(process).content is None, "the next one starts all the same"


def test_a_recording_that_cannot_be_written_is_told(make, blocks, tmp_path):
    process = make()
    (tmp_path / "kept").rmdir()
    process.start(blocks)
    assert "no verdict: [Errno 2] No such file or directory" in outcome_of(process).sentence


def test_an_end_leaves_nothing_behind(make, blocks, tmp_path):
    process = make()
    process.start(blocks)
    end = time.monotonic() + PATIENCE
    while (pid := process.pid) is None:
        assert time.monotonic() < end, "no process"
        time.sleep(0.01)
    process.stop()
    assert process.pid is None and list((tmp_path / "kept").iterdir()) == []
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
