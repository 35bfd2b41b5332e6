"""A fault that ends: within a second of its harm it is said, and a second after its end all is published again."""

from __future__ import annotations

from functools import cache
from itertools import count, islice

from draws import ALL
from world import FAULTS, random_stage

from faults.behaviours import BEHAVIOUR, behaviour_of
from faults.ending import Ended, ended
from faults.recordings import MOST_WRONG

OTHERS = (
    *("head_dead_later", "head_future_1s", "head_future_365d", "two_heads_dead_opposed", "autocollimator_dead_later"),
    *("autocollimator_noisy", "command_dead_later", "command_offset", "command_stamps_off"),
    *("blocks_late", "blocks_lost", "recording_paused"),
)
"""Faults that are over at once, or of which a row says more."""

WITHIN = "within 1 s of its end"
"""How the recovery of a fault begins that has to end so, whichever row of the page it stands in."""

RECOVERING = tuple(
    name
    for behaviour in BEHAVIOUR
    if behaviour.recovery.startswith(WITHIN)
    for name in behaviour.faults
    if name in FAULTS and name not in OTHERS
)

SUDDEN = (*RECOVERING, *OTHERS)

STAGES = 3
HEADS = 4
"""With fewer the ring has to come back to where it was at the same angle, which may take longer than a recording."""

MOST_MISSING = 0.3
"""Part of the time from a second after the end in which a component may be missing: a block is lost now and then."""

UNFORGIVEN = 0.1
"""Part of the cases in which it may be missing all the same: a block is lost just as a fault ends, or the rotation was
wrong for a head, at a speed at which its stamps outweigh its noise, while the command was judged."""

UNNAMED = 0.1
"""Part of the cases in which a second is not enough to tell which head drifts: that the heads contradict one another is
said by then, and nothing is published."""


@cache
def cases() -> dict[tuple[str, int], Ended]:
    """Every other fault on one of the stages, or all on each."""
    stages = list(islice((n for n in count(20) if len(random_stage(n)["encoder"]["heads"]) >= HEADS), STAGES))
    chosen = [
        (name, number)
        for place, name in enumerate(SUDDEN)
        for turn, number in enumerate(stages)
        if ALL or (place + turn) % (2 * STAGES) == 0
    ]
    found = {case: ended(*case) for case in chosen}
    return {case: each for case, each in found.items() if each is not None}


def test_what_is_published_is_right_while_the_fault_acts_and_when_it_ends():
    assert len(cases()) > 0.8 * len(SUDDEN) * (STAGES if ALL else 0.5)
    assert not {case: each.wrong for case, each in cases().items() if each.wrong > MOST_WRONG}


def test_what_is_harmed_is_said_within_a_second():
    """Where all streams pause the estimator, which hears nothing, says nothing; its node says which are stale."""
    harmed = {case: each for case, each in cases().items() if each.harmed and case[0] != "recording_paused"}
    assert len(harmed) > 0.4 * len(cases())
    unnamed = {case: (each.unnamed, each.said) for case, each in harmed.items() if each.unnamed}
    unknown = {case: each for case, each in unnamed.items() if not harmed[case].is_of_the_heads}
    assert not unknown, "the stream at fault is named, or the heads as a whole where nothing tells which of them it is"
    assert not {case: words for case, (names, words) in unnamed.items() if not all("head" in name for name in names)}
    told_apart = {case: each for case, each in harmed.items() if behaviour_of(case[0]).named}
    assert len(unnamed.keys() & told_apart.keys()) <= UNNAMED * len(told_apart), unnamed


def test_a_second_after_its_end_all_is_published_again():
    missing = {
        case: {name: f"{part:.0%}" for name, part in each.missing.items() if part > MOST_MISSING}
        for case, each in cases().items()
    }
    missing = {case: parts for case, parts in missing.items() if parts}
    assert len(missing) <= UNFORGIVEN * len(cases()), missing
