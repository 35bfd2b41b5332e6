"""Each kind of error component against its closed form on a machine of one axis."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.description.machine_parts import Axis, Body, ErrorComponent, ErrorTable, Harmonic
from rotary_error_monitor.machine.components import arrange_components

AXIS = Axis("Z", "linear", (0.0, 0.0, 1.0), (1.0, 5.0))
Q = np.array([[1.0, 2.0, 3.0, 4.5, 5.0]])


def slide(axis: Axis = AXIS, **errors: ErrorComponent) -> MachineDescription:
    return MachineDescription("slide", (Body("slide", "base", axis="Z"),), (axis,), errors, "slide", "base")


def test_without_errors_all_are_zero() -> None:
    errors = arrange_components(slide()).at(Q, None, None)
    assert errors.shape == (6, 1, 5)
    assert not errors.any()


def test_poly_is_in_the_scaled_position() -> None:
    errors = arrange_components(slide(EXZ=ErrorComponent(poly=(1.0, 2.0, 3.0)))).at(Q, None, None)
    u = np.array([-1.0, -0.5, 0.0, 0.75, 1.0])
    np.testing.assert_allclose(errors[0, 0], 1 + 2 * u + 3 * u**2, rtol=1e-15)
    assert not errors[1:].any()


def test_harmonic_is_in_the_position() -> None:
    waves = (Harmonic(2.0, 0.3, -0.7), Harmonic(0.5, 0.0, 1.0))
    errors = arrange_components(slide(ECZ=ErrorComponent(harmonic=waves))).at(Q, None, None)
    truth = 0.3 * np.cos(2 * Q[0]) - 0.7 * np.sin(2 * Q[0]) + np.sin(0.5 * Q[0])
    np.testing.assert_allclose(errors[5, 0], truth, rtol=1e-14)


@pytest.mark.parametrize(("sign", "expected"), [(1.0, 3.0), (-1.0, 5.0), (0.0, 4.0), (-0.2, 5.0)])
def test_table_depends_on_direction(sign: float, expected: float) -> None:
    table = ErrorTable((1.0, 2.0, 4.0), (0.0, 2.0, 4.0), (1.0, 3.0, 7.0))
    components = arrange_components(slide(EYZ=ErrorComponent(table=table)))
    assert components.at(np.array([[3.0]]), np.array([[sign]]), None)[1, 0, 0] == expected


def test_table_without_direction_is_the_mean_and_holds_its_ends() -> None:
    table = ErrorTable((1.0, 2.0, 4.0), (0.0, 2.0, 4.0), (1.0, 3.0, 7.0))
    errors = arrange_components(slide(EYZ=ErrorComponent(table=table))).at(np.array([[3.0, 0.0, 9.0]]), None, None)
    np.testing.assert_array_equal(errors[1, 0], [4.0, 0.5, 5.5])


def test_reversal_is_half_missing_in_the_direction_of_travel() -> None:
    components = arrange_components(slide(replace(AXIS, reversal=2e-6)))
    errors = components.at(np.full((1, 3), 2.0), np.array([[1.0, -1.0, 0.0]]), None)
    np.testing.assert_array_equal(errors[2, 0], [-1e-6, 1e-6, 0.0])


def test_expansion_grows_with_temperature_and_position() -> None:
    components = arrange_components(slide(replace(AXIS, expansion=1e-5)))
    errors = components.at(Q, None, np.array([20.0, 21.0, 25.0, 10.0, 20.0]))
    np.testing.assert_allclose(errors[2, 0], [0.0, 2e-5, 15e-5, -45e-5, 0.0], atol=1e-18)


def test_a_rotary_axis_reverses_about_itself() -> None:
    axis = Axis("Z", "rotary", (0.6, 0.0, 0.8), (-1.0, 1.0), reversal=1e-5)
    errors = arrange_components(slide(axis)).at(np.zeros((1, 1)), np.ones((1, 1)), None)
    np.testing.assert_allclose(errors[:, 0, 0], [0, 0, 0, -3e-6, 0, -4e-6], atol=1e-20)
