"""Two hosts on this computer: network namespaces, joined by a cable that delays, loses and can be cut.

Nothing is left of them when the test process ends, however it ends: what it started dies with it, and the namespaces
with the last process in them.
"""

from __future__ import annotations

import ctypes
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from network.relay import ADDRESSES

_RELAY = Path(__file__).with_name("relay.py")
DIES_WITH_ITS_PARENT = ("setpriv", "--pdeathsig", "KILL")
_GOES_FIRST = ("setsid", "nice", "-n", "-10")
"""Two hosts would have processors of their own: what else this computer does shall not be seen as the network's.

Linux shares its time among sessions first (sched_autogroup), and within each by niceness.
"""

_CLONE_NEWNET = 0x40000000
OWN_MEMORY = "mount -t tmpfs none /dev/shm"
"""Two hosts share no memory: what they say goes over the cable."""


def why_not() -> str:
    """Why there can be no hosts here; empty where there can."""
    lacking = [name for name in ("unshare", "nsenter", "setpriv") if shutil.which(name) is None]
    if lacking:
        return f"no {', '.join(lacking)} here (package util-linux)"
    if not os.access("/dev/net/tun", os.R_OK | os.W_OK):
        return "no /dev/net/tun here that may be opened"
    tried = subprocess.run(
        ["unshare", "--net", "--mount", "sh", "-c", OWN_MEMORY], capture_output=True, text=True, check=False
    )
    return f"namespaces are not allowed here: {tried.stderr.strip()}" if tried.returncode else ""


@dataclass(frozen=True)
class Host:
    """A computer of its own, as far as network and shared memory go.

    Attributes:
        process: id of a process on it that does nothing.
        address: on the cable.
    """

    process: int
    address: str

    @property
    def command(self) -> tuple[str, ...]:
        """What stands before a command that shall run on it; it dies with the process that starts it."""
        return (*DIES_WITH_ITS_PARENT, "nsenter", f"--target={self.process}", "--net", "--mount", "--", *_GOES_FIRST)

    @contextmanager
    def entered(self) -> Iterator[None]:
        """This thread, and whatever it starts, speaks over the network of this host."""
        with Path("/proc/thread-self/ns/net").open(encoding="ascii") as before:
            with Path(f"/proc/{self.process}/ns/net").open(encoding="ascii") as there:
                _set_network(there.fileno())
            try:
                yield
            finally:
                _set_network(before.fileno())


class Cable:
    """Between two hosts, whole at first."""

    def __init__(self, relay: subprocess.Popen[str], hosts: tuple[Host, Host]) -> None:
        self._relay, self.hosts = relay, hosts

    def impair(self, delay: float = 0.0, jitter: float = 0.0, loss: float = 0.0) -> None:
        """Delay each frame by `delay` ± `jitter` (s) and lose a part of them, both ways."""
        assert self._ask(f"delay {delay} jitter {jitter} loss {loss}") == "done"

    def cut(self) -> None:
        """Lose all frames until it is impaired otherwise."""
        self.impair(loss=1.0)

    def counts(self) -> tuple[int, int]:
        """Frames that were handed over and that were lost since the last call."""
        passed, lost = map(int, self._ask("counts").split())
        return passed, lost

    def _ask(self, order: str) -> str:
        assert self._relay.stdin is not None and self._relay.stdout is not None
        self._relay.stdin.write(order + "\n")
        self._relay.stdin.flush()
        return self._relay.stdout.readline().strip()


@contextmanager
def two_hosts() -> Iterator[Cable]:
    """Two hosts and the cable between them.

    The first shares the memory of this process, so that a `Cell` in this process can live on it (`Host.entered`).
    """
    with ExitStack() as stack:
        kinds = (("--net", "true"), ("--net --mount", OWN_MEMORY))
        processes = [stack.enter_context(holder(*each)) for each in kinds]
        first, second = (Host(pid, address) for pid, address in zip(processes, ADDRESSES, strict=True))
        command = [
            *DIES_WITH_ITS_PARENT,
            *_GOES_FIRST,
            sys.executable,
            str(_RELAY),
            str(first.process),
            str(second.process),
        ]
        relay = stack.enter_context(_started(command))
        yield Cable(relay, (first, second))


@contextmanager
def holder(kinds: str, prepare: str) -> Iterator[int]:
    """Process that holds namespaces of its own, of these kinds of `unshare`: its id."""
    command = ["unshare", *kinds.split(), "sh", "-c", f"{prepare} && echo ready && exec cat"]
    with _started([*DIES_WITH_ITS_PARENT, *command]) as process:
        yield process.pid


@contextmanager
def _started(command: list[str]) -> Iterator[subprocess.Popen[str]]:
    """A process that says `ready` and ends with its standard input."""
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline().strip() == "ready", f"{command} does not begin"
            yield process
        finally:
            process.kill()


def _set_network(descriptor: int) -> None:
    if ctypes.CDLL(None, use_errno=True).setns(descriptor, _CLONE_NEWNET) != 0:
        raise OSError(ctypes.get_errno(), "cannot enter a network namespace")
