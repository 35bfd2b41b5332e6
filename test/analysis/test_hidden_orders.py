"""Orders of form that pass for error motion, by the closed form of each set of sensors."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from pipeline.test_listed_sensors import AXIAL, FACE, SECOND, described, probe

from rotary_error_monitor.analysis.hidden_orders import HiddenOrders
from rotary_error_monitor.analysis.signals import AXIAL as AXIAL_MOTION
from rotary_error_monitor.analysis.signals import RADIAL, ROTATING, TILT, SignalName
from rotary_error_monitor.description.stage import StageDescription

ROUND = {f"radial_probe_p{k}": probe("radial_probe", azimuth=2 * np.pi * k / 3, height=0.0) for k in range(3)}
PAIR = {f"radial_probe_{k}": probe("radial_probe", azimuth=k * np.pi / 2, height=0.0) for k in range(2)}
HEADS = described({})
NONE, ALL, ODD = (), tuple(range(1, 13)), (1, 3, 5, 7, 9, 11)
BESIDE_3M = (1, 2, 4, 5, 7, 8, 10, 11)
X, Y = (SignalName(RADIAL, direction, 0.0) for direction in "xy")
HIGH, ABOUT_X, ALONG = SignalName(RADIAL, "x", 0.1), SignalName(TILT, "x", None), SignalName(AXIAL_MOTION, "z", None)


def without_heads(sensors: dict, tilt: bool = True) -> StageDescription:
    return dataclasses.replace(described(sensors, tilt=tilt), encoder=None)


@pytest.mark.parametrize(
    ("stage", "expected"),
    [
        (HEADS, {X: ODD, Y: ODD, HIGH: ODD, ABOUT_X: NONE}),
        (described(ROUND), {X: ODD, Y: ODD, ABOUT_X: NONE}),
        (described({"axial_probe_f0": FACE["axial_probe_f0"]}), {X: ODD, ALONG: ALL, ABOUT_X: NONE}),
        (described(AXIAL), {X: ODD, ALONG: NONE}),  # on the axis nothing goes round
        (without_heads(ROUND), {X: BESIDE_3M, Y: BESIDE_3M, ABOUT_X: NONE}),
        (without_heads(PAIR), {X: ALL, Y: ALL}),
        (without_heads({"radial_probe_0": PAIR["radial_probe_0"]}), {X: ALL}),
        (described(SECOND, tilt=False), {ABOUT_X: ALL, X: ODD}),
        # a face that leans is a tilt and nothing else
        (described(FACE, tilt=False), {ALONG: ALL[1:], ABOUT_X: ALL}),
    ],
)
def test_they_are_those_that_no_sensor_contradicts(stage: StageDescription, expected: dict) -> None:
    hidden = HiddenOrders(stage)
    for signal, orders in expected.items():
        assert hidden.of(signal, 12) == orders, signal
        assert hidden.of(signal, 5) == tuple(order for order in orders if order <= 5)
    assert hidden.of(SignalName(RADIAL, ROTATING, 0.0), 12) == ()
