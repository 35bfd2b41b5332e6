"""The gap monitor: diagnoses the last turns of the stage again and again, beside everything that is live.

ros2 run rotary_error_monitor gap_monitor --ros-args -p stage:=my_stage.yaml -p folder:=gaps
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from rotary_error_monitor.description.settings import Setting
from rotary_error_monitor.description.streams import COMMAND, FORCE, OWN_REFERENCE, TEMPERATURE, TWO_AXIS
from rotary_error_monitor.description.wire import Topic
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.gap.loading import load_twin
from rotary_error_monitor.kinds.stage.admission import SHORTEST
from rotary_error_monitor.nodes.diagnosis_process import DiagnosisEnd, DiagnosisProcess
from rotary_error_monitor.nodes.diagnostics import Condition, Level, StreamWatch
from rotary_error_monitor.nodes.managed import ManagedNode
from rotary_error_monitor.nodes.process import program
from rotary_error_monitor.pipeline.recent_turns import RecentTurns
from rotary_error_monitor.resources import config
from rotary_error_monitor.signals.blocks import NANOSECONDS, SampleBlock
from rotary_error_monitor.twin.recording import streams_with

_DAY = 86_400.0
_LOOK_PERIOD = 0.2
_STALE_AFTER = 1.0
_SPAN = 0.1
_STALE_PERIODS = 3.0
_FEWEST_TURNS = 1.0
"""Turns below which a verdict would tell less than the one before: orders look like one another on an arc."""

_SHORTEST = 1.25 * SHORTEST
"""Time, s, that is kept at least: streams begin and end a little apart."""

_SLOW = 10.0
"""Silence, s, after which a thermometer counts as stale."""

_HELPFUL = {OWN_REFERENCE: 1.0, FORCE: 1.0, TEMPERATURE: _SLOW}
"""Streams that a stage need not have, and the silence, s, after which they count as stale."""


@dataclass(frozen=True)
class _Recording:
    """What is diagnosed: turns, duration in s, timestamp (ns) of its end."""

    turns: float = 0.0
    duration: float = 0.0
    end_ns: int = 0


@dataclass(frozen=True)
class _Verdict:
    """A verdict in a sentence and as `diagnosis.json`, how long it took (s), and what it is about."""

    sentence: str
    content: Mapping[str, Any]
    duration: float
    recording: _Recording

    @property
    def names(self) -> tuple[str, ...]:
        """What is concluded, without numbers."""
        causes = (f"{row['effect']} {row['location']}".strip() for row in self.content["causes"])
        return (str(self.content["verdict"]), *causes)

    def figures(self) -> dict[str, object]:
        """What people and programs want to know beside the sentence."""
        gap, where = self.content["gap"], self.content["where"]
        causes = (
            f"{row['effect']} {row['location']}".strip() + f" ({row['probability']:.0%})"
            for row in self.content["causes"]
        )
        return {
            "verdict": self.content["verdict"],
            "causes": ", ".join(causes) or "none",
            "gap_before": float(gap["before"]),
            "gap_after": float(gap["after"]),
            "noise_floor": float(gap["noise_floor"]),
            "shrink": float(gap["shrink"]),
            "where": f"{where[0]['channel']}: {where[0]['pattern']}" if where else "nowhere",
            "notes": "; ".join(self.content["remarks"]) or "none",
            "turns": self.recording.turns,
            "duration_s": self.recording.duration,
            "took_s": self.duration,
        }


class GapMonitor(ManagedNode):
    """Holds what the stage does against its twin, and says on `/diagnostics` where, why and how far they part.

    The diagnosis runs in a process of its own. Where that dies, or finds that the recording cannot be diagnosed, the
    node says so, keeps the last verdict with its age, and tries again after the period.
    """

    settings = (
        Setting("turns", 25, "turns of the stage that are diagnosed, counted by the command's way", (1, 100_000)),
        Setting("longest", 120.0, "longest time that is kept however slowly the stage turns, s", (20.0, 3600.0)),
        Setting(
            "rate", 250.0, "samples a second that are diagnosed; faster streams are thinned to it, Hz", (50.0, 1e6)
        ),
        Setting("most_samples", 2_000_000, "samples of each stream that are kept at most", (1000, 1_000_000_000)),
        Setting("period", 60.0, "time from the start of a diagnosis to that of the next, s", (1.0, _DAY)),
        Setting("patience", 600.0, "longest time that a diagnosis may take, s", (1.0, _DAY)),
        Setting(
            "false_alarms",
            0.01,
            "chance that a gap is seen on a day without one; each diagnosis of the day gets its share",
            (1e-6, 0.5),
        ),
        Setting("effects", "", "Python files with effects of your own, joined by ':'; they run as code", at_start=True),
        Setting("folder", "", "folder that keeps recording and report of the latest diagnosis; empty keeps nothing"),
        Setting("max_age", 2.0, "samples older than this at their arrival are dropped, s", (0.01, 3600.0)),
    )

    def open(self) -> None:
        """Load the twin once, so that what is wrong with it is said at the start, and listen to the stage."""
        twin = Path(self.setting("stage") or config("stage.yaml"))
        effects = [Path(name) for name in self.setting("effects").split(os.pathsep) if name]
        load_twin(twin, effects)
        self._process = DiagnosisProcess(
            self.contract,
            ["--twin", str(twin), "--false-alarms", repr(self._false_alarms()), *_repeated("--effects", effects)],
            self.setting("patience"),
            self._kept_folder(),
        )
        needed, _ = streams_with(tuple(self.stage.azimuths), set(TWO_AXIS) - set(self.stage.two_axis))
        topics = {stream: self.wire.of_stream(stream) for stream in (*needed, *_HELPFUL, *self.stage.listed)}
        self._recent = RecentTurns(
            {stream: topic.columns for stream, topic in topics.items()},
            COMMAND,
            self.setting("turns"),
            _SHORTEST,
            self.setting("longest"),
            self.setting("most_samples"),
            self.setting("rate"),
        )
        self._max_age_ns = round(self.setting("max_age") * NANOSECONDS)
        late_after, now_ns = self.setting("max_age"), self.now_ns()
        slow = {stream: _SLOW for stream, each in self.stage.inputs.items() if each.is_slow}
        stale_after = _HELPFUL | slow
        watches = {
            stream: StreamWatch(topic.name, late_after, stale_after.get(stream, _STALE_AFTER), now_ns)
            for stream, topic in topics.items()
        }
        self._needed = {stream: watches[stream] for stream in needed}
        self._helpful = {stream: watch for stream, watch in watches.items() if stream not in needed}
        self._due = time.monotonic()
        self._under_way = _Recording()
        self._verdict: _Verdict | None = None
        self._failure_text = ""
        self._failures = 0
        for stream, topic in topics.items():
            self.listen_to_blocks(topic, self._receiver(stream, topic, watches[stream]))
        self.every(_LOOK_PERIOD, self._look_after)

    def release(self) -> None:
        """End the diagnosis that is under way."""
        process = getattr(self, "_process", None)
        if process is not None:
            process.stop()

    def conditions(self, now_ns: int) -> list[Condition]:
        """Each stream, how it goes with the diagnosis, and the last verdict."""
        # one that the stage lists is expected; of what has a topic whether a stage has it or not, silence tells nothing
        helpful = [
            watch.report(now_ns)
            for stream, watch in self._helpful.items()
            if stream in self.stage.listed or watch.last_ns is not None
        ]
        return [
            *(watch.report(now_ns) for watch in self._needed.values()),
            *(replace(condition, level=min(condition.level, Level.WARN)) for condition in helpful),
            self._diagnosis_condition(now_ns),
            self._verdict_condition(now_ns),
        ]

    def news(self, now_ns: int) -> Hashable:
        """Which streams come, whether the last diagnosis failed, and what it concluded."""
        states = [watch.state(now_ns) for watch in (*self._needed.values(), *self._helpful.values())]
        return *states, self._failure_text, None if self._verdict is None else self._verdict.names

    def _kept_folder(self) -> Path | None:
        name = self.setting("folder")
        try:
            return _made(Path(name)) if name else None
        except OSError as error:
            raise InputError(f"parameter 'folder': {name} cannot be made ({error}); give another path") from error

    def _false_alarms(self) -> float:
        """Chance for one diagnosis: all of a day together have the parameter's."""
        return float(-math.expm1(math.log1p(-self.setting("false_alarms")) * min(self.setting("period") / _DAY, 1.0)))

    def _receiver(self, stream: str, topic: Topic, watch: StreamWatch) -> Callable[[SampleBlock], None]:
        def receive(block: SampleBlock) -> None:
            if self.listening.is_shared(topic.name):
                watch.refuse("several publishers share the topic")
                raise InputError(self.listening.publishers_of(topic.name))
            now_ns = self.now_ns()
            watch.observe(block, now_ns)
            if abs(now_ns - block.newest_ns) > self._max_age_ns:
                limit = self._max_age_ns / NANOSECONDS
                watch.refuse(f"more than {limit:g} s from now; are the clocks of all computers alike?")
                return
            self._recent.push(stream, block)

        return receive

    def _look_after(self) -> None:
        """Take the outcome of a diagnosis that has ended; start the next one when it is due."""
        outcome = self._process.take()
        if outcome is not None:
            self._note(outcome)
        if time.monotonic() >= self._due and not self._process.is_running and not self._hindrance(self.now_ns()):
            self._due = time.monotonic() + self.setting("period")
            self._under_way = _Recording(self._recent.turns, self._recent.duration, self._recent.newest_ns or 0)
            self._process.start(self._recent.blocks(_SPAN))

    def _note(self, outcome: DiagnosisEnd) -> None:
        if outcome.content is None:
            self._failure_text = outcome.sentence
            self._failures += 1
            self.get_logger().error(outcome.sentence)
            return
        self._failure_text = ""
        verdict = _Verdict(outcome.sentence, outcome.content, outcome.duration, self._under_way)
        if self._verdict is None or self._verdict.names != verdict.names:
            self.get_logger().info(verdict.sentence)
        self._verdict = verdict

    def _hindrance(self, now_ns: int) -> str:
        """Why no diagnosis can start now, beside the time of the next one; empty if none."""
        if not self.active:
            return "inactive"
        silent = [w.what for w in self._needed.values() if w.last_ns is None or w.is_stale(now_ns)]
        if silent:
            return f"no samples on {', '.join(silent)}"
        recent, turns = self._recent, self.setting("turns")
        if recent.is_full and recent.turns < _FEWEST_TURNS:
            return f"the stage turned only {recent.turns:.2g} times in the last {recent.duration:.0f} s"
        return "" if recent.is_full else f"{recent.turns:.1f} of {turns} turns in {recent.duration:.0f} s so far"

    def _diagnosis_condition(self, now_ns: int) -> Condition:
        process, hindrance = self._process, self._hindrance(now_ns)
        figures = {
            "turns": self._recent.turns,
            "duration_s": self._recent.duration,
            "late_blocks": self._recent.late,
            "without_verdict": self._failures,
            "process": process.pid or "none",
        }
        wait = f"in {max(self._due - time.monotonic(), 0.0):.0f} s"
        if process.is_running:
            state = f"under way for {process.elapsed:.1f} s"
        elif hindrance:
            state = f"waiting: {hindrance}"
        else:
            state = f"the next one {wait}"
        silent = any(watch.is_stale(now_ns) for watch in self._needed.values())
        level = Level.ERROR if self._failure_text or silent else Level.OK
        again = f"{self._failure_text}; tried again {wait}; " if self._failure_text else ""
        return Condition("diagnosis", level, again + state, figures)

    def _verdict_condition(self, now_ns: int) -> Condition:
        verdict = self._verdict
        if verdict is None:
            return Condition("verdict", Level.OK, "none yet")
        age = (now_ns - verdict.recording.end_ns) / NANOSECONDS
        figures = {**verdict.figures(), "age_s": age}
        if age > _STALE_PERIODS * max(self.setting("period"), verdict.duration) + self.setting("longest"):
            return Condition("verdict", Level.STALE, f"{age:.0f} s old: {verdict.sentence}", figures)
        level = Level.OK if verdict.content["verdict"] == "no_gap" else Level.WARN
        return Condition("verdict", level, verdict.sentence, figures)


def _made(folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def _repeated(option: str, values: Sequence[Path]) -> list[str]:
    return [part for value in values for part in (option, str(value))]


main = program(GapMonitor, "gap_monitor")

if __name__ == "__main__":
    raise SystemExit(main())
