"""A network that comes up after the nodes: who began without it is not heard over it until it is started anew.

So SECURITY.md says ("What listens, and where"). The processes of this test look once which networks there are, as those
of a cell do.
"""

from __future__ import annotations

import ctypes
import fcntl
import multiprocessing
import signal
import socket
import struct
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import pytest
from faults.documenting import Row, shows
from faults.live.other_programs import stated

from network.hosts import Host, two_hosts, why_not
from rotary_error_monitor.testing import Cell, NodeProcess

pytestmark = [pytest.mark.cell, pytest.mark.skipif(bool(why_not()), reason=why_not() or "-")]

_DEVICE = b"eth0"
_SIOCGIFFLAGS, _SIOCSIFFLAGS, _IFF_UP, _IFF_RUNNING = 0x8913, 0x8914, 0x01, 0x40  # linux/sockios.h, linux/if.h
_PR_SET_PDEATHSIG = 1  # linux/prctl.h

LONG_ENOUGH = 8.0
"""Participants announce themselves every three seconds: after so long, s, one that can be found has been found."""

DISCOVERY = 4.0
"""Longest time, s, in which one that begins with the network is found."""

SWITCHED = 10.0
"""Longest time, s, in which a network is up or down once it is told so."""

_STEP = 0.01


@dataclass(frozen=True)
class Heard:
    """How many messages of the far head came: without a network, after it came up, and from the head started anew."""

    before: int
    late: int
    anew: int


@shows(
    Row(
        group="network",
        fault="a computer whose network comes up after its nodes have begun",
        seen="on the other computers as an absent stream or node; on its own nothing is said",
        done="nothing: the middleware of a node keeps to the networks that it found when it began",
        published="over the network nothing of these nodes, also once it is up",
        recovery="when they are started anew, within 4 s; let a cell start after `network-online.target`",
    )
)
@pytest.mark.long  # what the middleware does, not this package
def test_a_node_that_began_without_the_network_is_heard_only_once_it_is_started_anew():
    fresh = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=fresh, initializer=_prepare) as process:
        heard = process.submit(_run).result()
    assert heard.before == 0
    assert heard.late == 0, "it is heard all the same: SECURITY.md says too little"
    assert heard.anew > 0


def _run() -> Heard:
    with two_hosts() as cable, cable.hosts[0].entered(), Cell(reach="SUBNET") as cell:
        far = cable.hosts[1]
        received = cell.collect(cell.wire.topic("head_samples", "a"))

        def start() -> NodeProcess:
            return cell.start(
                "encoder_head", "encoder_head_a", within=far.command, head="a", block_period=0.02, source="mock"
            )

        cable.cut()  # what is sent to a device that is down cannot be handed over
        _plug(far, up=False)
        head = start()
        cell.wait_until(lambda: ": active" in head.output, "a head without a network", 60.0)
        cell.spin_for(1.0)
        before = len(received)
        _plug(far, up=True)
        cable.impair()
        cell.spin_for(LONG_ENOUGH)
        late = len(received)
        assert head.stop() == 0, head.ending
        head = start()
        cell.wait_until(lambda: ": active" in head.output, "the head started anew", 60.0)
        with stated("its first samples", DISCOVERY):
            cell.wait_until(lambda: len(received) > late, "its samples")
        assert head.stop() == 0, head.ending
        return Heard(before, late, len(received) - late)


def _plug(host: Host, *, up: bool) -> None:
    """Switch the network of a host on or off, and wait until it is."""
    with host.entered(), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asked:
        flags = _flags(asked)
        fcntl.ioctl(asked, _SIOCSIFFLAGS, struct.pack("16sH14x", _DEVICE, flags | _IFF_UP if up else flags & ~_IFF_UP))
        wanted = _IFF_RUNNING if up else 0
        for _ in range(round(SWITCHED / _STEP)):
            if _flags(asked) & _IFF_RUNNING == wanted:
                return
            signal.sigtimedwait([], _STEP)
        pytest.fail(f"the network of {host.address} is not {'up' if up else 'down'} within {SWITCHED:g} s")


def _flags(asked: socket.socket) -> int:
    (flags,) = struct.unpack("16xH", fcntl.ioctl(asked, _SIOCGIFFLAGS, struct.pack("16sH14x", _DEVICE, 0))[:18])
    return int(flags)


def _prepare() -> None:
    """The process ends with its parent."""
    ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
