"""Faults that last for some time in a recording of a random stage: what is said of them, and what comes after them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np
from described_stages import stage_of
from numpy.typing import NDArray
from world import FAULTS, Recording, random_stage
from world.fault import Fault, Injected

from faults.behaviours import Bound, behaviour_of
from faults.judging import SIGMAS, estimated, record, stream_of
from rotary_error_monitor.metrology.error_motion import COMPONENTS, ErrorMotion
from rotary_error_monitor.pipeline.estimation import Estimator

DURATION = 8.0
"""Length of a recording, s: the fault begins in its middle."""

LASTS = 1.5
"""How long a fault acts, s."""

REPORT = 1.0
"""Time within which a fault is to be said, and all to be as before once it is over, s."""


@dataclass(frozen=True)
class Heard:
    """What an estimator made of a recording.

    Attributes:
        motion: all that was published; nothing where there is none.
        said: for each turn of the estimator, its time (ns) and what it had to say then.
    """

    motion: ErrorMotion
    said: list[tuple[int, frozenset[str]]]

    def told(self, begin_ns: int, end_ns: int) -> frozenset[str]:
        """What was said between two times (ns)."""
        return frozenset().union(*(words for time, words in self.said if begin_ns <= time < end_ns))


@dataclass(frozen=True)
class Ended:
    """A fault that began and ended, beside the same recording without it.

    Attributes:
        heads: how many the stage has.
        touched: streams that have the fault.
        wrong: part of the ticks of the recording at which a component is off by more than six of its standard
            deviations and what its behaviour allows, the largest of all components.
        harmed: whether anything is missing or off by more than six deviations of the sound estimate while it acts.
        said: what was said within `REPORT` of its begin, or of its first harm, that is not said without it.
        missing: by component, part of what is published without the fault that is missing from `REPORT` after its end.
    """

    heads: int
    touched: tuple[str, ...]
    wrong: float
    harmed: bool
    said: frozenset[str]
    missing: Mapping[str, float]

    @property
    def unnamed(self) -> tuple[str, ...]:
        """Streams that have the fault of which nothing was said."""
        named = {word for words in self.said for word in words.partition(" refused:")[0].split()}
        return tuple(name for name in self.touched if name not in named)

    @property
    def is_of_the_heads(self) -> bool:
        """Whether it was said that the heads contradict one another, without which of them is wrong."""
        return not self.said.isdisjoint({"heads", "withheld"})


def _until(recording: Recording, injected: Injected, end_ns: int) -> Recording:
    """The recording with a fault up to a time (ns) of arrival, and without it from then on."""
    topics = {}
    for topic in injected.topics:
        changed, arrived = injected.recording.blocks[topic], injected.recording.arrivals[topic]
        sound, came = recording.blocks[topic], recording.arrivals[topic]
        blocks = [block for block, time in zip(changed, arrived, strict=True) if time < end_ns]
        blocks += [block for block, time in zip(sound, came, strict=True) if time >= end_ns]
        topics[topic] = blocks, np.concatenate([arrived[arrived < end_ns], came[came >= end_ns]])
    return recording.with_topics(topics)


class _Counts:
    """What an estimator says now: what it doubts and misses, and the counts that have risen since it was last asked."""

    def __init__(self, estimator: Estimator) -> None:
        self._estimator = estimator
        self._before: dict[str, int] = {}

    def words(self) -> frozenset[str]:
        """Names of what is doubted, missing or refused."""
        heads = self._estimator.belief.heads
        said = {name for name, _ in self._estimator.reasons}
        said |= {f"without {name}" for name in self._estimator.status.absent}
        said |= {"redundancy"} if heads.lost else set()
        said |= {"unsettled"} if heads.unsettled else set()
        now = dict(self._counts())
        said |= {name for name, count in now.items() if count > self._before.get(name, 0)}
        self._before = now
        return frozenset(said)

    def _counts(self) -> Iterator[tuple[str, int]]:
        status = self._estimator.status
        yield "withheld", status.withheld
        yield "impossible", status.unobservable
        yield "saturated", status.saturated.total()
        for (name, reason), count in status.refused.items():
            yield f"{name} refused: {reason}", count
        for name, count in status.unjoined.items():
            yield f"{name} unjoined", count
        for name, stream in status.streams.items():
            yield f"{name} lost", stream.lost  # as the watch of the node counts it
            for reason, count in stream.admission.refused.items():
                yield f"{name} refused: {reason}", count


def heard(recording: Recording, section: Mapping[str, object]) -> Heard:
    """What an estimator makes of a recording of the stage that a section describes."""
    estimator = Estimator(stage_of(section))
    counts, said = _Counts(estimator), list[tuple[int, frozenset[str]]]()
    parts = estimated(recording, estimator, lambda arrival: said.append((arrival, counts.words())))
    return Heard(ErrorMotion.joined(parts) if parts else ErrorMotion.unknown(0), said)


Options = tuple[tuple[str, object], ...]
"""Of a recording, by name."""


@cache
def _sound(number: int, options: Options) -> tuple[Mapping[str, object], Recording, Heard]:
    section = random_stage(number)
    recording = record(number, section, DURATION, **dict(options))
    return section, recording, heard(recording, section)


def distance_of(recording: Recording, motion: ErrorMotion) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(n, 6) distance from the truth and stated standard deviation, m and rad."""
    truth = recording.truth(motion.times_ns)
    off = motion.components - np.column_stack([getattr(truth, name) for name in COMPONENTS])
    off[:, 5] -= 2 * np.pi * np.rint(off[:, 5] / (2 * np.pi))
    return np.abs(off), np.sqrt(np.diagonal(motion.covariance, axis1=1, axis2=2))


