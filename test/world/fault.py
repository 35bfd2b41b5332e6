"""What a fault is: a named change of a recording, of a drawn size, from a drawn time on."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.signals.blocks import SampleBlock

from .recording import AUTOCOLLIMATOR, COMMAND, Recording, samples

Array = NDArray[np.float64]
Times = NDArray[np.int64]
Topics = dict[str, tuple[list[SampleBlock], Times]]
SECOND = 1_000_000_000


@dataclass(frozen=True)
class Injected:
    """A recording with a fault in it.

    Attributes:
        recording: the changed recording; its truth is that of the original, for no fault here moves the rotor.
        name: name of the fault.
        topics: topics that the fault touches.
        begin_ns: timestamp (ns) from which on it acts; what is stamped before is as it was.
        end_ns: timestamp (ns) up to which it acts.
        size: what was drawn, in `unit`.
        unit: unit of the size.
        acts: whether any block differs at all; a wrap that is never reached does nothing.
        detail: further drawn numbers and names.
    """

    recording: Recording
    name: str
    topics: tuple[str, ...]
    begin_ns: int
    end_ns: int
    size: float
    unit: str
    acts: bool
    detail: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Change:
    """What a fault's action gives back: the changed topics and what was drawn."""

    topics: Topics
    begin_ns: int
    size: float
    unit: str
    end_ns: int | None = None
    detail: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Size:
    """Bounds of a fault's size, which is drawn evenly in the logarithm.

    Attributes:
        low: the lower bound, or the size itself.
        high: the upper bound.
        unit: of the size.
        signed: whether it may be of either sign.
        whole: whether it is a whole number.
    """

    low: float = 1.0
    high: float | None = None
    unit: str = "1"
    signed: bool = False
    whole: bool = False


@dataclass(frozen=True)
class Draw:
    """Draws of one fault; what the caller wants fixed is not drawn.

    Attributes:
        recording: what the fault is put into.
        rng: generator.
        begin: wanted begin in s after the begin of the recording.
        size: wanted size.
        topic: wanted topic, for faults of one stream.
    """

    recording: Recording
    rng: np.random.Generator
    begin: float | None = None
    size: float | None = None
    topic: str | None = None

    def begin_ns(self, when: str) -> int:
        """Begin: at the start (`start`), in the middle (`later`) or one of both (`either`)."""
        first = first_ns(self.recording)
        if self.begin is not None:
            return first if self.begin <= 0.0 else self.recording.start_ns + round(self.begin * 1e9)
        share = self.rng.uniform(0.2, 0.7)
        if when == "start" or (when == "either" and self.rng.uniform() < 0.5):
            return first
        return self.recording.start_ns + round(share * self.recording.duration * 1e9)

    def sized(self, size: Size) -> float:
        """The fault's size."""
        drawn = float(np.exp(self.rng.uniform(np.log(size.low), np.log(size.high)))) if size.high else size.low
        drawn = float(round(drawn)) if size.whole else drawn
        drawn = -drawn if size.signed and self.rng.uniform() < 0.5 else drawn
        return drawn if self.size is None else self.size

    def one_of(self, topics: Sequence[str]) -> str:
        """One of the topics."""
        drawn = str(self.rng.choice(list(topics)))
        return drawn if self.topic is None else self.topic

    def topics(self, who: str) -> tuple[str, ...]:
        """Topics of `head`, `heads`, `probe`, `autocollimator`, `command`, `stream` (one, but no probe) or `all`."""
        heads = self.recording.head_topics
        if who == "head":
            return (self.one_of(heads),)
        if who == "probe":
            return (self.one_of(list(self.recording.probes)),)
        if who == "stream":
            return (self.one_of([*heads, AUTOCOLLIMATOR, COMMAND]),)
        single = {"autocollimator": (AUTOCOLLIMATOR,), "command": (COMMAND,)}
        return {"heads": tuple(heads), "all": tuple(self.recording.blocks), **single}[who]

    def neighbours(self, opposed: bool) -> tuple[str, str]:
        """Two heads: of all pairs, drawn from those that are nearest to opposite, or nearest to one another."""
        places = self.recording.stage["encoder"]["heads"]
        names = list(places)
        azimuths = np.array([places[name]["azimuth"] for name in names], float)
        apart = np.abs(np.angle(np.exp(1j * (azimuths[:, None] - azimuths))))
        i, j = np.triu_indices(len(names), 1)
        wrong = np.pi - apart[i, j] if opposed else apart[i, j]
        pick = int(self.rng.choice(np.flatnonzero(wrong < wrong.min() + 1e-6)))
        topics = self.recording.head_topics
        pair = [topics[i[pick]], topics[j[pick]]]
        first = int(self.rng.integers(0, 2))
        return pair[first], pair[1 - first]


Action = Callable[[Draw], Change]


