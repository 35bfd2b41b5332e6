"""What goes with the speed, against closed forms and against chance."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.pipeline.speed_slope import SpeedSlope

PERIOD = 0.01


def filled(slope: SpeedSlope, theta: np.ndarray, *values: np.ndarray) -> SpeedSlope:
    for number, row in enumerate(zip(theta, *values, strict=True)):
        slope.add(number, *map(float, row))
    slope.measure(PERIOD)
    return slope


def swing(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Angle and speed of a rotor that swings through a radian, 1 rad/s at most."""
    time = PERIOD * np.arange(count)
    return np.sin(time), np.cos(time)


def slow(generator: np.random.Generator, count: int, windows: int) -> np.ndarray:
    """Noise of standard deviation 1 that is alike over so many windows."""
    noise = generator.normal(size=count + windows - 1)
    return np.convolve(noise, np.ones(windows) / np.sqrt(windows), "valid")


def test_a_delay_is_found_beside_orders_of_the_rotation():
    theta, speed = swing(1000)
    for delay in (-3e-4, 2e-5):
        value = 1e-6 + 5e-6 * np.cos(theta) - 2e-6 * np.sin(2 * theta) + delay * speed
        slope = filled(SpeedSlope(1000, 2, orders=3), theta, value, np.zeros(1000))
        np.testing.assert_allclose(slope.value, [delay, 0.0], rtol=1e-3)
        np.testing.assert_allclose(slope.length, abs(delay), rtol=1e-3)


def test_noise_shows_none():
    """White or of the jitter's kind, slow over ten windows: of a thousand series none."""
    generator = np.random.default_rng(5)
    theta, _ = swing(600)
    found = [filled(SpeedSlope(1000), theta, slow(generator, 600, (1, 10)[n % 2])).length for n in range(1000)]
    assert not any(found)


def test_the_rotors_own_jitter_shows_none():
    """It is in the angle and in what is seen alike, at a constant speed and at rest."""
    generator = np.random.default_rng(6)
    time = PERIOD * np.arange(600)
    for number in range(300):
        jitter = 1e-6 * slow(generator, 600, (1, 3, 10)[number % 3])
        assert filled(SpeedSlope(1000), (0.0, 2.0)[number % 2] * time + jitter, jitter).length == 0.0, number


def test_drift_beside_one_start_shows_none():
    generator = np.random.default_rng(8)
    time = PERIOD * np.arange(400)
    theta = np.where(time > 1.0, 1.5 * (time - 1.0), 0.0)
    drift = 3e-7 * (1 - np.exp(-time / 8.0))
    for _ in range(100):
        assert filled(SpeedSlope(1000), theta, drift + 3e-8 * generator.normal(size=400)).length == 0.0


def test_what_interpolation_misses_as_a_ramp_ends_shows_none():
    """All but the last windows tell no speed beside drift; a delay that is real shows once the speed has changed."""
    generator = np.random.default_rng(9)
    time = PERIOD * np.arange(200)
    for ends in range(22, 60):
        theta = np.where(time < PERIOD * ends, 6.0 * time**2, PERIOD * ends * (12.0 * time - 6.0 * PERIOD * ends))
        size = generator.uniform(5e-6, 5e-5)
        missed = np.where(np.arange(200) == ends, size, 0.0)
        found = []
        for count, delay, told in ((ends + 2, 0.0, missed), (ends + 2, 0.0, 0.0 * missed), (200, 2e-4, missed)):
            slope = SpeedSlope(1000)
            value = missed + delay * np.gradient(theta, PERIOD) + 1e-9 * generator.normal(size=200)
            for number in range(count):
                slope.add(number, float(theta[number]), float(value[number]), missed=float(told[number]))
            slope.measure(PERIOD)
            found.append(slope.length)
        assert found[0] == 0.0 < found[1], "without it there is one"
        np.testing.assert_allclose(found[2], 2e-4, rtol=0.3)


def test_what_was_seen_holds_at_constant_speed_and_goes_when_it_is_contradicted():
    generator = np.random.default_rng(7)
    (theta, speed), time = swing(600), PERIOD * np.arange(600)
    noise = 1e-6 * generator.normal(size=600)
    slope = filled(SpeedSlope(600), theta, 1e-4 * speed + noise)
    np.testing.assert_allclose(slope.value, [1e-4], rtol=0.02)
    seen = slope.value.copy()
    slope.forget()
    np.testing.assert_array_equal(filled(slope, time, 1e-4 + noise).value, seen)
    slope.forget()
    np.testing.assert_array_equal(filled(slope, theta, noise).value, [0.0])


def test_drift_shows_none_where_windows_are_missing():
    """A slowly quickening rotor that is in what is seen as well, with a second or so without samples in between."""
    time = PERIOD * np.arange(400)
    drift = 3e-6 * time**2 - 1e-6 * time
    for seed in range(200):
        generator, slope = np.random.default_rng(seed), SpeedSlope(1000)
        begin = generator.integers(20, 200)
        end = begin + generator.integers(50, 150)
        seen = drift + 3e-9 * generator.normal(size=400)
        for number in (*range(begin), *range(end, 400)):
            slope.add(number, float(3 * time[number] + drift[number]), float(seen[number]))
        slope.measure(PERIOD)
        assert slope.length == 0.0, seed


