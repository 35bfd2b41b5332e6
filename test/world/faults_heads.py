"""Faults of read heads and of their driver."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.signals.blocks import SampleBlock

from .fault import (
    SECOND,
    Acting,
    Change,
    Draw,
    Fault,
    Size,
    Topics,
    blocks_from,
    changed_values,
    first_ns,
    shifted,
    some_of,
    stamps_fault,
    until,
    values_fault,
)
from .recording import samples

Array = NDArray[np.float64]
TURN = 2.0 * np.pi
DEGREE = np.pi / 180.0
ARCSECOND = DEGREE / 3600.0
DAY = 86400.0


def turned_by(acting: Acting) -> Array:
    """The angle off by whole turns."""
    values = acting.values.copy()
    values[:, 0] += TURN * acting.size
    return acting.stepped(values)


def wrapped(centred: bool) -> Callable[[Acting], Array]:
    """The angle within a turn: in (-pi, pi] if centred, else in [0, 2 pi)."""

    def transform(acting: Acting) -> Array:
        values = acting.values.copy()
        angle = values[:, 0]
        values[:, 0] = np.pi - np.mod(np.pi - angle, TURN) if centred else np.mod(angle, TURN)
        return acting.stepped(values)

    return transform


def in_unit(unit: float) -> Callable[[Acting], Array]:
    """Values in another unit than the radian."""
    return lambda acting: acting.values / unit


def stuck(acting: Acting) -> Array:
    """The value before, again and again."""
    return np.tile(acting.previous, (len(acting.values), 1))


def jumped(acting: Acting) -> Array:
    """Off by counts."""
    return acting.stepped(acting.values + acting.size * acting.step)


def _jumped_lines(acting: Acting) -> Array:
    """Off by lines of the graduation."""
    counts = acting.recording.stage["encoder"]["counts_per_line"]
    return acting.stepped(acting.values + acting.size * counts * acting.step)


def _drifted(acting: Acting) -> Array:
    """Further off with time."""
    return acting.stepped(acting.values + acting.size * acting.seconds[:, None])


def _noisy(acting: Acting) -> Array:
    """Noise of so many times the stated size, in all."""
    std = acting.recording.stage["encoder"]["noise"] or acting.recording.count
    extra = std * np.sqrt(max(acting.size**2 - 1.0, 0.0))
    return acting.stepped(acting.values + extra * acting.rng.standard_normal(acting.values.shape))


def some(acting: Acting, value: float, signed: bool) -> Array:
    """Some samples, a share of 0.1 to 100 %, are `value`."""
    n = len(acting.values)
    share = 10.0 ** acting.rng.uniform(-3.0, 0.3)
    hit = acting.rng.uniform(size=n) < share
    hit[acting.rng.integers(0, n)] = True
    values = acting.values.copy()
    values[hit] = value * (acting.rng.choice((-1.0, 1.0), (int(hit.sum()), 1)) if signed else 1.0)
    return values


def wraps(name: str, sentence: str, who: str, centred: bool) -> Fault:
    """Fault of a driver that wraps; it begins where the first value changes."""

    def act(draw: Draw) -> Change:
        begin = draw.begin_ns("start")
        changed = {topic: changed_values(draw, topic, begin, TURN, wrapped(centred)) for topic in draw.topics(who)}
        firsts = []
        for topic, (blocks, _) in changed.items():
            times, before = samples(draw.recording.blocks[topic])
            differs = np.flatnonzero((samples(blocks)[1] != before).any(axis=1))
            firsts += [int(times[differs[0]])] if len(differs) else []
        return Change(changed, min(firsts, default=begin), TURN, "rad")

    return Fault(name, sentence, who, act)


def _restarts(name: str, sentence: str, who: str) -> Fault:
    """Fault of a driver that starts again, after a turn if there is one, and counts from 0."""

    def act(draw: Draw) -> Change:
        topics, begin = draw.topics(who), draw.begin_ns("later")
        times, values = samples(draw.recording.blocks[topics[0]])
        after = np.flatnonzero(np.abs(values[:, 0] - values[0, 0]) >= TURN)
        if draw.begin is None and len(after):
            begin = int(times[after[int(draw.rng.uniform(0.0, 0.5) * len(after))]])
        pause = draw.sized(Size(0.1, 2.0))
        changed: Topics = {}
        for topic in topics:
            again = begin + round(pause * SECOND)
            counted = changed_values(draw, topic, again, 1.0, lambda a: a.stepped(a.values - a.values[0]))
            i, j = (blocks_from(counted[0], ns) for ns in (begin, again))
            changed[topic] = ([*counted[0][:i], *counted[0][j:]], np.delete(counted[1], np.s_[i:j]))
        return Change(changed, begin, pause, "s")

    return Fault(name, sentence, who, act)


def _swapped(draw: Draw) -> Change:
    """Each of two heads under the name of the other."""
    a, b = draw.rng.choice(draw.recording.head_topics, 2, replace=False).tolist()
    blocks, arrivals = draw.recording.blocks, draw.recording.arrivals
    changed = {a: (blocks[b], arrivals[b]), b: (blocks[a], arrivals[a])}
    return Change(changed, first_ns(draw.recording), 2.0, "heads")


def _two_publishers(draw: Draw) -> Change:
    """The blocks of two heads under one name; the other name may stay or be gone."""
    names = draw.recording.head_topics
    a = draw.one_of(names)
    b = str(draw.rng.choice([name for name in names if name != a]))
    blocks = [*draw.recording.blocks[a], *draw.recording.blocks[b]]
    arrivals = np.concatenate([draw.recording.arrivals[a], draw.recording.arrivals[b]])
    order = np.argsort(arrivals, kind="stable")
    changed: Topics = {a: ([blocks[i] for i in order], arrivals[order])}
    if draw.rng.uniform() < 0.5:
        changed[b] = ([], np.zeros(0, np.int64))
    return Change(changed, first_ns(draw.recording), 2.0, "heads", detail={"other": b})


def _copied(draw: Draw) -> Change:
    """One head gives what another one does: two nodes read the same device."""
    who, begin = draw.one_of(draw.recording.head_topics), draw.begin_ns("either")
    other = str(draw.rng.choice([name for name in draw.recording.head_topics if name != who]))
    blocks, arrivals = draw.recording.blocks, draw.recording.arrivals
    i, j = (blocks_from(blocks[topic], begin) for topic in (who, other))
    arrived = np.maximum.accumulate(np.concatenate([arrivals[who][:i], arrivals[other][j:]]))
    changed = [*blocks[who][:i], *blocks[other][j:]]
    return Change({who: (changed, arrived)}, begin, 1.0, "heads", detail={"other": other})


def dies(name: str, sentence: str, who: str, when: str) -> Fault:
    """Fault of streams that end, or never begin."""

    def act(draw: Draw) -> Change:
        topics, begin = draw.topics(who), draw.begin_ns(when)
        return Change({topic: until(draw.recording, topic, begin) for topic in topics}, begin, 1.0, "1")

    return Fault(name, sentence, who, act)


def _two_die(opposed: bool) -> Callable[[Draw], Change]:
    """Two heads that end, at once or the second some time later."""

    def act(draw: Draw) -> Change:
        first, second = draw.neighbours(opposed)
        begin = draw.begin_ns("later")
        left = draw.recording.start_ns + draw.recording.duration * 1e9 - begin
        later = begin + round(draw.rng.choice((0.0, draw.rng.uniform(0.0, 0.5))) * left)
        changed = {first: until(draw.recording, first, begin), second: until(draw.recording, second, later)}
        return Change(changed, begin, 2.0, "heads", detail={"second_topic": second, "second_begin_ns": later})

    return act


def _dies_then_jumps(counts: int) -> Fault:
    """Fault of a dead head, followed by a jump of another."""

    def act(draw: Draw) -> Change:
        dead = draw.one_of(draw.recording.head_topics)
        other = str(draw.rng.choice([name for name in draw.recording.head_topics if name != dead]))
        begin = draw.begin_ns("later")
        left = draw.recording.start_ns + draw.recording.duration * 1e9 - begin
        later = begin + round(draw.rng.uniform(0.2, 0.7) * left)
        size = draw.sized(Size(counts, signed=True))
        changed = {
            dead: until(draw.recording, dead, begin),
            other: changed_values(draw, other, later, size, jumped),
        }
        return Change(changed, begin, size, "counts", detail={"second_topic": other, "second_begin_ns": later})

    sentence = f"One head dies, and later another one is off by {counts} counts from a time on."
    return Fault(f"head_dead_then_other_jumps_{counts}", sentence, "two heads", act)


def _times_fall(back: tuple[float, float]) -> Callable[[Draw], Change]:
    """Some samples are stamped so many sample intervals before the one before them."""

    def act(draw: Draw) -> Change:
        topic, begin = draw.topics("head")[0], draw.begin_ns("either")
        share = draw.sized(Size(1e-3, 1.0))
        blocks = draw.recording.blocks[topic]
        times, _ = samples(blocks)
        interval = float(np.median(np.diff(times)))
        hit = some_of(draw, np.flatnonzero(times >= begin)[1:], share)
        for i in hit:
            times[i] = times[i - 1] - round(interval * draw.rng.uniform(*back))
        changed, first, touched = list(blocks), 0, set(hit.tolist())
        for n, block in enumerate(blocks):
            last = first + len(block.rows)
            if not touched.isdisjoint(range(first, last)):
                rows = block.rows.copy()
                rows[:, 0] = (times[first:last] - block.stamp_ns) * 1e-9
                changed[n] = SampleBlock(block.stamp_ns, block.names, rows)
            first = last
        return Change({topic: (changed, draw.recording.arrivals[topic])}, begin, share, "share of samples")

    return act


def _before_epoch(draw: Draw) -> Change:
    """Stamps of 1969, of all blocks from a time on or of one."""
    topic, begin = draw.topics("head")[0], draw.begin_ns("either")
    before = draw.sized(Size(1.0, 300.0 * DAY))
    only = None if draw.rng.uniform() < 0.5 else 1
    last = draw.recording.start_ns + round(draw.recording.duration * 1e9)
    changed = shifted(draw.recording, topic, begin, -last - round(before * 1e9), only)
    return Change({topic: changed}, begin, before, "s before 1970")


def _turns() -> list[Fault]:
    """Counts that are off by whole turns, wrapped or begun again."""
    who = {"head": "One head is", "heads": "All heads are", "command": "The command is"}
    driver = {"head": "The driver of one head", "heads": "The driver of all heads", "command": "The controller"}
    size = Size(0.6, 5.4, "turns", signed=True, whole=True)
    faults = []
    for w, text in who.items():
        since = (("start", "from the start"), ("later", "from a time on"))
        faults += [
            values_fault(f"{w}_turns_{t}", f"{text} off by whole turns {said}.", w, turned_by, size, when=t)
            for t, said in since
        ]
    for w, text in driver.items():
        faults.append(wraps(f"{w}_wraps_0_2pi", f"{text} wraps the angle into [0, 2 pi).", w, False))
        faults.append(wraps(f"{w}_wraps_pm_pi", f"{text} wraps the angle into (-pi, pi].", w, True))
    for w in ("head", "heads"):
        faults.append(_restarts(f"{w}_restarted", f"{driver[w]} is started again and counts from 0.", w))
    return faults


def _units() -> list[Fault]:
    """Other units than the radian."""
    who = {
        "head": "One head gives",
        "heads": "All heads give",
        "autocollimator": "The autocollimator gives",
        "command": "The command gives",
    }
    units = {"degrees": DEGREE, "arcseconds": ARCSECOND}
    return [
        values_fault(
            f"{w}_{unit}", f"{text} {unit} instead of radians.", w, in_unit(value), Size(1.0 / value), when="start"
        )
        for w, text in who.items()
        for unit, value in units.items()
    ]


def _jumps() -> list[Fault]:
    """Counts lost or won."""
    faults = [
        values_fault(
            f"head_jumps_{n}", f"One head is off by {n} counts from a time on.", "head", jumped,
            Size(n, unit="counts", signed=True),
        )
        for n in (1, 2, 10, 100)
    ]  # fmt: skip
    line = Size(1.0, unit="lines", signed=True)
    text = "One head is off by a line of the graduation from a time on."
    return [*faults, values_fault("head_jumps_line", text, "head", _jumped_lines, line)]


def _values() -> list[Fault]:
    """Values that are no readings."""
    table = {"nan": np.nan, "inf": np.inf, "1e30": 1e30, "1e300": 1e300}

    def transform(value: float) -> Callable[[Acting], Array]:
        return lambda acting: some(acting, value, not np.isnan(value))

    return [
        values_fault(f"head_{name}", f"Some samples of one head are {name}.", "head", transform(value), when="either")
        for name, value in table.items()
    ]


def _future() -> list[Fault]:
    """Stamps of the future."""
    spans = {"10ms": 0.01, "1s": 1.0, "1h": 3600.0, "365d": 365.0 * DAY}
    faults = [
        stamps_fault(f"head_future_{name}", f"One head is stamped {name} ahead.", "head", Size(shift))
        for name, shift in spans.items()
    ]
    text = "One block of a head is stamped 10 ms to 365 days ahead."
    return [*faults, stamps_fault("head_future_once", text, "head", Size(0.01, 365.0 * DAY), when="later", only=1)]


HEAD_FAULTS: list[Fault] = [
    *_turns(),
    *_units(),
    Fault("head_copied", "One head gives what another one does: two nodes read the same device.", "head", _copied),
    Fault("heads_swapped", "Each of two heads has the name of the other.", "two heads", _swapped),
    Fault("head_two_publishers", "Blocks of two heads come under one name.", "two heads", _two_publishers),
    dies("head_dead_later", "One head falls silent.", "head", "later"),
    dies("head_dead_start", "One head is silent from the start.", "head", "start"),
    values_fault("head_stuck", "One head repeats a value under fresh stamps.", "head", stuck),
    *_jumps(),
    values_fault("head_drifts", "One head drifts.", "head", _drifted, Size(1e-6, 1e-3, "rad/s", signed=True)),
    values_fault("head_noisy", "One head is noisier than stated.", "head", _noisy, Size(3.0, 1000.0, "times")),
    *_values(),
    values_fault("head_reversed", "One head counts backwards.", "head", lambda a: -a.values, when="start"),
    stamps_fault("head_late", "The values of one head are old at their stamps.", "head", Size(1e-3, 0.05), late=True),
    Fault("head_time_equal", "Some samples of a head have the time of the one before.", "head", _times_fall((0, 0))),
    Fault("head_time_falls", "Some samples of a head are before the one before.", "head", _times_fall((0.2, 3.0))),
    *_future(),
    Fault("head_1969", "One head has stamps of 1969.", "head", _before_epoch),
    Fault("two_heads_dead_opposed", "Two opposed heads fall silent.", "two heads", _two_die(True)),
    Fault("two_heads_dead_neighbours", "Two neighbouring heads fall silent.", "two heads", _two_die(False)),
    *[_dies_then_jumps(counts) for counts in (1, 10, 100)],
]
