"""The page of the machine file names every key, and what it says of signs, frames and scales is what the model does."""

from __future__ import annotations

import re
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.description.machine_limits import MachineLimits
from rotary_error_monitor.description.machine_parts import (
    Axis,
    BodySection,
    Displacement,
    Harmonic,
    PoseSection,
    Smooth,
)
from rotary_error_monitor.description.machine_section import TableSection, TreeSection
from rotary_error_monitor.machine.error_model import predict_tool_offset
from rotary_error_monitor.machine.kinematics import arrange_machine, stand

PAGE = (Path(__file__).parents[2] / "doc" / "machine_file.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def machine(tmp_path_factory):
    path = tmp_path_factory.mktemp("page") / "lathe.yaml"
    path.write_text(re.search(r"```yaml\n(.*?)```", PAGE, re.DOTALL)[1], encoding="utf-8")
    return load_machine(path)


def plain(machine):
    """The same without any error."""
    bodies = tuple(replace(body, location_error=Displacement()) for body in machine.bodies)
    axes = tuple(replace(axis, expansion=0.0, reversal=0.0) for axis in machine.axes)
    return replace(machine, bodies=bodies, axes=axes, errors={})


def offset(machine, x=0.0, z=0.0, c=0.0, **others):
    return predict_tool_offset(arrange_machine(machine), [[x, z, c]], **others)[0]


@pytest.mark.parametrize(
    "section",
    [TreeSection, Axis, BodySection, PoseSection, Displacement, MachineLimits, Smooth, Harmonic, TableSection],
)
def test_every_key_is_on_the_page(section):
    fence, text = r"```yaml\n.*?```", re.DOTALL
    named = {
        e for word in re.findall(r"`([^`]+)`", re.sub(fence, "", PAGE, flags=text)) for e in re.findall(r"\w+", word)
    }
    shown = set(re.findall(r"(\w+):", re.search(fence, PAGE, text)[0]))
    unnamed = {field.name for field in fields(section)} - named - shown - {"names_as", "letter"}
    assert not unnamed


def test_squareness_is_the_angle_of_the_positive_directions_less_a_right_angle(machine):
    square = replace(plain(machine), bodies=machine.bodies)
    model = arrange_machine(square)

    def tip(x, z):
        return stand(model, np.array([[x], [z], [0.0]]), np.zeros((6, 3, 1))).tool.end[:, 3, 0]

    along_x, along_z = tip(0.2, 0.0) - tip(0.0, 0.0), tip(0.0, 0.5) - tip(0.0, 0.0)
    angle = np.arccos(along_x @ along_z / np.linalg.norm(along_x) / np.linalg.norm(along_z))
    assert angle - np.pi / 2 == pytest.approx(2e-5, abs=1e-9)


def test_expansion_and_reversal_go_along_the_axis(machine):
    """Z moves along -z."""
    warm = replace(plain(machine), axes=machine.axes)
    assert offset(warm, z=0.3, temperature=30.0)[2] == pytest.approx(-1e-5 * 10.0 * 0.3, abs=1e-15)
    for way in (1.0, -1.0):
        assert offset(warm, direction=[[0.0, way, 0.0]])[2] == pytest.approx(way * 1e-6, abs=1e-15)
    assert offset(warm)[2] == 0.0


def test_errors_of_a_rotary_axis_turn_with_it_and_live_ones_do_not(machine):
    """In the workpiece's frame, which turns with C: displaced one way it has the tool the other way."""
    turning = replace(plain(machine), errors={"EXC": machine.errors["EXC"]})
    assert offset(turning, c=0.0)[:2] == pytest.approx([-5e-7, 0.0], abs=1e-15)
    assert offset(turning, c=np.pi)[:2] == pytest.approx([5e-7, 0.0], abs=1e-15)
    live = [[3e-7, 0.0, 0.0, 0.0, 0.0, 0.0]]
    assert offset(plain(machine), c=np.pi / 2, monitored=live)[:2] == pytest.approx([0.0, 3e-7], abs=1e-15)


@pytest.mark.parametrize(("x", "expected"), [(0.0, 0.0), (0.05, 1.5e-6), (0.15, 2e-6), (0.2, 1e-6), (0.25, 1e-6)])
def test_tables_are_straight_between_positions_and_constant_beyond(x, expected, machine):
    table = replace(plain(machine), errors={"EYX": machine.errors["EYX"]})
    assert offset(table, x=x)[1] == pytest.approx(expected, abs=1e-15)


@pytest.mark.parametrize(("x", "expected"), [(0.0, -1e-6), (0.1, 0.0), (0.2, 1e-6)])
def test_polynomials_go_by_the_travel(x, expected, machine):
    tilted = replace(plain(machine), errors={"EXX": machine.errors["EXX"]})
    assert offset(tilted, x=x)[0] == pytest.approx(expected, abs=1e-15)
