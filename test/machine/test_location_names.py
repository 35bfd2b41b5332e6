"""Location errors by the names of ISO 230 and of the paper; together they are all of what a machine has."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from rotary_error_monitor.description.machine import MachineDescription, load_machine
from rotary_error_monitor.description.machine_parts import Displacement
from rotary_error_monitor.machine.error_model import predict_tool_offset
from rotary_error_monitor.machine.kinematics import arrange_machine
from rotary_error_monitor.machine.location_names import location_errors, nominal_lines

Array = NDArray[np.float64]

PAN = {
    "carriage": ["squareness X-Y (EC0X)"],
    "ram": ["squareness Y-Z (EA0Z)", "squareness X-Z (EB0Z)"],
    "swivel_head": ["parallelism C-Z about x (EA0C)", "parallelism C-Z about y (EB0C)"],
    "rotary_head": ["coplanarity A-C (EY0A)", "squareness A-C (EB0A)"],
    "spindle": [
        "concentricity spindle-C along x (EX0S)",
        "coplanarity spindle-A (EY0S)",
        "squareness spindle-A (EB0S)",
    ],
}
"""Each row of the paper's Table 2 between axes, by the body where the machine file has it."""

TABLE = {
    "trunnion": [
        "position of A along y (EY0A)",
        "position of A along z (EZ0A)",
        "parallelism A-X about y (EB0A)",
        "parallelism A-X about z (EC0A)",
    ],
    "table": [
        "position of C along x (EX0C)",
        "distance C-A (EY0C)",
        "parallelism C-Z about x (EA0C)",
        "squareness C-A (EB0C)",
    ],
}


def named(machine: MachineDescription) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for error in location_errors(machine):
        found.setdefault(error.body, []).append(error.name)
    return found


def full(machine: MachineDescription) -> MachineDescription:
    """The machine with all six components of a location error at every body."""
    error = Displacement((1e-6, 2e-6, 3e-6), (4e-6, 5e-6, 6e-6))
    return replace(machine, bodies=tuple(replace(body, location_error=error) for body in machine.bodies))


def test_names_are_those_of_the_papers_table() -> None:
    assert named(load_machine("pan2013")) == PAN


def test_names_of_a_machine_with_its_rotary_axes_under_the_workpiece() -> None:
    found = named(load_machine("xyzac_trt"))
    assert {name: found[name] for name in TABLE} == TABLE


@pytest.mark.parametrize("name", ["pan2013", "xyzac_trt", "grinder_zhou2023"])
def test_every_component_has_a_name_of_its_own_and_all_of_them_are_the_whole(name: str) -> None:
    machine = full(load_machine(name))
    errors = location_errors(machine)
    assert len(errors) == len({error.name for error in errors}) == 6 * len(machine.bodies)
    again = replace(machine, bodies=tuple(replace(body, location_error=Displacement()) for body in machine.bodies))
    for error in errors:
        again = again.with_location_error(error.body, error.displacement)
    assert again == machine


@pytest.mark.parametrize(
    ("name", "component", "expected"),
    [
        ("gantry", 3, "orientation of Y about x (EA0Y)"),
        ("gantry", 4, "roll of Y (EB0Y)"),
        ("carriage", 0, "zero position of X along x (EX0X)"),
        ("swivel_head", 5, "zero position of C (EC0C)"),
        ("rotary_head", 5, "parallelism A-X about z (EC0A)"),
        ("spindle", 3, "parallelism spindle-C about x (EA0S)"),
        ("spindle", 5, "zero position of spindle (EC0S)"),
        ("tool", 2, "position of tool along z"),
        ("workpiece", 4, "orientation of workpiece about y"),
    ],
)
def test_other_components(name: str, component: int, expected: str) -> None:
    machine = full(load_machine("pan2013"))
    assert [error.name for error in location_errors(machine) if error.body == name][component] == expected


@pytest.mark.parametrize("seed", range(3))
def test_a_squareness_is_what_turns_one_axis_towards_the_other(seed: int) -> None:
    """In random poses: what a component called `squareness X-Y` does is an angle times the way along X, towards Y."""
    machine = load_machine("pan2013")
    (error,) = [error for error in location_errors(machine) if error.name.startswith("squareness X-Y")]
    ideal = replace(
        machine,
        errors={},
        bodies=tuple(replace(body, location_error=Displacement()) for body in machine.bodies),
        axes=tuple(replace(axis, reversal=0.0) for axis in machine.axes),
    )
    model = arrange_machine(ideal.with_location_error(error.body, error.displacement))
    poses = np.zeros((20, 5))
    poses[:, :3] = np.random.default_rng(seed).uniform(-1, 1, (20, 3))
    found = predict_tool_offset(model, poses)[:, 1]
    np.testing.assert_allclose(found, 5.2e-5 * poses[:, 0], rtol=0, atol=1e-12)


def test_lines_of_a_spindle_that_the_file_does_not_name_are_not_there() -> None:
    assert [line.name for line in nominal_lines(load_machine("pan2013"))] == ["Y", "X", "Z", "C", "A", "spindle"]
    assert [line.name for line in nominal_lines(load_machine("xyzac_trt"))] == ["A", "C", "Y", "X", "Z"]