def test_what_changed_while_nothing_was_seen_shows_none():
    """Another speed and another place after a second or so without samples: nothing tells that they belong together."""
    for seed in range(200):
        generator, slope = np.random.default_rng(seed), SpeedSlope(1000, 2, orders=3)
        numbers = np.concatenate([np.arange(300), np.arange(300 + generator.integers(2, 400), 1000)])
        late = numbers >= 300
        pace, place = generator.uniform(0.5, 6.0, 2), 2e-6 * generator.normal(size=(2, 2))
        theta = np.where(late, pace[1], pace[0]) * PERIOD * numbers
        seen = np.where(late, place[:, :1], place[:, 1:]) + 2e-8 * generator.normal(size=(2, len(numbers)))
        for row in zip(numbers.tolist(), theta.tolist(), *seen.tolist(), strict=True):
            slope.add(*row)
        slope.measure(PERIOD)
        assert slope.length == 0.0, seed


def test_a_delay_is_found_on_both_sides_of_what_is_missing():
    """What a change of speed shows before a gap and behind it, whatever changed in it."""
    (theta, speed), numbers = swing(1000), np.delete(np.arange(1000), range(350, 500))
    generator = np.random.default_rng(3)
    value = 1e-4 * speed + np.where(np.arange(1000) < 400, 3e-5, -4e-5) + 1e-7 * generator.normal(size=1000)
    slope = SpeedSlope(1000)
    for number in numbers.tolist():
        slope.add(number, float(theta[number]), float(value[number]))
    slope.measure(PERIOD)
    np.testing.assert_allclose(slope.value, [1e-4], rtol=0.02)


@pytest.mark.parametrize("seed", range(3))
def test_only_the_latest_windows_count_however_many_came(seed):
    """To the last bit what a slope shows that was given no others, over windows with gaps."""
    generator, kept = np.random.default_rng(seed), 200
    for count in (150, 200, 399, 400, 401, 1700):
        numbers = np.cumsum(generator.choice([1, 1, 1, 1, 3], count))
        theta = np.cumsum(generator.uniform(0.0, 0.1, count))
        value = 1e-3 * np.gradient(theta) + 1e-6 * generator.normal(size=count)
        slopes = SpeedSlope(kept, orders=2), SpeedSlope(kept, orders=2)
        for slope, first in zip(slopes, (0, max(0, count - kept)), strict=True):
            for row in zip(numbers[first:].tolist(), theta[first:].tolist(), value[first:].tolist(), strict=True):
                slope.add(*row)
            slope.measure(0.01)
        assert len(slopes[0]) == len(slopes[1]) == min(count, kept)
        assert slopes[0].value[0] == slopes[1].value[0] != 0.0


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("motion", ["steady", "swinging", "slow", "standing", "with gaps"])
def test_what_normal_equations_spare_is_what_the_fit_gives(motion, seed, monkeypatch):
    """To the last bit, for slopes from none to clear ones, also where waves and trend are hardly told apart."""
    generator, count = np.random.default_rng(seed), 900
    numbers = np.cumsum(generator.choice([1, 1, 1, 2], count)) if motion == "with gaps" else np.arange(count)
    pace = {"steady": 2.0, "swinging": 0.0, "slow": 1e-3, "standing": 0.0, "with gaps": 2.0}[motion]
    theta = PERIOD * pace * numbers + (np.sin(PERIOD * numbers) if motion == "swinging" else 0.0)
    theta = theta + 1e-6 * slow(generator, count, 3)
    size = 10.0 ** generator.uniform(-9, -5)
    values = size * np.stack([slow(generator, count, 10), generator.normal(size=count)])
    values += 1e-6 + np.outer(size * 10.0 ** generator.uniform(-3, 2, 2), np.gradient(theta) / PERIOD)

    def course(foreseen: int = 0) -> list[list[float]]:
        slope, found, numbered = SpeedSlope(300, 2, orders=3), [], numbers.tolist()
        for place, (number, row) in enumerate(zip(numbered, np.stack([theta, *values], axis=1).tolist(), strict=True)):
            if foreseen and place % foreseen == 0:
                come = slice(place, place + foreseen)
                slope.foresee(number, 10, theta[come].tolist(), *values[:, come].tolist())
            slope.add(number, *row)
            if number % 10 == 0:
                slope.measure(PERIOD)
                found.append([*slope.value.tolist(), slope.length])
        return found

    spared = [course(), course(30), course(137)]
    monkeypatch.setattr(SpeedSlope, "_show_none", lambda _, *given: np.zeros(len(given[-1]), np.bool_))
    assert spared == [course()] * 3


@pytest.mark.parametrize("seed", range(4))
def test_windows_that_were_foreseen_and_do_not_come_are_not_reckoned_with(seed, monkeypatch):
    """Nothing was foreseen of a jump in what is seen, or of windows that are missing."""
    generator, count, kept = np.random.default_rng(seed), 600, 300
    theta, _ = swing(count)
    value = 1e-6 * generator.normal(size=count)
    instead = value + np.where(np.arange(count) > 400, 1e-4, 0.0) * np.cos(PERIOD * np.arange(count))
    missing = set(generator.integers(350, 500, 3).tolist())

    def course(foreseen: bool) -> list[float]:
        slope, found = SpeedSlope(kept), []
        for number in range(count):
            if foreseen and number in (100, 350, 401):
                shown = value if number < 401 else instead
                slope.foresee(number, 10, theta[number:].tolist(), shown[number:].tolist())
            if number == 401:
                slope.forget()
            if number not in missing:
                slope.add(number, float(theta[number]), float((instead if number > 400 else value)[number]))
            if number % 10 == 0:
                slope.measure(PERIOD)
                found.append(slope.length)
        return found

    assert course(True) == course(False)
    assert course(True)[-1] > 0.0
