"""A cell of real processes on two computers at one switch, and what it sends and takes."""

from __future__ import annotations

import ctypes
import signal
import time
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

from network.hosts import Host

from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.testing import Cell, NodeProcess

from .feeding import cpu_seconds
from .switched_hosts import Traffic, held_mb, switched_hosts

MACHINE = "xyzac_trt"
BLOCK_PERIOD = 0.005
"""Time in a block, s: the default of the nodes."""

_PR_SET_PDEATHSIG = 1  # linux/prctl.h


def dies_with_its_parent() -> None:
    """Have this process end with the one that started it."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)


@dataclass(frozen=True)
class Measured:
    """A cell on two computers, for so many seconds.

    Attributes:
        seconds: on the wall.
        far: what went over the network, as the far computer counts it.
        near: as the near one does.
        used: part of a core by process.
        held: memory by process, MB.
        messages, message_bytes: that the recorder wrote, CDR.
        topics: those with messages.
        lost: messages that never came to the recorder, as it says.
    """

    seconds: float
    far: Traffic
    near: Traffic
    used: dict[str, float]
    held: dict[str, float]
    messages: int
    message_bytes: int
    topics: int
    lost: int


def nodes_of(rate: float, bag: Path) -> dict[str, tuple[str, dict[str, object]]]:
    """Executable and parameters of the ten nodes by name."""
    mock: dict[str, object] = {
        "mock__seed": 1,
        "mock__epoch": time.time_ns(),
        "rate": rate,
        "block_period": BLOCK_PERIOD,
    }
    return {
        "recorder": ("recorder", {"folder": str(bag)}),
        "error_estimator": ("error_estimator", {}),
        "compensation": ("compensation", {"machine": MACHINE}),
        **{f"encoder_head_{head}": ("encoder_head", {"source": "mock", "head": head, **mock}) for head in "abcd"},
        "autocollimator": ("autocollimator", {"source": "mock", **mock}),
        "lvdt": ("lvdt", {"source": "mock", **{key: mock[key] for key in mock if key != "rate"}}),
        "mock_controller": ("mock_controller", {"machine": MACHINE, **mock}),
    }


def measured(far: tuple[str, ...], rate: float, seconds: float, bag: Path) -> Measured:
    """Let a cell run on two computers for some seconds; this process lives on the near one.

    It has looked at no network before: a process does so once. Executables in `far` run on the other one.
    """
    with switched_hosts(2) as hosts, _on(hosts[0].process), Cell(reach="SUBNET") as cell:
        processes: dict[str, NodeProcess] = {}
        for name, (executable, parameters) in nodes_of(rate, bag).items():
            within = hosts[executable in far].command
            processes[name] = cell.start(executable, name, within=within, **parameters)
        cell.wait_until(
            lambda: not cell.status("compensation: correction").message.startswith("held"), "corrections", 120.0
        )
        cell.spin_for(3.0)
        begin, before = time.monotonic(), [host.traffic for host in hosts]
        used = {name: cpu_seconds(_inner(process)) for name, process in processes.items()}
        begin_ns = time.time_ns()
        cell.spin_for(seconds)
        end_ns, took, after = time.time_ns(), time.monotonic() - begin, [host.traffic for host in hosts]
        used = {name: (cpu_seconds(_inner(process)) - used[name]) / took for name, process in processes.items()}
        held = {name: held_mb(_inner(process)) for name, process in processes.items()}
        lost = int(cell.figures("recorder: recording")["lost_messages"])
        near, far_traffic = (now.since(then) for now, then in zip(after, before, strict=True))
    counts: dict[str, int] = {}
    size = 0
    for message in BagReader(bag).messages():
        if begin_ns <= message.log_time_ns < end_ns:
            counts[message.topic] = counts.get(message.topic, 0) + 1
            size += len(message.data)
    return Measured(took, far_traffic, near, used, held, sum(counts.values()), size, len(counts), lost)


def _inner(process: NodeProcess) -> int:
    """Process of the node itself: what brings it to its computer becomes it, or is its parent."""
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text(encoding="ascii").split()
    return int(children[0]) if children else process.pid


def _on(process: int) -> AbstractContextManager[None]:
    return Host(process, "").entered()
