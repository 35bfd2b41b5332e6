"""Forces from load cells: directions by hand, and the estimate of several against its covariance."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.metrology.forces import LoadCell, joined_force, shares

TIME = np.arange(400) * 0.01


def test_a_cell_reads_along_its_axes() -> None:
    """By hand: a push of 10 N along +y, seen at 90° along the first axis and by a cell that counts backwards."""
    cell = LoadCell(np.pi / 2, 2, (1.0, -2.0), -2.0, 0.1)
    np.testing.assert_allclose(cell.force(np.array([[1.0 - 20.0, -2.0]])), [[0.0, 10.0]], atol=1e-12)
    single = LoadCell(np.pi / 4, 1, (0.0, 0.0), 1.0, 0.1)
    np.testing.assert_allclose(single.force(np.array([[np.sqrt(2), 99.0]])), [[1.0, 1.0]], atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_several_cells_are_one_force_as_sure_as_weighted_least_squares_make_it(seed: int) -> None:
    """Covariance by brute force, the inverse of the sum of outer products, and the scatter that is seen."""
    rng = np.random.default_rng(seed)
    azimuths, gains, stds = rng.uniform(-3, 3, 3), rng.uniform(0.5, 2, 3), np.array([0.1, 0.3, 0.5])
    cells = [LoadCell(a, n, (0.5, -0.5), g, s) for a, n, g, s in zip(azimuths, (1, 1, 2), gains, stds, strict=True)]
    force = np.column_stack([30 * np.sin(2 * TIME), 10 * np.cos(TIME)])
    information, readings = np.zeros((2, 2)), []
    for azimuth, gain, std, cell in zip(azimuths, gains, stds, cells, strict=True):
        axes = [np.array([np.cos(azimuth + k * np.pi / 2), np.sin(azimuth + k * np.pi / 2)]) for k in range(2)]
        readings.append(np.column_stack([z + gain * force @ axis for z, axis in zip((0.5, -0.5), axes, strict=True)]))
        readings[-1] += std * rng.standard_normal((len(TIME), 2))
        information += sum(gain**2 / std**2 * np.outer(axis, axis) for axis in axes[: cell.axes])
    _, found = joined_force(cells, [TIME] * 3, readings)
    left = (found - force) @ np.linalg.cholesky(information)
    # chi-square of 800 values: 800 ± 40; five standard deviations
    assert abs((left**2).sum() - 800) < 200
    np.testing.assert_allclose(sum(shares(cells)[i] @ cells[i].directions.T @ cells[i].directions for i in range(3)),
                               np.eye(2), atol=1e-9)  # fmt: skip


def test_a_direction_that_no_cell_looks_along_has_no_force() -> None:
    cells = [LoadCell(0.0, 1, (0.0, 0.0), 1.0, 0.1), LoadCell(np.pi, 1, (0.0, 0.0), 1.0, 0.1)]
    readings = [np.full((len(TIME), 2), 4.0), np.full((len(TIME), 2), -6.0)]
    _, found = joined_force(cells, [TIME, TIME], readings)
    np.testing.assert_allclose(found, np.tile([5.0, 0.0], (len(TIME), 1)), atol=1e-12)


def test_nothing_is_known_in_a_gap_of_any_cell() -> None:
    cells = [LoadCell(0.0, 1, (0.0, 0.0), 1.0, 0.1), LoadCell(np.pi / 2, 1, (0.0, 0.0), 1.0, 0.1)]
    late = np.concatenate([np.arange(50, 150), np.arange(200, 390)]) * 0.01 + 0.004
    at, found = joined_force(cells, [TIME, late], [np.ones((400, 2)), np.column_stack([late, late])])
    assert at[0] == pytest.approx(0.51) and at[-1] == pytest.approx(3.89)
    assert not np.any((at > 1.5) & (at < 2.0))
    np.testing.assert_allclose(found, np.column_stack([np.ones(len(at)), at]), atol=1e-12)
