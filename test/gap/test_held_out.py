"""Causes are believed where they predict what was left out, on problems made of plain columns."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.gap.fitting import fit_causes
from rotary_error_monitor.gap.held_out import chance_of_no_better, dispersion, held_out_squares, predicts


def fitted(problem, *names):
    return fit_causes(problem, [Cause(problem.effects[name], "", np.zeros(1)) for name in names])


def test_squares_left_out_are_those_of_a_fit_without_them(linear):
    """Written down once more: least squares on three conditions, squares on the fourth."""
    fit = fitted(linear, "first")
    squares = held_out_squares(fit, linear.conditions)
    column, data = linear.effects["first"].column["x"][:, 0], linear.data["x"][:, 0]
    for block, rows in enumerate(np.split(np.arange(len(data)), linear.blocks)):
        train = np.concatenate(
            [r for b, r in enumerate(np.split(np.arange(len(data)), linear.blocks)) if b % 4 != block % 4]
        )
        size = column[train] @ data[train] / (column[train] @ column[train])
        expected = np.sum(np.square(data[rows] - size * column[rows])) + np.sum(np.square(linear.data["y"][rows]))
        assert squares[block] == pytest.approx(expected, rel=1e-6)


def test_a_cause_that_is_there_is_believed_and_one_that_is_not_is_not(linear):
    assert predicts(linear, fitted(linear, "first"))
    assert not predicts(linear, fitted(linear, "second"))
    assert not predicts(linear, fitted(linear, "first", "second"))
    assert not predicts(linear, fitted(linear))


def test_something_unknown_beside_it_does_not_hide_a_cause(linear):
    linear.data["x"] = linear.data["x"] + 2 * np.sin(np.arange(len(linear.data["x"])) / 9.0)[:, None]
    fit = fitted(linear, "first")
    assert predicts(linear, fit)
    assert dispersion(fit) == pytest.approx(1 + 0.5 * 2.0**2 / 2, rel=0.1)


def test_dispersion_of_noise_is_one(linear):
    assert dispersion(fitted(linear, "first")) == pytest.approx(1.0, abs=0.1)
    assert dispersion(fitted(linear, "first")) >= 1.0


def test_chance_is_a_share_of_resamplings():
    squares = np.ones(24)
    assert chance_of_no_better(squares, squares + 1) == 0.0
    assert chance_of_no_better(squares, squares - 0.5) == 1.0
    noisy = squares + np.random.default_rng(0).normal(0, 1, 24)
    assert 0.1 < chance_of_no_better(squares, noisy - noisy.mean() + 1) < 0.9
