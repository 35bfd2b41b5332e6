"""Several machines in one domain, each in a namespace of its own: `--ros-args -r __ns:=/left` is enough."""

from __future__ import annotations

import numpy as np
import pytest
from received_blocks import block_of
from sensor_msgs.msg import JointState

from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.nodes.compensation import Compensation
from rotary_error_monitor.nodes.encoder_head import EncoderHead
from rotary_error_monitor.nodes.error_estimator import ErrorEstimator
from rotary_error_monitor.nodes.gap_monitor import GapMonitor
from rotary_error_monitor.nodes.mock_controller import MockController
from rotary_error_monitor.nodes.recorder import Recorder
from rotary_error_monitor.resources import config

LEFT = ["-r", "__ns:=/left"]


def test_every_topic_moves_with_the_namespace_but_the_diagnostics(cell):
    moved = cell.wire.within("/left")
    assert moved.topic("head_samples", "a").name == "/left/stage/head_a/samples"
    assert {topic.name for topic in moved if not topic.name.startswith("/left/")} == {"/diagnostics"}
    assert cell.wire.within("/") == cell.wire
    for node_class, name, more in (
        (ErrorEstimator, "error_estimator", {}),
        (Compensation, "compensation", {"machine": "xyzac_trt"}),
        (MockController, "mock_controller", {"machine": "xyzac_trt"}),
        (GapMonitor, "gap_monitor", {}),
    ):
        cell.run(node_class, name, ros_args=LEFT, **more)
    alone = {topic.name for topic in cell.wire} - {"/diagnostics"}
    assert alone.isdisjoint(name for name, _ in cell.node.get_topic_names_and_types())
    for name in ("error_estimator", "mock_controller", "gap_monitor"):
        cell.wait_for_status(f"left/{name}: state", "active")
    cell.wait_for_status("left/compensation: correction", "no error motion yet on /left/stage/error_motion/samples")
    assert "error_estimator: state" not in cell.statuses
    assert "left.error_estimator: left.stage.head_a.samples" in cell.statuses
    assert not [name for name in cell.statuses if "/" in name], "tools show a tree that branches at each /"
    assert {status.hardware_id for status in cell.statuses.values()} == {"stage", "xyzac_trt", "mock"}


def test_cells_in_two_namespaces_do_not_hear_one_another(cell, plant):
    here, left = (cell.collect(w.topic("head_samples", "a")) for w in (cell.wire, cell.wire.within("/left")))
    cell.run(EncoderHead, "encoder_head_a", source="mock")
    cell.run(EncoderHead, "encoder_head_a", ros_args=LEFT, mock__seed=99, source="mock")
    cell.wait_until(lambda: len(here) > 3 and len(left) > 3, "blocks of both")
    for received, same in ((here, True), (left, False)):
        for block in map(block_of, received):
            true = plant.samples("head_a", plant.index_at("head_a", block.stamp_ns), len(block.rows))
            assert np.array_equal(block.rows, true.rows) is same


def test_a_driver_is_looked_for_in_the_namespace(cell):
    blocks = cell.collect(cell.wire.within("/left").topic("head_samples", "a"))
    driver = cell.node.create_publisher(JointState, "/left/joint_states", 10)
    cell.run(EncoderHead, "encoder_head_a", ros_args=LEFT, source="joint_state")
    cell.wait_until(lambda: driver.get_subscription_count() > 0, "the head to listen")
    driver.publish(JointState(name=["spindle"], position=[0.0]))
    cell.wait_for_status("left/encoder_head_a: refused /left/joint_states", "must fill header.stamp")
    assert blocks == []


def test_a_bag_of_a_cell_in_a_namespace_is_that_of_any_cell(cell, tmp_path):
    cell.run(EncoderHead, "encoder_head_b", source="mock")
    cell.run(EncoderHead, "encoder_head_a", ros_args=LEFT, source="mock")
    recorder = cell.run(Recorder, "recorder", ros_args=LEFT, folder=str(tmp_path / "bag"))
    cell.wait_until(lambda: cell.recorder_hears({"/stage/head_a/samples"}, "left/recorder"), "the recorder")
    cell.remove(recorder)
    blocks = BagReader(tmp_path / "bag").read_blocks(["/stage/head_a/samples", "/stage/head_b/samples"])
    assert blocks["/stage/head_a/samples"]
    assert not blocks["/stage/head_b/samples"]


@pytest.mark.parametrize("namespace", [[], LEFT, ["-r", "__ns:=/hall/left"]])
def test_the_parameter_file_of_the_cell_holds_in_every_namespace(cell, namespace, tmp_path):
    text = config("cell.yaml").read_text(encoding="utf-8")
    assert text.count("period: 0.001 ") == 1
    path = tmp_path / "cell.yaml"
    path.write_text(text.replace("period: 0.001 ", "period: 0.004 "), encoding="utf-8")
    node = cell.run(ErrorEstimator, "error_estimator", ros_args=["--params-file", str(path), *namespace])
    assert node.setting("period") == 0.004
