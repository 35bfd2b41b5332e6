"""Faults put into recordings of random stages, and what an estimator makes of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from itertools import count, islice
from zlib import crc32

import numpy as np
from world import FAULTS, random_stage
from world.fault import Injected

from faults.behaviours import WRONG_DESCRIPTIONS, behaviour_of
from faults.judging import Judgement, judge, record

MOST_WRONG = 0.002
"""Part of the ticks of a recording at which a component may be off by more than six of its standard deviations."""


@dataclass(frozen=True)
class Case:
    """A fault on a random stage.

    Attributes:
        heads: how many the stage has.
        wrong: streams that the fault touches.
        found: what the estimator makes of it.
        healthy: what it makes of the same recording without the fault.
        paused: part of the recording in which there are no samples at all.
    """

    heads: int
    wrong: tuple[str, ...]
    found: Judgement
    healthy: Callable[[], Judgement]
    paused: float = 0.0

    def lost(self, component: str) -> float:
        """Part of what is published of a component without the fault that is not published with it."""
        before = self.healthy().available[component] * (1.0 - self.paused)
        return 1.0 - self.found.available[component] / before if before > 0.0 else 0.0


def _seed(name: str, number: int) -> int:
    return crc32(f"{name} {number}".encode()) % 1_000_000


def fitting(name: str, stages: int) -> list[int]:
    """Numbers of the first stages that have as many heads as it takes for a fault's components to go on."""
    enough = (n for n in count() if len(random_stage(_seed(name, n))["encoder"]["heads"]) >= behaviour_of(name).heads)
    return list(islice(enough, stages))


@cache
def case(name: str, number: int, duration: float, *, own_clock_steps: bool = True) -> Case | None:
    """A fault, or a wrong description, on the stage of that number; None where the fault did nothing.

    Where the clocks of all streams step, the estimator's own clock does so with them, or not.
    """
    seed = _seed(name, number)
    section, generator = random_stage(seed), np.random.default_rng(seed)
    recording = record(seed, section, duration)
    bound = behaviour_of(name).bound
    described, injected = section, Injected(recording, name, (), recording.start_ns, recording.start_ns, 0.0, "", True)
    if name in WRONG_DESCRIPTIONS:
        described = WRONG_DESCRIPTIONS[name](section, generator)
    else:
        injected = FAULTS[name](recording, generator)
    if not injected.acts:
        return None
    step = step_of(name, injected)
    own = (lambda arrival: arrival + step * (arrival >= injected.begin_ns)) if step and own_clock_steps else None
    found = judge(injected.recording, described, stepped_clock(step, injected.begin_ns), bound, own)
    wrong = tuple(topic.split("/")[2] for topic in injected.topics)
    paused = injected.size / duration if name == "recording_paused" else 0.0
    return Case(len(section["encoder"]["heads"]), wrong, found, cache(lambda: judge(recording, section)), paused)


def step_of(name: str, injected: Injected) -> int:
    """How far a fault has set the clock, ns; 0 where it has not."""
    if not name.startswith("clocks_step"):
        return 0
    return round(injected.size * 1e9) * (1 if name.endswith("forward") else -1)


def stepped_clock(step: int, begin_ns: int) -> Callable[[np.ndarray], np.ndarray] | None:
    """The truth's times of stamps whose clock was set by `step` ns at `begin_ns`; None where it was not."""
    if step == 0:
        return None

    def true_times(stamps: np.ndarray) -> np.ndarray:
        falls = np.flatnonzero(np.diff(stamps) < 0)
        again = np.arange(len(stamps)) > (falls[0] if len(falls) else len(stamps))
        return stamps - step * (again | (stamps >= begin_ns))

    return true_times
