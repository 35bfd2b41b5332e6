"""Faults put into recordings of random stages, and what an estimator makes of them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
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
    """

    heads: int
    wrong: tuple[str, ...]
    found: Judgement
    healthy: Callable[[], Judgement]

    def lost(self, component: str) -> float:
        """Part of what is published of a component without the fault that is not published with it."""
        before = self.healthy().available[component]
        return 1.0 - self.found.available[component] / before if before > 0.0 else 0.0


@cache
def case(name: str, number: int, duration: float) -> Case | None:
    """A fault, or a wrong description, on the stage of that number; None where the fault did nothing."""
    seed = crc32(f"{name} {number}".encode()) % 1_000_000
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
    found = judge(injected.recording, described, stepped_clock(name, injected.begin_ns, injected.size), bound)
    wrong = tuple(topic.split("/")[2] for topic in injected.topics)
    return Case(len(section["encoder"]["heads"]), wrong, found, cache(lambda: judge(recording, section)))


def stepped_clock(name: str, begin_ns: int, size: float) -> Callable[[np.ndarray], np.ndarray] | None:
    """The truth's times of stamps of which the clock was set; None where it was not."""
    if not name.startswith("clocks_step"):
        return None
    step = round(size * 1e9) * (1 if name.endswith("forward") else -1)

    def true_times(stamps: np.ndarray) -> np.ndarray:
        falls = np.flatnonzero(np.diff(stamps) < 0)
        again = np.arange(len(stamps)) > (falls[0] if len(falls) else len(stamps))
        return stamps - step * (again | (stamps >= begin_ns))

    return true_times
