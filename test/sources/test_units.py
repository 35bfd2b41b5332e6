"""Drivers that tell angles in other units than the definitions of their messages."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest

from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.sources.device import Instrument
from rotary_error_monitor.sources.joint_state import CommandDriver, JointStateDriver
from rotary_error_monitor.sources.vector3 import DisplacementDriver, TiltDriver

IN_A_TURN = {"rad": math.tau, "deg": 360.0, "turn": 1.0, "gon": 400.0, "arcmin": 21600.0, "arcsec": 1296000.0}


def opened(driver, fields, **settings):
    values = {name.replace("__", "."): value for name, value in settings.items()}
    return driver.open(Instrument("head_a", fields, load_stage(), values.__getitem__, 0))


@pytest.mark.parametrize(("unit", "turn"), IN_A_TURN.items())
def test_a_turn_is_a_turn_in_every_unit(unit, turn):
    joints = {"joint_state__topic": "t", "joint_state__joint": "", "joint_state__unit": unit}
    message = SimpleNamespace(name=["C"], position=[turn], velocity=[turn / 2])
    head = opened(JointStateDriver(), ("angle",), **joints)
    command = opened(CommandDriver(), ("angle", "velocity"), **joints)
    assert head.sample(message) == pytest.approx((math.tau,), rel=1e-15)
    assert command.sample(message) == pytest.approx((math.tau, math.pi), rel=1e-15)
    vector = SimpleNamespace(vector=SimpleNamespace(x=turn, y=-turn))
    tilt = opened(TiltDriver(), ("tilt_x", "tilt_y"), vector3__topic="t", vector3__unit=unit)
    assert tilt.sample(vector) == pytest.approx((math.tau, -math.tau), rel=1e-15)


def test_displacements_stay_as_they_are():
    source = opened(DisplacementDriver(), ("radial_x", "radial_y"), vector3__topic="t")
    assert source.sample(SimpleNamespace(vector=SimpleNamespace(x=0.1, y=0.7))) == (0.1, 0.7)
