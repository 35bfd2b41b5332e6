"""The shipped grinder: figures of the paper, and a correction of Y alone that never reverses."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.machine.correction import remaining_offset, solve_axis_corrections
from rotary_error_monitor.machine.kinematics import arrange_machine
from rotary_error_monitor.metrology.guideway_compensation import count_reversals, rotate_monotone
from rotary_error_monitor.metrology.straightness import estimate_straightness

MACHINE = load_machine("grinder_zhou2023")


@pytest.mark.parametrize(("name", "figure"), [("EYX", 5.5e-6), ("EYZ", 5.8e-6)])
def test_straightness_has_the_figure_of_the_paper(name: str, figure: float) -> None:
    """Over the whole axis, each millimetre."""
    table = MACHINE.errors[name].table
    assert table is not None
    x = np.linspace(*MACHINE.axis(name[2]).travel, 1401)
    result = estimate_straightness(x, np.interp(x, table.positions, table.forward))
    assert result.error == pytest.approx(figure, rel=2e-3)


@pytest.mark.parametrize("name", ["EYX", "EYZ"])
def test_the_rotation_is_the_smallest_one(name: str) -> None:
    component = MACHINE.errors[name]
    assert component.table is not None
    rotated = rotate_monotone(np.array(component.table.positions), np.array(component.table.forward))
    low, high = MACHINE.axis(name[2]).travel
    assert component.poly[1] / ((high - low) / 2) == pytest.approx(np.tan(rotated.angle), rel=1e-6)


def test_x_and_z_in_correction_of_y_out() -> None:
    model = arrange_machine(MACHINE)
    x, z = np.linspace(-1.4, 0.0, 57), np.linspace(-0.65, -0.15, 21)
    grid = np.stack([*np.meshgrid(x, z, indexing="ij"), np.full((57, 21), 0.1)], axis=-1)
    result = solve_axis_corrections(model, grid.reshape(-1, 3))
    assert result.converged.all()
    assert result.position_spanned.all()
    np.testing.assert_array_equal(np.abs(result.corrections[:, :2]) < 1e-12, True)
    corrections = result.corrections[:, 2].reshape(57, 21)

    def curve(name: str, q: np.ndarray) -> np.ndarray:
        component, (low, high) = MACHINE.errors[name], MACHINE.axis(name[2]).travel
        assert component.table is not None
        u = (2 * q - low - high) / (high - low)
        return np.interp(q, component.table.positions, component.table.forward) + component.poly[1] * u

    expected = -(curve("EYX", x)[:, None] + curve("EYZ", z)[None, :] + 0.6e-6 * (2 * 0.1 / 0.55 - 1))
    np.testing.assert_allclose(corrections, expected, atol=1e-10)
    # Rounding of the tables leaves steps of less than a picometre at the levelled places.
    assert count_reversals(np.round(corrections, 11)) == 0
    assert count_reversals(np.round(corrections.T, 11)) == 0
    left = remaining_offset(model, grid.reshape(-1, 3), result.corrections)
    assert np.abs(left[:, :3]).max() < 1e-9
