"""What benchmarks of running cells share: drivers in a process of their own, what arrives, and what it costs."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from rotary_error_monitor.codec.cdr_blocks import BlockDecoder
from rotary_error_monitor.description.topics import samples_topic
from rotary_error_monitor.nodes import messages
from rotary_error_monitor.testing import Cell, NodeProcess

DRIVERS = Path(__file__).with_name("drivers.py")


def on_time() -> list[str]:
    """What starts a process of a cell in a real-time class, as it should run; nothing where that is forbidden."""
    command = ["chrt", "--rr", "1"]
    try:
        allowed = subprocess.run([*command, "true"], capture_output=True, check=False).returncode == 0
    except FileNotFoundError:
        allowed = False
    return command if allowed else []


def cpu_seconds(process: NodeProcess | int) -> float:
    """Processor time, user and system, of a process of this machine until now, s."""
    pid = process if isinstance(process, int) else process.pid
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="ascii").rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


@dataclass(frozen=True)
class Sent:
    """What the drivers sent, and what it cost others.

    Attributes:
        samples: of each instrument.
        epoch_ns: stamp of the first, timestamp (ns).
        behind_ms: most that the drivers were behind their own time, ms.
        processor: part of a core that they took.
        used: parts of a core that the watched processes took, while samples came.
    """

    samples: int
    epoch_ns: int
    behind_ms: float
    processor: float
    used: tuple[float, ...]


class Counted:
    """Counts the samples of a stream's blocks on the contract's topic."""

    def __init__(self, cell: Cell, stream: str) -> None:
        """Listen from now on."""
        self.samples = 0
        decoder = BlockDecoder()

        def count(data: bytes) -> None:
            self.samples += decoder.span(data)[2]

        kind = messages.message_class("sensor_msgs/msg/PointCloud2")
        cell.node.create_subscription(kind, samples_topic(stream), count, 1000, raw=True)


def fed(
    cell: Cell,
    kind: str,
    rate: float,
    seconds: float,
    late: float = 0.0,
    watched: Sequence[NodeProcess] = (),
    begun: Callable[[], bool] = bool,
    apart: float = 0.0,
) -> Sent:
    """Let drivers send into a cell, and what they caused arrive.

    Args:
        cell: that the nodes run in.
        kind: `messages` or `blocks`, as `drivers.py` has it.
        rate: of each instrument, 1/s.
        seconds: for which they send, more than two.
        late: periods that a message or block may be late.
        watched: processes whose processor time is taken.
        begun: whether samples came; time of the processor counts from then on, for 2 s less than they send.
        apart: periods from the first instrument's samples to the last one's.
    """
    environment = {**os.environ, "ROS_DOMAIN_ID": str(cell.node.context.get_domain_id())}
    command = [*on_time(), sys.executable, str(DRIVERS), kind, str(rate), str(seconds), str(late), str(apart)]
    used: tuple[float, ...] = ()
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, text=True) as process:
        try:
            if watched:
                cell.wait_until(begun, "the first samples")
                cell.spin_for(0.5)
                used = shares(cell, watched, seconds - 2)
            cell.wait_until(lambda: process.poll() is not None, "the drivers to end", seconds + 60)
        finally:
            process.kill()
        told = json.loads(process.communicate()[0])
    cell.spin_for(1.0)
    return Sent(told["samples"], told["epoch_ns"], told["behind_ms"], told["processor"] / seconds, used)


def shares(cell: Cell, processes: Sequence[NodeProcess], seconds: float) -> tuple[float, ...]:
    """Parts of a core that processes take while a cell runs for some seconds."""
    begin, before = time.monotonic(), [cpu_seconds(process) for process in processes]
    cell.spin_for(seconds)
    elapsed = time.monotonic() - begin
    return tuple((cpu_seconds(each) - then) / elapsed for each, then in zip(processes, before, strict=True))
