"""Probabilities of what else could have been the cause."""

from __future__ import annotations

import numpy as np
import pytest

from rotary_error_monitor.gap import alternatives
from rotary_error_monitor.gap.alternatives import rank_alternatives
from rotary_error_monitor.gap.diagnosis import diagnose
from rotary_error_monitor.gap.selection import select_causes
from rotary_error_monitor.gap.sentences import verdict_sentence
from rotary_error_monitor.gap.verdict import Verdict
from rotary_error_monitor.plant.motion import Motion, MotionSegment


@pytest.mark.parametrize("usual", [1e-3, 1.0, 1e3])
def test_what_looks_the_same_is_equally_probable(linear, usual):
    """The column of `twin` is that of `first` in another unit: how large such an effect usually is says nothing."""
    column = linear.effects["first"].column["x"]
    linear.offer({"first": {"x": column}, "twin": {"x": usual * column}})
    chosen = select_causes(linear).chosen
    found = rank_alternatives(chosen, chosen.fit.causes, 0.0)
    assert found.probability(("first", "")) == pytest.approx(found.probability(("twin", "")), abs=1e-6)
    assert {("first", ""), ("twin", "")} <= set(found.groups[0])


def test_probabilities_are_as_often_right_as_they_say(linear, rng):
    """Two effects of very unequal usual sizes, so much alike that the data often prefer the wrong one."""
    base = rng.normal(size=(800, 1))
    alike = {name: 0.999 * base + 0.045 * rng.normal(size=(800, 1)) for name in ("small", "large")}
    linear.offer({"small": {"x": alike["small"]}, "large": {"x": 1e3 * alike["large"]}})
    said, right = [], 0
    for trial in range(200):
        true = ("small", "large")[trial % 2]
        linear.data = {"x": 0.8 * alike[true] + rng.normal(size=(800, 1)), "y": rng.normal(size=(800, 1))}
        chosen = select_causes(linear).chosen
        found = rank_alternatives(chosen, chosen.fit.causes, 0.0)
        best = max(found.ranking, key=lambda row: row[2])
        said.append(best[2])
        right += best[0] == true
    # Three standard deviations of a count of so many.
    assert right == pytest.approx(sum(said), abs=3 * np.sqrt(np.sum(np.array(said) * (1 - np.array(said)))))
    assert 0.5 < np.mean(said) < 0.95


def late_at_one_speed(stage_problem, seed, size):
    """A late encoder on a stage that turned at one speed only."""
    motion = Motion((MotionSegment(1000.0, 1.5),))
    return stage_problem(seed, "single", ["encoder_latency"], snr=(size, 1.01 * size), motion=motion)[0]


@pytest.mark.few(1)
@pytest.mark.parametrize("seed", [18, 19, 20])
def test_at_one_speed_a_late_encoder_is_as_probable_as_backlash(stage_problem, seed):
    """Whatever shifts the rotation alike at the only speed that was driven is one group of equal chances."""
    problem = late_at_one_speed(stage_problem, seed, 2000.0)
    diagnosis = diagnose(problem)
    (group,) = diagnosis.indistinguishable
    keys = {("encoder_latency", ""), ("following_error", ""), ("reversal_backlash", "")}
    assert keys <= set(group.effects)
    assert "speed" in group.advice
    named, *others = (name for name, _ in group.effects)
    assert f"does not tell {named} from {' or '.join(others)}." in verdict_sentence(diagnosis)
    chances = [row.probability for row in diagnosis.ranking if (row.effect, row.location) in keys]
    assert chances == pytest.approx([1 / 3] * 3, abs=0.05)


@pytest.mark.few(1)
@pytest.mark.parametrize("seed", [18, 19, 20])
def test_at_one_speed_what_heads_may_round_off_is_no_late_encoder(stage_problem, seed):
    """Less than half a count against the command, always the same: heads that cut off their readings show that too."""
    assert diagnose(late_at_one_speed(stage_problem, seed, 150.0)).verdict is Verdict.NO_GAP


@pytest.mark.long
def test_beside_a_late_sensor_what_looks_the_same_stays_a_group(stage_problem):
    """The autocollimator's lateness turns the waves of every effect alike; without an LVDT it alone sees tilt."""
    problem, _ = stage_problem(3, "pair", ["autocollimator_latency", "spindle_tilt"], snr=(1000.0, 2000.0), rough=True)
    assert "lvdt" not in problem.twin.times
    diagnosis = diagnose(problem)
    keys = {("spindle_tilt", "order_9"), ("mirror_flatness", "order_9")}
    (group,) = diagnosis.indistinguishable
    assert set(group.effects) == keys
    assert group.advice.startswith("add an LVDT 100 mm above the ring")
    chances = {(row.effect, row.location): row.probability for row in diagnosis.ranking}
    assert chances["autocollimator_latency", ""] > 0.9
    assert [chances[key] for key in keys] == pytest.approx([0.5, 0.5], abs=0.05)


@pytest.mark.parametrize(
    ("table", "weighed", "expected"),
    [
        ([0.0, 235.0, 65.0, -3.0], {1: -1.5}, [0.0, -1.5, -171.5, -239.5]),  # noise was learnt anew since the table
        ([0.0, -2.0, 5.0, -3.0], {1: -1.0}, [0.0, -1.0, 0.0, -3.0]),  # a rival that gained tells nothing of others
        ([0.0, 4.0, 9.0, 8.0], {1: -40.0, 2: -3.0}, [0.0, -40.0, -3.0, -4.0]),  # the best of those that were weighed
        ([0.0, -2.0, 5.0, -3.0], {}, [0.0, -2.0, 0.0, -3.0]),
    ],
)
def test_sets_that_were_not_weighed_turn_out_as_the_best_of_those_that_were(table, weighed, expected):
    keys = [frozenset({(name, "")}) for name in "abcd"]
    credits = {keys[0]: 0.0, **{keys[place]: odds for place, odds in weighed.items()}}
    np.testing.assert_allclose(alternatives._all_credited(np.array(table), keys, credits), expected)
