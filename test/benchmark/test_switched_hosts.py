"""The hosts that benchmarks count traffic on: what is sent arrives and is counted, and nothing is left of them."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
from benchmark.switched_hosts import SwitchedHost, switched_hosts, why_not
from network.hosts import Host

PORT, COUNT, SIZE = 7000, 50, 1000
OVERHEAD = 14 + 20 + 8
"""Bytes of a frame before the data of a datagram: Ethernet, IPv4, UDP."""

pytestmark = pytest.mark.skipif(bool(why_not()), reason=why_not() or "-")


def opened(host: SwitchedHost) -> socket.socket:
    with Host(host.process, host.address).entered():
        own = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    own.bind((host.address, PORT))
    own.settimeout(5.0)
    return own


def test_datagrams_arrive_where_they_are_sent_to_and_are_counted():
    with (
        switched_hosts(3) as hosts,
        opened(hosts[0]) as sender,
        opened(hosts[1]) as receiver,
        opened(hosts[2]) as third,
    ):
        sender.sendto(b"who", (hosts[1].address, PORT))  # who has this address is asked for first
        assert receiver.recv(SIZE) == b"who"
        before = [host.traffic for host in hosts]
        for number in range(COUNT):
            sender.sendto(number.to_bytes(2, "big") + bytes(SIZE - 2), (hosts[1].address, PORT))
        assert [int.from_bytes(receiver.recv(2 * SIZE)[:2], "big") for _ in range(COUNT)] == list(range(COUNT))
        sent, received, beside = (host.traffic.since(then) for host, then in zip(hosts, before, strict=True))
        third.settimeout(0.1)
        with pytest.raises(TimeoutError):
            third.recv(SIZE)
    whole = COUNT * (SIZE + OVERHEAD)
    assert sent.datagrams == COUNT and received.datagrams == 0 and beside.datagrams == 0
    assert whole <= sent.sent_bytes < whole + 1000  # neighbours may ask for addresses meanwhile
    assert whole <= received.received_bytes < whole + 1000
    assert beside.received_bytes < 1000 and sent.inside_bytes == 0


def test_nothing_is_left_when_the_process_that_made_them_is_killed():
    program = (
        "import time\n"
        "from benchmark.switched_hosts import switched_hosts\n"
        "with switched_hosts(2):\n"
        "    print('ready', flush=True)\n"
        "    time.sleep(600)\n"
    )
    folder = Path(__file__).parents[1]
    with subprocess.Popen([sys.executable, "-c", program], cwd=folder, stdout=subprocess.PIPE, text=True) as maker:
        assert maker.stdout is not None and maker.stdout.readline() == "ready\n"
        children = Path(f"/proc/{maker.pid}/task/{maker.pid}/children").read_text(encoding="ascii").split()
        left = [Path("/proc") / each for each in children]
        assert len(left) == 3, "the switch and two hosts"
        os.kill(maker.pid, signal.SIGKILL)
    end = time.monotonic() + 60
    while any(each.exists() for each in left) and time.monotonic() < end:
        time.sleep(0.02)
    assert not [each for each in left if each.exists()], "still there"