@dataclass(frozen=True)
class Fault:
    """A fault: called with a recording and a generator, it gives the recording with the fault in it.

    Attributes:
        name: its name.
        sentence: what it is.
        streams: what it touches: `head`, `probe` or `stream` (one), `two heads`, `heads` (all), `autocollimator`,
            `command`, `all`.
        act: its action.
    """

    name: str
    sentence: str
    streams: str
    act: Action

    def __call__(
        self,
        recording: Recording,
        rng: np.random.Generator,
        *,
        begin: float | None = None,
        size: float | None = None,
        topic: str | None = None,
    ) -> Injected:
        """Put the fault into a recording; begin (s after the start), size and topic are drawn if not given."""
        change = self.act(Draw(recording, rng, begin, size, topic))
        acts = any(_differ(recording, name, pair) for name, pair in change.topics.items())
        end = last_ns(recording) if change.end_ns is None else change.end_ns
        touched = tuple(change.topics)
        changed = recording.with_topics(change.topics)
        return Injected(
            changed, self.name, touched, change.begin_ns, end, change.size, change.unit, acts, change.detail
        )


def _differ(recording: Recording, topic: str, pair: tuple[list[SampleBlock], Times]) -> bool:
    """Whether the changed topic differs from that of the recording."""
    blocks, arrivals = pair
    before = recording.blocks.get(topic, [])
    if len(before) != len(blocks) or not np.array_equal(arrivals, recording.arrivals[topic]):
        return True
    return any(
        a is not b and (a.stamp_ns != b.stamp_ns or not np.array_equal(a.rows, b.rows, equal_nan=True))
        for a, b in zip(before, blocks, strict=True)
    )


def first_ns(recording: Recording) -> int:
    """The first stamp of a recording."""
    return min((blocks[0].stamp_ns for blocks in recording.blocks.values() if blocks), default=recording.start_ns)


def last_ns(recording: Recording) -> int:
    """The end of a recording."""
    return recording.start_ns + round(recording.duration * 1e9)


@dataclass(frozen=True)
class Acting:
    """The samples of one topic on which a fault acts.

    Attributes:
        values: (n, k) what they were.
        seconds: (n,) s since the fault's begin.
        previous: (k,) the value before.
        size: what was drawn.
        rng: generator.
        recording: the original recording.
        step: (k,) step of the readings, 0 where there is none.
        topic: whose samples they are.
    """

    values: Array
    seconds: Array
    previous: Array
    size: float
    rng: np.random.Generator
    recording: Recording
    step: Array
    topic: str

    def stepped(self, values: Array) -> Array:
        """(n, k) values to whole steps."""
        safe = np.where(self.step > 0.0, self.step, 1.0)
        return np.where(self.step > 0.0, np.rint(values / safe) * safe, values)


def changed_values(
    draw: Draw, topic: str, begin_ns: int, size: float, transform: Callable[[Acting], Array], end_ns: int | None = None
) -> tuple[list[SampleBlock], Times]:
    """Blocks of a topic whose values from `begin_ns` (up to `end_ns`) went through `transform`; times stay."""
    blocks = draw.recording.blocks[topic]
    times, values = samples(blocks)
    acting = times >= begin_ns
    if end_ns is not None:
        acting &= times < end_ns
    if not acting.any():
        return blocks, draw.recording.arrivals[topic]
    first = int(np.argmax(acting))
    step = steps(draw.recording, topic, values.shape[1])
    subject = Acting(
        values=values[acting],
        seconds=np.asarray((times[acting] - begin_ns) * 1e-9, float),
        previous=values[max(first - 1, 0)],
        size=size,
        rng=draw.rng,
        recording=draw.recording,
        step=step,
        topic=topic,
    )
    new = values.copy()
    new[acting] = transform(subject)
    return with_values(blocks, new, acting), draw.recording.arrivals[topic]


def with_values(blocks: Sequence[SampleBlock], values: Array, acting: NDArray[np.bool_]) -> list[SampleBlock]:
    """The blocks with other values (n, k) where samples are acting (n,); untouched blocks are the same objects."""
    made, begin = [], 0
    touched = np.concatenate([[0], np.cumsum(acting)]).tolist()
    for block in blocks:
        end = begin + len(block.rows)
        if touched[end] > touched[begin]:
            rows = np.column_stack([block.rows[:, 0], values[begin:end]])
            made.append(SampleBlock(block.stamp_ns, block.names, rows))
        else:
            made.append(block)
        begin = end
    return made


def steps(recording: Recording, topic: str, columns: int) -> Array:
    """(columns,) step of a topic's readings."""
    if topic in recording.head_topics:
        return np.full(columns, recording.count)
    if topic == AUTOCOLLIMATOR:
        return np.full(columns, float(recording.stage["autocollimator"]["resolution"]))
    if topic in recording.probes:
        return np.full(columns, float(recording.probes[topic]["resolution"]))
    return np.zeros(columns)


