"""What of a running node listens on which address, and who reaches it from another computer: as SECURITY.md says.

The other computer is a network namespace; where the system does not let these be made, what needs them is skipped.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import pytest
from network.hosts import two_hosts, why_not
from network.relay import ADDRESSES

from rotary_error_monitor.resources import config
from rotary_error_monitor.testing.domains import own_domain

LOCALHOST = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
SUBNET = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}
MEMORY = {**SUBNET, "FASTDDS_BUILTIN_TRANSPORTS": "SHM"}
LOOPBACK = {**SUBNET, "FASTRTPS_DEFAULT_PROFILES_FILE": str(config("security/loopback.xml"))}
PYTHON = [sys.executable, "-m"]
NODE = [*PYTHON, "rotary_error_monitor.nodes.encoder_head", "--ros-args", "-r", "__node:=encoder_head_a",
        "-p", "source:=mock"]  # fmt: skip
EVERY_ADDRESS = "0.0.0.0"

# Listens to the node's samples and asks for its state; says what came of it.
VISITOR = """
import sys, time, rclpy
from lifecycle_msgs.srv import GetState
from sensor_msgs.msg import PointCloud2
rclpy.init()
node = rclpy.create_node("visitor")
heard = []
node.create_subscription(PointCloud2, "/stage/head_a/samples", heard.append, 10)
end = time.monotonic() + float(sys.argv[1])
while time.monotonic() < end and not heard:
    rclpy.spin_once(node, timeout_sec=0.1)
client = node.create_client(GetState, "/encoder_head_a/get_state")
answer = None
if heard and client.wait_for_service(60):
    future = client.call_async(GetState.Request())
    rclpy.spin_until_future_complete(node, future, timeout_sec=60)
    answer = future.result()
print("heard" if heard else "silence", "answered" if answer else "unanswered")
rclpy.shutdown()
"""


def addresses(pid: int) -> dict[str, list[str]]:
    """Local addresses of the IPv4 sockets of a process: 'udp' all, 'tcp' those that listen."""
    links = [str(path.readlink()) for path in Path(f"/proc/{pid}/fd").iterdir() if path.is_symlink()]
    inodes = {link.removeprefix("socket:[").rstrip("]") for link in links if link.startswith("socket:[")}
    found: dict[str, list[str]] = {"udp": [], "tcp": []}
    for kind, listed in found.items():
        for line in Path(f"/proc/{pid}/net/{kind}").read_text().splitlines()[1:]:
            words = line.split()
            if words[9] in inodes and (kind == "udp" or words[3] == "0A"):
                number = bytes.fromhex(words[1].split(":")[0])
                listed.append(".".join(map(str, reversed(number))))
    return found


@contextmanager
def head(domain: int, environment: Mapping[str, str], within: tuple[str, ...] = ()) -> Iterator[int]:
    """Process id of a read head that runs, in a network namespace or in that of this process."""
    process = subprocess.Popen(
        [*within, *NODE],
        env={**os.environ, "ROS_DOMAIN_ID": str(domain), **environment},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    try:
        yield process.pid
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(60)
        finally:
            process.kill()


def visit(domain: int, environment: Mapping[str, str], patience: float, within: tuple[str, ...] = ()) -> str:
    done = subprocess.run(
        [*within, sys.executable, "-c", VISITOR, str(patience)],
        env={**os.environ, "ROS_DOMAIN_ID": str(domain), **environment},
        capture_output=True,
        text=True,
        timeout=240,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


@pytest.mark.parametrize(
    ("environment", "open_to_all"),
    [(SUBNET, True), (LOCALHOST, False), (MEMORY, False), (LOOPBACK, False)],
    ids=["subnet", "localhost", "shared memory", "loopback"],
)
def test_what_listens(environment, open_to_all):
    with own_domain() as domain, head(domain, environment) as pid:
        assert visit(domain, environment, 60.0) == "heard answered"
        found = addresses(pid)
    assert found["tcp"] == []
    assert (EVERY_ADDRESS in found["udp"]) == open_to_all
    if environment == MEMORY:
        assert found["udp"] == []
    if environment in (LOCALHOST, LOOPBACK):
        assert {address for address in found["udp"] if not address.startswith("127.")} == set()


@pytest.fixture(scope="module")
def hosts() -> Iterator[tuple[tuple[str, ...], tuple[str, ...]]]:
    """What stands before a command that shall run on each of two computers with a cable between them."""
    if why_not():
        pytest.skip(why_not())
    with two_hosts() as cable:
        yield cable.hosts[0].command, cable.hosts[1].command


STRANGER = {**SUBNET, "ROS_STATIC_PEERS": ADDRESSES[0], "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"}


def test_another_computer_reaches_a_node_that_discovers_the_subnet(hosts):
    """What SECURITY.md warns of: who knows the address hears everything and may call every service."""
    with own_domain() as domain, head(domain, SUBNET, hosts[0]):
        # it is up: a stranger announces itself to it only for a moment
        assert visit(domain, {**SUBNET, "ROS_STATIC_PEERS": "127.0.0.1"}, 60.0, hosts[0]) == "heard answered"
        assert visit(domain, STRANGER, 60.0, hosts[1]) == "heard answered"


@pytest.mark.parametrize("environment", [LOCALHOST, MEMORY, LOOPBACK], ids=["localhost", "shared memory", "loopback"])
def test_another_computer_does_not_reach_a_node_that_is_closed(hosts, environment):
    with own_domain() as domain, head(domain, environment, hosts[0]):
        assert visit(domain, environment, 60.0, hosts[0]) == "heard answered"
        began = time.monotonic()
        assert visit(domain, STRANGER, 6.0, hosts[1]) == "silence unanswered"
        assert time.monotonic() - began > 6.0
