"""What the cell of a stage sends over a network, and takes of its computers: real processes on two computers. Printed.

The computers are network namespaces at one switch. Either the recorder alone is on the other one, as where one computer
records for many, or the instruments are, as where each machine has its own small computer and one estimates for all.
Bytes are those that the network devices count; to each frame come 24 bytes on the wire that no counter sees.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import time
from collections.abc import Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from contextlib import AbstractContextManager
from ctypes import CDLL
from dataclasses import dataclass
from pathlib import Path

import pytest
from network.hosts import Host

from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.testing import Cell, NodeProcess

from .feeding import cpu_seconds
from .switched_hosts import Traffic, held_mb, switched_hosts, why_not

SECONDS = float(os.environ.get("BENCH_SECONDS", "10"))
RATES = tuple(map(float, os.environ.get("BENCH_NETWORK_RATES", "10000,50000").split(",")))
MACHINE = "xyzac_trt"
BLOCK_PERIOD = 0.005
INSTRUMENTS = ("encoder_head", "autocollimator", "lvdt", "mock_controller")
FAR: Mapping[str, tuple[str, ...]] = {
    "the recorder on another computer": (*INSTRUMENTS, "error_estimator", "compensation"),
    "the instruments on another computer": INSTRUMENTS,
}
"""What is on the far computer; the rest is on the near one, with this process, which hears diagnostics alone."""

PER_FRAME = 24
"""Bytes of an Ethernet frame that a device does not count: preamble 8, checksum 4, gap 12 (IEEE 802.3)."""

UTILISED = 0.5
"""Part of a network that is reckoned with: blocks of all stages leave together, and what is lost is sent again."""

NETWORKS = {"1 Gbit/s": 1e9, "10 Gbit/s": 1e10}
_PR_SET_PDEATHSIG = 1  # linux/prctl.h
pytestmark = pytest.mark.skipif(bool(why_not()), reason=why_not() or "-")


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
        **{name: (name, {"source": "mock", **mock}) for name in ("autocollimator", "lvdt")},
        "mock_controller": ("mock_controller", {"machine": MACHINE, **mock}),
    }


def measured(far: tuple[str, ...], rate: float, bag: Path) -> Measured:
    """Let a cell run on two computers; this process lives on the near one."""
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
        cell.spin_for(SECONDS)
        end_ns, seconds, after = time.time_ns(), time.monotonic() - begin, [host.traffic for host in hosts]
        used = {name: (cpu_seconds(_inner(process)) - used[name]) / seconds for name, process in processes.items()}
        held = {name: held_mb(_inner(process)) for name, process in processes.items()}
        lost = int(cell.figures("recorder: recording")["lost_messages"])
        near, far_traffic = (now.since(then) for now, then in zip(after, before, strict=True))
    counts: dict[str, int] = {}
    size = 0
    for message in BagReader(bag).messages():
        if begin_ns <= message.log_time_ns < end_ns:
            counts[message.topic] = counts.get(message.topic, 0) + 1
            size += len(message.data)
    return Measured(seconds, far_traffic, near, used, held, sum(counts.values()), size, len(counts), lost)


def _inner(process: NodeProcess) -> int:
    """Process of the node itself: what brings it to its computer becomes it, or is its parent."""
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text(encoding="ascii").split()
    return int(children[0]) if children else process.pid


def _on(process: int) -> AbstractContextManager[None]:
    return Host(process, "").entered()


def described(rate: float, where: str, seen: Measured) -> Iterator[str]:
    """Lines about it."""
    frames = (seen.far.sent_frames + seen.far.received_frames) / seen.seconds
    size = (seen.far.sent_bytes + seen.far.received_bytes) / seen.seconds + PER_FRAME * frames
    ways = (seen.far.sent_bytes, seen.far.sent_frames), (seen.far.received_bytes, seen.far.received_frames)
    one_way = max(counted + PER_FRAME * number for counted, number in ways) / seen.seconds
    inside = (seen.far.inside_bytes + seen.near.inside_bytes) / seen.seconds
    yield f"{rate:.0f} samples a second of each instrument, blocks of 5 ms; {where}, {seen.seconds:.0f} s"
    yield (
        f"  messages: {seen.messages / seen.seconds:.0f} a second on {seen.topics} topics, "
        f"{seen.message_bytes / seen.seconds / 1e6:.2f} MB/s serialised; lost {seen.lost}"
    )
    yield (
        f"  network: {size * 8e-6:.1f} Mbit/s both ways, {one_way * 8e-6:.1f} Mbit/s the busier way, {frames:.0f} "
        f"frames a second; inside of the computers {inside * 8e-6:.1f} Mbit/s"
    )
    for name, speed in NETWORKS.items():
        yield f"  {name}, {UTILISED:.0%} of it: {int(UTILISED * speed / (8 * one_way))} stages"
    for name, share in seen.used.items():
        yield f"    {name:<16} {100 * share:5.1f} % of a core, {seen.held[name]:4.0f} MB"
    yield f"    {'all':<16} {100 * sum(seen.used.values()):5.1f} % of a core, {sum(seen.held.values()):4.0f} MB"


@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("where", FAR)
def test_what_a_cell_sends_over_a_network(where, rate, tmp_path, capsys):
    fresh = multiprocessing.get_context("spawn")  # it looks once which networks there are
    with ProcessPoolExecutor(1, mp_context=fresh, initializer=_prepare) as process:
        seen = process.submit(measured, FAR[where], rate, tmp_path / "bag").result()
    with capsys.disabled():
        print()
        for line in described(rate, where, seen):
            print(line)


def _prepare() -> None:
    """The process ends with its parent."""
    CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
