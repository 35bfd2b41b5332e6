"""Noise of sine and cosine signals: rounding that it does not break up, filters, gross samples, hardly any motion."""

from __future__ import annotations

import numpy as np
import pytest
from draws import seeds

from rotary_error_monitor.effects.library import load_effects
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.gap.diagnosis import diagnose
from rotary_error_monitor.gap.verdict import Verdict
from rotary_error_monitor.kinds.quadrature.description import QuadratureDescription
from rotary_error_monitor.kinds.quadrature.effects import QuadratureEffect
from rotary_error_monitor.kinds.quadrature.problem import QuadratureProblem, radius_scatter
from rotary_error_monitor.kinds.quadrature.rounding import repeated_variance
from rotary_error_monitor.kinds.quadrature.twin import QuadratureRecording

EFFECTS = load_effects(QuadratureEffect)
TWIN = QuadratureDescription("signals", 3.164e-7, 500.0, 50.0, 0.29)
COUNT, PERIODS = 8000, 40


def scanned(seed, noise, periods=PERIODS, wrong=(), offset=0.0):
    """Signals (n,) in whole counts of a steady scan over a circle of 480 counts; `noise` gives counts (2, n)."""
    rng = np.random.default_rng(seed)
    phase = 2 * np.pi * periods * np.arange(COUNT) / COUNT + rng.uniform(0, 2 * np.pi)
    cosine, sine = np.stack([480 * np.cos(phase) + offset, 480 * np.sin(phase)]) + noise(rng)
    cosine[list(wrong)] = 0.0
    return np.round(cosine) + 1j * np.round(sine)


def white(size):
    return lambda rng: size * rng.normal(size=(2, COUNT))


def filtered(rng):
    """The mean of ten samples of white noise, 0.7 counts."""
    window = np.full(10, 0.1**0.5)
    return 0.7 * np.stack([np.convolve(rng.normal(size=COUNT + 9), window, "valid") for _ in range(2)])


NOISES = {
    "none: every period is rounded alike": (white(0.0), PERIODS),
    "below the steps": (white(0.2), PERIODS),
    "none, at other phases each period": (white(0.0), 37.37),
    "filtered": (filtered, PERIODS),
}


def problem_of(signals):
    return QuadratureProblem(TWIN, QuadratureRecording(signals), EFFECTS)


@pytest.mark.parametrize("name", sorted(NOISES))
def test_what_converters_and_filters_do_to_noise_is_no_gap(name):
    noise, periods = NOISES[name]
    verdicts = [diagnose(problem_of(scanned(seed, noise, periods))).verdict for seed in seeds(6)]
    assert verdicts.count(Verdict.NO_GAP) >= len(verdicts) - 1  # one in a hundred may alarm


@pytest.mark.parametrize("name", sorted(NOISES))
def test_an_offset_is_found_beside_it(name):
    noise, periods = NOISES[name]
    (seed,) = seeds(1)
    diagnosis = diagnose(problem_of(scanned(seed, noise, periods, offset=4.0)))
    (found,) = diagnosis.causes
    shift = found.parameters["shift"]
    assert found.cause.key == ("signal_offset", "")
    assert np.all(np.abs(np.subtract(shift.value, (4.0, 0.0))) < 4 * np.asarray(shift.std))


def test_noise_that_turns_do_not_share_is_told():
    remarks = " ".join(problem_of(scanned(1, filtered)).remarks({}))
    assert "successive samples err alike" in remarks
    assert "successive" not in " ".join(problem_of(scanned(1, white(0.7))).remarks({}))


@pytest.mark.parametrize("seed", seeds(4))
def test_a_sample_that_is_alone_in_its_cell_may_be_gross(seed):
    """Forty periods of 200 samples each meet 200 of the 360 cells in which scatter is told."""
    wrong = np.random.default_rng(seed).choice(COUNT, 3, replace=False)
    signals = scanned(seed, white(0.7), wrong=wrong)
    scatter, kept = radius_scatter(signals)
    assert scatter == pytest.approx(np.hypot(0.7, np.sqrt(1 / 12)), rel=0.05)
    off = wrong[np.abs(np.abs(signals[wrong]) - 480) > 20]
    assert not kept[off].any() and np.count_nonzero(~kept) <= len(wrong)


@pytest.mark.parametrize(("periods", "met"), [(0.0, 2), (COUNT / 8, 16)], ids=["at rest", "eight samples a period"])
def test_signals_at_hardly_any_place_are_refused(periods, met):
    with pytest.raises(InputError, match=r"at (\d+) of 360 degrees of the circle; expected 33 or more") as told:
        diagnose(problem_of(scanned(2, white(0.7), periods)))
    assert int(str(told.value).split(" of 360")[0].split()[-1]) <= met


def test_noise_of_a_step_leaves_nothing_of_rounding():
    """Against rounding carried out: mean errors at places within a step, of many readings each."""
    rng = np.random.default_rng(5)
    places = (np.arange(100) + 0.5) / 100
    for noise in (0.0, 0.1, 0.2, 0.3):
        readings = np.round(places[:, None] + noise * rng.normal(size=(100, 20000)))
        assert np.var(readings.mean(axis=1) - places) == pytest.approx(repeated_variance(noise), rel=0.06)
    assert repeated_variance(1.0) < 1e-16
