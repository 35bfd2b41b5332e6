"""Machines as described: the shipped ones, a twin's parameters, and files that are wrong, each with its message."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from rotary_error_monitor.description.machine import (
    MachineDescription,
    load_machine,
    machine_from_mapping,
    machine_mapping,
)
from rotary_error_monitor.description.machine_parts import Displacement, ErrorComponent, Harmonic
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.resources import config

REFERENCE = Path(__file__).parents[1] / "reference"
CASES = Path(__file__).parents[3] / "shared" / "cases"

LATHE = """\
machine:
  name: lathe
  tool: tool
  workpiece: chuck
  monitored: C
  axes:
    X: {kind: linear, direction: [1, 0, 0], travel: [0, 0.2]}
    Z: {kind: linear, direction: [0, 0, 1], travel: [-0.5, 0]}
    C: {kind: rotary, direction: [0, 0, 1], travel: [-3.2, 3.2]}
  bodies:
    - {name: chuck, parent: base, axis: C}
    - {name: carriage, parent: base, axis: Z}
    - {name: slide, parent: carriage, axis: X, squareness: {Z: 2.0e-05}}
    - {name: tool, parent: slide, pose: {position: [0, 0, 0.1]}}
  errors:
    EXX: {poly: [0.0, 1.0e-06]}
    ECC: {table: {positions: [-3.2, 0.0, 3.2], forward: [0, 1.0e-06, 0], backward: [0, 2.0e-06, 0]}}
"""
TWIN = """\
machine:
  travel: {X: [-3, 3], Y: [-1, 1], Z: [-1, 1], C: [-3.1, 3.1], A: [-1.9, 1.9]}
  squareness: {XY: 1.0e-05, XZ: 2.0e-05, YZ: 3.0e-05}
  orientation: {C: [4.0e-05, 5.0e-05], A: [6.0e-05, 7.0e-05]}
  pivot_offset: [1.0e-06, 2.0e-06, 0.0]
  head_length: 0.35
  tool_length: 0.15
  expansion: {X: 1.0e-06, Y: 0.0, Z: 2.0e-06}
  reference_temperature: 21.0
  errors: {EXX: {poly: [0.0, 1.0e-06]}}
  uncertainty: {errors.linear: 8.0e-07, pivot_offset: 1.0e-06}
