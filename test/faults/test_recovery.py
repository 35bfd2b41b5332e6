"""The ends of faults that are hard to tell from their begins: a second later all is published, nothing wrong before.

What differs from one of them to the next is drawn: stage, size, begin, how long it acts, and how fast the stage turns.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from itertools import count, islice

import numpy as np
import pytest
from draws import ALL, seeds
from world import FAULTS, random_stage
from world.fault import Change, Draw, Fault, Size, changed_values
from world.faults_heads import jumped

from faults.behaviours import Bound, command_bound, tilt_bound
from faults.documenting import Row, shows
from faults.ending import Ended, ended_of
from faults.recordings import MOST_WRONG
from rotary_error_monitor.description.stage_limits import StageLimits

STAGES = 12 if ALL else 3
"""Stages of each kind of case."""

MOST_MISSING = 0.3
"""Part of the time from a second after the end in which a component may be missing: a block is lost now and then."""

UNFORGIVEN = 0.1
"""Part of all cases in which it may be missing all the same: a block is lost just as a fault ends."""


def _several(draw: Draw) -> Change:
    """Two heads or more are off at once, each by counts of its own."""
    heads, begin = draw.recording.head_topics, draw.begin_ns("later")
    chosen = draw.rng.choice(heads, int(draw.rng.integers(2, len(heads) + 1)), replace=False).tolist()
    size = Size(3.0, 3000.0, "counts", signed=True)
    changed = {topic: changed_values(draw, topic, begin, draw.sized(size), jumped) for topic in chosen}
    return Change(changed, begin, float(len(chosen)), "heads")


SEVERAL = Fault("heads_jump", "Several heads are off at once, by counts.", "heads", _several)


@dataclass(frozen=True)
class Kind:
    """Cases of one kind.

    Attributes:
        faults: of which one is drawn.
        heads: fewest and most heads of a stage.
        bound: what cannot be told from the stage.
        sizes: bounds of the size in parts of `following_error`; else the fault draws it.
        speeds: bounds of the highest speed, rad/s; else the recording draws it.
    """

    faults: tuple[Fault, ...]
    heads: tuple[int, int] = (2, 8)
    bound: Bound | None = None
    sizes: tuple[float, float] | None = None
    speeds: tuple[float, float] | None = None


KINDS: Mapping[str, Kind] = {
    "several heads without redundancy": Kind((SEVERAL,), (3, 3)),
    "several heads": Kind((SEVERAL,), (4, 8)),
    "a head of a fast stage": Kind(
        tuple(FAULTS[f"head_jumps_{counts}"] for counts in (2, 10, 100)), (4, 8), tilt_bound, speeds=(5.0, 60.0)
    ),
    "a command at a wrong speed": Kind((FAULTS["command_wrong_rate"],), bound=command_bound),
    "a command that is a little off": Kind((FAULTS["command_offset"],), bound=command_bound, sizes=(0.15, 0.6)),
    "an autocollimator with a wrong sign": Kind(
        (FAULTS["autocollimator_x_reversed"], FAULTS["autocollimator_y_reversed"]), bound=tilt_bound
    ),
}


def stages(kind: Kind) -> list[int]:
    """Numbers of stages with as many heads as a kind takes."""
    least, most = kind.heads
    fitting = (n for n in count(300) if least <= len(random_stage(n)["encoder"]["heads"]) <= most)
    return list(islice(fitting, STAGES))


def drawn(name: str, number: int) -> Ended | None:
    """A case of a kind on the stage of that number."""
    kind, generator = KINDS[name], np.random.default_rng([number, len(name)])
    fault = kind.faults[int(generator.integers(0, len(kind.faults)))]
    lasts, size = float(generator.uniform(0.3, 2.0)), None
    if kind.sizes is not None:
        size = float(generator.choice((-1.0, 1.0)) * generator.uniform(*kind.sizes)) * StageLimits().following_error
    options = () if kind.speeds is None else (("peak_speed", float(generator.uniform(*kind.speeds))),)
    return ended_of(fault, number, generator, lasts, kind.bound, size, options)


@cache
def cases() -> Mapping[tuple[str, int], Ended]:
    """All of them that do anything."""
    found = {(name, number): drawn(name, number) for name, kind in KINDS.items() for number in stages(kind)}
    return {case: each for case, each in found.items() if each is not None}


@pytest.mark.long
@shows(
    Row(
        "heads",
        "Two heads or more are off at once, each by counts of its own",
        "`error_estimator: estimate`: the heads contradict one another, or a step that no bearing makes",
        "none is believed where nothing tells which is wrong",
        "nothing; of five heads and more what those that are right determine",
        "within 1 s of the end: after 0.5 s in which all agree, and without redundancy after 0.5 s in which the jumps "
        "of the ring have taken back one another, or the ring is where it was at this angle; without redundancy a "
        "fault that ends while the heads are silent may need a turn, or a reset",
    ),
    Row(
        "command",
        "The command runs at a wrong speed for 0.3 s to 2 s, or is off by 15 % to 60 % of `following_error`, and is "
        "right again",
        "`error_estimator: estimate` names the command: late, apart, or a step; an offset of less than a quarter of "
        "`following_error` is not told",
        "the command is not used",
        "everything but positioning; a positioning error that is off by no more than `following_error` and `latency`",
        "within 1 s of the end, where the distance is again what it was for most of the last 10 s of belief, or just "
        "before; of a fault that was not seen for more than half of that time on a reset",
    ),
    Row(
        "autocollimator",
        "The autocollimator has the wrong sign for 0.3 s to 2 s, and the right one again",
        "`error_estimator: estimate` names it: a step that no bearing makes, or that it does not fit its description",
        "the tilt is not used",
        "everything but tilt",
        "within 1 s of the end: after 0.5 s in which it fits the description and not what was found before, or is "
        "where it was most of the time",
    ),
)
def test_nothing_wrong_is_published_meanwhile_or_afterwards():
    assert len(cases()) > 0.8 * STAGES * len(KINDS)
    assert not {case: each.wrong for case, each in cases().items() if each.wrong > MOST_WRONG}


@pytest.mark.long
def test_a_second_after_the_end_all_is_published_again():
    missing = {
        case: {name: f"{part:.0%}" for name, part in each.missing.items() if part > MOST_MISSING}
        for case, each in cases().items()
    }
    missing = {case: parts for case, parts in missing.items() if parts}
    assert len(missing) <= UNFORGIVEN * len(cases()), missing


def _one_stays(draw: Draw) -> Change:
    """Two heads jump alike; one of them is right again a second later."""
    chosen, begin = draw.rng.choice(draw.recording.head_topics, 2, replace=False).tolist(), draw.begin_ns("later")
    changed, end = {}, begin + round(float(draw.rng.uniform(0.5, 1.5)) * 1e9)
    for topic, until in zip(chosen, (end, None), strict=True):
        size = draw.sized(Size(10.0, 1000.0, "counts", signed=True))
        changed[topic] = changed_values(draw, topic, begin, size, jumped, until)
    return Change(changed, begin, 2.0, "heads")


ONE_STAYS = Fault("one_head_stays", "Two heads jump, and one is right again.", "heads", _one_stays)

LASTING: Mapping[str, Callable[[], tuple[Fault, Kind]]] = {
    "one of two heads": lambda: (ONE_STAYS, KINDS["several heads without redundancy"]),
    "heads of a fast stage": lambda: (FAULTS["head_jumps_100"], KINDS["a head of a fast stage"]),
    "reversed": lambda: (FAULTS["autocollimator_x_reversed"], KINDS["an autocollimator with a wrong sign"]),
    "command": lambda: (FAULTS["command_wrong_rate"], KINDS["a command at a wrong speed"]),
}
"""Faults that do not end, or not all of them."""


@pytest.mark.parametrize("name", LASTING)
def test_what_goes_on_is_not_taken_for_over(name):
    fault, kind = LASTING[name]()
    for number in stages(kind)[: len(seeds(STAGES))]:
        generator = np.random.default_rng([number, len(name), 1])
        options = () if kind.speeds is None else (("peak_speed", float(generator.uniform(*kind.speeds))),)
        found = ended_of(fault, number, generator, 10.0, kind.bound, options=options)
        assert found is None or found.wrong <= MOST_WRONG, (number, found.wrong, found.said)
