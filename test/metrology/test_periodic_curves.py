"""Measured curves against the sums of harmonics from which they were drawn: as near as the bound on interpolation."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from drawn_curves import ANGLES, DrawnCurves

from rotary_error_monitor.description.stage import (
    load_stage,
)
from rotary_error_monitor.metrology.encoder_heads import HeadLayout, estimate_ring_pose
from rotary_error_monitor.metrology.error_motion import remove_eccentricity, remove_graduation, remove_mirror
from rotary_error_monitor.metrology.periodic_curves import (
    angular_orders,
    angular_slopes,
    angular_values,
    doubted_orders,
    planar_orders,
    steepest,
)
from rotary_error_monitor.pipeline.publication import AssemblyVariance

SEEDS = range(6)


@pytest.mark.parametrize("even", [True, False])
@pytest.mark.parametrize("seed", SEEDS)
def test_interpolation_stays_within_its_bound(seed: int, even: bool) -> None:
    """Over several turns, for angles in even and in uneven steps; the bound is no more than 25 times too wide."""
    drawn = DrawnCurves(seed, even)
    psi = np.linspace(-20.0, 20.0, 40_001)
    error = np.abs(angular_values(drawn.ring_table, psi) - drawn.graduation(psi)).max()
    assert drawn.ring_bound / 25 < error < drawn.ring_bound
    fine = np.linspace(0, 2 * np.pi, 100_001)
    slope = np.gradient(drawn.graduation(fine), fine)
    np.testing.assert_allclose(angular_slopes(drawn.ring_table, fine), slope, atol=0.02 * np.abs(slope).max())
    assert steepest(drawn.ring_table) == pytest.approx(np.abs(slope).max(), rel=0.02)


@pytest.mark.parametrize("seed", SEEDS)
def test_the_estimate_by_tables_is_that_by_harmonics(seed: int) -> None:
    """Radial error motion, rotation and tilt, to the bound: each of four heads may miss by it, and weighs a half."""
    drawn = DrawnCurves(seed, even=False)
    rng = np.random.default_rng(100 + seed)
    theta = rng.uniform(-10, 10, 500)
    layout = HeadLayout(tuple(load_stage().azimuths.values()))
    readings = theta[:, None] + 1e-4 * rng.normal(size=(500, 4))
    found = []
    for stage in drawn.stages():
        free = remove_graduation(readings, np.array(layout.azimuths), stage.ring)
        ring = estimate_ring_pose(layout, stage.ring.disc_radius, free, np.ones_like(free))
        radial = remove_eccentricity(ring.centre, ring.theta, stage.ring)
        tilt = remove_mirror(1e-5 * np.ones((500, 2)), theta, stage.mirror)
        found.append((ring.theta, radial, tilt))
    by_orders, by_tables = found
    apart = [np.abs(a - b).max() for a, b in zip(by_orders, by_tables, strict=True)]
    assert 0 < apart[0] <= drawn.ring_bound
    assert 0 < apart[1] <= 0.1 * drawn.ring_bound
    assert 0 < apart[2] <= drawn.mirror_bound


@pytest.mark.parametrize("seed", SEEDS)
def test_orders_of_a_table_are_those_that_it_was_drawn_from(seed: int) -> None:
    drawn = DrawnCurves(seed)
    ring = {row.order: row for row in angular_orders(drawn.ring_table, 40)}
    mirror = {row.order: row for row in planar_orders(drawn.mirror_table, 40)}
    for truth, flat in zip(drawn.ring, drawn.mirror, strict=True):
        row, form = ring.pop(truth.order), mirror.pop(flat.order)
        np.testing.assert_allclose([row.cos, row.sin], [truth.cos, truth.sin], atol=drawn.ring_bound)
        np.testing.assert_allclose([*form.x, *form.y], [*flat.x, *flat.y], atol=drawn.mirror_bound)
    assert max(np.hypot(row.cos, row.sin) for row in ring.values()) < drawn.ring_bound
    assert len(ring) == len(mirror) == 41 - len(drawn.orders)


def test_the_covariance_carries_the_uncertainty_of_a_table() -> None:
    """Over many tables whose values err by what they state, independently: what is left of ring and mirror.

    Of the ring a half of that is displacement, but two thirds are stated: of the orders in which four heads differ so
    many are odd. `test/calibration/test_assembly_tables.py` has curves that such heads have measured.
    """
    u, theta = 1e-7, np.linspace(0, 2 * np.pi, 181)[:-1]
    layout = HeadLayout(tuple(load_stage().azimuths.values()))
    radial, tilt = [], []
    for seed in range(40):
        drawn = DrawnCurves(seed, u=u)
        rng = np.random.default_rng(1000 + seed)
        off = [tuple(np.add(column, u * rng.normal(size=ANGLES))) for column in (
            drawn.ring_table.values, drawn.mirror_table.x, drawn.mirror_table.y)]  # fmt: skip
        stage = drawn.stages()[1]
        wrong = replace(
            stage,
            encoder=replace(stage.ring, graduation_table=replace(drawn.ring_table, values=off[0])),
            mirror=replace(stage.mirror, flatness_table=replace(drawn.mirror_table, x=off[1], y=off[2])),
        )
        at = np.array(layout.azimuths) - theta[:, None]
        difference = remove_graduation(at * 0 + theta[:, None], np.array(layout.azimuths), wrong.ring)
        difference = difference - remove_graduation(at * 0 + theta[:, None], np.array(layout.azimuths), stage.ring)
        pose = estimate_ring_pose(layout, stage.ring.disc_radius, theta[:, None] + difference, np.ones_like(at))
        radial.append(pose.centre)
        still = np.zeros((len(theta), 2))
        tilt.append(remove_mirror(still, theta, wrong.mirror) - remove_mirror(still, theta, stage.mirror))
    stated = AssemblyVariance.of(stage)
    assert stated.radial == pytest.approx(2 / 3 * (0.1 * u) ** 2, rel=0.05)
    for found, variance in ((radial, 0.75 * stated.radial), (tilt, stated.tilt)):
        errors = np.abs(np.concatenate(found)) / np.sqrt(variance)
        # a spline between angles averages its neighbours a little
        assert 0.93 < np.mean(errors < 1.96) < 0.97
    exact = AssemblyVariance.of(DrawnCurves(0).stages()[1])
    assert exact.radial == exact.tilt == 0.0


def test_the_uncertainty_of_a_table_lies_in_orders_that_it_tells() -> None:
    """Coefficients of those orders, drawn by what is stated of each, make values as uncertain as the table says."""
    drawn = DrawnCurves(0, u=3e-7)
    orders, std = doubted_orders(drawn.ring_table)
    assert orders == tuple(range(2, 18))
    rng = np.random.default_rng(0)
    psi = np.linspace(0, 6, 50)
    waves = np.concatenate([[np.cos(k * psi), np.sin(k * psi)] for k in orders])
    made = rng.normal(size=(4000, len(waves))) * std @ waves
    np.testing.assert_allclose(made.std(axis=0), 3e-7, rtol=0.06)
