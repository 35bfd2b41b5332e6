"""What the heads of a ring are believed to show where the set of them changes."""

from __future__ import annotations

import numpy as np
import pytest
from pipeline.test_estimation import AZIMUTHS, STAGE

from rotary_error_monitor.metrology.agreement import chi_square_bound
from rotary_error_monitor.metrology.encoder_heads import HeadLayout
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


TICKS = 10


def told_by(readings: np.ndarray, belief: HeadBelief, number: int, ecc: float) -> EvidenceWindow:
    """Window of heads whose readings beside the rotation these are (TICKS, h), of those that are believed."""
    names = [name for name in AZIMUTHS if name not in belief.doubted]
    own = readings[:, [list(AZIMUTHS).index(name) for name in names]]
    layout, noise = HeadLayout(tuple(AZIMUTHS[name] for name in names)), STAGE.encoder.noise
    rotation, x, y = layout.weights @ own.mean(axis=0)
    whole = HeadLayout(tuple(AZIMUTHS.values()))
    radius = STAGE.encoder.disc_radius
    shown = {"heads": 1.0, "radial": 1.0, "command": 1.0, "head_samples": 1.0, "theta": 0.05 * number}
    shown |= {"ecc": ecc + rotation, "surplus_x": radius * x, "surplus_y": radius * y}
    shown["radial_variance"] = (STAGE.encoder.noise * radius) ** 2 / 2
    shown["agreement"] = float(np.mean(np.square(readings @ whole.parity.T / noise)))
    if layout.redundancy:
        shown["believed_agreement"] = float(np.mean(np.square(own @ layout.parity.T / noise)))
    mean = Means._make(float(shown.get(name, 0.0)) for name in COLUMNS)
    parity = layout.parity @ own.mean(axis=0) if layout.redundancy else np.zeros(1)
    return EvidenceWindow(number, 0.01, TICKS, mean, Scatter(0.0, 0.0, 0.0), parity, 0, True)


@pytest.mark.parametrize("timing", [0.0, 1e-5], ids=["stamps known", "stamps that may be late"])
@pytest.mark.parametrize("seed", range(5))
def test_heads_that_lose_as_much_one_by_one_agree_again_on_a_rotation_that_is_uncertain(seed, timing):
    """The radial motion is as before and no head contradicts another: nothing was told of 10 to 40 µrad.

    Meanwhile stamps may make as much, at 5 rad/s, but did not before.
    """
    draw = np.random.default_rng(seed)
    fault, order = draw.choice([-1, 1]) * draw.uniform(1e-5, 4e-5), draw.permutation(len(AZIMUTHS))
    lost = {int(head): 400 + 60 * place for place, head in enumerate(order)}
    belief = HeadBelief(AZIMUTHS, STAGE.encoder, STAGE.limits, 6.0, timing)
    for number in range(900):
        readings = STAGE.encoder.noise * draw.normal(size=(TICKS, len(AZIMUTHS)))
        readings += [fault * (number >= lost[head]) for head in range(len(AZIMUTHS))]
        belief.judge(told_by(readings, belief, number, 1e-6 * draw.normal()), tuple(AZIMUTHS))
        if number < 400:
            assert belief.rotation == 0.0
    assert not belief.contradiction and not belief.doubted
    assert abs(fault) < 6.0 * belief.rotation < 3.0 * abs(fault)
    if timing == 0.0:
        assert belief.scale < 2.0 * chi_square_bound(TICKS), "the radial motion is as it was"
