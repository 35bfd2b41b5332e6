"""Each fault of a recording: nothing is published that is off by more than it says, whatever the stage.

Nothing would be wrong either where nothing is published, so what is stated to go on is held to it as well. A single
random stage may be beyond help (a fault in its first tenth of a second, a rotor that hardly turns): rates are bounded.
"""

import pytest
from draws import ALL
from world import FAULTS

from faults.behaviours import BEHAVIOUR, WRONG_DESCRIPTIONS, behaviour_of, rows
from faults.documenting import shows
from faults.recordings import MOST_WRONG, case, fitting

DURATION = 8.0
"""Length of a recording, s: fast stages make several turns, slow ones none."""

EVERY = [*FAULTS, *WRONG_DESCRIPTIONS]

MOST_LOST = 0.3
"""Part of the ticks at which a component that goes on may be missing besides: a fault is found and forgiven."""


@shows(*rows())
@pytest.mark.parametrize("name", EVERY)
def test_nothing_wrong_is_published(name):
    tried = case(name, 0, DURATION)
    if tried is None:
        pytest.skip("this fault changes nothing in this recording")
    found = tried.found
    assert found.worst <= MOST_WRONG, (found.wrong, found.largest, found.doubted)


def every_case(condition, stages=1):
    """Cases of the faults whose behaviour fulfils a condition, on stages with as many heads as it takes."""
    some = EVERY if ALL else EVERY[::3]
    numbers = [(name, number) for name in some if condition(behaviour_of(name)) for number in fitting(name, stages)]
    cases = {numbered: case(*numbered, DURATION) for numbered in numbers}
    return {numbered: each for numbered, each in cases.items() if each}


def test_what_is_stated_to_go_on_goes_on():
    lost = {
        (numbered, component): each.lost(component)
        for numbered, each in every_case(lambda behaviour: behaviour.goes_on).items()
        for component in behaviour_of(numbered[0]).going_on(each.wrong)
    }
    missing = {what: f"{part:.0%}" for what, part in lost.items() if part > MOST_LOST}
    assert len(lost) > (150 if ALL else 45)
    assert len(missing) <= 0.05 * len(lost), missing


@pytest.mark.parametrize("name", ["clocks_step_forward", "clocks_step_back"])
def test_of_clocks_that_step_apart_from_the_estimators_own_nothing_is_used(name):
    together, apart = case(name, 1, DURATION), case(name, 1, DURATION, own_clock_steps=False)
    assert apart.found.worst <= MOST_WRONG
    assert apart.found.available["exc"] < 0.6 < together.found.available["exc"], "by more than max_age"


def test_the_wrong_head_is_left_out_by_name_and_no_other():
    cases = every_case(lambda behaviour: behaviour.named, stages=2)
    doubted = {what: {name for name in each.found.doubted if name.startswith("head_")} for what, each in cases.items()}
    others = {what: (cases[what].wrong, names) for what, names in doubted.items() if names - set(cases[what].wrong)}
    unnamed = {what: cases[what].wrong for what, names in doubted.items() if not names}
    assert len(cases) >= (10 if ALL else 3)
    assert not others
    assert len(unnamed) <= 0.2 * len(cases), unnamed


def test_healthy_stages_are_published_and_not_doubted():
    cases = every_case(lambda behaviour: behaviour.goes_on)
    doubted = {what: each.healthy().doubted for what, each in cases.items() if each.healthy().doubted}
    wrong = {what: each.healthy().wrong for what, each in cases.items() if each.healthy().worst > MOST_WRONG}
    assert not wrong
    assert len(doubted) <= 0.03 * len(cases), doubted


def test_every_fault_of_the_world_has_one_stated_behaviour():
    stated = [name for each in BEHAVIOUR for name in each.faults]
    assert sorted(stated) == sorted([*FAULTS, *WRONG_DESCRIPTIONS])
