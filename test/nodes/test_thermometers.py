"""A cell whose stage lists thermometers: published, recorded, seen by the gap monitor, and replayed as it was."""

from __future__ import annotations

import numpy as np
import pytest
from nodes.listing import stage_that_lists
from nodes.mock_cells import mock_parameters
from nodes.plant_samples import assert_sample, assert_samples
from nodes.replayed_motion import ESTIMATOR, REPLAY, assert_repeated
from received_blocks import block_of
from sensor_msgs.msg import Temperature

from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.description.topics import samples_topic
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

OWN = {"kind": "thermometer", "noise": 0.02, "resolution": 0.01, "range": 100.0, "uncertainty": 0.1}
PLACES = ("bearing", "housing")


@pytest.fixture
def path(tmp_path):
    return stage_that_lists(tmp_path, dict.fromkeys(PLACES, OWN))


def test_temperatures_of_a_third_party_driver(settings, path):
    """One message a second is no silence."""
    with Cell("abcd", mock_parameters(settings, stage=path), sensors=tuple(load_stage(path).listed)) as cell:
        blocks = cell.collect(cell.wire.topic("thermometer_samples", "bearing"))
        driver = cell.node.create_publisher(Temperature, "/pt100", 10)
        cell.run(ListedSensorNode, "listed_sensor_bearing", source="temperature", temperature__topic="/pt100")
        cell.wait_until(lambda: driver.get_subscription_count() > 0, "the node to listen")
        said = []
        for value in (20.5, 20.25, 21.0):
            stamp_ns = cell.node.get_clock().now().nanoseconds
            driver.publish(messages.temperature_message(stamp_ns, "", value))
            cell.spin_for(1.3)
            said.append(cell.status("listed_sensor_bearing: /pt100").message)
        cell.wait_until(lambda: sum(block.width for block in blocks) == 3, "all samples")
        rows = np.concatenate([block_of(block).rows for block in blocks])
        np.testing.assert_array_equal(rows[:, 1], [20.5, 20.25, 21.0])
        assert not [each for each in said[1:] if "stale" in each or "no " in each], said
        cell.spin_for(3.0)
        assert cell.has_status("listed_sensor_bearing: /pt100", "alive"), "a thermometer may take its time"


def test_thermometers_in_a_cell(settings, path, tmp_path):
    stage = load_stage(path)
    with Cell("abcd", mock_parameters(settings, stage=path), sensors=tuple(stage.listed)) as cell:
        estimates = cell.collect(cell.wire.topic("error_motion_samples"))
        read = {place: cell.collect(cell.wire.topic("thermometer_samples", place)) for place in PLACES}
        people = cell.collect(cell.wire.topic("thermometer_temperature", PLACES[0]))
        recorder = cell.run(Recorder, "recorder", folder=str(tmp_path / "bag"))
        for head in "abcd":
            cell.run(EncoderHead, f"encoder_head_{head}", source="mock")
        cell.run(AutocollimatorNode, "autocollimator", source="mock")
        for place in PLACES:
            cell.run(ListedSensorNode, f"listed_sensor_{place}", source="mock")
        cell.run(MockController, "mock_controller", machine="xyzac_trt")
        cell.run(GapMonitor, "gap_monitor")
        cell.run(ErrorEstimator, "error_estimator", **ESTIMATOR)
        cell.wait_until(lambda: len(estimates) > 10 and people, "estimates")
        cell.wait_until(lambda: all(len(blocks) > 3 for blocks in read.values()), "blocks of both thermometers")
        for place in PLACES:
            cell.wait_for_status(f"gap_monitor: {samples_topic(f'thermometer_{place}')}", "alive")
            cell.wait_for_status(f"listed_sensor_{place}: {samples_topic(f'thermometer_{place}')}", "alive")
        topics = {samples_topic(f"thermometer_{place}") for place in PLACES}
        cell.wait_until(lambda: cell.recorder_hears(topics), "the recorder")
        cell.remove(recorder)

    truth = mock_stage(stage, settings)
    recorded = BagReader(tmp_path / "bag").read_blocks(sorted(topics))
    for place, blocks in read.items():
        stream = f"thermometer_{place}"
        for message in blocks[1:]:
            block = block_of(message)
            assert_samples(block, truth, stream)
            assert len(block.rows) == 1, "one sample a second"
        mine = {block_of(message).stamp_ns for message in blocks}
        assert len({block.stamp_ns for block in recorded[samples_topic(stream)]} & mine) > 1
    assert_sample(people[0].header.stamp, [people[0].temperature], truth, f"thermometer_{PLACES[0]}")
    replayed = replay_bag(tmp_path / "bag", stage, load_machine("xyzac_trt"), REPLAY)
    assert_repeated(estimates, replayed)
