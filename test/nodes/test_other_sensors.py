"""A cell whose stage has five heads and no autocollimator, by its file alone: live, and replayed bit for bit."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml
from nodes.mock_cells import mock_parameters
from nodes.replayed_motion import ESTIMATOR, REPEATED, REPLAY, assert_repeated
from received_blocks import block_of

from rotary_error_monitor.codec.error_motion_blocks import error_motion_from_block
from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.nodes.autocollimator import AutocollimatorNode
from rotary_error_monitor.nodes.compensation import Compensation
from rotary_error_monitor.nodes.encoder_head import EncoderHead
from rotary_error_monitor.nodes.error_estimator import ErrorEstimator
from rotary_error_monitor.nodes.gap_monitor import GapMonitor
from rotary_error_monitor.nodes.mock_controller import MockController
from rotary_error_monitor.nodes.recorder import Recorder
from rotary_error_monitor.recordings.replay import replay_bag
from rotary_error_monitor.resources import config
from rotary_error_monitor.sources.mock import mock_stage
from rotary_error_monitor.testing import Cell

HEADS = "abcde"
SIGMAS = 6.0


@pytest.fixture
def stage_file(tmp_path) -> Path:
    content = yaml.safe_load(config("stage.yaml").read_text(encoding="utf-8"))
    del content["stage"]["autocollimator"]
    content["stage"]["encoder"]["heads"]["e"] = {"azimuth": 0.8}
    path = tmp_path / "five_heads.yaml"
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    return path


@pytest.fixture
def five(settings, stage_file) -> Iterator[Cell]:
    parameters = mock_parameters(settings, stage=stage_file)
    with Cell(HEADS, parameters) as cell:
        yield cell


def test_error_motion_and_corrections_from_five_heads_alone(five, settings, stage_file, tmp_path):
    estimates = five.collect(five.wire.topic("error_motion_samples"))
    corrections = five.collect(five.wire.topic("axis_corrections"))
    recorder = five.run(Recorder, "recorder", folder=str(tmp_path / "bag"))
    for head in HEADS:
        five.run(EncoderHead, f"encoder_head_{head}", source="mock")
    five.run(MockController, "mock_controller", machine="xyzac_trt")
    five.run(GapMonitor, "gap_monitor")
    five.run(ErrorEstimator, "error_estimator", **ESTIMATOR)
    five.run(Compensation, "compensation", machine="xyzac_trt")
    five.wait_until(lambda: len(estimates) > 10 and len(corrections) > 10, "estimates and corrections")
    five.forget_status("error_estimator: estimate")
    five.wait_for_status("error_estimator: estimate", "complete")
    five.wait_for_status("compensation: correction", "tilt from the description: no autocollimator is heard")
    five.wait_for_status("gap_monitor: /stage/head_e/samples", "alive")
    assert not five.has_status("gap_monitor: /stage/autocollimator/samples", "")
    five.remove(recorder)

    stage = load_stage(stage_file)
    plant = mock_stage(stage, settings)
    streams = five.wire.topic("error_motion_samples").field("streams")
    listed = tuple(f"head_{head}" for head in HEADS) + ("command",)
    used, whole = [], []
    for message in estimates:
        block = block_of(message)
        motion = error_motion_from_block(block)
        assert not motion.observable[:, 2:5].any()
        seen = motion.observable[:, [0, 1, 5]]
        truth = plant.scene((block.times_ns - plant.epoch_ns) * 1e-9).error_motion
        deviation = np.sqrt(np.diagonal(motion.covariance, axis1=1, axis2=2))
        assert (np.abs(motion.components - truth) <= SIGMAS * deviation)[:, [0, 1, 5]][seen].all()
        assert (deviation[:, [0, 1]] < 1e-5)[seen[:, :2]].all(), "an uncertainty that bounds something"
        whole.append(seen.all())
        used.append(int(block.column("streams")[-1]))
    # a head that the estimator discovers later than the others, or whose block is late, is missing and said to be
    assert not any(mask & ~streams.mask(listed) for mask in used)
    assert streams.mask(listed) in used, "the estimate that was called complete"
    assert np.mean(whole) > REPEATED

    replayed = replay_bag(tmp_path / "bag", stage, load_machine("xyzac_trt"), REPLAY)
    assert_repeated(estimates, replayed)


def test_a_recording_with_an_autocollimator_that_the_description_does_not_have(cell, tmp_path):
    """Live it was used: the replay says that it cannot be, not that the bag lacks it."""
    estimates = cell.collect(cell.wire.topic("error_motion_samples"))
    recorder = cell.run(Recorder, "recorder", folder=str(tmp_path / "bag"))
    for head in "abcd":
        cell.run(EncoderHead, f"encoder_head_{head}", source="mock")
    cell.run(AutocollimatorNode, "autocollimator", source="mock")
    cell.run(MockController, "mock_controller")
    cell.run(ErrorEstimator, "error_estimator", **ESTIMATOR)
    cell.wait_until(lambda: len(estimates) > 10, "estimates")
    cell.remove(recorder)
    replayed = replay_bag(tmp_path / "bag", replace(load_stage(), autocollimator=None))
    (said,) = [remark for remark in replayed.remarks if "cannot be repeated" in remark]
    assert "used samples of autocollimator which this stage's description does not have; they follow" in said
    assert np.isnan(replayed.error_motion[:, 3:5]).all()


def test_the_node_of_an_instrument_that_the_stage_does_not_have_says_so(five):
    with pytest.raises(InputError, match=r"five_heads\.yaml: the stage has no section 'autocollimator'"):
        five.run(AutocollimatorNode, "autocollimator", source="mock")
