"""Offsets against an independent SE(3) library, LinuxCNC's published kinematics and themselves in other batches."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from rotary_error_monitor.description.machine import MachineDescription, load_machine
from rotary_error_monitor.description.machine_parts import Displacement, ErrorComponent, ErrorTable, Harmonic
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.machine.correction import solve_axis_corrections
from rotary_error_monitor.machine.error_model import (
    monitored_jacobian,
    predict_tool_offset,
    propagate_covariance,
)
from rotary_error_monitor.machine.kinematics import arrange_machine, stand

Array = NDArray[np.float64]
MACHINES = ("pan2013", "xyzac_trt")


def poses(machine: MachineDescription, count: int, seed: int = 1) -> tuple[Array, Array, Array, Array]:
    """Positions within travel, directions, temperatures and live components."""
    rng = np.random.default_rng(seed)
    travel = np.array([axis.travel for axis in machine.axes])
    positions = rng.uniform(travel[:, 0], travel[:, 1], (count, len(travel)))
    directions = rng.choice([-1.0, 0.0, 1.0], positions.shape)
    live = rng.normal(size=(count, 6)) * [2e-6, 2e-6, 2e-6, 2e-5, 2e-5, 2e-5]
    return positions, directions, rng.uniform(15.0, 30.0, count), live


def displaced_everywhere(machine: MachineDescription) -> MachineDescription:
    """The machine with a pose that turns, a location error and a full set of errors at every body and axis."""
    rng = np.random.default_rng(3)

    def vector(size: float) -> tuple[float, float, float]:
        x, y, z = rng.normal(size=3) * size
        return float(x), float(y), float(z)

    bodies = tuple(
        replace(
            body,
            pose=Displacement(vector(0.3), vector(0.5)),
            location_error=Displacement(vector(1e-3), vector(1e-3)),
        )
        for body in machine.bodies
    )
    errors = {
        f"E{direction}{axis.letter}": ErrorComponent(
            poly=tuple(rng.normal(size=3) * 1e-4),
            harmonic=(Harmonic(2.5, 1e-4, -2e-4),),
            table=ErrorTable(axis.travel, tuple(rng.normal(size=2) * 1e-4), tuple(rng.normal(size=2) * 1e-4)),
        )
        for direction in "XYZABC"
        for axis in machine.axes
    }
    return replace(machine, bodies=bodies, errors=errors)


@pytest.mark.parametrize("change", [lambda machine: machine, displaced_everywhere], ids=["as_shipped", "displaced"])
@pytest.mark.parametrize("live", [False, True], ids=["table", "live"])
@pytest.mark.parametrize("name", MACHINES)
def test_exact_offset_is_that_of_an_independent_library(
    name: str,
    live: bool,
    change: Callable[[MachineDescription], MachineDescription],
    independent_offset: Callable[..., Array],
) -> None:
    machine = change(load_machine(name))
    q, directions, temperature, components = poses(machine, 1000)
    offset = predict_tool_offset(
        arrange_machine(machine),
        q,
        direction=directions,
        temperature=temperature,
        monitored=components if live else None,
    )
    truth = independent_offset(
        machine, q, directions, temperature - machine.reference_temperature, components if live else None
    )
    assert np.abs(truth).max() > 1e-5
    np.testing.assert_allclose(offset, truth, rtol=0.0, atol=1e-12)


def scaled(machine: MachineDescription, factor: float) -> MachineDescription:
    """The machine with every error, location error, reversal and expansion multiplied by `factor`."""

    def times(vector: tuple[float, float, float]) -> tuple[float, float, float]:
        x, y, z = vector
        return x * factor, y * factor, z * factor

    def larger(error: ErrorComponent) -> ErrorComponent:
        table = error.table
        return ErrorComponent(
            tuple(c * factor for c in error.poly),
            tuple(Harmonic(w.order, w.cos * factor, w.sin * factor) for w in error.harmonic),
            table
            and ErrorTable(
                table.positions, tuple(v * factor for v in table.forward), tuple(v * factor for v in table.backward)
            ),
        )

    return replace(
        machine,
        bodies=tuple(
            replace(b, location_error=Displacement(times(b.location_error.shift), times(b.location_error.rotation)))
            for b in machine.bodies
        ),
        axes=tuple(replace(a, expansion=a.expansion * factor, reversal=a.reversal * factor) for a in machine.axes),
        errors={name: larger(error) for name, error in machine.errors.items()},
    )


@pytest.mark.parametrize("change", [lambda machine: machine, displaced_everywhere], ids=["as_shipped", "displaced"])
@pytest.mark.parametrize("name", MACHINES)
def test_first_order_errs_by_second_order_only(
    name: str, change: Callable[[MachineDescription], MachineDescription]
) -> None:
    machine = change(load_machine(name))
    q, directions, temperature, live = poses(machine, 200)

    def difference(factor: float) -> Array:
        model = arrange_machine(scaled(machine, factor))
        exact, first = (
            predict_tool_offset(
                model, q, direction=directions, temperature=temperature, monitored=live * factor, exact=mode
            )
            for mode in (True, False)
        )
        np.testing.assert_allclose(first, factor * unit, rtol=1e-9, atol=1e-18)  # first order is linear
        return exact - first

    unit = predict_tool_offset(
        arrange_machine(machine), q, direction=directions, temperature=temperature, monitored=live, exact=False
    )
    small, large = difference(4.0), difference(16.0)
    size = np.abs(large).max()
    assert 0.0 < size < 16.0**2 * np.abs(unit).max() * 0.05
    np.testing.assert_allclose(large, 16.0 * small, rtol=0.0, atol=0.1 * size)


@given(
    start=st.integers(0, 299),
    count=st.integers(1, 300),
    name=st.sampled_from(MACHINES),
    exact=st.booleans(),
    strided=st.booleans(),
)
@settings(max_examples=60, deadline=None)
def test_numbers_do_not_depend_on_the_batch(start: int, count: int, name: str, exact: bool, strided: bool) -> None:
    machine = load_machine(name)
    model = arrange_machine(machine)
    q, directions, temperature, live = poses(machine, 300)
    live[::3, 2] = np.nan
    whole = predict_tool_offset(model, q, direction=directions, temperature=temperature, monitored=live, exact=exact)
    part = slice(start, start + count)
    some = np.asfortranarray(q[part]) if strided else q[part]
    np.testing.assert_array_equal(
        predict_tool_offset(
            model,
            some,
            direction=directions[part],
            temperature=temperature[part],
            monitored=live[part],
            exact=exact,
        ),
        whole[part],
    )
    np.testing.assert_array_equal(monitored_jacobian(model, some), monitored_jacobian(model, q)[part])


@pytest.mark.parametrize(
    ("rotation_point", "y_offset", "z_offset"), [((0, 0, 0), 0.02, 0.01), ((0.013, -0.021, 0.034), -0.05, 0.08)]
)
def test_ideal_kinematics_are_those_of_xyzac_trt_kins(
    rotation_point: tuple[float, float, float], y_offset: float, z_offset: float
) -> None:
    """Closed form of LinuxCNC's xyzac-trt-kins (src/emc/kinematics/trtfuncs.c, forward), tool offset zero."""
    machine = load_machine("xyzac_trt")
    x_rot, y_rot, z_rot = rotation_point
    stands = {
        "trunnion": (x_rot, y_rot + y_offset, z_rot + z_offset),
        "table": (0.0, -y_offset, -z_offset),
        "workpiece": (-x_rot, -y_rot, -z_rot),
    }
    bodies = tuple(replace(b, pose=Displacement(stands[b.name])) if b.name in stands else b for b in machine.bodies)
    if rotation_point == (0, 0, 0):
        assert bodies == machine.bodies
    q = poses(machine, 500)[0]
    seen = stand(arrange_machine(replace(machine, bodies=bodies)), np.ascontiguousarray(q.T), None)
    x, y, z, a, c = q.T
    x, y, z = x - x_rot, y - y_offset - y_rot, z - z_offset - z_rot
    across = np.cos(a) * y + np.sin(a) * z + y_offset
    expected = [
        np.cos(c) * x + np.sin(c) * across + x_rot,
        -np.sin(c) * x + np.cos(c) * across + y_rot,
        -np.sin(a) * y + np.cos(a) * z + z_offset + z_rot,
    ]
    np.testing.assert_allclose(seen.tool_in_workpiece()[:, 3], expected, rtol=0.0, atol=1e-15)


