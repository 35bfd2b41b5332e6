"""The node of a listed sensor: mock, third-party driver, voltage; and how it is told which sensor it is."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from faults.live.other_programs import stated
from geometry_msgs.msg import Vector3Stamped
from nodes.mock_cells import mock_parameters
from nodes.plant_samples import assert_sample, assert_samples
from nodes.probes import SECOND, STREAMS, stage_with_probes, stage_with_probes_instead
from received_blocks import block_of

from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.nodes import messages
from rotary_error_monitor.nodes.encoder_head import EncoderHead
from rotary_error_monitor.nodes.error_estimator import ErrorEstimator
from rotary_error_monitor.nodes.gap_monitor import GapMonitor
from rotary_error_monitor.nodes.listed_sensor import ListedSensorNode
from rotary_error_monitor.nodes.recorder import Recorder
from rotary_error_monitor.plant.stage import StagePlant
from rotary_error_monitor.sources.mock import mock_stage
from rotary_error_monitor.testing import Cell


@pytest.fixture
def stage_file(tmp_path) -> Path:
    return stage_with_probes(tmp_path)


@pytest.fixture
def probed(settings, stage_file) -> Iterator[Cell]:
    parameters = mock_parameters(settings, stage=stage_file)
    with Cell(parameters=parameters, sensors=STREAMS) as cell:
        yield cell


@pytest.fixture
def truth(settings, stage_file) -> StagePlant:
    return mock_stage(load_stage(stage_file), settings)


def test_blocks_are_those_of_the_plant_and_are_recorded(probed, truth, tmp_path):
    topics = [probed.wire.topic("axial_probe_samples", "top"), probed.wire.topic("radial_probe_samples", "low")]
    assert [topic.name for topic in topics] == [f"/stage/{stream}/samples" for stream in STREAMS]
    received = [probed.collect(topic) for topic in topics]
    people = probed.collect(probed.wire.topic("axial_probe_displacement", "top"))
    recorder = probed.run(Recorder, "recorder", folder=str(tmp_path / "bag"))
    probed.start("listed_sensor", "listed_sensor_top", source="mock")
    probed.run(ListedSensorNode, "any_name", sensor="radial_probe_low", source="mock")
    probed.wait_until(lambda: people and all(len(each) > 2 for each in received), "blocks of both")
    for stream, topic, blocks in zip(STREAMS, topics, received, strict=True):
        assert blocks[1].header.frame_id == stream
        block = block_of(blocks[1])
        assert block.names == ("t", "displacement") == ("t", *topic.columns)
        assert len(block.rows) == 50, "1000 samples a second"
        assert_samples(block, truth, stream)
    assert people[0].header.frame_id == "axial_probe_top"
    vector = people[0].vector
    assert_sample(people[0].header.stamp, [vector.x], truth, "axial_probe_top")
    assert (vector.y, vector.z) == (0.0, 0.0)
    wanted = {topic.name for topic in topics}
    probed.wait_until(lambda: probed.recorder_hears(wanted), "the recorder")
    probed.remove(recorder)
    bag = BagReader(tmp_path / "bag").read_blocks([topic.name for topic in topics])
    for topic, blocks in zip(topics, received, strict=True):
        mine = {block_of(message).stamp_ns for message in blocks}
        assert {block.stamp_ns for block in bag[topic.name]} & mine


def test_its_rate_is_a_parameter(probed):
    blocks = probed.collect(probed.wire.topic("axial_probe_samples", "top"))
    probed.run(ListedSensorNode, "listed_sensor", sensor="top", rate=4000.0, source="mock")
    probed.wait_until(lambda: len(blocks) > 1, "blocks")
    assert block_of(blocks[1]).rows.shape == (200, 2)


def test_vectors_of_a_third_party_driver(probed):
    blocks = probed.collect(probed.wire.topic("radial_probe_samples", "low"))
    driver = probed.node.create_publisher(Vector3Stamped, "/my_probe", 10)
    probed.run(ListedSensorNode, "listed_sensor_low", source="vector3", vector3__topic="/my_probe")
    probed.wait_until(lambda: driver.get_subscription_count() > 0, "the node to listen")
    start = probed.node.get_clock().now().nanoseconds
    for step in range(3):
        driver.publish(messages.vector_message(start + step, "", 1e-6 * step, 7.0))
    probed.wait_until(lambda: sum(block.width for block in blocks) == 3, "all samples")
    rows = np.concatenate([block_of(block).rows for block in blocks])
    np.testing.assert_allclose(rows[:, 1:], [[0.0], [1e-6], [2e-6]], atol=1e-18)


def test_the_voltage_of_an_amplifier(probed, tmp_path):
    (tmp_path / "in_voltage3_raw").write_text("-250\n")
    (tmp_path / "in_voltage_scale").write_text("2.0\n")  # mV
    blocks = probed.collect(probed.wire.topic("axial_probe_samples", "top"))
    iio = {"iio__device": str(tmp_path), "iio__channel": 3, "iio__sensitivity": 4e-6}
    probed.run(ListedSensorNode, "listed_sensor_top", source="iio", poll_rate=100.0, **iio)
    probed.wait_until(lambda: len(blocks) > 1, "blocks")
    np.testing.assert_allclose(block_of(blocks[1]).rows[0, 1:], [-2e-6], atol=1e-18)


@pytest.mark.parametrize("asked", ["side", "axial_probe_low", "a"])
def test_a_sensor_that_the_stage_does_not_list(probed, asked):
    told = (
        rf"/any: parameter 'sensor' is '{asked}', which is none of the stage's; "
        r"it lists the sensors axial_probe_top, radial_probe_low \(or name the node listed_sensor_<sensor>\)"
    )
    with pytest.raises(InputError, match=told):
        probed.run(ListedSensorNode, "any", sensor=asked, source="mock")


def test_a_stage_that_lists_no_sensors(cell):
    with pytest.raises(InputError, match=r"parameter 'sensor' is 'top', which is none of the stage's; it lists no sen"):
        cell.run(ListedSensorNode, "listed_sensor_top", source="mock")


def test_the_process_ends_with_2_where_its_sensor_is_wrong(probed):
    process = probed.start("listed_sensor", sensor="side", source="mock")
    assert process.wait() == 2
    assert "parameter 'sensor' is 'side', which is none of the stage's" in process.output
    assert "axial_probe_top, radial_probe_low" in process.output
    assert "Traceback" not in process.output


@pytest.fixture
def tilting(settings, tmp_path) -> Iterator[Cell]:
    path = stage_with_probes_instead(tmp_path, SECOND)
    with Cell(parameters=mock_parameters(settings, stage=path), sensors=("tilt_sensor_second",)) as cell:
        yield cell


def test_a_tilt_sensor_sends_both_of_its_fields(tilting, settings, tmp_path):
    topic = tilting.wire.topic("tilt_sensor_samples", "second")
    assert topic.name == "/stage/tilt_sensor_second/samples"
    blocks, people = tilting.collect(topic), tilting.collect(tilting.wire.topic("tilt_sensor_tilt", "second"))
    tilting.run(ListedSensorNode, "listed_sensor_second", source="mock")
    tilting.wait_until(lambda: people and len(blocks) > 2, "blocks")
    block = block_of(blocks[1])
    truth = mock_stage(load_stage(tmp_path / "instead.yaml"), settings)
    assert block.names == ("t", "tilt_x", "tilt_y")
    assert_samples(block, truth, "tilt_sensor_second")
    vector = people[0].vector
    assert_sample(people[0].header.stamp, [vector.x, vector.y], truth, "tilt_sensor_second")
    assert vector.z == 0.0


def test_vectors_of_a_driver_of_an_autocollimator(tilting):
    blocks = tilting.collect(tilting.wire.topic("tilt_sensor_samples", "second"))
    driver = tilting.node.create_publisher(Vector3Stamped, "/my_tilt", 10)
    tilting.run(ListedSensorNode, "listed_sensor_second", source="vector3", vector3__topic="/my_tilt")
    tilting.wait_until(lambda: driver.get_subscription_count() > 0, "the node to listen")
    driver.publish(messages.vector_message(tilting.node.get_clock().now().nanoseconds, "", 1e-6, -2e-6))
    tilting.wait_until(lambda: sum(block.width for block in blocks) == 1, "the sample")
    (row,) = np.concatenate([block_of(block).rows for block in blocks])
    np.testing.assert_allclose(row[1:], [1e-6, -2e-6], atol=1e-18)


def test_one_voltage_is_no_tilt(tilting, tmp_path):
    told = "source iio reads one voltage, but tilt_sensor_second has the fields tilt_x, tilt_y; expected the source"
    with pytest.raises(InputError, match=told):
        tilting.run(ListedSensorNode, "listed_sensor_second", source="iio", iio__device=str(tmp_path))


def test_a_listed_sensor_that_never_speaks_is_named_with_its_topic_within_seconds(settings, tmp_path):
    thermometer = {"kind": "thermometer", "noise": 0.02, "resolution": 0.01, "range": 100.0, "uncertainty": 0.1}
    path = stage_with_probes_instead(tmp_path, {**SECOND, "bearing": thermometer})
    stage = load_stage(path)
    with Cell("abcd", mock_parameters(settings, stage=path), sensors=tuple(stage.listed)) as cell:
        for head in "abcd":
            cell.run(EncoderHead, f"encoder_head_{head}", source="mock")
        cell.run(ListedSensorNode, "listed_sensor_second", source="mock")
        cell.run(ErrorEstimator, "error_estimator", period=0.005, check_turns=0.0)
        cell.run(GapMonitor, "gap_monitor")
        with stated("a word of each", 10.0):
            for listener, stream in (
                ("error_estimator", "axial_probe_nose"),
                ("gap_monitor", "axial_probe_nose"),
                ("gap_monitor", "thermometer_bearing"),
            ):
                cell.wait_for_status(f"{listener}: /stage/{stream}/samples", "nothing has arrived yet")
            cell.wait_for_status("error_estimator: estimate", "without command, axial_probe_nose")
            cell.wait_for_status("error_estimator: /stage/tilt_sensor_second/samples", "alive")
