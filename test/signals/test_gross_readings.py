"""Gross readings are told from noise, and from signals that are as quick."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.signals.gross_readings import gross_readings, recurring
from rotary_error_monitor.signals.reading_noise import noise_beside_line

SEEDS = range(8)
PERIODS = (0.001, 0.004, 0.01)
COUNT = 5000


def noise(seed, columns=2):
    return np.random.default_rng(seed).normal(size=(COUNT, columns))


@pytest.mark.parametrize("period", PERIODS)
@pytest.mark.parametrize("together", [False, True])
def test_noise_alone_has_none(period, together):
    assert sum(gross_readings(noise(seed, 4), 1.0, period, together).sum() for seed in SEEDS) == 0


@pytest.mark.parametrize("period", PERIODS)
@pytest.mark.parametrize("seed", SEEDS)
def test_one_in_a_hundred_is_found(period, seed):
    draw = np.random.default_rng(100 + seed)
    values, wrong = noise(seed, 1), draw.random(COUNT) < 0.01
    values[wrong, 0] += 50 * draw.choice([-1, 1], wrong.sum())
    found = gross_readings(values, 1.0, period)[:, 0]
    assert np.count_nonzero(wrong & ~found) <= 0.02 * wrong.sum()
    near = np.convolve(wrong, np.ones(4 * round(0.025 / period) + 9), "same") > 1.5  # between two of them
    assert np.count_nonzero(found & ~wrong & ~near) <= 0.02 * wrong.sum()


@pytest.mark.parametrize("place", [0, 1, -2, -1])
def test_the_first_and_the_last_are_found(place):
    values = noise(0)
    values[place, 1] -= 50.0
    assert np.argwhere(gross_readings(values, 1.0, 0.004)).tolist() == [[place % COUNT, 1]]


@pytest.mark.parametrize("period", PERIODS)
@pytest.mark.parametrize("seed", SEEDS)
def test_a_burst_is_found_whole_on_a_signal_that_moves(period, seed):
    draw = np.random.default_rng(200 + seed)
    time = period * np.arange(COUNT)
    values = noise(seed) + 200 * np.sin(2 * np.pi * 0.5 * time + draw.uniform(0, 6))[:, None]
    first, length = int(draw.integers(100, COUNT - 100)), round(0.02 / period)
    values[first : first + length, 1] += 60
    found = np.argwhere(gross_readings(values, 1.0, period))
    assert found.tolist() == [[first + k, 1] for k in range(length)]


@pytest.mark.parametrize("period", PERIODS)
@pytest.mark.parametrize("seed", SEEDS)
def test_what_does_not_come_back_or_is_as_quick_elsewhere_is_the_signal(period, seed):
    """Steps, corners, a wave whose frequency sweeps up to a sixth of the sampling rate, half a sine of 100 ms.

    Of a pulse that is hardly longer than a burst may be, one sample in twenty may count as gross.
    """
    draw = np.random.default_rng(300 + seed)
    place, size = int(draw.integers(100, COUNT - 100)), float(draw.uniform(10, 1000))
    index = np.arange(COUNT)
    pulse = round(0.1 / period)
    signals = [
        np.where(index > place, size, 0.0),
        size * np.maximum(index - place, 0) / 10,
        size * np.sin(2 * np.pi * index**2 / (12 * COUNT)),
        np.where((index > place) & (index < place + pulse), np.sin(np.pi * (index - place) / pulse), 0.0) * size,
    ]
    found = gross_readings(noise(seed, 4) + np.stack(signals, axis=1), 1.0, period).sum(axis=0)
    assert found[:3].tolist() == [0, 0, 0]
    assert found[3] <= 0.05 * pulse


@pytest.mark.parametrize("seed", SEEDS)
def test_a_burst_of_any_readings_is_found_whole_and_recurs_nowhere(seed):
    draw = np.random.default_rng(600 + seed)
    first, values = int(draw.integers(100, COUNT - 100)), noise(seed, 1)
    values[first : first + 5, 0] += 50 * draw.normal(size=5)
    values[[first, first + 4], 0] += 200.0  # so that it is this long
    found = gross_readings(values, 1.0, 0.004)[:, 0]
    assert np.flatnonzero(found).tolist() == list(range(first, first + 5))
    assert not recurring(found, np.linspace(0.0, 20.0, COUNT)).any()


@pytest.mark.parametrize("seed", SEEDS)
def test_what_all_instruments_show_is_motion(seed):
    values = noise(seed, 4)
    values[1000] += 80.0
    values[2000, 2] += 80.0
    assert np.argwhere(gross_readings(values, 1.0, 0.004, together=True)).tolist() == [[2000, 2]]


def test_where_many_are_off_they_are_the_signal():
    values = noise(0, 1)
    values[::15] += 60.0
    assert not gross_readings(values, 1.0, 0.004).any()


@pytest.mark.parametrize("step", [0.0, 5.0])
@pytest.mark.parametrize("seed", SEEDS)
def test_noise_is_found_beside_slow_motion(step, seed):
    values = noise(seed) + 300 * np.sin(np.arange(COUNT) / 300)[:, None]
    if step:
        values = np.round(values / step) * step
        np.testing.assert_array_equal(noise_beside_line(values) >= step, True)
    else:
        np.testing.assert_allclose(noise_beside_line(values), 1.0, rtol=0.06)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_mark_comes_again_at_its_place_and_accidents_do_not(seed):
    draw = np.random.default_rng(400 + seed)
    angle = np.linspace(0.0, 2 * np.pi * draw.uniform(8, 30), COUNT)
    mark = np.zeros(COUNT, bool)
    mark[np.searchsorted(angle, np.arange(draw.uniform(0, 6), angle[-1], 2 * np.pi))] = True
    accidents = draw.random(COUNT) < 0.004
    np.testing.assert_array_equal(recurring(mark | accidents, angle)[mark], True)
    assert np.count_nonzero(recurring(mark | accidents, angle) & ~mark) <= 2  # beside the mark by chance


def test_accidents_seldom_seem_to_recur():
    """One in a thousand recordings at most, and a rotor that stands still has no place of its own."""
    alarms = 0
    for seed in range(300):
        draw = np.random.default_rng(500 + seed)
        angle = np.where(np.arange(COUNT) < COUNT // 2, 1.0, np.linspace(1.0, 60.0, COUNT))
        alarms += recurring(draw.random(COUNT) < draw.choice([0.001, 0.01]), angle).any()
    assert alarms <= 3  # of 300 at a thousandth: four or more once in 4000
