"""Centres of polar profiles against brute force over true circles about a large base circle."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import linprog, minimize

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.circles import CENTRES, find_centre

BASE = 1e3  # radius of the base circle in units of the profile
ANGLES = np.arange(180) * (2 * np.pi / 180)


def profile_of(seed):
    rng = np.random.default_rng(seed)
    orders = rng.integers(2, 12, 4)
    waves = sum(rng.normal() * np.cos(k * ANGLES + rng.uniform(0, 6.3)) for k in orders)
    return waves + 3 * np.cos(ANGLES - rng.uniform(0, 6.3)) + 0.2 * rng.normal(size=len(ANGLES))


def radii(profile, centre):
    """Distances of the points of the true polar picture from a centre."""
    points = (BASE + profile) * np.exp(1j * ANGLES)
    return np.abs(points - complex(*centre))


COSTS = {
    "LSC": lambda r: r.var(),
    "MZC": np.ptp,
    "MCC": lambda r: r.max(),
    "MIC": lambda r: -r.min(),
}


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("method", CENTRES)
def test_no_centre_nearby_is_better_and_the_search_finds_no_other(seed, method):
    profile, cost = profile_of(seed), COSTS[method]
    found = find_centre(ANGLES, profile, method)
    best = cost(radii(profile, found.shift))
    rng = np.random.default_rng(100 + seed)
    for size in (1e-2, 1e-1, 1.0, 3.0):
        tried = [cost(radii(profile, found.shift + size * rng.normal(size=2))) for _ in range(200)]
        # the limaçon departs from the circle by shift²/(2 base)
        assert min(tried) > best - 2e-2
    starts = rng.normal(size=(6, 2))  # the costs have edges, on which a search may stop
    searched = min(minimize(lambda c: cost(radii(profile, c)), start, method="Nelder-Mead").fun for start in starts)
    assert best == pytest.approx(searched, abs=2e-2)
    assert found.value == pytest.approx(np.ptp(radii(profile, found.shift)), abs=2e-2)


@pytest.mark.parametrize("seed", range(6))
def test_the_minimum_zone_is_the_smallest(seed):
    profile = profile_of(seed)
    values = {method: find_centre(ANGLES, profile, method).value for method in CENTRES}
    assert min(values.values()) == values["MZC"]


def least_by_general_solver(angles, profile, method):
    """Least cost of the centre as a linear programme in shift, outer and inner radius."""
    waves, one, none = np.stack([np.cos(angles), np.sin(angles)], axis=1), np.ones((len(angles), 1)), 0.0
    outer, inner = np.hstack([-waves, -one, none * one]), np.hstack([waves, none * one, one])
    rows, edges = {
        "MZC": (np.vstack([outer, inner]), np.concatenate([-profile, profile])),
        "MCC": (outer, -profile),
        "MIC": (inner, profile),
    }[method]
    cost = np.array([0.0, 0.0, method != "MIC", -float(method != "MCC")])
    return linprog(cost, rows, edges, bounds=(None, None)).fun


@pytest.mark.parametrize("count", [3, 4, 5, 17, 90, 180, 361])
@pytest.mark.parametrize("method", ["MZC", "MCC", "MIC"])
def test_no_centre_is_better_whatever_the_angles_and_the_digits(count, method):
    """Also of profiles with equal values, and of angles that are apart by chance."""
    rng = np.random.default_rng(count)
    for draw in range(12):
        angles = np.arange(count) * (2 * np.pi / count)
        if draw % 3 == 0 and count > 3:
            angles = angles + rng.uniform(-0.4, 0.4, count) * (2 * np.pi / count)
        profile = rng.normal(size=count) + 3.0 * np.cos(angles - rng.uniform(0.0, 6.3))
        if draw % 4 == 0:
            profile = np.round(profile, 1)
        found = find_centre(angles, profile, method)
        left = profile - np.stack([np.cos(angles), np.sin(angles)], axis=1) @ found.shift
        cost = {"MZC": np.ptp(left), "MCC": left.max(), "MIC": -left.min()}[method]
        assert cost == pytest.approx(least_by_general_solver(angles, profile, method), abs=1e-9)
        assert found.value == pytest.approx(np.ptp(left), abs=1e-12)


@pytest.mark.parametrize("method", CENTRES)
def test_an_eccentric_circle_has_its_centre_and_no_value(method):
    found = find_centre(ANGLES, 5.0 + 0.3 * np.cos(ANGLES) - 0.2 * np.sin(ANGLES), method)
    assert found.shift == pytest.approx((0.3, -0.2), abs=1e-9)
    assert found.value == pytest.approx(0.0, abs=1e-9)
    assert find_centre(ANGLES, np.full(180, 2e-6), method).value == pytest.approx(0.0, abs=1e-20)


@pytest.mark.parametrize("scale", [1e-9, 1e-6, 1e3])
@pytest.mark.parametrize("method", CENTRES)
def test_the_unit_does_not_matter(scale, method):
    one, other = find_centre(ANGLES, profile_of(1), method), find_centre(ANGLES, scale * profile_of(1), method)
    assert other.value == pytest.approx(scale * one.value, rel=1e-6)


def test_wrong_questions_are_refused():
    with pytest.raises(InputError, match="'LSQ' is no centre of a polar profile; there are LSC, MZC, MCC, MIC"):
        find_centre(ANGLES, profile_of(0), "LSQ")
    with pytest.raises(InputError, match="2 angles; at least 3"):
        find_centre(ANGLES[:2], np.zeros(2), "MZC")