@pytest.mark.parametrize("name", MACHINES)
def test_live_components_replace_the_table_in_the_stator_frame(name: str) -> None:
    """What the table says in the moved frame, given live as seen from the stator, changes nothing."""
    machine = load_machine(name)
    model = arrange_machine(machine)
    q, directions, _, _ = poses(machine, 100)
    table = np.moveaxis(model.components.at(np.ascontiguousarray(q.T), np.ascontiguousarray(directions.T), None), 2, 0)
    column = machine.letters.index("C")
    c = q[:, column]
    turn = np.zeros((100, 3, 3))
    turn[:, 0, 0], turn[:, 0, 1], turn[:, 1, 0], turn[:, 1, 1], turn[:, 2, 2] = (
        np.cos(c),
        -np.sin(c),
        np.sin(c),
        np.cos(c),
        1.0,
    )
    live = np.concatenate(
        [np.einsum("nij,nj->ni", turn, table[:, part, column]) for part in (slice(0, 3), slice(3, 6))], axis=1
    )
    expected = predict_tool_offset(model, q, direction=directions)
    found = predict_tool_offset(model, q, direction=directions, monitored=live)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-15)
    unseen = np.full((100, 6), np.nan)
    np.testing.assert_allclose(
        predict_tool_offset(model, q, direction=directions, monitored=unseen), expected, rtol=0.0, atol=1e-15
    )


