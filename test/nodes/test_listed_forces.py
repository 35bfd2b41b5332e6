"""A cell whose stage lists a load cell and its command: published, recorded, and replayed as it was."""

from __future__ import annotations

import numpy as np
import pytest
from geometry_msgs.msg import WrenchStamped
from nodes.listing import stage_that_lists
from nodes.mock_cells import mock_parameters
from nodes.plant_samples import assert_sample, assert_samples
from nodes.replayed_motion import ESTIMATOR, REPLAY, assert_repeated
from received_blocks import block_of

from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.description.topics import samples_topic
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.nodes import messages
from rotary_error_monitor.nodes.autocollimator import AutocollimatorNode
from rotary_error_monitor.nodes.encoder_head import EncoderHead
from rotary_error_monitor.nodes.error_estimator import ErrorEstimator
from rotary_error_monitor.nodes.gap_monitor import GapMonitor
from rotary_error_monitor.nodes.listed_sensor import ListedSensorNode
from rotary_error_monitor.nodes.mock_controller import MockController
from rotary_error_monitor.nodes.recorder import Recorder
from rotary_error_monitor.recordings.replay import replay_bag
from rotary_error_monitor.sources.mock import mock_stage
from rotary_error_monitor.testing import Cell

NOSE = {
    "kind": "force",
    "azimuth": 0.5,
    "gain": -1.2,
    "zero": [4.0, -2.0],
    "noise": 0.05,
    "resolution": 0.01,
    "range": 500.0,
    "uncertainty": 0.3,
}
DRIVE = {"kind": "command", "zero": 0.4, "sign": -1, "gain": 3.0, "latency": 2.0e-4}
TOPIC = samples_topic("force_nose")


@pytest.fixture
def path(tmp_path):
    return stage_that_lists(tmp_path, {"nose": NOSE, "drive": DRIVE})


def test_forces_of_a_third_party_driver_in_its_unit(settings, path):
    with Cell("abcd", mock_parameters(settings, stage=path), sensors=tuple(load_stage(path).listed)) as cell:
        blocks = cell.collect(cell.wire.topic("listed_force_samples", "nose"))
        driver = cell.node.create_publisher(WrenchStamped, "/dynamometer", 10)
        given = {"wrench__topic": "/dynamometer", "wrench__unit": "kN"}
        cell.run(ListedSensorNode, "listed_sensor_nose", source="wrench", **given)
        cell.wait_until(lambda: driver.get_subscription_count() > 0, "the node to listen")
        for number in range(3):
            stamp_ns = cell.node.get_clock().now().nanoseconds
            driver.publish(messages.wrench_message(stamp_ns, "", [0.25 * number, -0.5]))
            cell.spin_for(0.1)
        cell.wait_until(lambda: sum(block.width for block in blocks) == 3, "all samples")
        rows = np.concatenate([block_of(block).rows for block in blocks])
        np.testing.assert_allclose(rows[:, 1:], [[0.0, -500.0], [250.0, -500.0], [500.0, -500.0]], rtol=1e-12)


def test_a_name_that_the_stage_does_not_list_is_refused(settings, path):
    with (
        Cell("abcd", mock_parameters(settings, stage=path), sensors=tuple(load_stage(path).listed)) as cell,
        pytest.raises(InputError, match=r"'nase', which is none of the stage's; it lists the sensors force_nose"),
    ):
        cell.run(ListedSensorNode, "listed_sensor_nase", source="mock")


def test_force_and_command_of_the_list_in_a_cell(settings, path, tmp_path):
    stage = load_stage(path)
    with Cell("abcd", mock_parameters(settings, stage=path), sensors=tuple(stage.listed)) as cell:
        estimates = cell.collect(cell.wire.topic("error_motion_samples"))
        read = cell.collect(cell.wire.topic("listed_force_samples", "nose"))
        told = cell.collect(cell.wire.topic("command_samples"))
        people = cell.collect(cell.wire.topic("listed_force_wrench", "nose"))
        recorder = cell.run(Recorder, "recorder", folder=str(tmp_path / "bag"))
        for head in "abcd":
            cell.run(EncoderHead, f"encoder_head_{head}", source="mock")
        cell.run(AutocollimatorNode, "autocollimator", source="mock")
        cell.run(ListedSensorNode, "listed_sensor_nose", source="mock")
        cell.run(MockController, "mock_controller", machine="xyzac_trt")
        cell.run(GapMonitor, "gap_monitor")
        cell.run(ErrorEstimator, "error_estimator", **ESTIMATOR)
        cell.wait_until(lambda: len(estimates) > 10 and people, "estimates")
        cell.wait_until(lambda: len(read) > 3, "blocks of the load cell")
        for node in ("gap_monitor", "listed_sensor_nose"):
            cell.wait_for_status(f"{node}: {TOPIC}", "alive")
        cell.wait_until(lambda: cell.recorder_hears({TOPIC}), "the recorder")
        cell.wait_until(lambda: len(estimates) > 150, "a recording")
        cell.remove(recorder)

    truth = mock_stage(stage, settings)
    for message in read[1:]:
        assert_samples(block_of(message), truth, "force_nose")
    for message in told[1:10]:
        block = block_of(message)
        assert_samples(block, truth, "command")
        angle, speed = truth.motion.at((block.times_ns - truth.epoch_ns) * 1e-9 - 2.0e-4)
        np.testing.assert_allclose(block.rows[:, 1:], np.column_stack([0.4 - 3.0 * angle, -3.0 * speed]), atol=1e-9)
    first = people[0].wrench.force
    assert_sample(people[0].header.stamp, [first.x, first.y], truth, "force_nose")
    recorded = BagReader(tmp_path / "bag").read_blocks([TOPIC])[TOPIC]
    mine = {block_of(message).stamp_ns for message in read}
    assert len({block.stamp_ns for block in recorded} & mine) > 1
    replayed = replay_bag(tmp_path / "bag", stage, load_machine("xyzac_trt"), REPLAY)
    assert_repeated(estimates, replayed)
    assert np.isfinite(replayed.error_motion[-20:, [0, 1, 3, 4, 5]]).all(), "the command is none that contradicts"
