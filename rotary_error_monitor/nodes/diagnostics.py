"""What a node says about its health on `/diagnostics` (REP 107), and the watches behind it: over streams and time."""

from __future__ import annotations

import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import IntEnum

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.serialization import deserialize_message
from std_msgs.msg import Header

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.signals.arrival import AHEAD_NS
from rotary_error_monitor.signals.blocks import NANOSECONDS, SampleBlock

STANDSTILL = 0.8
"""s of real time, a little less than a report takes: a simulation that is alive moves its clock many times in it."""

RATE_PERIOD = 0.5
"""s over which a rate is counted at least: a report may follow at once on another, when something has changed."""

SIMULATED_TOPICS = "simulated_topics"
"""Figure of a node's state: what of it is simulated, for whoever records it."""


class Level(IntEnum):
    """How bad it is, as REP 107 counts."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


@dataclass(frozen=True)
class Condition:
    """State of one part of a node: `what` it is, how bad, one sentence, and figures by name."""

    what: str
    level: Level
    message: str
    figures: Mapping[str, object] = field(default_factory=dict)


def diagnostic_array(stamp: Time, node: str, hardware: str, conditions: Iterable[Condition]) -> DiagnosticArray:
    """Message of a node's conditions, each named as `status_name` says."""
    return DiagnosticArray(
        header=Header(stamp=stamp),
        status=[
            DiagnosticStatus(
                level=bytes([condition.level]),
                name=status_name(f"{node}: {condition.what}"),
                message=condition.message,
                hardware_id=hardware,
                values=[KeyValue(key=key, value=_text(value)) for key, value in condition.figures.items()],
            )
            for condition in conditions
        ],
    )


def status_name(name: str) -> str:
    """Name of a status for what is named `<node>: <what>`, where either may be a path of ROS.

    Tools that show `/diagnostics` as a tree (rqt_robot_monitor, diagnostic_aggregator) take each `/` for a branch.
    """
    return name.lstrip("/").replace(" /", " ").replace("/", ".")


def simulation_figures(source: str, topics: Sequence[str]) -> dict[str, object]:
    """Figures that say that what a node publishes on its topics is simulated by a source."""
    return {"source": source, "simulated": "true", SIMULATED_TOPICS: ", ".join(topics)}


def simulated_topics(data: bytes) -> set[str]:
    """The topics that a node's message, as it is serialised, says are simulated.

    Raises:
        InputError: it is no such message.
    """
    if SIMULATED_TOPICS.encode() not in data:  # as of all nodes of a real cell: nothing is built for them
        return set()
    try:
        message = deserialize_message(data, DiagnosticArray)
    except RuntimeError as error:  # so rmw says that bytes are no message
        raise InputError(f"{len(data)} bytes are no message of diagnostics: {error}") from error
    told = (each.value for status in message.status for each in status.values if each.key == SIMULATED_TOPICS)
    return {topic for text in told for topic in text.split(", ")}


def life_condition(halted: str, origin: Mapping[str, object], *, active: bool) -> Condition:
    """Condition of a node's life cycle, with the figures of its `origin`; `halted` says why it stands, if it does."""
    if halted:
        return Condition("state", Level.ERROR, halted, origin)
    return Condition("state", *((Level.OK, "active") if active else (Level.WARN, "inactive")), origin)


def _text(value: object) -> str:
    return f"{value:.6g}" if isinstance(value, float) else str(value)


class ClockWatch:
    """Whether simulated time moves."""

    def __init__(self) -> None:
        self._moved = (0, 0.0)

    def trouble(self, now_ns: int) -> str:
        """What is wrong with `/clock`, which says `now_ns`, as far as successive calls tell; empty where nothing is."""
        now = time.monotonic()
        if now_ns != self._moved[0]:
            self._moved = now_ns, now
        if now_ns == 0:
            return "but nothing has come on /clock: time stands still"
        still = now - self._moved[1]
        return f"and nothing new has come on /clock for {still:.1f} s: time stands still" if still > STANDSTILL else ""


class RateMeter:
    """Counts what comes, and tells how much of it comes a second."""

    def __init__(self, began_ns: int) -> None:
        """Count from the present time (ns) on."""
        self._count = 0
        self._since_ns = began_ns
        self._rate: float | None = None

    def add(self, count: int = 1) -> None:
        """So many came."""
        self._count += count

    def rate(self, now_ns: int) -> float:
        """Rate in 1/s until now, since it was last told if that is `RATE_PERIOD` ago; else as it was told."""
        elapsed = (now_ns - self._since_ns) / NANOSECONDS
        if self._rate is not None and 0 <= elapsed < RATE_PERIOD:
            return self._rate
        rate = self._count / elapsed if elapsed > 0 else 0.0
        if elapsed >= RATE_PERIOD or elapsed < 0:
            self._rate, self._count, self._since_ns = rate if elapsed > 0 else None, 0, now_ns
        return rate


