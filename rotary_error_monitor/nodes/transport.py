"""The transport between processes: UDP, unless whoever starts them chose one.

Fast DDS as it comes moves samples through shared memory. A process that stands still for more than a second (stopped, a
computer that is suspended or short of processors) counts as broken there, and what is made anew for it is often not
found again by those who write to it: they go on, all looks alive, and it hears nothing any more. UDP on the same
computer goes on, and costs no more at the rates of a cell (`make bench`).

The discovery range `LOCALHOST` of ROS always adds shared memory, and sockets on every address of the computer. What it
asks for, nodes of this computer alone, is had from Fast DDS itself instead.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from rclpy.utilities import get_rmw_implementation_identifier

from rotary_error_monitor.resources import config

RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
TRANSPORTS = "FASTDDS_BUILTIN_TRANSPORTS"
PROFILES = "FASTRTPS_DEFAULT_PROFILES_FILE"
_CHOICES = (TRANSPORTS, PROFILES, "FASTDDS_DEFAULT_PROFILES_FILE")
"""Variables by which the transports of Fast DDS are chosen."""
_WIDER = ("ROS_STATIC_PEERS", "ROS_LOCALHOST_ONLY")
"""Variables that change what the range `LOCALHOST` means."""


@contextmanager
def environment(variables: Mapping[str, str]) -> Iterator[None]:
    """Set variables of this process's environment for a while."""
    before = {name: os.environ.get(name) for name in variables}
    os.environ.update(variables)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


@contextmanager
def steady_transport() -> Iterator[None]:
    """Set the environment for what follows, the start of ROS and of its first node, which reads it."""
    with environment(transport_variables(os.environ, get_rmw_implementation_identifier())):
        yield


def transport_variables(environment: Mapping[str, str], middleware: str) -> dict[str, str]:
    """What to set before ROS starts: nothing where a transport was chosen, or for other middleware.

    Args:
        environment: of the process.
        middleware: identifier of the implementation, such as `rmw_fastrtps_cpp`.
    """
    if not middleware.startswith("rmw_fastrtps") or any(environment.get(name) for name in _CHOICES):
        return {}
    if environment.get(RANGE) != "LOCALHOST":
        return {TRANSPORTS: "UDPv4", PROFILES: str(config("subnet.xml"))}
    if any(environment.get(name) for name in _WIDER):
        return {}
    return {RANGE: "SUBNET", PROFILES: str(config("security/loopback.xml"))}
