"""Keeps the processes of a cell running: starts them, starts again what ended, and ends them in order.

The order of ending goes against the stream, so that whatever a process says to its end is heard by the next, and by the
recorder, which goes last.
"""

from __future__ import annotations

import asyncio
import ctypes
import os
import signal
import stat
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from rotary_error_monitor.supervision.cell_file import CellNode

BAD_INPUT = 2
"""Exit code of a node whose parameters or files are wrong."""

LAST = "recorder"
FIRST = ("error_estimator", "compensation", "gap_monitor", "linuxcnc_bridge")
"""Who ends last, and who ends first: those that reckon with what the instruments say."""

_DEATH_SIGNAL = 1  # PR_SET_PDEATHSIG of prctl(2)


@dataclass(frozen=True)
class RestartTimes:
    """How fast things are tried again, all in s.

    Attributes:
        shortest, longest: wait before a node is started again; it doubles from one to the other.
        settled: a node that ran as long as this is waited for as at first when it ends.
        patience: time that a node has to end before it is killed.
    """

    shortest: float = 1.0
    longest: float = 30.0
    settled: float = 60.0
    patience: float = 15.0

    def wait(self, before: float, ran: float) -> float:
        """How long to wait after a node `ran`, when the wait `before` (0 for none) was the last one."""
        return self.shortest if before == 0.0 or ran >= self.settled else min(2 * before, self.longest)


class Supervisor:
    """Runs the nodes of a cell until it is told to end.

    A node that ends is started again, after a wait that doubles from time to time. One whose input is wrong at its
    first start ends the cell: a wrong file does not get right by itself.
    """

    def __init__(
        self,
        nodes: Sequence[CellNode],
        arguments: Sequence[str],
        say: Callable[[str], None] = print,
        pace: RestartTimes | None = None,
    ) -> None:
        """Supervise `nodes`, each started with `arguments` behind `--ros-args`; `say` takes what there is to tell."""
        self._nodes, self._arguments, self._say = nodes, arguments, say
        self._pace = pace or RestartTimes()
        self._processes: dict[CellNode, asyncio.subprocess.Process] = {}
        self._ending = asyncio.Event()
        self._code = 0
        self._unread: BrokenPipeError | None = None

    async def run(self) -> int:
        """Keep the cell running until SIGINT, SIGTERM or SIGHUP, or until nobody reads the pipe that it writes to.

        Returns the exit code: 0, 2 after wrong input of a node, 1 where a node had to be killed.

        Raises:
            BrokenPipeError: nobody reads what it says any more; all nodes have ended.
        """
        loop = asyncio.get_running_loop()
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            loop.add_signal_handler(number, self._ending.set)
        _when_unread(loop, self._ending.set)
        keepers = [asyncio.create_task(self._keep(node)) for node in self._nodes]
        await self._ending.wait()
        self._tell("ending the cell")
        reckoning = [node for node in self._nodes if node.executable in FIRST]
        recorders = [node for node in self._nodes if node.executable == LAST]
        others = [node for node in self._nodes if node not in reckoning and node not in recorders]
        for group in (reckoning, others, recorders):
            await asyncio.gather(*(self._end(node) for node in group))
        await asyncio.gather(*keepers)
        if self._unread is not None:
            raise self._unread
        return self._code

    def _tell(self, text: str) -> None:
        """Say what there is to tell; where nobody reads it the cell ends, in order."""
        try:
            self._say(text)
        except BrokenPipeError as error:
            self._unread = error
            self._ending.set()

    async def _keep(self, node: CellNode) -> None:
        """Start a node again and again until the cell ends."""
        wait, begun_before = 0.0, False
        while not self._ending.is_set():
            begun = time.monotonic()
            process = self._processes[node] = await self._start(node)
            self._tell(f"{node.name} started{' again' if begun_before else ''}: process {process.pid}")
            if self._ending.is_set():  # told to end while it was being started: nobody else knows of it
                await self._end(node)
            code = await process.wait()
            if self._ending.is_set():
                return
            if code == BAD_INPUT and not begun_before:
                self._tell(f"{node.name} ended with exit code 2, its input is wrong: see what it said")
                self._code = BAD_INPUT
                self._ending.set()
                return
            wait, begun_before = self._pace.wait(wait, time.monotonic() - begun), True
            self._tell(f"{node.name} ended {_how(code)}; it is started again in {wait:g} s")
            try:
                await asyncio.wait_for(self._ending.wait(), wait)
            except TimeoutError:
                continue

    async def _start(self, node: CellNode) -> asyncio.subprocess.Process:
        namespace = ("-r", f"__ns:={node.namespace}") if node.namespace else ()
        words = ("--ros-args", *self._arguments, "-r", f"__node:={node.name}", *namespace)
        return await asyncio.create_subprocess_exec(
            *(sys.executable, "-m", "rotary_error_monitor.start", node.executable, *words),
            stdin=asyncio.subprocess.DEVNULL,
            start_new_session=True,  # Ctrl-C at a terminal is for the supervisor, which ends them in order
            preexec_fn=_end_with_parent,
        )

    async def _end(self, node: CellNode) -> None:
        process = self._processes.get(node)
        if process is None or process.returncode is not None:
            return
        process.send_signal(signal.SIGINT)
        try:
            await asyncio.wait_for(process.wait(), self._pace.patience)
        except TimeoutError:
            self._tell(f"{node.name} did not end within {self._pace.patience:g} s and is killed")
            self._code = self._code or 1
            process.kill()
            await process.wait()


def _how(code: int) -> str:
    return f"with exit code {code}" if code >= 0 else f"by signal {signal.Signals(-code).name}"


def _end_with_parent() -> None:
    """A supervisor that is killed takes its nodes along (Linux)."""
    ctypes.CDLL(None).prctl(_DEATH_SIGNAL, signal.SIGINT)


def _when_unread(loop: asyncio.AbstractEventLoop, call: Callable[[], None]) -> None:
    """Call once nobody reads the pipe that the output goes to: hours may pass until something is written to it.

    A terminal that closes sends SIGHUP, and files and sockets of a journal stay.
    """

    def closed() -> None:
        loop.remove_reader(output)
        call()

    try:
        output = sys.stdout.fileno()
    except OSError:  # kept in memory, as tests do
        return
    if stat.S_ISFIFO(os.fstat(output).st_mode):
        loop.add_reader(output, closed)  # of a pipe that is written to: its error