def ended(name: str, number: int) -> Ended | None:
    """A fault that ends, on the stage of that number; None where it does nothing, or the stage shows nothing."""
    generator = np.random.default_rng([number, len(name)])
    return ended_of(FAULTS[name], number, generator, LASTS, behaviour_of(name).bound)


def ended_of(
    fault: Fault,
    number: int,
    generator: np.random.Generator,
    lasts: float,
    bound: Bound | None = None,
    size: float | None = None,
    options: Options = (),
) -> Ended | None:
    """The same of any fault.

    Args:
        fault: what goes wrong.
        number: of the stage.
        generator: draws when it begins, and what else is drawn of it.
        lasts: how long it acts, s.
        bound: what of it cannot be told from the stage by its nature.
        size: of the fault; drawn if not given.
        options: of the recording.
    """
    section, recording, sound = _sound(number, options)
    injected = fault(recording, generator, begin=float(generator.uniform(0.4, 0.5)) * DURATION, size=size)
    if not injected.acts or not len(sound.motion.times_ns):
        return None
    begin_ns, end_ns = injected.begin_ns, injected.begin_ns + round(lasts * 1e9)
    found = heard(_until(recording, injected, end_ns), section)
    allowed = bound(stage_of(section)) if bound else {}
    margin = np.array([allowed.get(each, 0.0) for each in COMPONENTS])
    off, deviation = distance_of(recording, found.motion)
    wrong = found.motion.observable & ~(off <= margin + SIGMAS * deviation)

    times, before = sound.motion.times_ns, sound.motion.observable
    _, here, there = np.intersect1d(found.motion.times_ns, times, return_indices=True)
    kept, worse = np.zeros_like(before), np.zeros_like(before)
    kept[there] = found.motion.observable[here]
    fine, sure = distance_of(recording, sound.motion)
    worse[there] = kept[there] & (off[here] > margin + SIGMAS * sure[there]) & (fine[there] <= SIGMAS * sure[there])
    harm = ((before & ~kept) | worse).any(axis=1) & (times > begin_ns) & (times < end_ns)
    shown_ns = int(times[harm][0]) if harm.any() else begin_ns
    until_ns = shown_ns + round(REPORT * 1e9)
    after = times > end_ns + round(REPORT * 1e9)
    return Ended(
        len(section["encoder"]["heads"]),
        tuple(name for topic in injected.topics if (name := stream_of(topic)) is not None),
        float(wrong.sum(axis=0).max()) / (DURATION * 1e3),
        bool(harm.mean() > 1e-3),
        found.told(begin_ns, until_ns) - sound.told(begin_ns, until_ns),
        {
            component: float((before & ~kept)[after, i].mean() / before[after, i].mean())
            for i, component in enumerate(COMPONENTS)
            if before[after, i].any()
        },
    )
