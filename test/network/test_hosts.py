"""The hosts and the cable that other tests rest on do what they say, and nothing is left of them."""

from __future__ import annotations

import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from network.hosts import Cable, Host, two_hosts, why_not

PORT = 7000
pytestmark = pytest.mark.skipif(bool(why_not()), reason=why_not() or "-")


@contextmanager
def listening(host: Host) -> Iterator[socket.socket]:
    with host.entered():
        own = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    with own:
        own.bind((host.address, PORT))
        own.settimeout(0.3)
        yield own


def delays(cable: Cable, sender: socket.socket, receiver: socket.socket, count: int) -> list[float]:
    """Time that each of so many datagrams took, s, of those that arrived once the cable had seen all of them."""
    cable.counts()
    sent = []
    for number in range(count):
        sent.append(time.monotonic())
        sender.sendto(number.to_bytes(2, "big") + bytes(1000), (receiver.getsockname()[0], PORT))
        time.sleep(0.001)
    seen, end = 0, time.monotonic() + 60
    while seen < count:
        assert time.monotonic() < end, f"the cable has seen {seen} of {count}"
        seen += sum(cable.counts())
        time.sleep(0.01)
    found = []
    try:
        while True:
            number = int.from_bytes(receiver.recv(2000)[:2], "big")
            found.append(time.monotonic() - sent[number])
    except TimeoutError:
        return found


def test_the_cable_delays_loses_and_is_cut():
    with two_hosts() as cable, listening(cable.hosts[0]) as one, listening(cable.hosts[1]) as other:
        for sender, receiver in ((one, other), (other, one)):
            cable.impair()
            assert len(delays(cable, sender, receiver, 50)) == 50
            cable.impair(loss=0.2)
            assert 120 < len(delays(cable, sender, receiver, 200)) < 195
            cable.cut()
            assert delays(cable, sender, receiver, 20) == []
        cable.impair(delay=0.02, jitter=0.01)
        took = []
        receiver.setblocking(True)
        while len(took) < 100 or (min(took) > 0.0125 and len(took) < 2000):  # a busy computer only adds to them
            begin = time.monotonic()
            sender.sendto(b"there", (receiver.getsockname()[0], PORT))
            receiver.recv(2000)
            took.append(time.monotonic() - begin)
        assert 0.01 <= min(took) <= 0.0125, "0.01 to 0.03, one in eight below this where the cable is in time"
        assert np.median(took) > 0.015


def test_hosts_share_nothing_with_this_computer_and_one_another():
    with two_hosts() as cable:
        for host in cable.hosts:
            with host.entered():
                assert sorted(name for _, name in socket.if_nameindex()) == ["eth0", "lo"]
        ids = ("self", *(host.process for host in cable.hosts))
        assert len({Path(f"/proc/{each}/ns/net").readlink() for each in ids}) == 3
        shared = subprocess.run([*cable.hosts[1].command, "ls", "/dev/shm"], capture_output=True, check=True)
        assert shared.stdout == b"", "memory of another host"


def test_nothing_is_left_when_the_process_that_made_them_is_killed():
    program = (
        "import subprocess, time\n"
        "from network.hosts import two_hosts\n"
        "with two_hosts() as cable:\n"
        "    guest = subprocess.Popen([*cable.hosts[1].command, 'sh', '-c', 'echo ready; exec sleep 600'], stdout=-1)\n"
        "    guest.stdout.readline()\n"
        "    print('ready', flush=True)\n"
        "    time.sleep(600)\n"
    )
    folder = Path(__file__).parents[1]
    with subprocess.Popen([sys.executable, "-c", program], cwd=folder, stdout=subprocess.PIPE, text=True) as maker:
        assert maker.stdout is not None
        maker.stdout.readline()
        left = [
            Path("/proc") / each for each in Path(f"/proc/{maker.pid}/task/{maker.pid}/children").read_text().split()
        ]
        assert len(left) == 4, "two hosts, the relay, and what was started on a host"
        os.kill(maker.pid, signal.SIGKILL)
    end = time.monotonic() + 60
    while any(each.exists() for each in left) and time.monotonic() < end:
        time.sleep(0.02)
    assert not [each for each in left if each.exists()], "still there"