"""


@pytest.fixture
def load_text(tmp_path: Path) -> Callable[[str], MachineDescription]:
    def load(text: str) -> MachineDescription:
        path = tmp_path / "machine.yaml"
        path.write_text(text, encoding="utf-8")
        return load_machine(path)

    return load


@pytest.mark.parametrize(
    ("name", "letters"), [("pan2013", ("X", "Y", "Z", "C", "A")), ("xyzac_trt", ("X", "Y", "Z", "A", "C"))]
)
def test_shipped_machines(name: str, letters: tuple[str, ...]) -> None:
    machine = load_machine(name)
    assert (machine.name, machine.letters, machine.monitored) == (name, letters, "C")


def test_a_twins_parameters_make_the_published_tree(load_text: Callable[[str], MachineDescription]) -> None:
    twin, shipped = load_text(TWIN), load_machine("pan2013")
    assert [(b.name, b.parent, b.axis, b.pose) for b in twin.bodies] == [
        (b.name, b.parent, b.axis, b.pose) for b in shipped.bodies
    ]
    assert [(a.letter, a.kind, a.direction) for a in twin.axes] == [
        (a.letter, a.kind, a.direction) for a in shipped.axes
    ]
    assert (twin.tool, twin.workpiece, twin.monitored) == (shipped.tool, shipped.workpiece, shipped.monitored)
    assert twin.body_of("X").location_error == Displacement(rotation=(0.0, 0.0, -1e-5))
    assert twin.body_of("Z").location_error == Displacement(rotation=(-3e-5, 2e-5, 0.0))
    assert twin.body_of("C").location_error == Displacement(rotation=(4e-5, 5e-5, 0.0))
    assert twin.body_of("A").location_error == Displacement((1e-6, 2e-6, 0.0), (0.0, 6e-5, 7e-5))
    assert (twin.axis("X").expansion, twin.axis("Z").expansion) == (1e-6, 2e-6)
    assert twin.reference_temperature == 21.0
    assert twin.uncertainty == {"errors.linear": 8e-7, "pivot_offset": 1e-6}


def test_the_noise_of_the_probe_is_what_a_file_states(load_text: Callable[[str], MachineDescription]) -> None:
    assert load_text(TWIN).probe_noise is None
    stated = load_text(TWIN.replace("reference_temperature: 21.0", "probe_noise: 4.0e-06"))
    assert stated.probe_noise == machine_from_mapping(machine_mapping(stated)).probe_noise == (4e-6, 4e-6, 4e-6)
    apart = load_text(TWIN.replace("reference_temperature: 21.0", "probe_noise: [1.0e-06, 4.0e-06, 3.0e-06]"))
    assert apart.probe_noise == machine_from_mapping(machine_mapping(apart)).probe_noise == (1e-6, 4e-6, 3e-6)


@pytest.mark.skipif(not CASES.is_dir(), reason=f"no recorded cases in {CASES}")
def test_every_recorded_twin_loads() -> None:
    twins = [path for path in sorted(CASES.glob("*/*/twin.yaml")) if path.read_text().startswith("machine")]
    assert len(twins) > 10
    for path in twins:
        assert load_machine(path).letters == ("X", "Y", "Z", "C", "A")


def test_tree_in_a_file(load_text: Callable[[str], MachineDescription]) -> None:
    machine = load_text(LATHE)
    assert machine == machine_from_mapping(yaml.safe_load(LATHE)["machine"])
    assert machine.letters == ("X", "Z", "C")
    # X stands 90 degrees + 20 urad to Z: it leans away from Z.
    turned = np.array([1, 0, 0]) + np.cross(machine.body("slide").location_error.rotation, [1, 0, 0])
    np.testing.assert_allclose(turned, [1.0, 0.0, -2e-5], atol=1e-18)
    assert machine.errors["ECC"].table is not None
    assert machine.errors["ECC"].table.backward == (0.0, 2e-6, 0.0)
    assert load_text(LATHE.replace("monitored: C", "monitored: null")).monitored is None


def test_changed_machines_leave_the_old_one_alone(load_text: Callable[[str], MachineDescription]) -> None:
    machine = load_text(LATHE)
    moved = machine.with_location_error("slide", Displacement((1e-6, 0.0, 0.0), (0.0, 1e-5, 0.0)))
    assert moved.body("slide").location_error.shift == (1e-6, 0.0, 0.0)
    assert moved.body("slide").location_error.rotation == pytest.approx((0.0, 3e-5, 0.0))
    warm = machine.with_axis("X", expansion=1e-5, reversal=2e-6).with_axis("X", expansion=1e-5)
    assert (warm.axis("X").expansion, warm.axis("X").reversal) == (2e-5, 2e-6)
    wavy = machine.with_error("EXX", poly=[1e-6, 1e-6, 2e-6], harmonic=[Harmonic(1.0, 0.0, 1e-6)])
    assert wavy.errors["EXX"] == ErrorComponent((1e-6, 2e-6, 2e-6), (Harmonic(1.0, 0.0, 1e-6),))
    assert machine.with_error("EYC", poly=[1e-6]).errors["EYC"] == ErrorComponent((1e-6,))
    assert machine == load_text(LATHE)


def test_names_that_a_machine_has_not() -> None:
    machine = load_machine("xyzac_trt")
    with pytest.raises(InputError, match="no axis of machine xyzac_trt is called 'B'; it has X, Y, Z, A, C"):
        machine.axis("B")
    with pytest.raises(InputError, match="is called 'head'; it has trunnion"):
        machine.body("head")
    with pytest.raises(InputError, match="is called 'B'"):
        machine.body_of("B")
    with pytest.raises(InputError, match="'EQX' names no error component"):
        machine.with_error("EQX", poly=[0.0])
    with pytest.raises(InputError, match=r"no machine 'pan2014'; .*pan2013, xyzac_trt"):
        load_machine("pan2014")
    with pytest.raises(InputError, match="cannot be read"):
        load_machine("nowhere/pan2013.yaml")


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("tool: tool", "tol: tool", 3, "'tol' was unexpected"),
        ("kind: linear, direction: [1", "kind: straight, direction: [1", 7, "expected: linear or rotary"),
        ("travel: [0, 0.2]", "travel: [0, 200000]", 7, "expected: a position in m or rad"),
        ("travel: [0, 0.2]", "travel: [0, far]", 7, "'far' is no number"),
        ("travel: [0, 0.2]", "travel: [0.2, 0]", 7, r"machine.axes.X.travel: \[0.2, 0.0\] is no travel"),
        ("direction: [1, 0, 0]", "direction: [1, 1, 0]", 7, "has length 1.41421356; expected a unit vector"),
        ("travel: [-0.5, 0]", "travel: [-0.5, 0], expansion: 11", 8, "expected: a coefficient of thermal expansion"),
        ("parent: carriage", "parent: saddle", 13, "no body 'saddle' stands above; expected one of base, chuck"),
        ("name: slide", "name: chuck", 13, "there is already a body 'chuck'"),
        ("axis: X", "axis: Z", 13, "axis Z moves 'carriage' already"),
        ("axis: X", "axis: Y", 13, "there is no axis Y; the axes are X, Z, C"),
        ("squareness: {Z: 2", "squareness: {Y: 2", 13, "there is no axis Y"),
        ("squareness: {Z: 2", "squareness: {X: 2", 13, "expected angles from this body's own axis"),
        (
            "squareness: {Z: 2.0e-05}",
            "location_error: {rotation: [0, 0.006, 0]}, squareness: {Z: 0.005}",
            13,
            "the angles and the location error add up to 11 mrad",
        ),
        ("squareness: {Z: 2.0e-05}", "squareness: {Z: 0.02}", 13, "expected: an angle in rad of at most 10 mrad"),
        (", axis: C}", "}", 9, "axis C moves no body"),
        ("workpiece: chuck", "workpiece: vice", 4, "there is no body 'vice'"),
        (
            "monitored: C",
            "monitored: C\n  spindle: head",
            6,
            "there is no body 'head'; expected one of chuck, carriage",
        ),
        ("monitored: C", "monitored: C\n  spindle: base", 6, "there is no body 'base'; expected one of chuck"),
        ("travel: [-0.5, 0]", "travel: [-0.5, 0], repeatability: 8", 8, "expected: repeatability R of positioning"),
        ("monitored: C", "monitored: C\n  spindle: chuck", 6, "axis C moves 'chuck'; expected a body of its own"),
        ("monitored: C", "monitored: X", 5, "'X' is no rotary axis; expected C"),
        ("rotary, direction: [0, 0, 1]", "rotary, direction: [0, 1, 0]", 9, r"not the z of the stage .* pose.rotation"),
        ("rotary, direction: [0, 0, 1]", "rotary, direction: [0, 0, -1]", 9, r"expected \[0, 0, 1\], with the body"),
        ("position: [0, 0, 0.1]", "position: [0, 0, 150]", 14, "expected: a length in m, at most 100 m"),
        ("EXX: {poly: [0.0, 1.0e-06]}", "EXX: {poly: [0.0, 1.0]}", 16, "expected: an error in m or rad"),
        ("EXX: {poly: [0.0, 1.0e-06]}", "EXX: {poly: [0.0, 1e-6]}", 16, "write 1.0e-6"),
        ("EXX: {poly", "EXY: {poly", 16, "there is no axis Y; the axes are X, Z, C"),
        ("EXX: {poly", "EQX: {poly", 16, "EQX"),
        ("EXX: {poly", "EXX: {poli", 16, "poli"),
        ("[-3.2, 0.0, 3.2]", "[-3.2, 3.2, 0.0]", 17, "do not rise; expected rising positions"),
        ("forward: [0, 1.0e-06, 0]", "forward: [0, 1.0e-06]", 17, "2 values at 3 positions; expected one for each"),
        ("forward: [0, 1.0e-06, 0], ", "", 17, r"{positions, values} or"),
        ("[-3.2, 0.0, 3.2]", "[-180.0, 0.0, 180.0]", 17, "beyond the travel of axis C, .*; expected positions in m or"),
        ("travel: [-0.5, 0]", "travel: [-500, 0]", 8, r"\[-500.0, 0.0\] m is no travel; expected at most 100 m"),
        ("tool: tool", "tool: chuck", 3, "'chuck' is the workpiece as well; expected the body that holds the tool"),
        ("workpiece: chuck", "workpiece: base", 5, "axis C moves the tool against the workpiece nowhere: .* of Z, X"),
        ("monitored: C", "monitored: C\n  reference_temperature: 60", 6, "60 °C is outside limits.temperature: exp"),
    ],
)
def test_a_wrong_tree_is_refused_with_its_line(
    old: str, new: str, line: int, message: str, load_text: Callable[[str], MachineDescription]
) -> None:
    assert LATHE.count(old) == 1
    with pytest.raises(InputError, match=rf"machine\.yaml:{line}: .*{message}"):
        load_text(LATHE.replace(old, new))


@pytest.mark.parametrize(
    ("direction", "flat"),
    [((1.0, 0.0, 0.0), True), ((0.6, 0.0, 0.8), True), ((0.0, 1.0, 0.0), False), ((0.0, 0.6, 0.8), False)],
)
@pytest.mark.parametrize("turned", [False, True])
def test_linear_axes_in_one_plane_are_refused(
    direction: tuple[float, float, float], flat: bool, turned: bool, load_text: Callable[[str], MachineDescription]
) -> None:
    """Also where a body between them is turned, here by a quarter about x, which takes y to z."""
    content = yaml.safe_load(config("machines/xyzac_trt.yaml").read_text(encoding="utf-8"))
    x, y, z = direction
    content["machine"]["axes"]["Y"]["direction"] = [x, z, -y] if turned else [x, y, z]
    if turned:
        body = next(row for row in content["machine"]["bodies"] if row.get("axis") == "Y")
        body["pose"] = {"rotation": [math.pi / 2, 0.0, 0.0]}
        for row in content["machine"]["bodies"]:
            if row["parent"] == body["name"]:
                row["pose"] = {"rotation": [-math.pi / 2, 0.0, 0.0]}
    text = yaml.safe_dump(content, sort_keys=False)
    if flat:
        with pytest.raises(InputError, match="lie in one plane; expected axes that span space"):
            load_text(text)
    else:
        load_text(text)


@pytest.mark.parametrize(
    ("old", "new", "line", "message"),
    [
        ("head_length: 0.35", "head_length: 350", 6, "expected: a length in m from 0 to 10 m"),
        ("  tool_length: 0.15\n", "", 1, "'tool_length' is a required property"),
        ("squareness: {XY", "squareness: {YX", 3, "YX"),
        ("orientation: {C: [4.0e-05, 5.0e-05]", "orientation: {C: [4.0e-05]", 4, "expected: two angles in rad"),
        ("X: [-3, 3]", "X: [3, -3]", 2, r"machine.travel.X: \[3.0, -3.0\] is no travel"),
        ("EXX: {poly", "EXB: {poly", 10, "there is no axis B; the axes are X, Y, Z, C, A"),
        ("pivot_offset: 1.0e-06}", "pivot_offset: -1.0e-06}", 11, "minimum"),
        ("errors.linear:", "errors.lineal:", 11, "errors.lineal"),
        (
            "reference_temperature: 21.0",
            "probe_noise: 4.0",
            9,
            "expected: standard deviation of one component of the probe or tracker in m, from 1e-9 to 0.001",
        ),
        ("reference_temperature: 21.0", "probe_noise: [1.0e-06, 2.0e-06]", 9, r"or of \[x, y, z\] where they differ"),
        (
            "reference_temperature: 21.0",
            "probe_noise: [1.0e-06, 2.0e-06, 3.0]",
            9,
            r"or of \[x, y, z\] where they differ",
        ),
    ],
)
def test_a_wrong_twin_is_refused_with_its_line(
    old: str, new: str, line: int, message: str, load_text: Callable[[str], MachineDescription]
) -> None:
    assert TWIN.count(old) == 1
    with pytest.raises(InputError, match=rf"machine\.yaml:{line}: .*{message}"):
        load_text(TWIN.replace(old, new))


def test_an_error_component_of_nothing_is_none(load_text: Callable[[str], MachineDescription]) -> None:
    """It could not be read again where it is written."""
    machine = load_text(LATHE.replace("EXX: {poly: [0.0, 1.0e-06]}", "EXX: {harmonic: []}"))
    assert set(machine.errors) == {"ECC"}
    empty = replace(machine, errors={**machine.errors, "EXX": ErrorComponent()})
    assert machine_from_mapping(machine_mapping(empty)) == machine
