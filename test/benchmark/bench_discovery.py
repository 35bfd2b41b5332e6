"""Stages in one network, each a cell on a computer of its own: how they find one another, and what that costs. Printed.

The computers are network namespaces at one switch; the cell of a stage is its ten nodes, the package's own, each a DDS
participant as in a process of its own, but in one process and without data (`light_cell.py`): so twenty stages fit
where two processors are. What goes over the network before data does is counted by the devices of the computers.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

from rotary_error_monitor.nodes.transport import PROFILES, TRANSPORTS
from rotary_error_monitor.resources import config

from .switched_hosts import SwitchedHost, Traffic, cores, switched_hosts, why_not

MANAGED = tuple(map(int, os.environ.get("BENCH_STAGES", "1,2,3").split(",")))
"""Stages in one network whose cells are the package's nodes; those of the documentation are 1,2,3,4,5."""

PLAIN = tuple(map(int, os.environ.get("BENCH_PLAIN_STAGES", "1,2,5").split(",")))
"""The same of cells that have their topics alone; those of the documentation are 1,2,3,4,5,6,7,8,10,20."""

QUIET = float(os.environ.get("BENCH_QUIET_SECONDS", "5"))
"""Time for which is counted what goes over the network once all have found one another, s."""

PARTICIPANTS = 10
"""Of a cell."""

PATIENCE = 60.0
"""Time after which no more cells are added, s, if not all have found one another."""

DOMAIN = 42
"""ROS domain: any, for these networks reach nobody else."""

_LIGHT_CELL = Path(__file__).with_name("light_cell.py")
pytestmark = pytest.mark.skipif(bool(why_not()), reason=why_not() or "-")


class LightCell:
    """A process of `light_cell.py` on a host."""

    def __init__(self, process: subprocess.Popen[str], host: SwitchedHost) -> None:
        self._process, self.host = process, host

    def tell(self, line: str) -> None:
        """Write a line to it."""
        assert self._process.stdin is not None
        self._process.stdin.write(f"{line}\n")
        self._process.stdin.flush()

    def hear(self) -> str:
        """Its next line on standard output."""
        assert self._process.stdout is not None
        return self._process.stdout.readline().strip()

    def answer(self) -> dict[str, float]:
        """The next line as JSON."""
        line = self.hear()
        assert line.startswith("{"), f"a cell said {line!r} and ended with {self._process.poll()}"
        found: dict[str, float] = json.loads(line)
        return found


@contextmanager
def light_cells(hosts: Sequence[SwitchedHost], folder: Path, kind: str, apart: bool) -> Iterator[list[LightCell]]:
    """A cell on each host, in a namespace of its own, loaded; they end with the block.

    `kind` as of `light_cell.py`; where they are `apart`, each has a ROS domain of its own as well.
    """
    environment = {
        **os.environ,
        TRANSPORTS: "UDPv4",
        PROFILES: str(config("subnet.xml")),  # so participants of one process talk as those of several do
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET",
        "OMP_NUM_THREADS": "1",
    }
    with ExitStack() as stack:
        cells = []
        for number, host in enumerate(hosts, start=1):
            command = [*host.command, sys.executable, str(_LIGHT_CELL), f"/stage_{number:02}"]
            log = stack.enter_context((folder / f"log_{number}").open("w"))
            process = stack.enter_context(
                subprocess.Popen(
                    [*command, str(folder / f"bag_{number}"), kind],
                    env=environment | {"ROS_DOMAIN_ID": str(DOMAIN + number * apart)},
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=log,
                    text=True,
                )
            )
            stack.callback(process.kill)
            cells.append(LightCell(process, host))
        for cell in cells:
            assert cell.hear() == "loaded"
        yield cells


@dataclass(frozen=True)
class Found:
    """How cells found one another.

    Attributes:
        stages: cells that are there.
        seconds: from the beginning of the last, or of all at once, until all had found all, or `PATIENCE` was over.
        known: part of the nodes that the least knowing one knew then.
        endpoints: readers and writers of all.
        processor: time of all cells until then, since there were fewer, s.
        memory: of a participant, MB, beside what its process held before.
        traffic: of each host until then, since there were fewer.
        quiet: of each host, in `QUIET` s after that.
        idle: processor time of all in these, s.
    """

    stages: int
    seconds: float
    known: float
    endpoints: int
    processor: float
    memory: float
    traffic: list[Traffic]
    quiet: list[Traffic]
    idle: float

    @property
    def is_whole(self) -> bool:
        """Whether all had found all in time."""
        return self.seconds < PATIENCE


