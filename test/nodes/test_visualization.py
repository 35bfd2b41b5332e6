"""Markers for RViz: error motion of a known form, magnified as the text says, in the frame of the stage."""

from __future__ import annotations

import re
import time

import numpy as np
import pytest

from rotary_error_monitor.nodes.visualization import Visualization
from rotary_error_monitor.pipeline.error_motion_rows import COLUMN, COLUMNS
from rotary_error_monitor.signals.blocks import block_from_samples

STREAM = "visualization: /stage/error_motion/samples"
COUNT = 720


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
        rows[:, COLUMN[name]] = values
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
    cell.publish_blocks(cell.wire.topic("error_motion_samples"))(
        block_from_samples(np.array([time.time_ns()]), ("angle",), np.zeros((1, 1)))
    )
    cell.wait_for_status(STREAM, "messages refused")
