"""How far the ring's centre scatters, against what it was drawn with."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.pipeline.ring_scatter import KEPT, RingScatter

NOISE, TIMING = 4e-8, 2e-6
FASTEST = 4e6
"""Rate of a head's reading over the noise of it, 1/s: as of 1.2 rad/s and 0.3 µrad."""


def drawn(generator: np.random.Generator, rate: np.ndarray, excess: float, jitter: float) -> np.ndarray:
    """Places whose standard deviation is `excess` times the noise at rest, and goes with stamps off by `jitter` (s)."""
    deviation = NOISE * np.sqrt(excess**2 + (jitter * rate) ** 2)
    return np.asarray(deviation[:, None] * generator.normal(size=(len(rate), 2)))


def followed(scatter: RingScatter, places: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """The scale at each window, as it is before the window is taken in."""
    scales = np.empty(len(rate))
    for number, (place, each) in enumerate(zip(places.tolist(), rate.tolist(), strict=True)):
        scales[number] = scatter.scale(each)
        scatter.add(number, (place[0], place[1]), NOISE**2, each)
    return scales


def rates(count: int) -> np.ndarray:
    """Rests and moves of a second each, with ramps of 0.2 s between them."""
    return np.interp(np.arange(count) % 200, [0, 80, 100, 180, 200], [0.0, 0.0, FASTEST, FASTEST, 0.0])


@pytest.mark.parametrize(("excess", "jitter"), [(1.0, 0.0), (1.0, 1e-6), (1.3, 4e-6), (2.0, 0.0)])
def test_no_noise_is_a_step(excess: float, jitter: float):
    """Of 20,000 steps not one, whether stamps scatter as stated or twice as far, from the first turn on."""
    generator = np.random.default_rng(3)
    for _ in range(10):
        rate = rates(1000)
        places = drawn(generator, rate, excess, jitter)
        scales = followed(RingScatter(TIMING), places, rate)
        steps = np.abs(np.diff(places, axis=0)).max(axis=1)
        sure = rate > 0.5 * FASTEST if jitter > TIMING else np.ones(len(rate), bool)
        sure[: KEPT // 2] = False  # noise beyond the stated is seen first
        assert not (steps > 6.0 * np.sqrt(2.0) * NOISE * scales[1:])[sure[1:]].any()


@pytest.mark.parametrize(("excess", "jitter"), [(1.0, 0.0), (1.0, 1e-6), (2.0, 4e-6), (1.0, 1e-5)])
def test_the_scatter_is_found_at_any_speed(excess: float, jitter: float):
    generator = np.random.default_rng(4)
    rate = rates(4000)
    found = []
    for _ in range(20):
        scatter = RingScatter(TIMING)
        followed(scatter, drawn(generator, rate, excess, jitter), rate)
        found.append([scatter.scale(each) for each in (0.0, 0.5 * FASTEST, FASTEST)])
    true = np.hypot(excess, jitter * FASTEST * np.array([0.0, 0.5, 1.0]))
    stated = np.hypot(1.0, TIMING * FASTEST * np.array([0.0, 0.5, 1.0]))
    assert (np.mean(found, axis=0) > 0.9 * true).all()
    assert (np.mean(found, axis=0) < 1.2 * true + 0.4 * stated).all(), "what is stated counts a tenth at last"


def test_a_fault_is_a_step_still():
    """One beyond twelve standard deviations of what scatters, after a second of turning."""
    generator = np.random.default_rng(5)
    rate = np.full(300, FASTEST)
    for jitter in (0.0, 1e-6, 4e-6):
        scatter = RingScatter(TIMING)
        followed(scatter, drawn(generator, rate, 1.0, jitter), rate)
        deviation = NOISE * np.hypot(1.0, max(jitter, 0.5 * TIMING) * FASTEST)
        assert 12.0 * np.sqrt(2.0) * deviation > 6.0 * np.sqrt(2.0) * NOISE * scatter.scale(FASTEST)


def test_beside_no_stated_noise_no_scatter_is_told():
    scatter = RingScatter(TIMING)
    for number, place in enumerate((0.0, 1e-7, -1e-7, 2e-7)):
        scatter.add(number, (place, 0.0), 0.0, 0.0)
    assert scatter.scale(0.0) == 1.0
