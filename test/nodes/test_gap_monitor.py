"""The gap monitor as a node: verdicts on live streams, and what happens when streams, twin or diagnosis fail."""

from __future__ import annotations

import json
import os
import signal
import time
from dataclasses import replace

import pytest
import yaml

from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.cases.making import make_stage_case
from rotary_error_monitor.description.stage import stage_mapping
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.nodes.autocollimator import AutocollimatorNode
from rotary_error_monitor.nodes.diagnosis_process import LATEST
from rotary_error_monitor.nodes.encoder_head import EncoderHead
from rotary_error_monitor.nodes.gap_monitor import GapMonitor
from rotary_error_monitor.nodes.mock_controller import MockController
from rotary_error_monitor.testing import Cell

STEP_NS = 250_000_000
LENGTH = 20.0  # s, 11.5 turns
TURNS = 11
VERDICT, DIAGNOSIS = "gap_monitor: verdict", "gap_monitor: diagnosis"
DEADLINE = 300.0
"""How long to wait for a diagnosis, s: of lowest priority, it gets what others leave, which may be little."""


def write_twin(folder, stage):
    path = folder / "stage.yaml"
    path.write_text(yaml.safe_dump({"stage": stage_mapping(stage)}), encoding="utf-8")
    return str(path)


@pytest.fixture(scope="module")
def case():
    """A recording of a stage whose mirror stands askew, which its twin does not know."""
    return make_stage_case(5, "single", ["mirror_wobble"], (150.0, 300.0), duration=LENGTH)


class Tape:
    """A case, played on the cell's topics faster than it was recorded, under simulated time."""

    def __init__(self, cell, case, node=None):
        self.cell = cell
        self.node = node
        self.set_time = cell.clock()
        self.sends = {name: cell.publish_blocks(cell.wire.named(f"/stage/{name}/samples")) for name in case.blocks}
        self.blocks = sorted(
            ((int(b.times_ns[-1]), name, b) for name, blocks in case.blocks.items() for b in blocks),
            key=lambda row: row[:2],
        )
        self.place = 0
        self.now_ns = self.blocks[0][0]

    def play(self, duration, silent=()):
        end_ns = self.now_ns + round(duration * 1e9)
        while self.now_ns < end_ns:
            self.now_ns += STEP_NS
            self.set_time(self.now_ns)
            if self.node is not None:
                self.cell.wait_until(lambda: self.node.now_ns() >= self.now_ns, "simulated time")
            while self.place < len(self.blocks) and self.blocks[self.place][0] <= self.now_ns:
                _, name, block = self.blocks[self.place]
                if name not in silent:
                    self.sends[name](block)
                self.place += 1

    def play_at_once(self, is_set):
        """All of it, at its end, which `is_set` says the node knows: of a process nobody sees its clock, and a thread
        of its own may take blocks before that is set."""
        self.now_ns = self.blocks[-1][0]

        def told():
            self.set_time(self.now_ns)
            return is_set()

        self.cell.wait_until(told, "simulated time")
        for _, name, block in self.blocks:
            self.sends[name](block)


def monitor(cell, twin, **parameters):
    settings = {"turns": TURNS, "period": 2.0, "use_sim_time": True, "max_age": 60.0, "stage": twin, **parameters}
    return cell.run(GapMonitor, "gap_monitor", **settings)


def figures(status):
    return {each.key: each.value for each in status.values}


@pytest.fixture
def cell():
    with Cell() as cell:
        yield cell


@pytest.mark.long  # until its twin is believed
def test_a_stage_that_does_what_its_twin_says():
    """Live: six nodes of the mock stage, at least four turns and 15 s."""
    parameters = {
        "block_period": 0.05,
        "mock.seed": 7,
        "mock.epoch": time.time_ns() - 3_000_000_000,
        "mock.speeds": [3.0, 9.0],
        "mock.forces": False,
    }
    with Cell(parameters=parameters) as cell:
        cell.run(GapMonitor, "gap_monitor", turns=4)
        for head in "abcd":
            cell.run(EncoderHead, f"encoder_head_{head}", source="mock")
        cell.run(AutocollimatorNode, "autocollimator", source="mock")
        cell.run(MockController, "mock_controller")
        cell.wait_for_status(DIAGNOSIS, "of 4 turns in")
        status = cell.wait_for_status(VERDICT, "No gap", DEADLINE)
    assert status.level == b"\x00"
    found = figures(status)
    assert found["verdict"] == "no_gap" and found["causes"] == "none"
    assert float(found["turns"]) > 4.0 and float(found["duration_s"]) >= 15.0
    assert float(found["gap_before"]) == pytest.approx(1.0, abs=0.1)
    assert float(found["age_s"]) >= 0