def values_fault(
    name: str,
    sentence: str,
    who: str,
    transform: Callable[[Acting], Array],
    size: Size | None = None,
    *,
    when: str = "later",
    lasts: tuple[float, float] | None = None,
) -> Fault:
    """Fault that changes values of all topics of `who` in the same way.

    Args:
        name: of the fault.
        sentence: what it is.
        who: see `Draw.topics`.
        transform: from the acting samples to their new values.
        size: bounds of the size.
        when: see `Draw.begin_ns`.
        lasts: bounds in s of how long it acts; without, to the end.
    """
    bounds = size or Size()

    def act(draw: Draw) -> Change:
        topics = draw.topics(who)
        begin = draw.begin_ns(when)
        drawn = draw.sized(bounds)
        end = None if lasts is None else begin + round(draw.rng.uniform(*lasts) * 1e9)
        changed = {topic: changed_values(draw, topic, begin, drawn, transform, end) for topic in topics}
        return Change(changed, begin, drawn, bounds.unit, end)

    return Fault(name, sentence, who, act)


def blocks_from(blocks: Sequence[SampleBlock], begin_ns: int) -> int:
    """Index of the first block that is stamped, and holds samples, at or after `begin_ns` only."""
    for i, block in enumerate(blocks):
        first = block.stamp_ns + min(0, round(float(block.rows[0, 0]) * 1e9)) if len(block.rows) else block.stamp_ns
        if first >= begin_ns:
            return i
    return len(blocks)


def some_of(draw: Draw, candidates: NDArray[np.int64], share: float) -> NDArray[np.int64]:
    """A share of the candidates, at least one of them if there is one."""
    hit = draw.rng.uniform(size=len(candidates)) < share
    if len(hit):
        hit[draw.rng.integers(0, len(hit))] = True
    return candidates[hit]


def kept(recording: Recording, topic: str, keep: NDArray[np.bool_]) -> tuple[list[SampleBlock], Times]:
    """The blocks of a topic that are to be kept, by a mask (n,), and their arrivals."""
    blocks = recording.blocks[topic]
    return [blocks[i] for i in np.flatnonzero(keep)], recording.arrivals[topic][keep]


def until(recording: Recording, topic: str, begin_ns: int) -> tuple[list[SampleBlock], Times]:
    """The blocks of a topic that begin before `begin_ns`, and their arrivals."""
    n = blocks_from(recording.blocks[topic], begin_ns)
    return recording.blocks[topic][:n], recording.arrivals[topic][:n]


def stepped(recording: Recording, topic: str, size: float, begin: float) -> tuple[list[SampleBlock], Times]:
    """Blocks of a topic whose first value is off by a `size` from a time (s) on, and their arrivals."""
    blocks = []
    for block in recording.blocks[topic]:
        rows = block.rows.copy()
        rows[:, 1] += size * ((block.times_ns - recording.start_ns) * 1e-9 >= begin)
        blocks.append(SampleBlock(block.stamp_ns, block.names, rows))
    return blocks, recording.arrivals[topic]


def shifted(
    recording: Recording, topic: str, begin_ns: int, shift_ns: int, only: int | None = None, late: bool = False
) -> tuple[list[SampleBlock], Times]:
    """Blocks of a topic whose stamps are shifted: all from `begin_ns` on, or `only` so many.

    They arrive when they did or, if `late`, as much later.
    """
    blocks, arrivals = recording.blocks[topic], recording.arrivals[topic].copy()
    i = blocks_from(blocks, begin_ns)
    j = len(blocks) if only is None else min(i + only, len(blocks))
    moved = [SampleBlock(block.stamp_ns + shift_ns, block.names, block.rows) for block in blocks[i:j]]
    if late:
        arrivals[i:j] += max(shift_ns, 0)
        arrivals = np.maximum.accumulate(arrivals)
    return [*blocks[:i], *moved, *blocks[j:]], arrivals


def stamps_fault(
    name: str,
    sentence: str,
    who: str,
    size: Size,
    *,
    when: str = "either",
    only: int | None = None,
    late: bool = False,
    factor: float = 1.0,
) -> Fault:
    """Fault that shifts the stamps of whole blocks by its size in s times `factor`; see `shifted`."""

    def act(draw: Draw) -> Change:
        topics, begin, drawn = draw.topics(who), draw.begin_ns(when), draw.sized(size)
        shift = round(factor * drawn * 1e9)
        changed = {topic: shifted(draw.recording, topic, begin, shift, only, late) for topic in topics}
        return Change(changed, begin, drawn, "s")

    return Fault(name, sentence, who, act)


def registry(faults: Sequence[Fault]) -> dict[str, Fault]:
    """Faults by name.

    Raises:
        ValueError: two of them have one name.
    """
    table = {fault.name: fault for fault in faults}
    if len(table) != len(faults):
        raise ValueError("two faults have one name")
    return table
