"""A network between two hosts in user space: it delays frames, loses some, and can be cut.

It holds the far end of a TAP device in each of two network namespaces and hands over what comes out of one to the
other, as a cable with `netem` would, without needing its kernel module. With this process the devices go.

    python relay.py PID PID    the namespaces of two processes; orders come on standard input, a line each:
    delay 0.02 jitter 0.005 loss 0.02    from now on, s and part of the frames, in each direction; answered by `done`
    counts                     answered by `<frames handed over> <frames lost>`, since the last such order
"""

from __future__ import annotations

import contextlib
import ctypes
import fcntl
import heapq
import os
import random
import selectors
import socket
import struct
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

DEVICE = b"eth0"
ADDRESSES = ("10.77.0.1", "10.77.0.2")
_NETMASK = "255.255.255.0"

_CLONE_NEWNET = 0x40000000  # linux/sched.h
_TUNSETIFF = 0x400454CA  # linux/if_tun.h
_IFF_TAP_NO_PI = 0x0002 | 0x1000
_SIOCGIFFLAGS, _SIOCSIFFLAGS, _SIOCSIFADDR, _SIOCSIFNETMASK = 0x8913, 0x8914, 0x8916, 0x891C  # linux/sockios.h
_IFF_UP, _IFF_RUNNING = 0x01, 0x40

_LARGEST_FRAME = 65536


@dataclass
class Impairment:
    """What the network does to frames, each direction alike: delay and jitter in s, loss as a part of the frames."""

    delay: float = 0.0
    jitter: float = 0.0
    loss: float = 0.0


@dataclass
class Relay:
    """Hands frames from one device to the other.

    Attributes:
        ends: file descriptors of the two devices.
        impairment: in force.
        passed, lost: frames since they were last asked for.
    """

    ends: tuple[int, int]
    impairment: Impairment = field(default_factory=Impairment)
    passed: int = 0
    lost: int = 0
    _chance: random.Random = field(default_factory=lambda: random.Random(1))
    _waiting: list[tuple[float, int, int, bytes]] = field(default_factory=list)
    _number: int = 0

    def run(self) -> None:
        """Until standard input ends."""
        selector = selectors.DefaultSelector()
        for end, other in (self.ends, self.ends[::-1]):
            selector.register(end, selectors.EVENT_READ, other)
        selector.register(sys.stdin.fileno(), selectors.EVENT_READ)
        while True:
            timeout = max(0.0, self._waiting[0][0] - time.monotonic()) if self._waiting else None
            for key, _ in selector.select(timeout):
                if key.data is not None:
                    self._take(key.fd, key.data)
                elif not self._obey():
                    return
            self._hand_over()

    def _take(self, end: int, other: int) -> None:
        """All frames that wait at one end; each goes its own time, so that jitter changes their order."""
        impairment = self.impairment
        while True:
            try:
                frame = os.read(end, _LARGEST_FRAME)
            except BlockingIOError:
                return
            if self._chance.random() < impairment.loss:
                self.lost += 1
                continue
            due = time.monotonic() + impairment.delay + self._chance.uniform(-1.0, 1.0) * impairment.jitter
            self._number += 1
            heapq.heappush(self._waiting, (due, self._number, other, frame))

    def _hand_over(self) -> None:
        while self._waiting and self._waiting[0][0] <= time.monotonic():
            _, _, end, frame = heapq.heappop(self._waiting)
            os.write(end, frame)
            self.passed += 1

    def _obey(self) -> bool:
        """One order; whether there was one."""
        words = os.read(sys.stdin.fileno(), 4096).decode().split()
        if not words:
            return False
        if words == ["counts"]:
            print(self.passed, self.lost, flush=True)
            self.passed = self.lost = 0
        else:
            self.impairment = Impairment(
                **{name: float(value) for name, value in zip(words[::2], words[1::2], strict=True)}
            )
            print("done", flush=True)
        return True


def open_device(process: int, address: str) -> int:
    """TAP device with an address in the network namespace of a process, and the loopback up: its file descriptor.

    Linux may say a second later only that it runs (`link_watch.c`), and until then a DDS participant that begins takes
    it for absent, for good.
    """
    with Path(f"/proc/{process}/ns/net").open(encoding="ascii") as namespace:
        if ctypes.CDLL(None, use_errno=True).setns(namespace.fileno(), _CLONE_NEWNET) != 0:
            raise OSError(ctypes.get_errno(), f"cannot enter the network of process {process}")
    device = os.open("/dev/net/tun", os.O_RDWR | os.O_NONBLOCK)
    fcntl.ioctl(device, _TUNSETIFF, struct.pack("16sH22x", DEVICE, _IFF_TAP_NO_PI))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as asked:
        for order, value in ((_SIOCSIFADDR, address), (_SIOCSIFNETMASK, _NETMASK)):
            number = socket.inet_aton(value)
            fcntl.ioctl(asked, order, struct.pack("16sH2x4s16x", DEVICE, socket.AF_INET, number))
        for name in (DEVICE, b"lo"):
            fcntl.ioctl(asked, _SIOCSIFFLAGS, struct.pack("16sH14x", name, _flags(asked, name) | _IFF_UP))
        while not _flags(asked, DEVICE) & _IFF_RUNNING:
            time.sleep(0.01)
    return device


def _flags(asked: socket.socket, name: bytes) -> int:
    (flags,) = struct.unpack("16xH", fcntl.ioctl(asked, _SIOCGIFFLAGS, struct.pack("16sH14x", name, 0))[:18])
    return int(flags)


def main() -> None:
    first, second = (open_device(int(pid), address) for pid, address in zip(sys.argv[1:], ADDRESSES, strict=True))
    with contextlib.suppress(PermissionError):
        # of a tenth of a processor: late frames would be another network than the one that is asked for
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
    print("ready", flush=True)
    Relay((first, second)).run()


if __name__ == "__main__":
    main()
