"""As many hosts as somebody asks for on this computer: network namespaces at one Ethernet switch, and their counters.

The switch is a bridge of the kernel in a namespace of its own, each host is joined to it by a pair of virtual devices:
nothing is delayed or lost. Nothing is left when the process that asked for them ends, however it ends: the processes
that hold the namespaces die with it, and the namespaces with the last process in them.
"""

from __future__ import annotations

import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from network.hosts import DIES_WITH_ITS_PARENT, OWN_MEMORY, holder

_HOST = f"{OWN_MEMORY} && ip link set lo up"
_SWITCH = "ip link add switch type bridge mcast_snooping 0 && ip link set switch up"
"""A switch that hands multicast to all, as one without management does."""

DEVICE = "eth0"


class Traffic(NamedTuple):
    """What a host has sent and received until now.

    Attributes:
        sent_frames, sent_bytes: on its network device, without preamble, checksum and the gap between frames.
        received_frames, received_bytes: the same.
        inside_frames, inside_bytes: on its loopback device, each once.
        datagrams: of UDP that were sent, on both.
        overflowed: datagrams that came and found the buffer of their socket full.
    """

    sent_frames: int
    sent_bytes: int
    received_frames: int
    received_bytes: int
    inside_frames: int
    inside_bytes: int
    datagrams: int
    overflowed: int

    def since(self, before: Traffic) -> Traffic:
        """What came since."""
        return Traffic(*(now - then for now, then in zip(self, before, strict=True)))


@dataclass(frozen=True)
class SwitchedHost:
    """A computer of its own, as far as network and shared memory go.

    Attributes:
        process: id of a process on it that does nothing.
        address: on the network.
    """

    process: int
    address: str

    @property
    def command(self) -> tuple[str, ...]:
        """What stands before a command that shall run on it; it dies with the process that starts it."""
        return (*DIES_WITH_ITS_PARENT, "nsenter", f"--target={self.process}", "--net", "--mount", "--")

    @property
    def traffic(self) -> Traffic:
        """Its counters now."""
        rows = Path(f"/proc/{self.process}/net/dev").read_text(encoding="ascii").splitlines()[2:]
        found = {name.strip(): list(map(int, rest.split())) for name, rest in (row.split(":") for row in rows)}
        net, inside = found[DEVICE], found["lo"]
        udp = [
            line.split()
            for line in Path(f"/proc/{self.process}/net/snmp").read_text(encoding="ascii").splitlines()
            if line.startswith("Udp:")
        ]
        sent, overflowed = (int(udp[1][udp[0].index(name)]) for name in ("OutDatagrams", "RcvbufErrors"))
        return Traffic(net[9], net[8], net[1], net[0], inside[9], inside[8], sent, overflowed)


def why_not() -> str:
    """Why there can be no such hosts here; empty where there can."""
    lacking = [name for name in ("unshare", "nsenter", "setpriv", "ip") if shutil.which(name) is None]
    if lacking:
        return f"no {', '.join(lacking)} here (packages util-linux, iproute2)"
    tried = subprocess.run(
        ["unshare", "--net", "--mount", "sh", "-c", f"{_HOST} && {_SWITCH} && ip link add v0 type veth peer name v1"],
        capture_output=True,
        text=True,
        check=False,
    )
    return f"namespaces are not allowed here: {tried.stderr.strip()}" if tried.returncode else ""


@contextmanager
def switched_hosts(count: int) -> Iterator[tuple[SwitchedHost, ...]]:
    """So many hosts at one switch, at most 250: their addresses are in one network of 254."""
    with ExitStack() as stack:
        switch = stack.enter_context(holder("--net", _SWITCH))
        hosts = []
        for number in range(1, count + 1):
            host = SwitchedHost(stack.enter_context(holder("--net --mount", _HOST)), f"10.78.0.{number}")
            _run(host.process, f"ip link add {DEVICE} type veth peer name port{number} netns {switch}")
            _run(host.process, f"ip address add {host.address}/24 dev {DEVICE} && ip link set {DEVICE} up")
            _run(switch, f"ip link set port{number} master switch && ip link set port{number} up")
            hosts.append(host)
        yield tuple(hosts)


def _run(process: int, script: str) -> None:
    """A script of the shell in the network of a process."""
    subprocess.run(["nsenter", f"--target={process}", "--net", "--", "sh", "-ec", script], check=True)


def held_mb(process: int) -> float:
    """Memory of a process, MB: its proportional share, so that what several processes share counts once."""
    rows = Path(f"/proc/{process}/smaps_rollup").read_text(encoding="ascii")
    return int(rows.split("\nPss:")[1].split()[0]) * 1024 / 1e6


def cores() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0))
