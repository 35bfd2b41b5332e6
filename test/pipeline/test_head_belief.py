"""What the heads of a ring are believed to show where the set of them changes."""

from __future__ import annotations

import numpy as np
import pytest
from pipeline.test_estimation import AZIMUTHS, STAGE

from rotary_error_monitor.pipeline.evidence import COLUMNS, EvidenceWindow, Means, Scatter
from rotary_error_monitor.pipeline.head_belief import HeadBelief

HEADS = {name: AZIMUTHS[name] for name in "abc"}
ECCENTRICITY = 3e-6
"""Along the direction that a third head shows, m; two opposed heads do not see it."""


def judged(sets: list[str], seed: int) -> HeadBelief:
    """Belief after 60 windows of each set of heads, none of which has redundancy, with noise as it is stated."""
    belief = HeadBelief(HEADS, STAGE.encoder, STAGE.limits, 6.0, STAGE.timing("encoder"))
    generator, variance = np.random.default_rng(seed), (STAGE.encoder.noise * STAGE.encoder.disc_radius) ** 2
    for number in range(60 * len(sets)):
        heads = sets[number // 60]
        shown = {"heads": 1.0, "head_samples": 1.0, "radial_variance": variance, "theta": 1e-3 * number}
        shown["radial"] = float(len(heads) > 2)
        shown["surplus_x"], shown["surplus_y"] = np.sqrt(variance / 10) * generator.normal(size=2)
        shown["surplus_x"] += ECCENTRICITY * shown["radial"]
        mean = Means._make(float(shown.get(name, 0.0)) for name in COLUMNS)
        belief.judge(EvidenceWindow(number, 0.01, 10, mean, Scatter(0.0, 0.0, 0.0), np.zeros(1), 0, True), tuple(heads))
    return belief


@pytest.mark.parametrize("seed", range(5))
def test_another_set_of_heads_shows_no_scatter_of_the_ring(seed):
    """Where a third head falls silent, the component that it alone shows is gone: a change of view, no noise."""
    changed, same = judged(["abc", "ab", "abc", "ab"], seed), judged(["ab"] * 4, seed)
    assert not changed.contradiction and not same.contradiction
    assert changed.reach.reach == pytest.approx(same.reach.reach, rel=0.1)


@pytest.mark.parametrize("lasts", [1, 2, 5])
def test_a_step_that_is_interpolated_over_windows_which_tell_little_is_told_behind_them(lasts):
    """As of a slow head without redundancy: what its samples do not follow is uncertain, the places beside are not."""
    generator, noise = np.random.default_rng(lasts), STAGE.encoder.noise * STAGE.encoder.disc_radius
    for _ in range(5):
        way, begin = STAGE.limits.radial_rate * 0.01 * (lasts + 1), int(generator.integers(30, 60))
        for size, told in ((1.2 * way + 12.0 * noise, True), (0.8 * way, False)):
            belief = HeadBelief({name: HEADS[name] for name in "ab"}, STAGE.encoder, STAGE.limits, 6.0, 0.0)
            for number in range(100):
                bent = begin <= number < begin + lasts
                shown = {"heads": 1.0, "head_samples": 1.0, "radial_variance": (size if bent else noise) ** 2}
                shown["surplus_x"] = size * float(np.clip((number - begin + 1) / lasts, 0.0, 1.0))
                shown["surplus_x"] += noise / np.sqrt(10.0) * generator.normal()
                mean = Means._make(float(shown.get(name, 0.0)) for name in COLUMNS)
                belief.judge(
                    EvidenceWindow(number, 0.01, 10, mean, Scatter(0.0, 0.0, 0.0), np.zeros(1), 0, True), ("a", "b")
                )
                assert number >= begin or not belief.contradiction
            assert bool(belief.contradiction) is told, (size, begin)
