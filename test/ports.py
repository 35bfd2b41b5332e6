"""Ports for servers under test."""

from __future__ import annotations

import random
import socket
from pathlib import Path

_OUTGOING = Path("/proc/sys/net/ipv4/ip_local_port_range")
_HIGHEST = 65535


def free_port(kind: socket.SocketKind = socket.SOCK_STREAM) -> int:
    """A port of TCP, or of another kind, that nobody has here: one by chance, for tests run beside one another.

    None that the system gives to who asks for any or connects to others: one of these might have it before the server
    that it is for, or while that one is started anew.
    """
    _, last = map(int, _OUTGOING.read_text(encoding="ascii").split())
    for port in random.SystemRandom().sample(range(last + 1, _HIGHEST + 1), _HIGHEST - last):
        if _is_free(port, kind):
            return port
    with socket.socket(type=kind) as probe:  # where the system gives all of them
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def _is_free(port: int, kind: socket.SocketKind) -> bool:
    with socket.socket(type=kind) as probe:
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return False
    return True
