"""Whitening filters against noise whose law is known in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from rotary_error_monitor.noise.jitter import Jitter
from rotary_error_monitor.noise.whitening import convolve, drift_predictor, predictor, segments_of, whitening_taps

PERIOD = 0.004


def ornstein_uhlenbeck(rng, count, std, correlation_time):
    memory = np.exp(-PERIOD / correlation_time)
    drive = std * np.sqrt(1 - memory**2) * rng.normal(size=count)
    drive[0] = std * rng.normal()
    return lfilter([1.0], [1.0, -memory], drive)


def correlations(values, lags):
    return np.array([np.mean(values[lag:] * values[:-lag]) for lag in lags]) / np.mean(values**2)


def test_drift_and_white_noise_become_white():
    rng = np.random.default_rng(1)
    count = 200_000
    noise = ornstein_uhlenbeck(rng, count, 3e-7, 0.3) + 5e-7 * rng.normal(size=count)
    whitener = drift_predictor(3e-7, 0.3, 5e-7, PERIOD)
    white = whitener.apply(noise[:, None], [slice(0, count)])[whitener.start_up :, 0]
    assert np.std(white) == pytest.approx(1.0, abs=0.006)
    assert np.abs(correlations(white, [1, 2, 5, 20, 100])).max() < 0.01


def test_a_spectrum_of_an_autoregression_gives_back_its_filter():
    # x_t = 0.9 x_(t-1) + e_t: the one-step predictor is (1, -0.9).
    def density(frequency):
        return 2 * PERIOD / np.abs(1 - 0.9 * np.exp(-2j * np.pi * frequency * PERIOD)) ** 2

    taps = whitening_taps(density, PERIOD)
    np.testing.assert_allclose(taps[:4], [1.0, -0.9, 0.0, 0.0], atol=1e-6)


def test_both_whiteners_of_a_drift_agree():
    std, correlation_time, white = 3e-7, 0.3, 5e-7
    memory = np.exp(-PERIOD / correlation_time)

    def density(frequency):
        turn = np.abs(1 - memory * np.exp(-2j * np.pi * frequency * PERIOD)) ** 2
        return 2 * PERIOD * (std**2 * (1 - memory**2) / turn + white**2)

    rows = np.random.default_rng(2).normal(size=(4000, 2))
    whole = [slice(0, 4000)]
    recursive = drift_predictor(std, correlation_time, white, PERIOD).apply(rows, whole)
    smooth = predictor(density, PERIOD).apply(rows, whole)
    np.testing.assert_allclose(recursive[600:], smooth[600:], rtol=0, atol=0.02 * np.abs(smooth).max())


def test_segments_start_afresh_and_leave_out_their_start():
    whitener = drift_predictor(3e-7, 0.3, 5e-7, PERIOD)
    rows = np.random.default_rng(3).normal(size=(1000, 1))
    split = whitener.apply(rows, [slice(0, 400), slice(500, 1000)])
    alone = whitener.apply(rows[500:], [slice(0, 500)])
    np.testing.assert_array_equal(split[500:], alone)
    assert not split[400:500].any() and not split[500 : 500 + whitener.start_up].any()


def test_segments_are_the_runs_that_are_present():
    present = np.array([0, 1, 1, 0, 0, 1, 0, 1, 1, 1], bool)
    assert segments_of(present) == [slice(1, 3), slice(5, 6), slice(7, 10)]
    assert segments_of(np.zeros(3, bool)) == []


@pytest.mark.parametrize(("rows", "taps"), [(3000, 40), (50, 40), (7, 1), (1000, 255)])
def test_overlapping_pieces_give_the_plain_convolution(rows, taps):
    draw = np.random.default_rng(4)
    values, filter_ = draw.normal(size=(rows, 3)), draw.normal(size=taps)
    plain = lfilter(filter_, [1.0], values, axis=0)
    np.testing.assert_allclose(convolve(values, filter_), plain, rtol=0, atol=1e-12)


def test_the_filter_of_a_drift_is_its_recursion():
    std, correlation_time, white = 3e-7, 0.3, 5e-7
    whitener = drift_predictor(std, correlation_time, white, PERIOD)
    rows = np.random.default_rng(5).normal(size=(2000, 2))
    memory = np.exp(-PERIOD / correlation_time)
    forget = memory + whitener.taps[1] / whitener.taps[0]  # the response to one sample is 1, forget - memory, …
    recursion = lfilter(whitener.taps[0] * np.array([1.0, -memory]), [1.0, -forget], rows, axis=0)
    filtered = whitener.apply(rows, [slice(0, 2000)])
    later, close = slice(whitener.start_up, None), 1e-6 * float(np.abs(recursion).max())
    np.testing.assert_allclose(filtered[later], recursion[later], rtol=0, atol=close)


@pytest.mark.parametrize("period", [0.001, 0.004])
@pytest.mark.parametrize("floor", [3e-17, 1e-15, 1e-13])
@pytest.mark.parametrize(("bandwidth", "shape"), [(6.66, 2.9), (5.0, 1.2), (10.0, 2.0)])
def test_jitter_far_above_its_floor_becomes_white(period, floor, bandwidth, shape):
    """The gain of the filter is one over the root of the density, at all frequencies and behind its start-up."""
    jitter = Jitter(2e-6, bandwidth, shape)
    whitener = predictor(lambda frequency: jitter.density(frequency) + floor, period)
    frequency = np.array([0.5, 1.0, 2.0, 4.0, 6.0, 8.0, 10.0, 13.0, 17.0, 25.0, 50.0, 100.0])
    turns = np.exp(-2j * np.pi * frequency[:, None] * period * np.arange(len(whitener.taps)))
    density = (jitter.density(frequency) + floor) / (2 * period)
    np.testing.assert_allclose(np.square(np.abs(turns @ whitener.taps)) * density, 1.0, atol=0.2)
    dense = np.fft.rfftfreq(2**15, period)
    left = np.square(np.abs(np.fft.rfft(whitener.taps[whitener.start_up :], 2**15)))
    assert np.mean(left * (jitter.density(dense) + floor) / (2 * period)) < 0.02
