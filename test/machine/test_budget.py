"""Parts of the offset body by body: against closed forms, brute-force products of matrices, and their own sum."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from rotary_error_monitor.description.machine import MachineDescription, load_machine
from rotary_error_monitor.description.machine_parts import Displacement, ErrorComponent
from rotary_error_monitor.machine.budget import estimate_budget
from rotary_error_monitor.machine.error_model import predict_tool_offset
from rotary_error_monitor.machine.kinematics import arrange_machine

Array = NDArray[np.float64]
SQUARE = -5.2e-5


def ideal(name: str) -> MachineDescription:
    machine = load_machine(name)
    return replace(
        machine,
        errors={},
        bodies=tuple(replace(body, location_error=Displacement()) for body in machine.bodies),
        axes=tuple(replace(axis, expansion=0.0, reversal=0.0) for axis in machine.axes),
    )


def poses(machine: MachineDescription, count: int, seed: int) -> Array:
    rng = np.random.default_rng(seed)
    travel = np.array([axis.travel for axis in machine.axes])
    return rng.uniform(travel[:, 0], travel[:, 1], (count, len(travel)))


def test_a_squareness_moves_the_tool_by_angle_times_travel() -> None:
    """X leaves the perpendicular of Y by an angle: y goes off by the angle times the way along X, Y does not matter."""
    machine = ideal("pan2013").with_location_error("carriage", Displacement(rotation=(0.0, 0.0, -SQUARE)))
    x, y = np.meshgrid([-3.0, -1.0, 0.0, 2.0], [-1.0, 0.5])
    at = np.zeros((x.size, 5))
    at[:, 0], at[:, 1] = x.ravel(), y.ravel()
    budget = estimate_budget(machine, at)
    np.testing.assert_allclose(budget.first_order[:, 1], -SQUARE * at[:, 0], rtol=0, atol=1e-18)
    np.testing.assert_allclose(budget.exact[:, 1], math.sin(-SQUARE) * at[:, 0], rtol=0, atol=1e-15)
    np.testing.assert_allclose(budget.exact[:, 0], (math.cos(SQUARE) - 1) * at[:, 0], rtol=0, atol=1e-15)
    np.testing.assert_allclose(budget.difference, budget.exact - budget.first_order, rtol=0, atol=0)
    (part,) = [part for part in budget.parts if np.any(part.both)]
    assert part.body.name == "carriage"
    np.testing.assert_array_equal(part.motion, 0.0)
    np.testing.assert_array_equal(part.location, budget.first_order)


def test_a_tilt_of_a_rotary_axis_moves_the_tool_by_angle_times_lever() -> None:
    """The tool hangs 0.5 m below A: A tilted by t about y moves the tip by t times the height of the lever left."""
    tilt = 7e-5
    machine = ideal("pan2013").with_location_error("rotary_head", Displacement(rotation=(0.0, tilt, 0.0)))
    angles = np.array([-1.2, 0.0, 0.9])
    at = np.zeros((3, 5))
    at[:, 4] = angles
    found = estimate_budget(machine, at).first_order
    np.testing.assert_allclose(found[:, 0], -tilt * 0.5 * np.cos(angles), rtol=0, atol=1e-16)
    np.testing.assert_allclose(found[:, 4], tilt, rtol=0, atol=1e-18)


def test_an_error_of_the_workpiece_table_counts_against_the_tool() -> None:
    """What lifts the table by h has the workpiece see the tool lower by h, turned back by the table's angle."""
    machine = ideal("xyzac_trt").with_error("EYC", poly=(4e-6,))
    at = np.zeros((2, 5))
    at[:, 4] = [0.0, math.pi / 2]
    budget = estimate_budget(machine, at)
    # ΔTs is told in the frame of the table, in which the workpiece stands.
    np.testing.assert_allclose(budget.exact[:, :3], [[0.0, -4e-6, 0.0]] * 2, rtol=0, atol=1e-15)
    assert [part.body.name for part in budget.parts if np.any(part.motion)] == ["table"]


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("name", ["pan2013", "xyzac_trt", "grinder_zhou2023"])
def test_exact_is_the_product_of_matrices_and_parts_add_up(
    name: str, seed: int, independent_offset: Callable[..., Array]
) -> None:
    machine = load_machine(name)
    at = poses(machine, 40, seed)
    rng = np.random.default_rng(100 + seed)
    direction, warm = rng.choice([-1.0, 0.0, 1.0], at.shape), rng.uniform(15.0, 30.0, len(at))
    budget = estimate_budget(machine, at, direction=direction, temperature=warm)
    truth = independent_offset(machine, at, direction, warm - machine.reference_temperature)
    np.testing.assert_allclose(budget.exact, truth, rtol=0, atol=1e-12)
    direct = predict_tool_offset(arrange_machine(machine), at, direction=direction, temperature=warm, exact=False)
    np.testing.assert_allclose(budget.first_order, direct, rtol=0, atol=1e-17)
    assert np.abs(budget.first_order).max() > 1e-6