def test_what_the_twin_lacks_is_named_and_kept(cell, case, tmp_path):
    folder = tmp_path / "gaps"
    node = monitor(cell, write_twin(tmp_path, case.twin), folder=str(folder))
    Tape(cell, case, node).play(LENGTH)
    status = cell.wait_for_status(VERDICT, "Explained by mirror mounted askew, mirror_wobble", DEADLINE)
    assert status.level == b"\x01"
    found = figures(status)
    assert found["causes"].startswith("mirror_wobble (")
    assert float(found["gap_after"]) < 1.1 < 1.2 < float(found["gap_before"])
    assert found["where"].startswith("/stage/autocollimator/samples")
    kept = folder / LATEST
    assert json.loads((kept / "out" / "diagnosis.json").read_text())["causes"][0]["effect"] == "mirror_wobble"
    assert (kept / "out" / "diagnosis.html").is_file()
    assert "/stage/lvdt/samples" in BagReader(kept / "bag").topics


def test_the_process_is_killed_and_another_one_does_it(cell, case, tmp_path):
    node = monitor(cell, write_twin(tmp_path, case.twin))
    Tape(cell, case, node).play(LENGTH)
    cell.wait_until(lambda: node._process.pid is not None, "a process that diagnoses")
    cell.wait_until(lambda: os.getpriority(os.PRIO_PROCESS, node._process.pid) == 19, "lowest priority")
    os.kill(node._process.pid, signal.SIGKILL)
    status = cell.wait_for_status(DIAGNOSIS, "was ended by SIGKILL; tried again")
    assert status.level == b"\x02"
    cell.wait_for_status(VERDICT, "Explained by mirror mounted askew, mirror_wobble", DEADLINE)
    cell.forget_status(DIAGNOSIS)
    status = cell.status(DIAGNOSIS)
    assert status.level == b"\x00" and figures(status)["without_verdict"] == "1"


def test_streams_that_fall_silent_are_told(cell, case, tmp_path):
    node = monitor(cell, write_twin(tmp_path, case.twin))
    cell.wait_for_status(DIAGNOSIS, "waiting: no samples on /stage/head_a/samples, /stage/head_b/samples")
    tape = Tape(cell, case, node)
    tape.play(3.0)
    status = cell.wait_for_status(DIAGNOSIS, "of 11 turns in")
    assert status.level == b"\x00"
    tape.play(2.0, silent=("head_c",))
    status = cell.wait_for_status(DIAGNOSIS, "waiting: no samples on /stage/head_c/samples")
    assert status.level == b"\x02"
    cell.wait_for_status("gap_monitor: /stage/head_c/samples", "stale")
    assert cell.status(VERDICT).message == "none yet"
    tape.play(1.0)
    cell.wait_for_status(DIAGNOSIS, "of 11 turns in")


def another_stage(stage):
    """A stage that states what is not there: eccentricity, mirror and the LVDT's artefact."""
    return replace(
        stage,
        encoder=replace(stage.encoder, eccentricity=(3e-4, -2e-4)),
        mirror=replace(stage.mirror, tilt=(-4e-4, 4e-4)),
        lvdt=replace(stage.lvdt, artefact_eccentricity=(-9e-5, 8e-5)),
    )


def test_a_twin_of_another_stage_and_a_clock_of_another_time_are_told(cell, case, tmp_path):
    node = monitor(cell, write_twin(tmp_path, another_stage(case.twin)))
    tape = Tape(cell, case, node)
    tape.play(LENGTH)
    status = cell.wait_for_status(DIAGNOSIS, "It describes another stage", DEADLINE)
    assert status.level == b"\x02" and "tried again" in status.message
    later_ns = tape.now_ns + 3_600_000_000_000
    tape.set_time(later_ns)
    cell.wait_until(lambda: node.now_ns() >= later_ns, "simulated time")
    tape.sends["head_a"](case.blocks["head_a"][-1])
    cell.wait_for_status("gap_monitor: /stage/head_a/samples", "are the clocks of all computers alike?")


def test_a_signal_ends_it_while_it_diagnoses(cell, case, tmp_path):
    twin = write_twin(tmp_path, case.twin)
    process = cell.start("gap_monitor", turns=TURNS, use_sim_time=True, max_age=60.0, stage=twin)
    nothing = "nothing has come on /clock"
    cell.wait_for_status("gap_monitor: state", nothing)
    Tape(cell, case).play_at_once(lambda: not cell.has_status("gap_monitor: state", nothing))
    cell.forget_status(DIAGNOSIS)
    status = cell.wait_for_status(DIAGNOSIS, "under way", DEADLINE)
    child = int(figures(status)["process"])
    assert process.stop(signal.SIGINT) == 0
    assert "Traceback" not in process.output
    with pytest.raises(ProcessLookupError):
        os.kill(child, 0)


@pytest.mark.parametrize(
    ("parameters", "problem"),
    [
        ({"effects": "nowhere.py"}, r"nowhere\.py: no Python file"),
        ({"folder": "/dev/null/gaps"}, "parameter 'folder': /dev/null/gaps cannot be made"),
        ({"turns": 0}, "parameter 'turns' is 0"),
        ({"false_alarms": 0.9}, "parameter 'false_alarms' is 0.9"),
    ],
)
def test_wrong_parameters_are_told(cell, parameters, problem):
    with pytest.raises(InputError, match=problem):
        cell.run(GapMonitor, "gap_monitor", **parameters)
