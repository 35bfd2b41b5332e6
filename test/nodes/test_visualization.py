"""Markers for RViz: error motion of a known form, magnified as the text says, in the frame of the stage."""

from __future__ import annotations

import re
import sys
import time
from types import SimpleNamespace

import numpy as np
import pytest
from geometry_msgs.msg import TransformStamped
from rcl_interfaces.msg import Log
from sensor_msgs.msg import JointState

from rotary_error_monitor.description.wire import load_wire
from rotary_error_monitor.nodes.visualization import Visualization
from rotary_error_monitor.signals.blocks import block_from_samples

STREAM = "visualization: /stage/error_motion/samples"
COUNT = 720
COLUMNS = load_wire().topic("error_motion_samples").columns


def turn(observable: int, exc: float = 1e-6, eyc: float = 3e-7, tilt: float = 2e-6):
    """Block of a turn that ends now: an elliptic orbit and a constant tilt about x."""
    rows, theta = np.zeros((COUNT, len(COLUMNS))), (np.arange(COUNT) + 0.5) * 2 * np.pi / COUNT
    for name, values in (
        ("theta", theta),
        ("exc", exc * np.cos(theta)),
        ("eyc", eyc * np.sin(theta)),
        ("eac", tilt),
        ("observable", observable),
    ):
        rows[:, COLUMNS.index(name)] = values
    return block_from_samples(time.time_ns() - 1_000_000 * np.arange(COUNT)[::-1], COLUMNS, rows)


def drawn(message, name):
    """Points (k, 3) of the markers of a namespace."""
    points = [[p.x, p.y, p.z] for marker in message.markers if marker.ns == name for p in marker.points]
    return np.reshape(points, (-1, 3))


def magnification(message, what):
    (text,) = (marker.text for marker in message.markers if marker.ns == "scale")
    return float(re.search(rf"{what} × ([\d,]+)", text)[1].replace(",", ""))


def test_what_is_drawn_is_the_error_motion_as_many_times_too_large_as_is_written(cell):
    node = cell.run(Visualization, "visualization", period=0.05)
    send = cell.publish_blocks(cell.wire.topic("error_motion_samples"))
    pictures = cell.collect(cell.wire.topic("error_motion_markers"))
    send(turn(0b11011))
    cell.wait_until(lambda: len(pictures) > 0, "a picture")
    picture, radius = pictures[0], node.stage.encoder.disc_radius
    assert {marker.header.frame_id for marker in picture.markers} == {"stage"}
    assert len({(marker.ns, marker.id) for marker in picture.markers}) == len(picture.markers)
    assert [m.text for m in picture.markers if m.ns == "heads"] == ["a", "b", "c", "d"]
    orbit, polar = drawn(picture, "orbit"), drawn(picture, "polar")
    scale = magnification(picture, "radial")
    np.testing.assert_allclose(np.abs(orbit).max(axis=0) / scale, [1e-6, 3e-7, 0.0], rtol=1e-3)
    away = np.hypot(polar[:, 0], polar[:, 1]) - radius
    np.testing.assert_allclose([away.max() / scale, away.min() / scale], [1e-6, 3e-7], rtol=1e-3)
    axis = drawn(picture, "axis")
    np.testing.assert_allclose((axis[1] - axis[0])[1] / axis[1, 2] / magnification(picture, "tilt"), -2e-6, rtol=1e-3)
    cell.wait_for_status(STREAM, "stale")
    before = len(pictures)
    cell.spin_for(0.3)
    assert len(pictures) == before, "an old picture is not sent as a new one, and goes by its lifetime"
    assert all(0 < marker.lifetime.sec <= 2 for marker in picture.markers)


@pytest.mark.parametrize(
    ("observable", "orbit", "axis", "words"), [(0b11000, 0, 2, "not observable"), (0b11, 361, 0, "×")]
)
def test_what_is_not_observable_is_not_drawn(cell, observable, orbit, axis, words):
    cell.run(Visualization, "visualization", period=0.05)
    send = cell.publish_blocks(cell.wire.topic("error_motion_samples"))
    pictures = cell.collect(cell.wire.topic("error_motion_markers"))
    send(turn(observable))
    cell.wait_until(lambda: len(pictures) > 0, "a picture")
    assert (len(drawn(pictures[0], "orbit")), len(drawn(pictures[0], "axis"))) == (orbit, axis)
    (text,) = (marker.text for marker in pictures[0].markers if marker.ns == "scale")
    assert words in text


def test_a_block_that_is_no_error_motion_is_refused(cell):
    cell.run(Visualization, "visualization", period=0.05)
    send = cell.publish_blocks(cell.wire.topic("error_motion_samples"))

    def is_refused():  # said of those since the last report alone
        send(block_from_samples(np.array([time.time_ns()]), ("angle",), np.zeros((1, 1))))
        return cell.has_status(STREAM, "messages refused")

    cell.wait_until(is_refused, "a word of it")


@pytest.fixture
def sent(monkeypatch):
    """What a stand-in for tf2's broadcaster is given: tf2 has no wheel."""
    messages = []

    class TransformBroadcaster:
        def __init__(self, node):
            self.pub_tf = node.create_publisher(TransformStamped, "tf_stand_in", 1)

        def sendTransform(self, transforms):
            messages.append({each.child_frame_id: each for each in transforms})

    monkeypatch.setitem(sys.modules, "tf2_ros", SimpleNamespace(TransformBroadcaster=TransformBroadcaster))
    return messages


def test_frames_of_machine_stage_and_rotor_go_to_tf2_where_it_is_installed(cell, sent):
    cell.run(Visualization, "visualization", period=0.05, machine="xyzac_trt", ring_height=0.04)
    tell = cell.publish_on(cell.wire.topic("machine_joint_states"))
    letters = ["X", "Y", "Z", "A", "C"]
    tell(JointState(name=letters, position=[0.01, 0.02, 0.03, 0.0, 0.5], velocity=[0.0] * 5))
    cell.publish_blocks(cell.wire.topic("error_motion_samples"))(turn(0b11011))
    cell.wait_until(lambda: sent and "saddle" in sent[-1], "frames with the machine's")
    frames = sent[-1]
    carriers = {name: frame.header.frame_id for name, frame in frames.items()}
    assert (carriers["stage"], carriers["rotor"], carriers["table"]) == ("trunnion", "stage", "trunnion")
    stage, carriage, rotor = (frames[name].transform for name in ("stage", "carriage", "rotor"))
    np.testing.assert_allclose(stage.translation.z - frames["table"].transform.translation.z, -0.04, atol=1e-15)
    assert carriage.translation.x == 0.01
    assert 0 < abs(rotor.translation.x) <= 1e-6 < 0.999 < np.hypot(rotor.rotation.z, rotor.rotation.w)


def test_without_tf2_markers_come_all_the_same_and_the_log_says_so(cell):
    said = []
    cell.node.create_subscription(Log, "/rosout", said.append, 10)
    cell.run(Visualization, "visualization", period=0.05, machine="xyzac_trt")
    cell.publish_blocks(cell.wire.topic("error_motion_samples"))(turn(0b11011))
    pictures = cell.collect(cell.wire.topic("error_motion_markers"))
    cell.wait_until(lambda: len(pictures) > 0, "a picture")
    cell.wait_until(lambda: any("no frames on /tf" in line.msg for line in said), "a line in the log")