@dataclass
class Network:
    """Cells that come one after another, or together."""

    cells: list[LightCell]
    empty: list[dict[str, float]]
    apart: bool
    there: int = 0

    def grow_to(self, stages: int) -> Found:
        """Have the cells that are not yet there begin, all at once."""
        hosts = [cell.host for cell in self.cells]
        before, then = [host.traffic for host in hosts], self._states()
        begin = time.monotonic()
        new, self.there = self.cells[self.there : stages], stages
        present = self.cells[:stages]
        for cell in new:
            cell.tell("make")
        for cell in present:
            cell.tell(f"find {1 if self.apart else stages} {PATIENCE}")
        for cell in new:
            cell.answer()
        answers = [cell.answer() for cell in present]
        seconds, after = time.monotonic() - begin, [host.traffic for host in hosts]
        now, quiet = self._states(), [host.traffic for host in hosts]
        time.sleep(QUIET)
        rest, end = [host.traffic for host in hosts], self._states()
        held = sum(each["mb"] - empty["mb"] for each, empty in zip(now[:stages], self.empty, strict=False))
        return Found(
            stages,
            seconds,
            min(each["known"] for each in answers),
            round(sum(each["endpoints"] for each in answers)),
            _processor(now) - _processor(then),
            held / (PARTICIPANTS * stages),
            [late.since(early) for late, early in zip(after, before, strict=True)],
            [late.since(early) for late, early in zip(rest, quiet, strict=True)],
            _processor(end) - _processor(now),
        )

    def _states(self) -> list[dict[str, float]]:
        for cell in self.cells:
            cell.tell("state")
        return [cell.answer() for cell in self.cells]


def _processor(states: Sequence[dict[str, float]]) -> float:
    return sum(each["processor"] for each in states)


@contextmanager
def network(stages: int, folder: Path, kind: str = "nodes", apart: bool = False) -> Iterator[Network]:
    """A network of so many computers, the cells on them not yet begun; arguments as of `light_cells`."""
    folder.mkdir()
    with switched_hosts(stages) as hosts, light_cells(hosts, folder, kind, apart) as cells:
        made = Network(cells, [], apart)
        made.empty = made._states()
        yield made


def described(seen: Found) -> str:
    """Lines about it."""
    participants = PARTICIPANTS * seen.stages
    wire, arrived, inside = (
        sum(each[name] for each in map(Traffic._asdict, seen.traffic)) * 1e-6
        for name in ("sent_bytes", "received_bytes", "inside_bytes")
    )
    still, come, datagrams = (
        sum(each[name] for each in map(Traffic._asdict, seen.quiet)) / QUIET
        for name in ("sent_bytes", "received_bytes", "datagrams")
    )
    return (
        f"  {seen.stages:2} stages, {participants:3} participants, {seen.endpoints:,} endpoints: "
        f"{'found' if seen.is_whole else f'{seen.known:.0%} of the nodes known, not all connected,'} after "
        f"{seen.seconds:.1f} s, {seen.processor:.1f} s of processor; {sum(t.datagrams for t in seen.traffic):,} "
        f"datagrams, {sum(t.overflowed for t in seen.traffic):,} lost to full buffers, {wire:.1f} MB "
        f"sent over the network, {arrived / len(seen.traffic):.1f} MB to each computer, "
        f"{inside:.1f} MB inside of computers; {seen.memory:.1f} MB a participant\n"
        f"     afterwards {still * 8e-3:.0f} kbit/s sent by all, {come * 8e-3 / len(seen.quiet):.0f} kbit/s to each "
        f"computer, {datagrams:.0f} datagrams a second, {100 * seen.idle / QUIET:.1f} % of a core"
    )


def print_growth(stages: Sequence[int], cells: Network) -> None:
    """One cell after another; said is what the last one adds."""
    for there in range(1, max(stages) + 1):
        seen = cells.grow_to(there)
        if there in stages or not seen.is_whole:
            print(described(seen), flush=True)
        if not seen.is_whole:
            break


@pytest.mark.parametrize(("kind", "stages"), [("nodes", MANAGED), ("topics", PLAIN)])
def test_one_cell_after_another(kind, stages, tmp_path, capsys):
    with network(max(stages), tmp_path / "cells", kind) as cells, capsys.disabled():
        print(
            f"\none domain, cells of {kind}, one after another, {cores()} processors for all; what the last one adds:"
        )
        print_growth(stages, cells)


def test_all_at_once(tmp_path, capsys):
    stages = max(MANAGED)
    with network(stages, tmp_path / "cells") as cells, capsys.disabled():
        print(f"\none domain, cells of nodes, all at once as after a loss of power, {cores()} processors for all:")
        print(described(cells.grow_to(stages)), flush=True)


def test_a_domain_for_each_cell(tmp_path, capsys):
    stages = max(PLAIN)
    with network(stages, tmp_path / "cells", "nodes", apart=True) as cells, capsys.disabled():
        print(f"\na domain for each cell, cells of nodes, all at once, {cores()} processors for all:")
        print(described(cells.grow_to(stages)), flush=True)
