"""A cell whose stage has three probes and neither heads nor autocollimator, by its file alone: live, and replayed."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from nodes.mock_cells import mock_parameters
from nodes.replayed_motion import ESTIMATOR, REPEATED, REPLAY, assert_repeated
from received_blocks import block_of
from without_heads import STREAMS, example

from rotary_error_monitor.cli import main
from rotary_error_monitor.codec.error_motion_blocks import error_motion_from_block
from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.nodes.compensation import Compensation
from rotary_error_monitor.nodes.encoder_head import EncoderHead
from rotary_error_monitor.nodes.error_estimator import ErrorEstimator
from rotary_error_monitor.nodes.gap_monitor import GapMonitor
from rotary_error_monitor.nodes.listed_sensor import ListedSensorNode
from rotary_error_monitor.nodes.mock_controller import MockController
from rotary_error_monitor.nodes.recorder import Recorder
from rotary_error_monitor.nodes.stage_follower import StageFollower
from rotary_error_monitor.recordings.replay import replay_bag
from rotary_error_monitor.sources.mock import mock_stage
from rotary_error_monitor.testing import Cell

SIGMAS = 6.0


@pytest.fixture
def stage_file(tmp_path):
    return example(tmp_path)


@pytest.fixture
def headless(settings, stage_file) -> Iterator[Cell]:
    with Cell((), mock_parameters(settings, stage=stage_file), sensors=STREAMS) as cell:
        yield cell


def test_error_motion_and_corrections_from_three_probes(headless, settings, stage_file, tmp_path, capsys):
    estimates = headless.collect(headless.wire.topic("error_motion_samples"))
    corrections = headless.collect(headless.wire.topic("axis_corrections"))
    recorder = headless.run(Recorder, "recorder", folder=str(tmp_path / "bag"))
    for name in ("one", "two", "three"):
        headless.run(ListedSensorNode, f"listed_sensor_{name}", source="mock")
    headless.run(MockController, "mock_controller", machine="xyzac_trt")
    headless.run(GapMonitor, "gap_monitor")
    headless.run(ErrorEstimator, "error_estimator", **ESTIMATOR)
    headless.run(Compensation, "compensation", machine="xyzac_trt")
    headless.wait_until(lambda: len(estimates) > 10 and len(corrections) > 10, "estimates and corrections")
    headless.forget_status("error_estimator: estimate")
    headless.wait_for_status("error_estimator: estimate", "complete")
    assert "by the command, which no sensor checks" in headless.figures("error_estimator: estimate")["rotation"]
    headless.wait_for_status("compensation: correction", "angular positioning from the description: nothing is heard")
    headless.wait_for_status("gap_monitor: /stage/radial_probe_one/samples", "alive")
    assert not any("head" in topic.key for topic in headless.wire)
    headless.remove(recorder)

    stage = load_stage(stage_file)
    plant = mock_stage(stage, settings)
    assert plant.streams == ("command", "force", "temperature", *STREAMS)
    whole = []
    for message in estimates[2:]:
        block = block_of(message)
        motion = error_motion_from_block(block)
        truth = plant.scene((block.times_ns - plant.epoch_ns) * 1e-9).error_motion
        deviation = np.sqrt(np.diagonal(motion.covariance, axis1=1, axis2=2))
        assert (np.abs(motion.components - truth) <= SIGMAS * deviation)[motion.observable].all()
        assert not motion.observable[:, 2:].any() and (deviation < 1e-6).all(), "an uncertainty that bounds something"
        whole.append(motion.observable[:, :2].all(axis=1).mean())
    assert np.mean(whole) > REPEATED

    settings_of_node = REPLAY
    assert_repeated(estimates, replay_bag(tmp_path / "bag", stage, load_machine("xyzac_trt"), settings_of_node))
    assert main(["check", "--stage", str(stage_file), str(tmp_path / "bag")]) != 2
    said = capsys.readouterr().out
    assert said.startswith(("Nothing contradicts the description", "The description fits the recording")), said
    assert "uncertainty of the rotation, which is the command" in said and "heads" not in said


def test_nodes_that_need_heads_say_so(headless):
    with pytest.raises(InputError, match=r"three_probes\.yaml: the stage has no section 'encoder'"):
        headless.run(EncoderHead, "encoder_head_a", source="mock")
    with pytest.raises(InputError, match="no section 'encoder' or 'autocollimator'"):
        headless.run(StageFollower, "stage_follower")
