"""Orders of rows, against sums over every row."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.gap.orders import Angles, order_spectrum


@pytest.fixture(params=[25.0, 0.4], ids=["four turns", "part of a turn"])
def turning(request):
    draw = np.random.default_rng(4)
    angle = np.sort(draw.uniform(-0.6 * request.param, 0.4 * request.param, 3000))
    return angle, draw.normal(size=3000) + 0.4 * np.cos(3 * angle + 0.7) + 0.2


def waves(angle, orders):
    k = np.arange(orders + 1)
    return np.concatenate([np.cos(np.outer(angle, k)), np.sin(np.outer(angle, k[1:]))], axis=1)


def test_sums_are_those_over_every_row(turning):
    angle, rows = turning
    exact = np.exp(-1j * np.outer(np.arange(41), angle)) @ rows
    np.testing.assert_allclose(Angles(angle).sums(rows, 40), exact, atol=0.04 * np.sqrt(np.sum(rows**2)))
    assert Angles(angle).sums(rows, 40)[0] == pytest.approx(rows.sum(), rel=1e-12)


def test_power_of_the_highest_order_is_hardly_too_small():
    angle = np.linspace(0, 20, 40_000)
    power = order_spectrum(angle, np.cos(200 * angle), 200)
    exact = 2 * abs(np.exp(-200j * angle) @ np.cos(200 * angle)) ** 2 / len(angle)
    assert power[-1] == pytest.approx(exact, rel=1e-3)
    assert int(np.argmax(power)) + 1 == 200


def test_products_give_the_fit_of_all_waves(turning):
    angle, rows = turning
    table = waves(angle, 16)
    gram, moment = Angles(angle).products(16), Angles(angle).moments(rows, 16)
    assert gram.shape == (33, 33)
    np.testing.assert_allclose(gram, table.T @ table, atol=0.01 * len(angle))
    np.testing.assert_allclose(moment, table.T @ rows, atol=0.02 * np.sqrt(np.sum(rows**2) * len(angle)))


def test_products_are_those_of_waves_at_the_middle_of_an_arc():
    # At angles that are the middle of an arc nothing is rounded.
    arcs = 2**12
    angle = (np.random.default_rng(5).integers(-9000, 9000, 500) + 0.5) * 2 * np.pi / arcs
    rows = np.random.default_rng(6).normal(size=500)
    gram, moment = Angles(angle).products(16), Angles(angle).moments(rows, 16)
    table = waves(angle, 16)
    np.testing.assert_allclose(gram, table.T @ table, atol=1e-8)
    np.testing.assert_allclose(moment, table.T @ rows, atol=1e-8)
