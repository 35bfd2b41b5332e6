"""All heads of a ring lose counts alike while none of them is heard, as where one card counts for all of them."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from described_stages import stage_of
from draws import ALL, seeds
from world import Options, Recording, make_recording, random_stage

from faults.documenting import Row, shows
from faults.judging import Judgement, judge
from faults.recordings import MOST_WRONG
from rotary_error_monitor.signals.blocks import SampleBlock

SEEDS = range(5)


def some(place: int) -> range:
    """All of the seeds; in `make test` one, another one for each place in a list of parameters."""
    return SEEDS if ALL else range(place % len(SEEDS), place % len(SEEDS) + 1)


DURATION, BEGIN, GAP = 10.0, 5.0, 0.2
EARLY = 0.7, 1.2
"""Times of a silence, s, before which a recording shows enough, but little more than a second."""

MOTIONS = ("steady", "both_directions", "s_curves", "creep", "indexing")


@cache
def recorded(seed: int, duration: float = DURATION) -> Recording:
    """A random stage with three heads or more."""
    drawn = (random_stage(number) for number in range(1000 * seed, 1000 * seed + 1000))
    stage = next(each for each in drawn if len(each["encoder"]["heads"]) > 2)
    lag = float(np.random.default_rng([seed, 9]).uniform(0.0, 2.5e-4))  # of a drive that nobody has told before
    options = Options(motion=MOTIONS[seed % len(MOTIONS)], odd_rates=False, drive_lag=lag)
    return make_recording(seed, duration=duration, stage=stage, options=options)


@cache
def judged(
    seed: int,
    off: float,
    gap: float = GAP,
    until: float = np.inf,
    begin: float = BEGIN,
    duration: float = DURATION,
) -> Judgement:
    """All heads are silent for a time (s) and off by an angle (rad) after it, from one time to another (s)."""
    recording, changed = recorded(seed, duration), {}
    for topic in recording.head_topics:
        pairs = []
        for block, arrival in zip(recording.blocks[topic], recording.arrivals[topic], strict=True):
            seconds = (block.times_ns - recording.start_ns) * 1e-9
            if seconds[-1] < begin or seconds[0] >= begin + gap or gap == 0.0:
                wrong = (seconds >= begin + gap) & (seconds < until)
                rows = block.rows + np.column_stack([np.zeros(len(wrong)), off * wrong])
                pairs.append((SampleBlock(block.stamp_ns, block.names, rows), arrival))
        changed[topic] = ([block for block, _ in pairs], np.array([arrival for _, arrival in pairs]))
    return judge(recording.with_topics(changed), recording.stage)


@cache
def sound(seed: int) -> Judgement:
    """The same without anything."""
    return judge(recorded(seed), recorded(seed).stage)


@pytest.mark.few(2)
@shows(
    Row(
        "heads",
        "All heads are silent for 0.2 s and off alike after it, 20 µrad to 0.4 mrad, as where one card counts for all",
        "`error_estimator: estimate` says how much further apart rotation and command are than before",
        "held against what it was before, at the same angle or at last; a step that the drive does not make takes the "
        "command away, less counts as uncertainty; so does what a delay makes at another speed that was not seen yet",
        "everything but positioning; of less than a quarter of `following_error` everything, positioning with that "
        "uncertainty",
        "when it is as before again, or on a reset",
    )
)
@pytest.mark.parametrize(("place", "off"), list(enumerate([2e-5, -6e-5, 3e-4, -4e-4])))
def test_counts_that_all_heads_lost_in_a_silence_are_not_believed(place, off):
    seeds = some(place)
    begins = {}
    for seed in seeds:
        draw = np.random.default_rng([seed, place])
        begins |= {
            (seed, early): float(draw.uniform(*(EARLY if early else (EARLY[1], BEGIN)))) for early in (True, False)
        }
    found = {case: judged(case[0], off, begin=begin) for case, begin in begins.items()}
    wrong = {case: (dict(each.wrong), each.doubted) for case, each in found.items() if each.worst > MOST_WRONG}
    assert not wrong
    healthy = {case: judged(case[0], 0.0, begin=begin) for case, begin in begins.items()}
    for name in ("exc", "eac"):
        lost = [healthy[case].available[name] - found[case].available[name] for case in begins]
        assert max(lost) < 0.05 + GAP / DURATION, (name, lost)


def test_a_silence_without_loss_costs_nothing_but_itself():
    for seed in some(0):
        begin = float(np.random.default_rng(seed).uniform(EARLY[0], BEGIN))
        found, without = judged(seed, 0.0, begin=begin), sound(seed)
        assert not found.doubted and found.worst <= MOST_WRONG
        assert found.available["ecc"] > without.available["ecc"] - (GAP + 0.4) / DURATION
        # what remains of it is no more than the rotor's own jitter about its command
        limits = stage_of(recorded(seed).stage).limits
        assert found.estimator.belief.command.shift < 0.02 * limits.following_error, seed


@shows(
    Row(
        "heads",
        "All heads step alike without a silence, as where a card misses counts of all, by 0.3 mrad; by 20 µrad",
        "`error_estimator: estimate` names a step between rotation and command; of less than a quarter of "
        "`following_error` nothing: a drive makes such a step as well",
        "the command is not used after a step that no drive makes",
        "everything but positioning; after a smaller step everything, a positioning error that is off by no more than "
        "that quarter",
        "when it is as before again, or on a reset",
    )
)
@pytest.mark.parametrize(("place", "off"), list(enumerate([3e-4, -3e-4, 2e-5])))
def test_counts_that_all_heads_lose_at_once_are_a_step_or_within_what_is_stated(place, off):
    for seed in some(place + 2):
        found, limits = judged(seed, off, gap=0.0), stage_of(recorded(seed).stage).limits
        others = {name: part for name, part in found.wrong.items() if name != "ecc"}
        assert max(others.values()) <= MOST_WRONG, (seed, others)
        if abs(off) < 0.25 * limits.following_error:
            assert found.largest["ecc"] < 0.25 * limits.following_error + 2e-5, seed
        else:
            # it is seen within 0.1 s
            assert found.wrong["ecc"] <= 0.1 / DURATION, (seed, found.wrong, found.doubted)


def test_counts_that_all_heads_lose_at_any_time_are_told():
    """Within a window, or between the samples of a head, as well as beside them."""
    wrong = {}
    for seed in seeds(24, first=100):
        draw = np.random.default_rng(seed)
        off, begin = float(draw.choice([3e-4, -3e-4, 4e-4, -5e-4])), float(draw.uniform(1.0, 2.0))
        wrong[seed] = judged(seed, off, gap=0.0, begin=begin, duration=3.0).wrong["ecc"]
    assert all(part <= 0.1 / 3.0 for part in wrong.values()), wrong


@pytest.mark.few(2)
@pytest.mark.parametrize(("place", "off", "gap"), [(0, 3e-4, 0.0), (1, 3e-4, GAP), (2, -4e-4, 0.0), (3, -4e-4, GAP)])
def test_heads_that_are_right_again_are_believed_again(place, off, gap):
    """Of the 10 s 1.5 s are off, and valid output comes within a second of their end."""
    for seed in some(place):
        found, without = judged(seed, off, gap, BEGIN + 1.5), sound(seed)
        assert found.available["ecc"] > without.available["ecc"] - 2.6 / DURATION, (seed, found.doubted)
        assert not found.estimator.belief.command.doubt, seed
