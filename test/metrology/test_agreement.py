"""Which head is wrong, told by the course of the contradiction alone, over layouts, faults and many seeds."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import chi2

from rotary_error_monitor.metrology.agreement import (
    FAR,
    chi_square_bound,
    independent_values,
    isolate_drift,
    isolate_head,
    isolate_implausible,
    isolate_step,
)
from rotary_error_monitor.metrology.encoder_heads import HeadLayout

FOUR = (0.0, np.pi, np.pi / 2, 3 * np.pi / 2)
FIVE = tuple(2 * np.pi * k / 5 for k in range(5))
UNEVEN = (0.1, 1.3, 2.9, 3.6, 5.5)
COUNT = 2e-6
STEPS = 60


def course(kind, generator):
    """A fault over 60 steps of 10 ms, rad; the first third is sound."""
    t = np.arange(STEPS) * 0.01
    begun = t >= 0.2
    return {
        "jump": begun * generator.choice([-1, 1]) * generator.uniform(3, 100) * COUNT,
        "drift": begun * (t - 0.2) * generator.choice([-1, 1]) * generator.uniform(3e-5, 1e-3),
        "noise": begun * generator.normal(0.0, generator.uniform(2e-6, 1e-4), STEPS),
        "late": begun * generator.uniform(1e-3, 0.02) * np.cumsum(generator.normal(0.0, 0.02, STEPS)),
    }[kind]


def observed(layout, head, fault, generator):
    """Motion and parity that a fault of one head makes, with noise and a rotor that moves by itself."""
    h = len(layout.azimuths)
    rotor = np.cumsum(generator.normal(0.0, 1e-7, (STEPS, 3)), axis=0)
    readings = rotor @ layout.sensitivity.T + generator.normal(0.0, 1.5e-7, (STEPS, h))
    readings[:, head] += fault
    return readings @ layout.weights.T, readings @ layout.parity.T


@pytest.mark.parametrize("azimuths", [FOUR, FIVE, UNEVEN], ids=["four", "five", "uneven"])
@pytest.mark.parametrize("kind", ["jump", "drift", "noise", "late"])
def test_the_wrong_head_is_found_and_never_another(azimuths, kind):
    layout = HeadLayout(azimuths)
    found, wrong = 0, 0
    for seed in range(100):
        generator = np.random.default_rng(seed)
        head = int(generator.integers(len(azimuths)))
        fault = course(kind, generator)
        motion, parity = observed(layout, head, fault, generator)
        said = isolate_head(layout, motion, parity, 1)
        found += said is not None and said.head == head
        wrong += said is not None and said.head != head
        if said is not None and said.head == head:
            np.testing.assert_allclose(said.fault, fault, atol=6 * 1.5e-7 * 2.5)
    assert wrong == 0
    assert found >= 85, "small ones of short duration may stay open"


def test_sound_heads_are_never_accused():
    layout = HeadLayout(FOUR)
    for seed in range(500):
        generator = np.random.default_rng(seed)
        motion, parity = observed(layout, 0, np.zeros(STEPS), generator)
        assert isolate_head(layout, motion, parity, 1) is None


TURNING = np.linspace(0.0, 1.0, STEPS)


def jittering(layout, head, fault, generator):
    """A rotor whose drive jitters by counts, and whose radial motion a push changes in between, with such a fault."""
    rotor = np.cumsum(generator.normal(0.0, 1e-7, (STEPS, 3)), axis=0)
    rotor[:, 0] += 1.2e-6 * np.cumsum(generator.normal(0.0, 1.0, STEPS))
    rotor[:, 1:] += generator.uniform(-2e-5, 2e-5, 2) * np.clip((np.arange(STEPS)[:, None] - 40) / 10, 0, 1)
    readings = rotor @ layout.sensitivity.T + generator.normal(0.0, 1.5e-7, (STEPS, len(layout.azimuths)))
    readings[:, head] += fault
    return readings @ layout.weights.T, readings @ layout.parity.T


@pytest.mark.parametrize("azimuths", [FOUR, FIVE, UNEVEN], ids=["four", "five", "uneven"])
def test_a_step_of_a_few_counts_is_told_beside_a_drive_that_jitters_by_as_much(azimuths):
    """Roughness alone told none of 3 to 25 counts: the heads were believed no more for as long as they ran."""
    layout = HeadLayout(azimuths)
    found, rough = 0, 0
    for seed in range(100):
        generator = np.random.default_rng(seed)
        head = int(generator.integers(len(azimuths)))
        fault = (np.arange(STEPS) >= 30) * generator.choice([-1, 1]) * generator.uniform(3, 25) * COUNT
        fault[30] *= generator.uniform()  # it begins within a window
        motion, parity = jittering(layout, head, fault, generator)
        said = [isolate_step(layout, TURNING, motion, parity, lag) for lag in (1, 2)]
        assert all(each is None or each.head == head for each in said)
        found += any(said)
        rough += isolate_head(layout, motion, parity, 1) is not None
    assert found >= 95 and rough < 60


@pytest.mark.parametrize("two", [False, True], ids=["sound", "two wrong ones"])
def test_steps_accuse_nobody_who_did_not_step(two):
    """Neither a push or a knock at sound heads, nor two heads that step at once, each by another size."""
    layout = HeadLayout(FIVE if two else FOUR)
    for seed in range(300):
        generator = np.random.default_rng(seed)
        motion, parity = jittering(layout, 0, np.zeros(STEPS), generator)
        knock = (np.arange(STEPS) >= 30)[:, None] * generator.uniform(-3e-5, 3e-5, 3)
        first, second = generator.choice(len(layout.azimuths), 2, replace=False)
        sizes = generator.choice([-1, 1], 2) * generator.uniform(20, 40, 2) * COUNT * two
        motion = motion + knock
        for head, size in ((first, sizes[0]), (second, sizes[1])):
            motion = motion + np.outer(np.arange(STEPS) >= 30, size * layout.weights[:, head])
            parity = parity + np.outer(np.arange(STEPS) >= 30, size * layout.parity[:, head])
        assert not any(isolate_step(layout, TURNING, motion, parity, lag) for lag in (1, 2))


def test_a_contradiction_that_does_not_change_belongs_to_nobody():
    motion, parity = observed(HeadLayout(FOUR), 1, np.full(STEPS, 1e-4), np.random.default_rng(1))
    assert isolate_head(HeadLayout(FOUR), motion, parity, 1) is None


MOST = np.array([5e-4, 3e-5, 3e-5])
"""What rotation less command and radial motion over the radius can be, rad."""


def standing(layout, faults, seed):
    """Three steps of a rotor somewhere within its limits, and of heads with faults that stand."""
    generator = np.random.default_rng(seed)
    rotor = generator.uniform(-1, 1, 3) * MOST + generator.normal(0.0, 1e-7, (3, 3))
    readings = rotor @ layout.sensitivity.T + generator.normal(0.0, 1.5e-7, (3, len(layout.azimuths)))
    for head, fault in faults.items():
        readings[:, head] += fault
    return readings @ layout.weights.T, readings @ layout.parity.T


@pytest.mark.parametrize("azimuths", [FOUR, FIVE, UNEVEN], ids=["four", "five", "uneven"])
@pytest.mark.parametrize("command", [True, False])
def test_a_head_that_is_off_by_more_than_the_stage_moves_is_found_at_once(azimuths, command):
    layout = HeadLayout(azimuths)
    for seed in range(200):
        generator = np.random.default_rng(seed)
        head = int(generator.integers(len(azimuths)))
        fault = generator.choice([-1, 1]) * np.exp(generator.uniform(np.log(2e-3), np.log(2.0)))
        motion, parity = standing(layout, {head: fault}, seed)
        motion[:, 0] = motion[:, 0] if command else np.nan
        said = isolate_implausible(layout, motion, parity, MOST)
        assert said is not None
        assert said.head == head
        np.testing.assert_allclose(said.fault, fault, rtol=0.05)


@pytest.mark.parametrize("azimuths", [FOUR, FIVE, UNEVEN], ids=["four", "five", "uneven"])
def test_what_the_stage_could_have_moved_accuses_nobody(azimuths):
    layout = HeadLayout(azimuths)
    for seed in range(300):
        generator = np.random.default_rng(seed)
        head = int(generator.integers(len(azimuths)))
        motion, parity = standing(layout, {head: generator.uniform(-1, 1) * MOST[1]}, seed)
        assert isolate_implausible(layout, motion, parity, MOST) is None


def test_two_wrong_heads_accuse_no_third():
    layout = HeadLayout(FIVE)
    for seed in range(300):
        generator = np.random.default_rng(seed)
        pair = generator.choice(5, 2, replace=False)
        faults = {int(head): generator.uniform(-1, 1) * 0.1 for head in pair}
        said = isolate_implausible(layout, *standing(layout, faults, seed), MOST)
        assert said is None or abs(faults.get(said.head, 0.0)) > FAR * min(map(abs, faults.values()))


def test_without_command_the_radial_motion_tells():
    layout = HeadLayout(FOUR)
    generator = np.random.default_rng(2)
    motion, parity = observed(layout, 2, course("jump", generator), generator)
    motion[:, 0] = np.nan
    said = isolate_head(layout, motion, parity, 1)
    assert said is not None
    assert said.head == 2


@pytest.mark.parametrize("azimuths", [FOUR, FIVE, UNEVEN, FOUR[:3], FOUR[:2]])
def test_parity_is_blind_to_motion_and_of_unit_length(azimuths):
    layout = HeadLayout(azimuths)
    assert layout.parity.shape == (layout.redundancy, len(azimuths))
    np.testing.assert_allclose(layout.parity @ layout.sensitivity, 0.0, atol=1e-12)
    np.testing.assert_allclose(layout.parity @ layout.parity.T, np.eye(layout.redundancy), atol=1e-12)


def test_parity_of_four_heads_is_the_difference_of_the_sums_of_opposed_pairs():
    """A and B opposed, C and D opposed: (A + B - C - D) / 2, up to its sign."""
    parity = HeadLayout(FOUR).parity[0]
    np.testing.assert_allclose(np.abs(parity), 0.5)
    np.testing.assert_allclose(parity, parity[0] * np.array([1, 1, -1, -1]))


@pytest.mark.parametrize("freedom", [1.0, 2.5, 10.0, 100.0, 2500.0])
def test_the_bound_on_chi_square(freedom):
    exceeded = chi2.sf(chi_square_bound(freedom) * freedom, freedom)
    assert exceeded == pytest.approx(1e-4, rel=1e-6)


LONG_COURSE = 800


def pushed(layout, head, fault, generator):
    """Over 8 s: a rotor that pushes move to and fro, each for about 0.1 s, and a head with such a fault."""
    pushes = np.zeros((LONG_COURSE, 3))
    for k in range(1, LONG_COURSE):
        pushes[k] = 0.9 * pushes[k - 1] + generator.normal(0.0, 1e-6, 3)
    readings = pushes @ layout.sensitivity.T + generator.normal(0.0, 1.5e-7, (LONG_COURSE, len(layout.azimuths)))
    readings[:, head] += fault
    return readings @ layout.weights.T, readings @ layout.parity.T


@pytest.mark.parametrize("azimuths", [FOUR, FIVE, UNEVEN], ids=["four", "five", "uneven"])
def test_a_slow_drift_is_told_where_it_goes_beyond_what_pushes_make(azimuths):
    """No change over a second is more than what pushes make, so that roughness tells nothing."""
    layout, found, rough = HeadLayout(azimuths), 0, 0
    for seed in range(100):
        generator = np.random.default_rng(seed)
        head = int(generator.integers(len(azimuths)))
        fault = np.linspace(0.0, generator.choice([-1, 1]) * generator.uniform(2e-5, 6e-5), LONG_COURSE)
        motion, parity = pushed(layout, head, fault, generator)
        said = isolate_drift(layout, motion, parity)
        assert said is None or said.head == head
        found += said is not None
        rough += any(isolate_head(layout, motion, parity, lag) for lag in (1, 10, 100))
    assert found >= 95 and rough <= 50


def test_what_moves_as_slowly_as_a_contradiction_grows_leaves_it_open():
    """One event, however many windows it lasts: warmth that moves the rotor as far as the fault would tells no head."""
    layout = HeadLayout(FOUR)
    for seed in range(200):
        generator = np.random.default_rng(seed)
        motion, parity = pushed(layout, 0, np.linspace(0.0, 4e-5, LONG_COURSE), generator)
        warmth = np.outer(np.linspace(0.0, 1.0, LONG_COURSE) ** generator.uniform(0.5, 2.0), [0.0, 1.0, 1.0])
        said = isolate_drift(layout, motion + warmth * generator.uniform(-4e-5, 4e-5, 3), parity)
        assert said is None or said.head == 0


def test_independent_values_are_fewer_the_longer_a_course_remembers():
    """Of an autoregression with coefficient r they are (1 - r) / (1 + r) of its values (Box and Jenkins)."""
    generator = np.random.default_rng(4)
    for r in (0.0, 0.5, 0.9):
        course = np.zeros((20_000, 1))
        for k in range(1, len(course)):
            course[k] = r * course[k - 1] + generator.normal()
        assert independent_values(course) == pytest.approx(len(course) * (1 - r) / (1 + r), rel=0.25)
    assert independent_values(np.zeros((10, 0))) == 1.0