class StreamWatch:
    """Counts what arrives on one stream: rate, age, samples lost between blocks, blocks that came late.

    A sample counts as lost where the step between two blocks is wider than the stream's own period, so it needs no
    sequence number and works for any driver. Totals run since the start, the rate since the last report.

    Attributes:
        refused_samples: single samples that were not believed, by reason; whoever judges them sets it.
    """

    def __init__(
        self, what: str, late_after: float, stale_after: float, began_ns: int, *, outgoing: bool = False
    ) -> None:
        """Watch the stream called `what`.

        Args:
            what: its topic.
            late_after: age, s, from which what comes is late.
            stale_after: age of the last sample, s, from which the stream is stale.
            began_ns: the present time (ns).
            outgoing: whether it is the node's own.
        """
        self.what = what
        self._nothing = "nothing has been sent yet" if outgoing else "nothing has arrived yet"
        self.lost = 0
        self.late = 0
        self.refused = 0
        self.refused_samples: Mapping[str, int] = {}
        self.last_ns: int | None = None
        self._late_after_ns = round(late_after * NANOSECONDS)
        self._stale_after_ns = round(stale_after * NANOSECONDS)
        self._period = 0.0
        self._samples = RateMeter(began_ns)
        self._began_ns = began_ns
        self._seen = (0, 0, 0)
        self._seen_samples: Mapping[str, int] = {}
        self._reason = ""

    def observe(self, block: SampleBlock, now_ns: int) -> None:
        """Take note of a block that is there at `now_ns`."""
        times = block.times_ns
        count, first_ns, last_ns = len(times), int(times[0]), int(times[-1])
        if count > 1:
            self._period = (last_ns - first_ns) / (count - 1)
        if self.last_ns is not None and self._period > 0:
            self.lost += max(0, round((first_ns - self.last_ns) / self._period) - 1)
        self._samples.add(count - 1)
        self.observe_stamp(last_ns, now_ns)

    def observe_stamp(self, stamp_ns: int, now_ns: int) -> None:
        """Take note of a message that was measured at `stamp_ns`."""
        self._samples.add()
        self.late += now_ns - stamp_ns > self._late_after_ns
        if stamp_ns - now_ns > AHEAD_NS:  # nor does a stream that falls silent seem alive by a stamp in the future
            stamp_ns = now_ns
        self.last_ns = stamp_ns if self.last_ns is None else max(stamp_ns, self.last_ns)

    def refuse(self, reason: str) -> None:
        """Take note of a message that could not be used."""
        self.refused += 1
        self._reason = reason

    def is_stale(self, now_ns: int) -> bool:
        """Whether the last sample is older than the stream may become."""
        reference = self._began_ns if self.last_ns is None else self.last_ns
        return now_ns - reference > self._stale_after_ns

    def state(self, now_ns: int) -> str:
        """In a word how the stream is, for what is said at once when it changes; the rest is counted."""
        return "stale" if self.is_stale(now_ns) else "waited for" if self.last_ns is None else "alive"

    def report(self, now_ns: int) -> Condition:
        """Condition of the stream; what is new is so once."""
        age = None if self.last_ns is None else (now_ns - self.last_ns) / NANOSECONDS
        totals = (self.lost, self.late, self.refused)
        new = [now - before for now, before in zip(totals, self._seen, strict=True)]
        self._seen = totals
        samples = self._refused_anew()
        if age is None:
            level, message = (Level.ERROR if self.is_stale(now_ns) else Level.WARN), self._nothing
        elif self.is_stale(now_ns):
            level, message = Level.ERROR, f"stale: the last sample is {age:.3g} s old"
        elif any(new):
            level = Level.WARN
            message = f"{new[0]} samples lost, {new[1]} blocks late, {new[2]} messages refused since the last report"
        else:
            level, message = (Level.WARN if samples else Level.OK), "alive"
        if new[2]:
            message += f"; refused: {self._reason}"
        if samples:
            message += f"; samples refused: {samples}"
        figures = {
            "rate_hz": self._samples.rate(now_ns),
            "age_ms": "none" if age is None else age * 1e3,
            "lost_samples": self.lost,
            "late_blocks": self.late,
            "refused_messages": self.refused,
        }
        if self.refused_samples:
            figures["refused_samples"] = sum(self.refused_samples.values())
        return Condition(self.what, level, message, figures)

    def _refused_anew(self) -> str:
        """Samples that were refused since the last report, by their reason."""
        before, self._seen_samples = self._seen_samples, dict(self.refused_samples)
        new = {why: count - before.get(why, 0) for why, count in self.refused_samples.items()}
        return ", ".join(f"{count} {why}" for why, count in new.items() if count > 0)
