"""A mock cell of processes into which faults are put, and the criterion that all of them are judged by.

From 0.1 s after a fault has begun, what is published is right within six of its stated standard deviations, or
corrections are held and that is said within a second; a second after its end all is published and right again.
"""

from __future__ import annotations

import os
import re
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import dataclass, field

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped
from sensor_msgs.msg import JointState, PointCloud2

from faults.live.other_programs import Lost, lost_time
from faults.live.truth import Judged, Truth
from rotary_error_monitor.codec.cdr_blocks import BlockDecoder
from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.nodes import messages
from rotary_error_monitor.nodes.diagnostics import status_name
from rotary_error_monitor.nodes.qos import profile
from rotary_error_monitor.plant.motion import reversing_motion
from rotary_error_monitor.signals.blocks import SampleBlock
from rotary_error_monitor.sources.mock import MockSettings, mock_stage
from rotary_error_monitor.testing import Cell, NodeProcess

HEADS = ("a", "b", "c", "d")
NAMES = (
    *(f"encoder_head_{head}" for head in HEADS),
    "autocollimator",
    "mock_controller",
    "error_estimator",
    "compensation",
)
MACHINE = "xyzac_trt"
SPEEDS = [3.0, 6.0]
LONGEST_AT_ONE_SPEED = max(segment.duration for segment in reversing_motion(SPEEDS).segments)
"""Time, s, until the stage changes its speed, at most."""

PERIOD = 0.01
"""Distance of two estimates, s."""

ALL_STREAMS = 0b111111
ALL_COMPONENTS = 0b111011

AHEAD_NS = 100_000_000
"""What is stamped later than this from now was on its way when a clock was set back, ns."""

SETTLING_NS = 100_000_000
MOST_WRONG = 0.002
"""Part of the ticks of a window that may be off by more than six standard deviations."""

SAID_WITHIN = 1.0
RIGHT_WITHIN = 1.0

DISCOVERY = 4.0
"""Longest time in which the middleware finds a new process, s: it announces itself within half a second and then every
three."""

OWN: dict[str, dict[str, object]] = {
    "mock_controller": {"machine": MACHINE, "rate": 500.0},
    "autocollimator": {"source": "mock", "rate": 500.0},
    "error_estimator": {"period": PERIOD},
    "compensation": {"machine": MACHINE, "correction_period": 0.02},
    **{f"encoder_head_{head}": {"source": "mock", "rate": 500.0} for head in HEADS},
}
"""Parameters of the processes: rates that leave a loaded computer some room."""

_ACTIVE = re.compile(r"\[(\d+)\.(\d+)\] \[[^\]]*\]: active$", re.MULTILINE)


@dataclass(frozen=True)
class Statement:
    """One status of the diagnostics, and when it was made (ns)."""

    stamp_ns: int
    name: str
    level: int
    message: str


@dataclass
class Heard:
    """What went out of the cell, in the order of its arrival."""

    motion: list[SampleBlock] = field(default_factory=list)
    offsets: list[SampleBlock] = field(default_factory=list)
    corrections: list[tuple[int, dict[str, float]]] = field(default_factory=list)
    before: list[tuple[int, object]] = field(default_factory=list)
    after: list[tuple[int, object]] = field(default_factory=list)
    said: list[Statement] = field(default_factory=list)