@pytest.mark.parametrize("name", MACHINES)
def test_jacobian_is_the_derivative_by_live_components(name: str) -> None:
    machine = load_machine(name)
    still = replace(machine, errors={}, bodies=tuple(replace(b, location_error=Displacement()) for b in machine.bodies))
    q = poses(machine, 50)[0]
    jacobian = monitored_jacobian(arrange_machine(machine), q)
    step = 1e-6
    for component in range(6):
        live = np.zeros((50, 6))
        live[:, component] = step
        ahead, behind = (predict_tool_offset(arrange_machine(still), q, monitored=s * live) for s in (1.0, -1.0))
        np.testing.assert_allclose(jacobian[:, :, component], (ahead - behind) / (2 * step), rtol=0.0, atol=1e-8)


def test_covariance_is_that_of_sampled_offsets() -> None:
    machine = load_machine("xyzac_trt")
    model = arrange_machine(machine)
    q = poses(machine, 1)[0]
    rng = np.random.default_rng(5)
    factor = rng.normal(size=(6, 6)) * np.array([1e-7] * 3 + [1e-6] * 3)[:, None]
    covariance = factor @ factor.T
    samples = rng.normal(size=(40_000, 6)) @ factor.T
    offsets = predict_tool_offset(model, np.repeat(q, len(samples), axis=0), monitored=samples)
    found = propagate_covariance(model, q, covariance[None])[0]
    spread = np.sqrt(np.diag(found))
    np.testing.assert_allclose(
        np.cov(offsets.T) / np.outer(spread, spread), found / np.outer(spread, spread), atol=0.03
    )


def test_unobservable_component_counts_with_the_stated_uncertainty() -> None:
    machine = replace(load_machine("pan2013"), uncertainty={"errors.linear": 3e-7, "errors.angular": 2e-6})
    model = arrange_machine(machine)
    q = poses(machine, 4)[0]
    covariance = np.zeros((4, 6, 6))
    covariance[:, 2, :] = covariance[:, :, 2] = np.nan
    covariance[:, 4, :] = covariance[:, :, 4] = np.nan
    jacobian = monitored_jacobian(model, q)
    expected = jacobian @ np.diag([0, 0, 3e-7**2, 0, 2e-6**2, 0]) @ np.swapaxes(jacobian, 1, 2)
    np.testing.assert_allclose(propagate_covariance(model, q, covariance), expected, rtol=1e-12, atol=1e-30)