@pytest.mark.parametrize("seed", range(3))
def test_each_part_is_the_exact_offset_of_that_body_alone(seed: int, independent_offset: Callable[..., Array]) -> None:
    """A machine with the errors of one body alone, by brute force: its part, but for squares of 0.2 mrad."""
    machine = load_machine("xyzac_trt")
    at = poses(machine, 20, 10 + seed)
    still = np.zeros_like(at), np.zeros(len(at))
    for part in estimate_budget(machine, at).parts:
        alone = ideal("xyzac_trt").with_location_error(part.body.name, part.body.location_error)
        errors = {name: each for name, each in machine.errors.items() if name[2] == part.body.axis}
        truth = independent_offset(replace(alone, errors=errors), at, *still)
        np.testing.assert_allclose(part.both, truth, rtol=0, atol=(2e-4) ** 2)


def test_uncertainty_that_calibrations_have_left() -> None:
    """Each part in closed form: squareness by its lever, a place by its shift, a component as it is."""
    at = np.array([[1.5, 0.0, 0.0, 0.0, 0.0]])
    exact = tuple(replace(axis, repeatability=None) for axis in ideal("pan2013").axes)
    machine = replace(ideal("pan2013"), axes=exact)

    def found(calibrated: dict[str, float], **stated: float) -> Array:
        uncertainty = {name.replace("_", "."): value for name, value in stated.items()}
        budget = estimate_budget(replace(machine, calibrated=calibrated, uncertainty=uncertainty), at)
        assert budget.uncertainty is not None
        return budget.uncertainty[0]

    square = [1e-6, math.hypot(3e-6, 1e-6), 0.0, 2e-6, 2e-6, 2e-6]
    np.testing.assert_allclose(found({"squareness": 2e-6}), square, rtol=1e-6, atol=2e-12)
    # Known by itself, it does not count a second time with what is stated of its kind.
    np.testing.assert_allclose(found({"squareness": 2e-6}, squareness=9e-6), square, rtol=1e-6, atol=2e-12)
    np.testing.assert_allclose(found({"EYX": 4e-7}), [0, 4e-7, 0, 0, 0, 0], rtol=1e-9, atol=1e-18)
    # A leans about y and z; 0.5 m below it hangs the tool.
    leaning = [0.5 * 3e-6, 0, 0, 0, 3e-6, 3e-6]
    np.testing.assert_allclose(found({"location of A": 3e-6}), leaning, rtol=1e-6, atol=1e-11)
    shifted = found({"location of spindle.shift": 2e-6})
    np.testing.assert_allclose(shifted, [2e-6, 2e-6, 0, 0, 0, 0], rtol=1e-6, atol=1e-15)
    whole = found({"machine": 3e-6})
    np.testing.assert_allclose(whole, [math.sqrt(3) * 1e-6] * 3 + [0] * 3, rtol=1e-9)
    both = found({"location of A": 3e-6}, location_angular=5e-6)
    # Of the others C and spindle lean as stated, and X, Y, Z; A as it was measured.
    assert both[0] > leaning[0]
    assert both[0] == pytest.approx(
        math.sqrt(leaning[0] ** 2 + found({}, location_angular=5e-6)[0] ** 2 - (2.5e-6) ** 2)
    )


def test_uncertainty_in_closed_form() -> None:
    """Squareness known to u: the tool is known to u times the travel; a second, independent number adds in squares."""
    exact = tuple(replace(axis, repeatability=None) for axis in ideal("pan2013").axes)
    machine = replace(ideal("pan2013"), axes=exact, uncertainty={"squareness": 2e-6})
    at = np.array([[1.5, 0.0, 0.0, 0.0, 0.0]])
    found = estimate_budget(machine, at).uncertainty
    assert found is not None
    # X to Y turns about z: y by 2 µrad times 1.5 m. Z to X and Z to Y turn the 0.5 m of head and tool below the ram.
    np.testing.assert_allclose(found[0, :3], [1e-6, math.hypot(3e-6, 1e-6), 0.0], rtol=1e-6, atol=2e-12)
    np.testing.assert_allclose(found[0, 3:], 2e-6, rtol=1e-6)
    both = replace(
        machine,
        uncertainty={"squareness": 2e-6, "errors.linear": 1e-6},
        errors={"EYX": ErrorComponent(poly=(0.0, 5e-6))},
    )
    found = estimate_budget(both, at).uncertainty
    assert found is not None
    assert found[0, 1] == pytest.approx(math.sqrt(3e-6**2 + 1e-6**2 + (0.5 * 1e-6) ** 2), rel=1e-6)
    found = estimate_budget(ideal("pan2013"), at).uncertainty
    assert found is not None
    np.testing.assert_allclose(found[0], [10e-6 / 4, 8e-6 / 4, 11e-6 / 4, 0, 0, 0], rtol=0, atol=1e-18)  # repeatability
    assert estimate_budget(load_machine("xyzac_trt"), at).uncertainty is None


def test_a_zero_of_the_thermometer_counts_by_what_expands() -> None:
    """10 µm/(m K) times 1.5 m times 0.1 K."""
    exact = tuple(replace(axis, repeatability=None) for axis in ideal("pan2013").axes)
    machine = replace(ideal("pan2013"), axes=exact, uncertainty={"thermometer": 0.1}).with_axis("X", expansion=1e-5)
    found = estimate_budget(machine, np.array([[1.5, 0.0, 0.0, 0.0, 0.0]]), temperature=np.array([23.0])).uncertainty
    assert found is not None
    np.testing.assert_allclose(found[0], [1.5e-6, 0.0, 0.0, 0.0, 0.0, 0.0], rtol=1e-4, atol=2e-12)
