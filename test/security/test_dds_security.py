"""Keys and permissions of the package against DDS Security itself: Fast DDS of the distribution, with its plugins.

The ROS wheels' Fast DDS lacks the plugins, so participants of a small program stand for the nodes: each takes the
enclave that `rotary_error_monitor security keys` makes for a node, and a topic as ROS names it on the wire.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from rotary_error_monitor.cli import main
from rotary_error_monitor.testing.domains import own_domain

HEADER = Path("/usr/include/fastdds/dds/domain/DomainParticipant.hpp")
pytestmark = pytest.mark.skipif(
    shutil.which("g++") is None or not HEADER.is_file(), reason="needs g++ and libfastrtps-dev, with DDS Security"
)
CORRECTIONS = "rt/machine/axis_corrections"
RESET = "rq/compensation/resetRequest"
PATIENCE = 60.0


@pytest.fixture(scope="module")
def program(tmp_path_factory) -> Path:
    built = tmp_path_factory.mktemp("probe") / "dds_probe"
    source = Path(__file__).with_name("dds_probe.cpp")
    command = ["g++", "-std=c++17", "-w", "-o", str(built), str(source), "-lfastrtps", "-lfastcdr"]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    return built


class Participant:
    """A process with what it has said so far."""

    def __init__(self, command: list[str], output: Path) -> None:
        self._output = output
        with output.open("w") as file:
            self.process = subprocess.Popen(command, stdout=file, stderr=subprocess.DEVNULL)

    @property
    def said(self) -> list[str]:
        return self._output.read_text().split("\n")[:-1]

    def wait_for(self, word: str) -> None:
        end = time.monotonic() + PATIENCE
        while word not in self.said:
            assert time.monotonic() < end, f"waited for '{word}', heard {self.said[:5]}"
            time.sleep(0.05)


@pytest.fixture
def start(program, tmp_path, capsys) -> Iterator[Callable[..., Participant]]:
    """Function that starts a participant: role, topic, and the node whose keys it has, or '' for none."""
    with own_domain() as domain:
        keys = tmp_path / "keys"
        assert main(["security", "keys", str(keys), "--domain", str(domain)]) == 0
        capsys.readouterr()
        running: list[Participant] = []

        def begin(role: str, topic: str, node: str = "") -> Participant:
            enclave = [str(keys / "enclaves" / node)] if node else []
            output = tmp_path / f"output_{len(running)}"
            running.append(Participant([str(program), role, topic, str(domain), *enclave], output))
            return running[-1]

        try:
            yield begin
        finally:
            for participant in running:
                participant.process.kill()
                participant.process.wait()


def test_the_compensation_is_heard_and_whoever_has_no_keys_is_not(start):
    bridge = start("subscribe", CORRECTIONS, "linuxcnc_bridge")
    bridge.wait_for("open")
    stranger = start("publish", CORRECTIONS)
    stranger.wait_for("open")
    time.sleep(4.0)  # several times what discovery takes below
    assert "heard" not in bridge.said
    start("publish", CORRECTIONS, "compensation")
    bridge.wait_for("heard")


@pytest.mark.parametrize("node", ["encoder_head_a", "error_estimator", "recorder", "operator"])
def test_keys_without_the_topic_do_not_publish_corrections(start, node):
    forger = start("publish", CORRECTIONS, node)
    forger.wait_for("refused: writer")


def test_a_head_does_not_speak_for_another(start):
    start("publish", "rt/stage/head_b/samples", "encoder_head_a").wait_for("refused: writer")
    start("publish", "rt/stage/head_a/samples", "encoder_head_a").wait_for("open")


def test_whoever_has_no_keys_hears_nothing(start):
    stranger = start("subscribe", CORRECTIONS)
    stranger.wait_for("open")
    start("publish", CORRECTIONS, "compensation").wait_for("open")
    start("subscribe", CORRECTIONS, "linuxcnc_bridge").wait_for("heard")
    assert "heard" not in stranger.said


def test_the_operator_may_reset_and_a_node_may_not(start):
    compensation = start("subscribe", RESET, "compensation")
    compensation.wait_for("open")
    start("publish", RESET, "recorder").wait_for("refused: writer")
    start("publish", RESET, "operator")
    compensation.wait_for("heard")


def test_keys_are_for_their_domain_alone(program, tmp_path, capsys):
    """The permissions say domain 0, where nothing of this test speaks."""
    assert main(["security", "keys", str(tmp_path / "keys"), "--domain", "0"]) == 0
    capsys.readouterr()
    with own_domain() as domain:
        command = [str(program), "publish", CORRECTIONS, str(domain), str(tmp_path / "keys/enclaves/compensation")]
        said = subprocess.run(command, capture_output=True, text=True, timeout=60, env=os.environ).stdout
    assert said.splitlines()[-1].startswith("refused: ")
