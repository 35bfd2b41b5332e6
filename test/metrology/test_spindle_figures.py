"""Error motion values against closed forms: waves of whole orders, tones between orders, eccentricity, noise."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from draws import seeds

from rotary_error_monitor.metrology import spindle_figures
from rotary_error_monitor.metrology.order_spectrum import estimate_orders
from rotary_error_monitor.metrology.spindle_figures import SignalNoise, estimate_values, sensitive_direction
from rotary_error_monitor.metrology.turns import MOST_WAVES, SAMPLES_A_WAVE, cut_turns

NAMES = ("total", "synchronous", "asynchronous")
SEEDS = 40
FEWEST_INSIDE = 0.93
"""Part of the recordings whose truth lies within an expanded uncertainty that is stated for 95 %."""


@dataclass(frozen=True)
class Drawn:
    """A recording: rotation, error motion as measured and without noise, and the values that it truly has."""

    theta: np.ndarray
    measured: np.ndarray
    clean: np.ndarray
    synchronous: float
    once: float


def drawn(seed, *, turns, tone=0.0, noise=0.0, once=0.0, samples=1000.3, order=5.37):
    """Orders 2 and 3 with random phases, `once` a turn, and a tone between the orders."""
    rng = np.random.default_rng(seed)
    theta = rng.choice((-1.0, 1.0)) * (rng.uniform(0, 6) + np.arange(int(turns * samples)) * (2 * np.pi / samples))
    phase = rng.uniform(0, 2 * np.pi, 4)

    def waves(angle):
        return 1e-6 * np.cos(2 * angle + phase[0]) + 4e-7 * np.cos(3 * angle + phase[1])

    clean = waves(theta) + tone * np.cos(order * theta + phase[2]) + once * np.cos(theta + phase[3])
    ring = np.linspace(0, 2 * np.pi, 20_001)
    return Drawn(theta, clean + noise * rng.normal(size=len(theta)), clean, np.ptp(waves(ring)), once)


def by_definition(found, keeps):
    """Total and asynchronous values of the turns without noise, each point by its definition, without a filter."""
    # The grid of angles that a reader would choose: each sample's neighbours one turn on lie beside it.
    angle = np.abs(found.theta) - np.abs(found.theta[0])
    count = int(angle[-1] // (2 * np.pi))
    begin = np.ceil(np.abs(found.theta[0]) / (2 * np.pi) * 720) * (2 * np.pi / 720)
    grid = begin + np.arange(count * 720) * (2 * np.pi / 720)
    values = found.clean if keeps else found.clean - found.once * fitted_once(found)
    at = np.interp(grid, np.abs(found.theta), values).reshape(count, 720)
    return np.ptp(at), np.ptp(at, axis=0).max()


def fitted_once(found):
    """The once-per-turn wave of amplitude one in it, which is known from how it was drawn."""
    if found.once == 0.0:
        return np.zeros(len(found.theta))
    waves = np.stack([np.cos(found.theta), np.sin(found.theta)], 1)
    fit = np.linalg.lstsq(
        np.column_stack([waves, *(f(k * found.theta) for k in (2, 3) for f in (np.cos, np.sin))]),
        found.clean,
        rcond=None,
    )[0][:2]
    return waves @ fit / found.once


def values_of(found, noise, keeps=False, measured=None, most_waves=MOST_WAVES):
    signal = found.measured if measured is None else measured
    turns = cut_turns(found.theta, signal[:, None], [(0, len(found.theta))], most_waves)
    return estimate_values(turns, 0, SignalNoise(noise), keeps_fundamental=keeps)


@pytest.mark.parametrize("seed", seeds(6))
def test_without_noise_the_values_are_those_of_the_closed_form(seed):
    found = drawn(seed, turns=12.4, tone=2e-7, once=5e-6)
    values = values_of(found, 0.0)
    total, asynchronous = by_definition(found, keeps=False)
    assert values["total"].value == pytest.approx(total, rel=0.01)
    assert values["asynchronous"].value == pytest.approx(asynchronous, rel=0.01)
    quiet = values_of(drawn(seed, turns=12.4, once=5e-6), 0.0)
    assert quiet["synchronous"].value == pytest.approx(found.synchronous, rel=0.01)
    assert quiet["asynchronous"].value < 0.01 * found.synchronous
    assert set(values) == set(NAMES)


@pytest.mark.parametrize("keeps", [False, True])
def test_values_are_the_same_whether_random_numbers_are_kept_or_drawn_anew(keeps, monkeypatch):
    """To the last bit: what is simulated is the same for each signal, however much of it memory holds."""
    found, noise = drawn(1, turns=5.4, tone=3e-7, noise=2e-7), 2e-7
    kept = values_of(found, noise, keeps)
    monkeypatch.setattr(spindle_figures, "_MOST_VALUES", 20_000)
    assert values_of(found, noise, keeps) == kept


@pytest.mark.parametrize("seed", seeds(6))
def test_fundamental_and_residual_of_axial_motion(seed):
    values = values_of(drawn(seed, turns=5.2, once=7e-7), 0.0, keeps=True)
    assert values["fundamental"].value == pytest.approx(1.4e-6, rel=0.01)
    assert values["residual_synchronous"].value == pytest.approx(drawn(seed, turns=1).synchronous, rel=0.01)


CONDITIONS = {
    "quiet": {"turns": 7.4, "noise": 3e-8},
    "a tone": {"turns": 7.4, "noise": 3e-8, "tone": 2e-7},
    "a loud tone": {"turns": 7.4, "noise": 3e-8, "tone": 1e-6, "order": 7.63},
    "few turns, loud": {"turns": 3.3, "noise": 2e-7},
    "two turns": {"turns": 2.3, "noise": 3e-8, "tone": 2e-7},
    "many turns": {"turns": 20.5, "noise": 1e-7, "tone": 2e-7},
    "few samples a turn": {"turns": 9.5, "noise": 5e-8, "samples": 211.7, "tone": 1e-7},
}


@pytest.mark.parametrize("stated", [0.3, 3.0], ids=["noise stated too small", "too large"])
@pytest.mark.parametrize("condition", CONDITIONS)
def test_the_expanded_uncertainty_holds_the_truth(condition, stated):
    """Against the stage's own harmonics, and the tone's spread over these turns."""
    drawing = CONDITIONS[condition]
    inside = dict.fromkeys(NAMES, 0)
    off = {name: [] for name in NAMES}
    for seed in range(SEEDS):
        found = drawn(1000 + seed, **drawing, once=5e-6)
        values = values_of(found, stated * drawing["noise"])
        total, asynchronous = by_definition(found, keeps=False)
        for name, truth in zip(NAMES, (total, found.synchronous, asynchronous), strict=True):
            inside[name] += abs(values[name].value - truth) <= values[name].expanded
            off[name].append(values[name].value - truth)
            assert values[name].value <= values[name].measured
    assert min(inside.values()) >= FEWEST_INSIDE * SEEDS, inside
    if "tone" in drawing or drawing["noise"] > 1e-7:
        return
    for name, rows in off.items():  # the mean is off by little beside the measured values' own bias
        assert abs(np.mean(rows)) < drawing["noise"], (name, np.mean(rows))


def test_the_correction_makes_the_values_better_not_only_smaller():
    """Squared distance from the truth, over many recordings: less than that of the values by definition."""
    better = worse = 0.0
    for seed in range(SEEDS):
        found = drawn(seed, turns=5.4, noise=1e-7, tone=2e-7)
        values = values_of(found, 1e-7)
        total, asynchronous = by_definition(found, keeps=False)
        for name, truth in (("total", total), ("asynchronous", asynchronous)):
            better += (values[name].value - truth) ** 2
            worse += (values[name].measured - truth) ** 2
    assert better < 0.5 * worse


def test_readings_slower_than_the_estimates_count_with_their_own_noise():
    """Noise of every fourth sample, joined by straight lines: the same variance, but of fewer independent readings."""
    inside, found_rows = [], []
    for seed in range(SEEDS):
        found = drawn(seed, turns=8.4)
        readings = 2e-7 * np.random.default_rng(50 + seed).normal(size=len(found.theta) // 4 + 2)
        slow = np.interp(np.arange(len(found.theta)), 4 * np.arange(len(readings)), readings)
        most_waves = 1000 // 4 // SAMPLES_A_WAVE
        values = values_of(found, slow.std(), measured=found.clean + slow, most_waves=most_waves)
        asynchronous, synchronous = values["asynchronous"], values["synchronous"]  # the stage has none of the former
        inside.append(asynchronous.value <= asynchronous.expanded)
        inside.append(abs(synchronous.value - found.synchronous) <= synchronous.expanded)
        found_rows.append((asynchronous.value, asynchronous.measured))
    assert np.mean(inside) >= FEWEST_INSIDE
    value, measured = np.mean(found_rows, axis=0)
    assert value < 0.4 * measured


def test_uncertainty_is_no_less_than_covariance_and_spread_say():
    found = drawn(1, turns=6.3, noise=3e-8)
    plain = values_of(found, 3e-8)
    stated = values_of(found, 3e-7)
    assert all(stated[name].uncertainty > 2 * plain[name].uncertainty for name in ("total", "synchronous"))
    louder = drawn(1, turns=6.3, noise=3e-7)
    assert all(values_of(louder, 3e-8)[name].uncertainty > 2 * plain[name].uncertainty for name in NAMES[:2])
    turns = cut_turns(found.theta, found.measured[:, None], [(0, len(found.theta))])
    shaped = estimate_values(turns, 0, SignalNoise(3e-8, shape=1e-7, turning=4e-7), keeps_fundamental=True)
    assert shaped["synchronous"].uncertainty >= np.sqrt(2) * np.hypot(1e-7, 4e-7)
    assert shaped["fundamental"].uncertainty >= 8e-7
    assert shaped["residual_synchronous"].uncertainty >= np.sqrt(2) * 1e-7


def test_one_turn_has_no_asynchronous_value_and_less_than_one_has_none():
    assert set(values_of(drawn(3, turns=1.6, noise=3e-8), 3e-8)) == {"total", "synchronous"}
    part = drawn(3, turns=0.9)
    turns = cut_turns(part.theta, part.measured[:, None], [(0, len(part.theta))])
    assert len(turns.profiles) == 0 and turns.whole == pytest.approx(0.9, abs=0.01)
    assert estimate_values(turns, 0, SignalNoise(0.0), keeps_fundamental=False) == {}
    assert estimate_orders(turns, 0, SignalNoise(0.0)) is None


@pytest.mark.parametrize("seed", seeds(8))
def test_a_rotating_direction_sees_no_eccentricity_and_half_of_what_goes_round(seed):
    """A circle of order k about the axis is a wave of order k - 1 or k + 1 along a direction that turns along."""
    rng = np.random.default_rng(seed)
    theta = np.arange(8000) * (2 * np.pi / 1000.7)
    order, sense, phase = int(rng.integers(3, 9)), rng.choice((-1, 1)), rng.uniform(0, 6.3)
    circle = 1e-6 * np.exp(1j * (sense * order * theta + phase)) + 8e-6 * np.exp(1j * (theta + 2.0)) + 3e-6
    along = sensitive_direction(np.stack([circle.real, circle.imag], 1), theta)
    turns = cut_turns(theta, along[:, None], [(0, len(theta))])
    values = estimate_values(turns, 0, SignalNoise(0.0), keeps_fundamental=False)
    assert values["synchronous"].value == pytest.approx(2e-6, rel=0.01)
    spectrum = estimate_orders(turns, 0, SignalNoise(0.0))
    assert spectrum.orders[np.argmax(np.where(spectrum.orders > 1, spectrum.amplitude, 0))] == order - sense


@pytest.mark.parametrize("noise", [3e-8, 2e-7])
def test_order_amplitudes_are_inside_their_uncertainty(noise):
    """Orders 2 and 3 of each recording against what was drawn, and of all others that they are noise."""
    inside, quiet, count = 0, [], 0
    for seed in range(SEEDS):
        found = drawn(seed, turns=5.3, noise=noise)
        turns = cut_turns(found.theta, found.measured[:, None], [(0, len(found.theta))])
        spectrum = estimate_orders(turns, 0, SignalNoise(noise))
        for order, truth in ((2, 1e-6), (3, 4e-7)):
            off = abs(spectrum.amplitude[order - 1] - truth)
            inside += off <= 2 * spectrum.uncertainty[order - 1]
            count += 1
        quiet.append(np.mean(spectrum.amplitude[3:] < 2.5 * spectrum.uncertainty[3:]))
        assert off < 0.01 * 4e-7 + 5 * noise / np.sqrt(5000 / 2)
    assert inside >= 0.93 * count
    assert np.mean(quiet) > 0.95


def test_what_heads_cannot_tell_from_a_graduation_is_named():
    four = (1, 3, 5, 7, 9, 11)  # odd orders pass for radial motion of four heads
    found = drawn(0, turns=4.2, noise=3e-8)
    turns = cut_turns(found.theta, found.measured[:, None], [(0, len(found.theta))])
    plain, hidden = (estimate_orders(turns, 0, SignalNoise(3e-8, shape), four) for shape in (0.0, 2e-7))
    assert hidden.hidden == four
    raised = hidden.uncertainty > plain.uncertainty + 1e-12
    assert tuple(hidden.orders[raised]) == four


def test_turns_with_gaps_stops_and_both_ways_are_told_apart():
    """Only whole turns without a gap count; where they begin does not matter."""
    theta = np.arange(9500) * (2 * np.pi / 1000.0)
    signal = 1e-6 * np.cos(3 * theta) + 5e-7 * np.sin(2 * theta)
    signal[4200:4230] = np.nan
    turns = cut_turns(theta, signal[:, None], [(0, 9500)])
    assert (len(turns.profiles), turns.incomplete) == (8, 1)
    assert turns.whole == pytest.approx(9.5, abs=0.01)
    assert turns.cut_off == 142 < MOST_WAVES
    assert np.diff(turns.labels, axis=1).sum() == pytest.approx(8000, abs=16)
    there_and_back = np.concatenate([theta[:4200], theta[4200] - np.arange(4200) * (2 * np.pi / 1000.0)])
    both = 1e-6 * np.cos(3 * there_and_back)
    forth, back = (cut_turns(there_and_back, both[:, None], [run]) for run in ((0, 4200), (4200, 8400)))
    shape = 1e-6 * np.cos(3 * forth.angles)
    for one in (forth, back):
        assert len(one.profiles) == 4
        assert (
            np.abs(one.profiles[:, :, 0] - shape).max() < 2e-3 * 1e-6
        )  # at the ends of a run the filter has one side alone
    assert cut_turns(theta[:1], signal[:1, None], [(0, 1)]) is None
    assert cut_turns(theta[::100], signal[::100, None], [(0, 95)]) is None
