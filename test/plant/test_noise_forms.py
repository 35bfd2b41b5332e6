"""Noise that is not as stated: its form, its strength, and that it comes again."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import welch
from scipy.stats import kurtosis

from rotary_error_monitor.cases.making import make_machine_case, make_stage_case
from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.plant.noise import Noise
from rotary_error_monitor.plant.noise_forms import FORMS, Flicker, Hum, Tails, WanderingNoise, draw_noise

RATE = 250.0
NOISE = Noise(3, "head_a")
TIME = np.arange(100_000) / RATE
NORMAL = NOISE.normal(0, len(TIME))[:, None]


def test_tails_are_heavier_at_the_stated_standard_deviation() -> None:
    heavy = Tails(5.0).shaped(NORMAL, NOISE, TIME)[:, 0]
    assert heavy.std() == pytest.approx(1.0, rel=0.03)
    assert kurtosis(heavy) > 2 > 0.1 > abs(kurtosis(NORMAL[:, 0]))
    assert (np.abs(heavy) > 5).sum() > 50 > 5 > (np.abs(NORMAL) > 5).sum()


def test_flicker_meets_the_white_noise_at_its_corner_and_falls_with_frequency() -> None:
    corner = 2.0
    shown = Flicker(corner, RATE).shaped(NORMAL, NOISE, TIME)[:, 0]
    frequency, density = welch(shown - NORMAL[:, 0], RATE, nperseg=8192)
    white = 2 / RATE
    for low, high in ((0.1, 0.2), (0.4, 0.8), (1.0, 2.0)):
        band = (frequency > low) & (frequency < high)
        expected = white * corner * np.mean(1 / frequency[band])
        assert density[band].mean() == pytest.approx(expected, rel=0.35)


def test_what_wanders_has_its_size_and_forgets_in_its_time() -> None:
    shown = WanderingNoise(0.5, 2.0).shaped(NORMAL, NOISE, TIME)[:, 0] - NORMAL[:, 0]
    assert shown.std() == pytest.approx(0.5, rel=0.2)
    later = shown[round(2.0 * RATE) :]
    assert np.corrcoef(shown[: len(later)], later)[0, 1] == pytest.approx(np.exp(-1), abs=0.15)


def test_hum_is_one_line() -> None:
    shown = Hum(50.02, 0.1).shaped(NORMAL, NOISE, TIME)[:, 0] - NORMAL[:, 0]
    assert np.sqrt(2) * shown.std() == pytest.approx(0.1, rel=1e-3)
    spectrum = np.abs(np.fft.rfft(shown))
    assert np.fft.rfftfreq(len(TIME), 1 / RATE)[spectrum.argmax()] == pytest.approx(50.02, abs=0.01)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("seed", range(5))
def test_drawn_noise_is_near_the_stated_one(form: str, seed: int) -> None:
    drawn = draw_noise(form, np.random.default_rng(seed), RATE, 10_000)
    assert drawn == draw_noise(form, np.random.default_rng(seed), RATE, 10_000)
    shaped = drawn.shaped(NORMAL, NOISE, TIME)
    assert shaped.std() == pytest.approx(1.0, rel=0.05)
    assert not np.array_equal(shaped, NORMAL)
    part = drawn.shaped(NORMAL[2000:2500], NOISE, TIME[2000:2500])
    np.testing.assert_array_equal(part, shaped[2000:2500])
    if isinstance(drawn, Hum):
        assert 1.5 <= drawn.amplitude * np.sqrt(10_000 / 2) <= 4.0  # standard deviations in the whole recording


@pytest.mark.parametrize("form", FORMS)
def test_a_stage_has_the_noise_in_all_its_sensors_and_nowhere_else(form: str) -> None:
    case, usual = (make_stage_case(6, "null", duration=10.0, noise=name) for name in (form, ""))
    for stream in case.blocks:
        rows, others = (np.concatenate([b.rows for b in c.blocks[stream]]) for c in (case, usual))
        assert np.array_equal(rows, others) == (stream in ("command", "force", "temperature"))
    assert set(case.plant.noise_forms) == set(case.blocks) - {"command", "force", "temperature"}
    assert replace(case.plant, noise_forms={}).signal("lvdt", TIME[:50]).tolist() == (
        usual.plant.signal("lvdt", TIME[:50]).tolist()
    )


@pytest.mark.parametrize("form", ["tails", "flicker"])
def test_a_machine_has_the_noise_in_its_tracker(form: str) -> None:
    machine = load_machine("pan2013")
    case, usual = (make_machine_case(machine, 6, "null", noise=name) for name in (form, ""))
    difference = case.probe - usual.probe
    assert 0.02 < difference.std() / 1.5e-6 < 1.0


def test_another_noise_is_refused() -> None:
    with pytest.raises(InputError, match="no noise of form 'pink'; there are tails, flicker, wander, hum"):
        draw_noise("pink", np.random.default_rng(1), RATE, 100)