class LiveCell:
    """Eight processes, in a namespace if one is given, and all that they publish."""

    def __init__(
        self,
        cell: Cell,
        seed: int,
        namespace: str = "",
        clock: Callable[[], int] = time.time_ns,
        before: int = 3_000_000_000,
    ) -> None:
        """Listen; `start_all` starts the processes.

        Args:
            cell: to work in.
            seed: of the mock stage.
            namespace: of the processes; empty for none.
            clock: what the processes take for the time, ns.
            before: how long ago the mock stage began, ns.
        """
        self.cell = cell
        self.clock = clock
        self.namespace = namespace
        self.wire = cell.wire.within(namespace or "/")
        self.epoch_ns = clock() - before
        self.mock: dict[str, object] = {
            "mock.seed": seed, "mock.epoch": self.epoch_ns, "mock.speeds": SPEEDS, "block_period": 0.02
        }  # fmt: skip
        settings = MockSettings(seed, self.epoch_ns, SPEEDS, rate=500.0)
        self.plant = mock_stage(load_stage(), settings)
        self.truth = Truth(self.plant, load_machine(MACHINE))
        self.processes: dict[str, NodeProcess] = {}
        self.heard = Heard()
        self._listen()

    # Processes.

    def start(self, name: str, **parameters: object) -> NodeProcess:
        """Start a process of the cell, anew where it has ended."""
        executable = "encoder_head" if name.startswith("encoder_head") else name
        own = OWN[name] | (self.mock if name not in ("error_estimator", "compensation") else {}) | parameters
        place = ["-r", f"__ns:={self.namespace}"] if self.namespace else []
        process = self.cell.start(executable, name, place, **own)
        self.processes[name] = process
        return process

    def start_all(self, **parameters: object) -> None:
        """Start all processes and wait until they correct."""
        for name in NAMES:
            self.start(name, **parameters)
        self.wait_until_all_is_well(self.clock())

    def kill(self, name: str) -> None:
        """End a process with no time for a last word."""
        process = self.processes[name]
        process.send(signal.SIGKILL)
        process.wait()

    def make_whole(self) -> None:
        """Start what has ended and let go on what was stopped, where a test broke off."""
        for name, process in self.processes.items():
            if process.exit_code is None:
                process.go_on()
            else:
                self.start(name)

    def active_ns(self, name: str) -> int:
        """When a process that was started said that it is active, timestamp (ns) of the system."""
        process = self.processes[name]
        self.cell.wait_until(lambda: _ACTIVE.search(process.output) is not None, f"{name} to be active")
        found = _ACTIVE.search(process.output)
        assert found is not None
        return int(found[1]) * 10**9 + int(found[2])

    # Waiting.

    def wait(self, condition: Callable[[], bool], what: str) -> None:
        """Let everything run until the condition holds."""
        self.cell.wait_until(condition, what)

    def let_run(self, duration: float) -> None:
        """Let everything run for a while."""
        self.cell.spin_for(duration)

    def complete_ns(self, since_ns: int) -> int | None:
        """Stamp of the first estimate after `since_ns` that uses all streams and lacks nothing."""
        until_ns = self.clock() + AHEAD_NS
        for block in self.heard.motion:
            if block.newest_ns < since_ns:
                continue
            full = (block.column("streams") == ALL_STREAMS) & (block.column("observable") == ALL_COMPONENTS)
            full &= (block.times_ns >= since_ns) & (block.times_ns <= until_ns)
            if full.any():
                return int(block.times_ns[full][0])
        return None

    def corrected_ns(self, since_ns: int) -> int | None:
        """Stamp of the first correction after `since_ns`."""
        until_ns = self.clock() + AHEAD_NS
        return next((stamp for stamp, _ in self.heard.corrections if since_ns <= stamp <= until_ns), None)

    def wait_until_all_is_well(self, since_ns: int) -> int:
        """Wait for complete estimates and corrections that are right; when both were there, timestamp (ns)."""
        self.wait(lambda: self.complete_ns(since_ns) is not None, "a complete estimate")
        self.wait(lambda: self.corrected_ns(since_ns) is not None, "a correction")
        return max(self.complete_ns(since_ns) or 0, self.corrected_ns(since_ns) or 0)

    def said(self, name: str, since_ns: int, *words: str, least: int = 1) -> Statement | None:
        """First statement after `since_ns` that holds all of the words, of at least that level."""
        return next(self._statements(name, since_ns, words, least), None)

    def last_said_ns(self, name: str, since_ns: int, *words: str) -> int:
        """Timestamp (ns) of the last such statement of a warning or more; `since_ns` where there is none."""
        return max((each.stamp_ns for each in self._statements(name, since_ns, words, 1)), default=since_ns)

    def _statements(self, name: str, since_ns: int, words: tuple[str, ...], least: int) -> Iterator[Statement]:
        name = status_name(f"{self.namespace}/{name}")
        for each in self.heard.said:
            fits = each.stamp_ns >= since_ns and each.name == name and each.level >= least
            if fits and all(word in each.message for word in words):
                yield each

    def has_said(self, name: str, since_ns: int, *words: str) -> bool:
        """Whether there is such a statement."""
        return self.said(name, since_ns, *words) is not None

    def wait_for_word(self, name: str, since_ns: int, *words: str, least: int = 1) -> Statement:
        """Wait for such a statement."""
        self.wait(lambda: self.said(name, since_ns, *words, least=least) is not None, f"'{name}' to say {words}")
        said = self.said(name, since_ns, *words, least=least)
        assert said is not None
        return said

    # Judging.

    def judge(self, since_ns: int, until_ns: int | None = None) -> None:
        """All that was published with stamps from `since_ns` on is right, but for a five-hundredth of the ticks."""
        if until_ns is None:
            self.wait(lambda: any(True for _ in self._judged(since_ns, self.clock())), "something that can be judged")
            until_ns = self.clock()
        ticks = max(1.0, (until_ns - since_ns) * 1e-9 / PERIOD)
        judged: dict[str, list[Judged]] = {}
        for each in self._judged(since_ns, until_ns):
            judged.setdefault(each.what, []).append(each)
        assert judged, "something was published that can be judged"
        for what, parts in judged.items():
            wrong = np.concatenate([part.wrong for part in parts])
            worst = max(float(part.off.max()) for part in parts)
            most = max(1, round(MOST_WRONG * ticks))
            assert len(wrong) <= most, (
                f"{what}: {len(wrong)} of {ticks:.0f} ticks are off, by up to {worst:.3g} standard deviations, from "
                f"{(wrong[0] - since_ns) * 1e-9:.3f} s to {(wrong[-1] - since_ns) * 1e-9:.3f} s"
            )

    def _judged(self, since_ns: int, until_ns: int) -> Iterator[Judged]:
        def inside(stamp: int) -> bool:
            return since_ns <= stamp <= until_ns

        for block in self.heard.motion:
            if inside(int(block.times_ns[0])):
                yield self.truth.of_motion(block)
        corrections = dict(self.heard.corrections)
        for stamp, pose in self.heard.before:
            if inside(stamp):
                yield self.truth.of_offset(stamp, pose)
        for stamp, pose in self.heard.after:
            if inside(stamp) and stamp in corrections:
                yield self.truth.of_offset(stamp, pose, corrections[stamp])

    def newest_ns(self) -> int:
        """Stamp of the newest correction; 0 before the first."""
        return self.heard.corrections[-1][0] if self.heard.corrections else 0

    def forget(self) -> None:
        """Forget what was heard so far."""
        for each in vars(self.heard).values():
            each.clear()

    def lost(self) -> AbstractContextManager[Callable[[], Lost]]:
        """Function that tells what other programs took of the time since the `with`.

        This process counts too: it asks for what is timed, and publishes `/clock` or what a stranger says.
        """
        return lost_time(lambda: [os.getpid(), *(process.pid for process in self.processes.values())])

    def _listen(self) -> None:
        heard, node, wire = self.heard, self.cell.node, self.wire
        decoders = {"motion": BlockDecoder(), "offsets": BlockDecoder()}

        def note_corrections(message: JointState) -> None:
            stamp = messages.ns_from_stamp(message.header.stamp)
            heard.corrections.append((stamp, dict(zip(message.name, message.position, strict=True))))

        def note_diagnostics(message: DiagnosticArray) -> None:
            stamp = messages.ns_from_stamp(message.header.stamp)
            heard.said.extend(Statement(stamp, each.name, each.level[0], each.message) for each in message.status)

        def note(into: list) -> Callable[[PoseWithCovarianceStamped], None]:
            return lambda message: into.append((messages.ns_from_stamp(message.header.stamp), message.pose))

        for key, kind, callback, raw in (
            ("error_motion_samples", PointCloud2, lambda d: heard.motion.append(decoders["motion"].decode(d)), True),
            ("tool_offset_samples", PointCloud2, lambda d: heard.offsets.append(decoders["offsets"].decode(d)), True),
            ("axis_corrections", JointState, note_corrections, False),
            ("tool_offset_pose", PoseWithCovarianceStamped, note(heard.before), False),
            ("corrected_offset_pose", PoseWithCovarianceStamped, note(heard.after), False),
            ("diagnostics", DiagnosticArray, note_diagnostics, False),
        ):
            topic = wire.topic(key)
            node.create_subscription(kind, topic.name, callback, profile(topic), raw=raw)