def test_machine_without_rotary_axis() -> None:
    """A grinder with X, Z, Y and nothing monitored: room for it in the same model."""
    machine = load_machine("xyzac_trt")
    grinder = replace(
        machine,
        axes=tuple(axis for axis in machine.axes if axis.kind == "linear"),
        bodies=tuple(body for body in machine.bodies if body.name not in ("trunnion", "table", "workpiece")),
        errors={name: error for name, error in machine.errors.items() if name[2] in "XYZ"},
        workpiece="base",
        monitored=None,
    )
    model = arrange_machine(grinder)
    full = poses(machine, 20)[0]
    expected = replace(
        machine,
        errors=grinder.errors,
        axes=tuple(replace(axis, reversal=0.0) for axis in machine.axes),
        bodies=tuple(
            replace(b, location_error=Displacement()) if b.name in ("trunnion", "table") else b for b in machine.bodies
        ),
    )
    full[:, 3:] = 0.0
    np.testing.assert_allclose(
        predict_tool_offset(model, full[:, :3]),
        predict_tool_offset(arrange_machine(expected), full),
        rtol=0.0,
        atol=1e-15,
    )
    with pytest.raises(InputError, match="without monitored axis"):
        predict_tool_offset(model, full[:, :3], monitored=np.zeros((20, 6)))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"positions": np.zeros((2, 4))}, r"positions of shape \(2, 4\); expected \(n, 5\): X, Y, Z, A, C"),
        ({"positions": np.full((2, 5), np.nan)}, r"positions at \(0, 0\) is nan"),
        ({"direction": np.zeros((3, 5))}, r"direction of shape \(3, 5\); expected \(2, 5\)"),
        ({"temperature": [20.0, np.inf]}, r"temperature at \(1,\) is inf"),
        ({"monitored": np.full((2, 6), np.inf)}, r"monitored at \(0, 0\) is inf"),
        ({"monitored": np.zeros((2, 5))}, r"monitored of shape \(2, 5\); expected \(2, 6\)"),
    ],
)
def test_wrong_input_is_named(change: dict[str, object], message: str) -> None:
    arguments: dict[str, object] = {"positions": np.zeros((2, 5)), **change}
    with pytest.raises(InputError, match=message):
        predict_tool_offset(arrange_machine(load_machine("xyzac_trt")), **arguments)  # type: ignore[arg-type]


def test_covariance_of_the_wrong_shape_is_refused() -> None:
    model = arrange_machine(load_machine("xyzac_trt"))
    with pytest.raises(InputError, match=r"expected \(2, 6, 6\)"):
        propagate_covariance(model, np.zeros((2, 5)), np.zeros((2, 5, 5)))


def test_no_poses_give_no_offsets() -> None:
    model = arrange_machine(load_machine("xyzac_trt"))
    assert predict_tool_offset(model, np.zeros((0, 5)), monitored=np.zeros((0, 6))).shape == (0, 6)


def test_one_temperature_holds_for_all_poses() -> None:
    machine = load_machine("xyzac_trt")
    q = poses(machine, 10)[0]
    model = arrange_machine(machine)
    one = predict_tool_offset(model, q, temperature=25.0)
    np.testing.assert_array_equal(one, predict_tool_offset(model, q, temperature=np.full(10, 25.0)))
    assert np.abs(one - predict_tool_offset(model, q)).max() > 1e-6


def test_a_table_that_moves_under_a_tool_that_stands_still() -> None:
    """No axis between base and tool: the tool is one place for all poses."""
    machine = load_machine("xyzac_trt")
    still = replace(
        machine,
        bodies=(*(replace(body, axis=None) if body.axis in ("X", "Y", "Z") else body for body in machine.bodies),),
        axes=tuple(axis for axis in machine.axes if axis.letter in ("A", "C")),
        errors={name: error for name, error in machine.errors.items() if name[2] in "AC"},
    )
    full, directions, temperature, live = poses(machine, 20)
    full[:, :3] = directions[:, :3] = 0.0
    unexpanded = replace(
        machine,
        errors=still.errors,
        axes=tuple(replace(a, reversal=0.0) if a.letter in "XYZ" else a for a in machine.axes),
    )
    known = {"temperature": temperature, "monitored": live}
    np.testing.assert_allclose(
        predict_tool_offset(arrange_machine(still), full[:, 3:], direction=directions[:, 3:], **known),
        predict_tool_offset(arrange_machine(unexpanded), full, direction=directions, **known),
        rtol=0.0,
        atol=1e-15,
    )
    solved = solve_axis_corrections(arrange_machine(still), full[:, 3:], direction=directions[:, 3:], **known)
    assert solved.converged.all()
    assert not solved.position_spanned.any()
    assert monitored_jacobian(arrange_machine(still), full[:, 3:]).shape == (20, 6, 6)
