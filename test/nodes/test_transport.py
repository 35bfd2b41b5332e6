"""What carries messages between processes: no shared memory, and profiles that the middleware takes."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest
from std_msgs.msg import String

from rotary_error_monitor.nodes.transport import PROFILES, RANGE, TRANSPORTS, transport_variables
from rotary_error_monitor.resources import config
from rotary_error_monitor.testing import Cell


@pytest.mark.parametrize("name", ["fastdds.xml", "subnet.xml", "security/loopback.xml"])
def test_the_middleware_takes_the_shipped_profiles(cell, tmp_path, monkeypatch, name):
    """It says so where it does not, and goes on with its defaults."""
    monkeypatch.setenv(PROFILES, str(config(name)))
    good = cell.start("encoder_head", "encoder_head_a", source="mock")
    bad = tmp_path / "bad.xml"
    bad.write_text(config(name).read_text(encoding="utf-8").replace("heartbeatPeriod", "period"), "utf-8")
    monkeypatch.setenv(PROFILES, str(bad))
    other = cell.start("encoder_head", "encoder_head_b", head="b", source="mock")
    for name in "ab":
        cell.wait_for_status(f"encoder_head_{name}: state", "active")
    assert "XMLPARSER" in other.output
    assert "XMLPARSER" not in good.output


def test_a_process_can_be_started_by_another_command(cell):
    process = cell.start("encoder_head", "encoder_head_a", within=["nice", "-n", "5"], source="mock")
    cell.wait_for_status("encoder_head_a: state", "active")
    stat = Path(f"/proc/{process.pid}/stat").read_text(encoding="ascii")
    assert int(stat.rpartition(")")[2].split()[16]) >= 5
    assert process.stop() == 0


@pytest.mark.parametrize(
    ("environment", "found"),
    [
        ({RANGE: "SUBNET"}, {TRANSPORTS: "UDPv4", PROFILES: str(config("subnet.xml"))}),
        ({TRANSPORTS: ""}, {TRANSPORTS: "UDPv4", PROFILES: str(config("subnet.xml"))}),
        ({RANGE: "LOCALHOST"}, {RANGE: "SUBNET", PROFILES: str(config("security/loopback.xml"))}),
        ({RANGE: "LOCALHOST", "ROS_STATIC_PEERS": "192.0.2.1"}, {}),
        ({RANGE: "LOCALHOST", TRANSPORTS: "SHM"}, {}),
        ({PROFILES: "cell.xml"}, {}),
        ({"FASTDDS_DEFAULT_PROFILES_FILE": "cell.xml"}, {}),
    ],
    ids=repr,
)
def test_transports_unless_somebody_chose(environment, found):
    assert transport_variables(environment, "rmw_fastrtps_cpp") == found
    assert transport_variables(environment, "rmw_cyclonedds_cpp") == {}


def shared_memory(process):
    """Files of Fast DDS in shared memory that a process has mapped."""
    lines = Path(f"/proc/{process.pid}/maps").read_text(encoding="utf-8").splitlines()
    return [line for line in lines if "/dev/shm/fastrtps" in line]


@pytest.mark.parametrize("chosen", ["", "DEFAULT"])
def test_a_node_uses_shared_memory_only_where_it_was_chosen(cell, monkeypatch, chosen):
    monkeypatch.setenv(TRANSPORTS, chosen)
    heard = cell.collect(cell.wire.topic("head_samples", "a"))
    head = cell.start("encoder_head", "encoder_head_a", source="mock")
    cell.wait_until(lambda: len(heard) > 10, "samples")
    assert bool(shared_memory(head)) == bool(chosen)


def carried():
    """Bytes that the loopback interface has carried."""
    lines = Path("/proc/net/dev").read_text(encoding="ascii").splitlines()
    return int(next(line for line in lines if line.split(":")[0].strip() == "lo").split(":")[1].split()[0])


def carried_of_one_process(size, count):
    """Bytes that the loopback interface carries of messages from a node to itself."""
    with Cell() as cell:
        heard = []
        cell.node.create_subscription(String, "large", heard.append, 10)
        publisher = cell.node.create_publisher(String, "large", 10)
        cell.wait_until(lambda: publisher.get_subscription_count() == 1, "its subscription")
        before = carried()
        for number in range(1, count + 1):
            publisher.publish(String(data=size * "x"))
            cell.wait_until(lambda number=number: len(heard) == number, f"message {number}")
        return carried() - before


def test_nothing_is_handed_over_within_a_process():
    """Fast DDS does so under locks that the end of a participant's lease takes the other way round, and hangs.

    The first participant of a process takes the profiles for all that follow.
    """
    size, count = 100_000, 50
    program = f"from nodes.test_transport import carried_of_one_process as run; print(run({size}, {count}))"
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=Path(__file__).parents[1], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert int(done.stdout.split()[-1]) > size * count
