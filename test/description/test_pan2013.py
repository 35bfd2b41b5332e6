"""config/machines/pan2013.yaml against each row of the paper's Table 2, from lines of axes by products of matrices."""

from __future__ import annotations

import math
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray
from pytransform3d.rotations import matrix_from_compact_axis_angle

from rotary_error_monitor.description.machine import MachineDescription, load_machine
from rotary_error_monitor.description.machine_parts import Displacement, ErrorComponent

REFERENCE = Path(__file__).parents[1] / "reference"
Array = NDArray[np.float64]
MACHINE = load_machine("pan2013")
TABLE = yaml.safe_load((REFERENCE / "pan2013_table2.yaml").read_text(encoding="utf-8"))
ROWS = 22
"""Rows of the printed table, both of its halves."""


def rows(name: str) -> list[Any]:
    return list(TABLE[name])


def height(component: ErrorComponent) -> float:
    """Range of an error component over the travel, in m or rad."""
    u = np.linspace(-1.0, 1.0, 2001)
    value = np.polyval(component.poly[::-1], u) if component.poly else np.zeros(1)
    for wave in component.harmonic:
        q = np.linspace(-math.pi, math.pi, 7201)
        value = wave.cos * np.cos(wave.order * q) + wave.sin * np.sin(wave.order * q)
    return float(np.ptp(value))


def matrix(step: Displacement) -> Array:
    result = np.eye(4)
    result[:3, :3] = matrix_from_compact_axis_angle(np.array(step.rotation))
    result[:3, 3] = step.shift
    return result


def placed(machine: MachineDescription, name: str) -> Array:
    """(4, 4) of a body in the base as the machine is, all axes at zero."""
    if name == "base":
        return np.eye(4)
    body = machine.body(name)
    return placed(machine, body.parent) @ matrix(body.pose) @ matrix(body.location_error)


def line(name: str) -> tuple[Array, Array]:
    """Point and direction of an axis, or of the spindle, in the base."""
    if name == "spindle":
        assert MACHINE.spindle is not None
        at, direction = placed(MACHINE, MACHINE.spindle), np.array([0.0, 0.0, 1.0])
    else:
        at, direction = placed(MACHINE, MACHINE.body_of(name).name), np.array(MACHINE.axis(name).direction)
    return at[:3, 3], at[:3, :3] @ direction


def angle(one: str, other: str) -> float:
    """Between two axes, or an axis and the plane of two axes such as XY, rad."""
    first = line(one)[1]
    if len(other) == 2:
        normal = np.cross(line(other[0])[1], line(other[1])[1])
        return math.pi / 2 - math.atan2(float(np.linalg.norm(np.cross(first, normal))), float(first @ normal))
    return math.acos(float(first @ line(other)[1]))


def distance(one: str, other: str) -> float:
    """Least distance of two lines that cross, m."""
    (p, d), (q, e) = line(one), line(other)
    normal = np.cross(d, e)
    return float(abs((p - q) @ normal) / np.linalg.norm(normal))


def test_the_table_is_all_there() -> None:
    names = [
        "positioning",
        "repeatability",
        "straightness",
        "squareness",
        "perpendicularity",
        "coplanarity",
        "concentricity",
    ]
    assert sum(len(rows(name)) for name in names) == ROWS
    assert set(TABLE) - set(names) == {"straightness_in_text", "angles", "backlash"}


@pytest.mark.parametrize(("letter", "error", "length"), rows("positioning"))
def test_positioning(letter: str, error: float, length: float) -> None:
    linear = MACHINE.axis(letter).kind == "linear"
    expected = error * 1e-3 if linear else math.radians(error)
    assert height(MACHINE.errors[f"E{letter}{letter}"]) == pytest.approx(expected, rel=1e-6)
    if linear:
        assert np.ptp(MACHINE.axis(letter).travel) == pytest.approx(length * 1e-3)


@pytest.mark.parametrize(("letter", "size", "length"), rows("repeatability"))
def test_repeatability(letter: str, size: float, length: float) -> None:
    assert MACHINE.axis(letter).repeatability == pytest.approx(size * 1e-3)
    assert np.ptp(MACHINE.axis(letter).travel) == pytest.approx(length * 1e-3)


@pytest.mark.parametrize(("name", "error", "length"), rows("straightness"))
def test_straightness_is_that_of_the_table_and_not_of_the_text(name: str, error: float, length: float) -> None:
    assert height(MACHINE.errors[name]) == pytest.approx(error * 1e-3, rel=1e-6)
    assert dict(TABLE["straightness_in_text"])[name] < 0.5 * error
    assert length in (2500, 5000)  # beyond the 2000 and half of the 6000 mm of the text


@pytest.mark.parametrize(("one", "other", "error", "length"), rows("squareness"))
def test_squareness(one: str, other: str, error: float, length: float) -> None:
    assert math.pi / 2 - angle(one, other) == pytest.approx(error / length, rel=1e-4)  # all below 90 degrees


@pytest.mark.parametrize(("axis", "plane", "error", "length"), rows("perpendicularity"))
def test_perpendicularity_to_a_plane(axis: str, plane: str, error: float, length: float) -> None:
    assert math.pi / 2 - angle(axis, plane) == pytest.approx(error / length, rel=1e-3)


@pytest.mark.parametrize(("one", "other", "error"), rows("coplanarity"))
def test_coplanarity(one: str, other: str, error: float) -> None:
    assert distance(one, other) == pytest.approx(error * 1e-3, rel=1e-3)


@pytest.mark.parametrize(("one", "other", "error"), rows("concentricity"))
def test_concentricity_at_the_nose(one: str, other: str, error: float) -> None:
    nose = line(one)[0]
    point, direction = line(other)
    assert np.linalg.norm(np.cross(nose - point, direction)) == pytest.approx(error * 1e-3, rel=1e-3)


@pytest.mark.parametrize(("one", "other", "degrees"), rows("angles"))
def test_angles_of_the_text_are_those_of_the_table_within_a_step_and_a_half(
    one: str, other: str, degrees: float
) -> None:
    """The text prints steps of 0.001 degrees and differs from its own table by up to 1.2 of them."""
    found = math.degrees(angle(one, other)) if len(other) == 1 else 90 - math.degrees(math.pi / 2 - angle(one, other))
    assert found == pytest.approx(degrees, abs=1.5e-3)


def test_all_axes_that_the_table_squares_are_square_otherwise() -> None:
    """What it does not name is not made up: no pair of linear axes is missing."""
    named = {frozenset(row[:2]) for row in rows("squareness")}
    assert named >= {frozenset(pair) for pair in combinations("XYZ", 2)}


@pytest.mark.parametrize(("letter", "backlash"), sorted(TABLE["backlash"].items()))
def test_backlash(letter: str, backlash: float) -> None:
    assert MACHINE.axis(letter).reversal == pytest.approx(backlash * 1e-3)
