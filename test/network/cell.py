"""A mock cell on two hosts with a bad network between them: what is said while it runs, and when."""

from __future__ import annotations

import re
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from network.hosts import Cable, two_hosts
from network.judging import ALL_STREAMS
from rotary_error_monitor.codec.cdr_blocks import BlockDecoder
from rotary_error_monitor.nodes import messages
from rotary_error_monitor.nodes.qos import profile
from rotary_error_monitor.signals.blocks import NANOSECONDS
from rotary_error_monitor.sources.mock import MockSettings
from rotary_error_monitor.testing import Cell, NodeProcess

MACHINE = "xyzac_trt"
NETWORK = {"delay": 0.02, "jitter": 0.005, "loss": 0.02}
"""Of the network between the two: each frame takes 15 to 25 ms and overtakes others, one in fifty is lost."""

BLOCK_PERIOD = 0.02
PERIOD = 0.002
"""Of blocks and of estimates, s: a quarter of the default's messages and half of its estimates, for two processors."""

STAGE_FIRST = 4.0
"""By how much longer than the cell the stage has been turning, s: it changes its speed soon after the cell is up."""

MAX_AGE = 0.25
"""Oldest correction that the far controller believes, s: one that has been lost and asked for again, too."""

SAYINGS = {
    "compensation": ("corrections flow", "corrections are held: no "),
    "mock_controller": ("corrections: applied", "corrections: held for "),
}
"""What a node logs when corrections flow, and when they are held because nothing comes."""

_LOGGED = re.compile(r"^\[(?:INFO|WARN|ERROR)\] \[(\d+)\.(\d{9})\] \[[\w.]+\]: (.*)$", re.MULTILINE)


@dataclass
class Course:
    """How the estimates come, as the near host hears them.

    Attributes:
        period_ns: distance of two estimates, ns.
        newest_ns: stamp of the latest; 0 before the first.
        whole_since_ns: from when on each tick has come, with all streams, timestamp (ns).
        speeds: at which the stage turned meanwhile, in rad/s.
    """

    period_ns: int
    newest_ns: int = 0
    whole_since_ns: int = 0
    speeds: set[int] = field(default_factory=set)
    _decoder: BlockDecoder = field(default_factory=BlockDecoder)

    def receive(self, data: bytes) -> None:
        """Take note of a message."""
        block = self._decoder.decode(data)
        complete, theta = block.column("streams") == ALL_STREAMS, block.column("theta")
        if complete.all() and len(theta) > 1:
            duration = int(block.times_ns[-1] - block.times_ns[0]) / NANOSECONDS
            self.speeds.add(round(float(theta[-1] - theta[0]) / duration))
        for time_ns, whole in zip(block.times_ns.tolist(), complete.tolist(), strict=True):
            if not whole or time_ns - self.newest_ns != self.period_ns:
                self.whole_since_ns = time_ns
            self.newest_ns = time_ns

    def is_whole_for(self, duration: float) -> bool:
        """Whether nothing has been missing for so long, s."""
        return self.newest_ns - self.whole_since_ns >= duration * NANOSECONDS


@dataclass
class TwoHostCell:
    """What is needed of a running cell.

    Attributes:
        cell: on the near host, with estimator and compensation.
        cable: to the far host.
        course: of the estimates.
        settings: of the mock stage.
        bag: what the near host's recorder makes.
        processes: by name of the node.
    """

    cell: Cell
    cable: Cable
    course: Course
    settings: MockSettings
    bag: Path
    processes: dict[str, NodeProcess] = field(default_factory=dict)
    _outputs: dict[str, str] = field(default_factory=dict)

    def said(self, node: str) -> list[tuple[int, str]]:
        """What a node has logged, and when, timestamp (ns)."""
        found = _LOGGED.findall(self._outputs.get(node) or self.processes[node].output)
        return [(int(seconds) * NANOSECONDS + int(rest), text) for seconds, rest, text in found]

    def corrects(self, duration: float = 0.0) -> bool:
        """Whether the latest that both sides have said, for so long (s), is that corrections flow."""
        for node, (flows, _) in SAYINGS.items():
            told = [(time_ns, text) for time_ns, text in self.said(node) if text.startswith("corrections")]
            if not told or not told[-1][1].startswith(flows) or time.time_ns() - told[-1][0] < duration * NANOSECONDS:
                return False
        return True

    def stop(self) -> None:
        """End the recorder, so that its bag can be read, after the others."""
        self._outputs = {name: process.output for name, process in self.processes.items()}
        recorder = self.processes.pop("recorder")
        for process in (*self.processes.values(), recorder):
            assert process.stop() == 0, process.ending


@contextmanager
def two_host_cell(
    far: tuple[str, ...],
    bag: Path,
) -> Iterator[TwoHostCell]:
    """A cell that makes the recording `bag`; nodes of the executables `far` are on the far host, the others here."""
    begun_ns = time.time_ns() - round(STAGE_FIRST * NANOSECONDS)
    settings = MockSettings(seed=5, epoch_ns=begun_ns, speeds=(3.0, 6.0), rate=1000.0)
    mock: dict[str, object] = {
        "mock__seed": settings.seed,
        "mock__epoch": settings.epoch_ns,
        "mock__speeds": settings.speeds,
        "mock__forces": settings.forces,
        "mock__force_cycle": settings.force_cycle,
        "rate": settings.rate,
        "block_period": BLOCK_PERIOD,
    }
    nodes: dict[str, tuple[str, dict[str, object]]] = {
        "recorder": ("recorder", {"folder": str(bag)}),
        "error_estimator": ("error_estimator", {"period": PERIOD}),
        "compensation": ("compensation", {"machine": MACHINE, "correction_period": 0.02}),
        **{f"encoder_head_{letter}": ("encoder_head", {"source": "mock", "head": letter, **mock}) for letter in "abcd"},
        "autocollimator": ("autocollimator", {"source": "mock", **mock}),
        "mock_controller": ("mock_controller", {"machine": MACHINE, "max_age": MAX_AGE, **mock}),
    }
    with two_hosts() as cable, cable.hosts[0].entered(), Cell(reach="SUBNET") as cell:
        cable.impair(**NETWORK)
        topic = cell.wire.topic("error_motion_samples")
        running = TwoHostCell(cell, cable, Course(round(PERIOD * NANOSECONDS)), settings, bag)
        kind = messages.message_class(topic.type)
        cell.node.create_subscription(kind, topic.name, running.course.receive, profile(topic), raw=True)
        for name, (executable, parameters) in nodes.items():
            host = cable.hosts[executable in far]
            running.processes[name] = cell.start(executable, name, within=host.command, **parameters)
        yield running
