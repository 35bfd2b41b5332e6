"""Drivers that tell angles in other units than the definitions of their messages."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest

from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.sources.device import Instrument
from rotary_error_monitor.sources.joint_state import CommandDriver, JointStateDriver
from rotary_error_monitor.sources.surroundings import WrenchDriver
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


@pytest.mark.parametrize(
    ("unit", "newtons"), [("N", 1.0), ("kN", 1e3), ("mN", 1e-3), ("kgf", 9.80665), ("lbf", 4.4482216)]
)
def test_a_force_is_one_in_every_unit(unit, newtons):
    """Pound-force and kilogram-force by NIST SP 811."""
    source = opened(WrenchDriver(), ("force_x", "force_y"), wrench__topic="t", wrench__unit=unit)
    message = SimpleNamespace(wrench=SimpleNamespace(force=SimpleNamespace(x=1.0, y=-3.0)))
    assert source.sample(message) == pytest.approx((newtons, -3.0 * newtons), rel=1e-8)


def test_what_is_no_load_cell_is_not_read_as_one():
    with pytest.raises(InputError, match="head_a shows displacement; only a load cell is read so"):
        opened(WrenchDriver(), ("displacement",), wrench__topic="t", wrench__unit="N")
