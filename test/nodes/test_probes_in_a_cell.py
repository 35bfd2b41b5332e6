"""A cell whose stage has listed sensors in place of an autocollimator, by its file alone: live, and replayed."""

from __future__ import annotations

import numpy as np
import pytest
from nodes.mock_cells import mock_parameters
from nodes.probes import INSTEAD, SECOND, stage_with_probes_instead
from nodes.replayed_motion import ESTIMATOR, REPLAY, assert_repeated
from received_blocks import block_of

from rotary_error_monitor.codec.error_motion_blocks import error_motion_from_block
from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.nodes.encoder_head import EncoderHead
from rotary_error_monitor.nodes.error_estimator import ErrorEstimator
from rotary_error_monitor.nodes.gap_monitor import GapMonitor
from rotary_error_monitor.nodes.listed_sensor import ListedSensorNode
from rotary_error_monitor.nodes.mock_controller import MockController
from rotary_error_monitor.nodes.recorder import Recorder
from rotary_error_monitor.recordings.replay import replay_bag
from rotary_error_monitor.sources.mock import mock_stage
from rotary_error_monitor.testing import Cell

HEADS = "abcd"
SIGMAS = 6.0


@pytest.mark.parametrize("sensors", [INSTEAD, SECOND], ids=["probes", "second autocollimator"])
def test_all_six_components_are_observable_and_right(settings, tmp_path, sensors):
    path = stage_with_probes_instead(tmp_path, sensors)
    stage = load_stage(path)
    parameters = mock_parameters(settings, stage=path)
    with Cell(HEADS, parameters, sensors=tuple(stage.sensors)) as cell:
        estimates = cell.collect(cell.wire.topic("error_motion_samples"))
        recorder = cell.run(Recorder, "recorder", folder=str(tmp_path / "bag"))
        for head in HEADS:
            cell.run(EncoderHead, f"encoder_head_{head}", source="mock")
        for name in sensors:
            cell.run(ListedSensorNode, f"listed_sensor_{name}", source="mock")
        cell.run(MockController, "mock_controller", machine="xyzac_trt")
        cell.run(GapMonitor, "gap_monitor")
        cell.run(ErrorEstimator, "error_estimator", **ESTIMATOR)
        cell.wait_until(lambda: len(estimates) > 10, "estimates")
        cell.forget_status("error_estimator: estimate")
        cell.wait_for_status("error_estimator: estimate", "complete")
        for stream in stage.sensors:
            cell.wait_for_status(f"gap_monitor: /stage/{stream}/samples", "alive")
        cell.remove(recorder)

    plant = mock_stage(stage, settings)
    whole = []
    for message in estimates[2:]:
        block = block_of(message)
        motion = error_motion_from_block(block)
        truth = plant.scene((block.times_ns - plant.epoch_ns) * 1e-9).error_motion
        deviation = np.sqrt(np.diagonal(motion.covariance, axis1=1, axis2=2))
        assert (np.abs(motion.components - truth) <= SIGMAS * deviation)[motion.observable].all()
        whole.append(motion.observable.all(axis=1).mean())
        assert (deviation[:, 2] < 3e-7).all(), "an uncertainty that bounds something"
    assert np.mean(whole) > 0.9

    replayed = replay_bag(tmp_path / "bag", stage, load_machine("xyzac_trt"), REPLAY)
    assert_repeated(estimates, replayed)
