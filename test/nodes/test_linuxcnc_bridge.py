"""The bridge between LinuxCNC and ROS: against the real controller, and without one."""

import json
import math
import shlex
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from std_srvs.srv import Trigger

from rotary_error_monitor.controller import presence
from rotary_error_monitor.controller.connection import Connection
from rotary_error_monitor.controller.instance import Instance
from rotary_error_monitor.controller.modules import system_program
from rotary_error_monitor.controller.protocol import Observation, ObserverSettings
from rotary_error_monitor.nodes import messages
from rotary_error_monitor.nodes.linuxcnc_bridge import LinuxcncBridge
from rotary_error_monitor.resources import config
from rotary_error_monitor.testing import Cell

CORRECTION = {"X": 10e-6, "Y": -20e-6, "Z": 7e-6, "A": 1e-4, "C": -2e-4}
NAMES = tuple(CORRECTION)
CONTROLLER, MACHINE, CORRECTIONS = (f"linuxcnc_bridge: {what}" for what in ("controller", "machine", "corrections"))


@pytest.fixture
def cnc():
    if shutil.which("linuxcnc") is None:
        pytest.skip("LinuxCNC is not installed (apt-get install linuxcnc-uspace)")
    with Instance(config("linuxcnc/xyzac_trt.ini")) as running:
        yield running


def operate(cnc, *arguments):
    done = cnc.run([*system_program("rotary_error_monitor.controller.operation"), *arguments])
    assert done.returncode == 0, done.stderr


def where(cnc):
    """Parameters that let a bridge find the instance."""
    return {"enter": " ".join(cnc.enter), "home": cnc.environment["HOME"]}


def latest_ns(states):
    return messages.ns_from_stamp(states[-1].header.stamp)


class Corrector:
    """Publishes corrections until a condition holds."""

    def __init__(self, cell):
        topic = cell.wire.topic("axis_corrections")
        self.cell, self.frame, self.send = cell, topic.frame, cell.publish_on(topic)

    def __call__(self, condition, what, corrections=CORRECTION, age_ns=0):
        def step():
            stamp_ns = time.time_ns() - age_ns
            names = list(corrections)
            self.send(messages.joint_state_message(stamp_ns, self.frame, names, list(corrections.values())))
            return condition()

        self.cell.wait_until(step, what)


@pytest.mark.linuxcnc
def test_program_positions_go_out_and_corrections_come_in(cnc):
    operate(cnc, "--prepare", "--mdi", "G21 G90 G0 X10 Y20 Z30 A30 C90")
    observations = []
    witness = Connection(ObserverSettings(), observations.append, enter=cnc.enter, environment=cnc.environment)
    try:
        with Cell() as cell:
            states = cell.collect(cell.wire.topic("machine_joint_states"))
            cell.start("linuxcnc_bridge", **where(cnc))
            cell.wait_until(lambda: len(states) > 100, "joint states")
            expected = [-0.02, 0.0013397459621556, 0.0223205080756888, math.radians(30), math.radians(90)]
            assert list(states[-1].name) == list(NAMES)
            assert list(states[-1].position) == pytest.approx(expected, abs=1e-12)
            assert list(states[-1].velocity) == [0.0] * 5
            assert len(states[-1].effort) == 5

            def errors():
                seen = [each for each in observations if isinstance(each, Observation)][-1]
                wanted = zip(seen.joints, expected, CORRECTION.values(), strict=True)
                return [abs(joint - start - correction) for joint, start, correction in wanted]

            correct = Corrector(cell)
            correct(lambda: max(errors()) < 1e-9, "the joints to move by the corrections, to 1 nm and 1 nrad")
            correct(lambda: cell.status(CORRECTIONS).message == "applied", "the bridge to say so")
            assert list(states[-1].position) == pytest.approx(expected, abs=1e-12), "corrections are left out"
            stamps = [messages.ns_from_stamp(state.header.stamp) for state in states]
            assert (len(stamps) - 1) / (stamps[-1] - stamps[0]) * 1e9 > 100
            cell.wait_for_status(CORRECTIONS, "too old: the last one is held")
            assert max(errors()) < 1e-9
            answer = cell.call(Trigger, "/linuxcnc_bridge/clear_offsets")
            assert answer.success
            cell.wait_for_status(CORRECTIONS, "no correction has come yet")
            offsets = [abs(joint - start) for joint, start in zip(observations[-1].joints, expected, strict=True)]
            assert max(offsets) < 1e-9
    finally:
        witness.close()


@pytest.mark.linuxcnc
def test_wrong_corrections_are_refused_and_the_machine_stays(cnc):
    operate(cnc, "--prepare")
    with Cell() as cell:
        cell.start("linuxcnc_bridge", **where(cnc))
        cell.wait_for_status(CONTROLLER, "connected")
        correct = Corrector(cell)

        def told(text):
            return lambda: text in cell.status(CORRECTIONS).message

        correct(told("correction of X is 0.001; expected at most 0.0005"), "the refusal", {"X": 1e-3})
        correct(told("correction for B"), "the refusal", {"B": 1e-6})
        correct(told("expected at most 0.1 s"), "the refusal", {"X": 1e-6}, age_ns=400_000_000)
        assert cell.figures(CORRECTIONS)["offset_x"] == "0"


@pytest.mark.linuxcnc
def test_while_the_machine_is_off_nothing_is_published_and_the_diagnostics_say_so(cnc):
    with Cell() as cell:
        states = cell.collect(cell.wire.topic("machine_joint_states"))
        cell.start("linuxcnc_bridge", **where(cnc))
        cell.wait_for_status(MACHINE, "the machine is off; no joint states are published")
        assert states == []
        operate(cnc, "--prepare")
        cell.wait_until(lambda: len(states) > 10, "joint states")
        operate(cnc, "--off")
        off_ns = time.time_ns()
        cell.wait_for_status(MACHINE, "the machine is off")
        cell.spin_for(0.5)
        assert latest_ns(states) < off_ns


@pytest.mark.linuxcnc
@pytest.mark.parametrize("how", ["killed", "stopped"])
def test_the_end_of_linuxcnc_is_noticed_within_half_a_second(cnc, how):
    operate(cnc, "--prepare")
    with Cell() as cell:
        states = cell.collect(cell.wire.topic("machine_joint_states"))
        cell.start("linuxcnc_bridge", **where(cnc))
        cell.wait_until(lambda: len(states) > 10, "joint states")
        if how == "killed":
            listing = cnc.run(["halcmd", "show", "comp"]).stdout
            assert cnc.run(["kill", "-9", str(presence.component_pid(listing, presence.TASK))]).returncode == 0
        else:
            cnc.stop()
        end_ns = time.time_ns()
        # The clean stop takes time itself, during which LinuxCNC is half alive.
        reasons = ("task process has ended", "shuts down", "no LinuxCNC runs here", "task process")
        cell.wait_until(lambda: any(word in cell.status(CONTROLLER).message for word in reasons), "the reason")
        cell.spin_for(0.5)
        assert latest_ns(states) - end_ns < 500_000_000


@pytest.fixture
def place():
    """Command into namespaces in which LinuxCNC can come and go, apart from any other."""
    if shutil.which("linuxcnc") is None:
        pytest.skip("LinuxCNC is not installed (apt-get install linuxcnc-uspace)")
    root = shlex.quote(str(Path(__file__).parents[2]))  # the checkout may itself lie in /tmp
    mount = (
        f"mount --bind {root} /mnt && mount -t tmpfs -o mode=1777 tmpfs /tmp && mkdir -p {root} "
        f"&& mount --bind /mnt {root} && echo ready && exec sleep 600"
    )
    unshare = ["unshare", "--ipc", "--pid", "--net", "--mount", "--fork", "--mount-proc", "--kill-child"]
    holder = subprocess.Popen([*unshare, "sh", "-c", mount], stdout=subprocess.PIPE, text=True)
    try:
        if holder.stdout.readline() != "ready\n":
            pytest.skip("the system allows no namespaces (unshare needs root)")
        child = Path(f"/proc/{holder.pid}/task/{holder.pid}/children").read_text().split()[0]
        yield ["nsenter", "--target", child, "--ipc", "--pid"]
    finally:
        holder.kill()
        holder.wait()
        holder.stdout.close()


@pytest.mark.linuxcnc
def test_a_linuxcnc_that_comes_back_is_found_again(place):
    """It runs unisolated as far as it knows: as on a machine of one's own."""
    host = Path(__file__).with_name("linuxcnc_host.py")
    with Cell() as cell:
        cell.start("linuxcnc_bridge", enter=" ".join(place))
        for _ in range(2):
            cell.wait_for_status(CONTROLLER, "no LinuxCNC runs here")
            command = [*place, "--mount", "--net", sys.executable, str(host), str(config("linuxcnc/xyzac_trt.ini"))]
            linuxcnc = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
            try:
                assert linuxcnc.stdout.readline() == "refused: another LinuxCNC runs here\n"
                cell.wait_for_status(CONTROLLER, "connected")
            finally:
                linuxcnc.communicate()
            assert linuxcnc.returncode == 0


@pytest.mark.linuxcnc
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_the_bridge_within_a_second(cnc, number):
    operate(cnc, "--prepare")
    with Cell() as cell:
        bridge = cell.start("linuxcnc_bridge", **where(cnc))
        cell.wait_for_status(CONTROLLER, "connected")
        begin = time.monotonic()
        assert bridge.stop(number) == 0
        assert time.monotonic() - begin < 1.0
    assert "rotary-error-monitor" not in cnc.run(["halcmd", "show", "comp"]).stdout


def fake_link(tmp_path, *lines, then="cat >&2"):
    """An interpreter that answers as the link would."""
    path = tmp_path / "python3"
    text = "\n".join(lines)
    path.write_text(f"#!/bin/sh\ncat <<'E'\n{text}\nE\n{then}\n")
    path.chmod(0o755)
    return str(path)


def state(**values):
    """What the link says, by default an hour ahead so that it does not grow old."""
    defaults = {
        "kind": "State", "stamp_ns": time.time_ns() + HOUR_NS, "positions": [0.1], "velocities": [0.0], "valid": True,
        "offsets": [1e-6], "lag": 0.0, "limited": False, "trouble": "", "refused": "", "takeovers": 0,
        "correction_age": 0.01,
    }  # fmt: skip
    return json.dumps(defaults | values)


HOUR_NS = 3_600_000_000_000
HELLO = '{"kind": "Hello", "names": ["X"]}'


def test_without_linuxcnc_the_bridge_says_so_and_looks_again(tmp_path):
    python = fake_link(tmp_path, '{"kind": "End", "reason": "no LinuxCNC runs here"}', then="exit 1")
    with Cell() as cell:
        cell.run(LinuxcncBridge, "linuxcnc_bridge", python=python)
        status = cell.wait_for_status(CONTROLLER, "no LinuxCNC runs here")
        assert status.level == b"\x02"
        assert not cell.call(Trigger, "/linuxcnc_bridge/clear_offsets").success
        fake_link(tmp_path, HELLO, state())
        cell.wait_for_status(CONTROLLER, "connected")


@pytest.mark.parametrize(
    ("values", "status", "message", "level"),
    [
        ({}, CORRECTIONS, "applied", 0),
        ({"limited": True}, CORRECTIONS, "soft limits of the controller clip the offsets", 1),
        ({"trouble": "too old"}, CORRECTIONS, "too old", 1),
        ({"refused": "correction for B", "correction_age": -1.0}, CORRECTIONS, "refused: correction for B", 2),
        ({"valid": False, "trouble": "the machine is off"}, MACHINE, "the machine is off; no joint states", 1),
        ({}, MACHINE, "on and homed", 0),
        ({"stamp_ns": 1}, CONTROLLER, "the link has been silent for", 2),
    ],
)
def test_what_the_link_says_is_in_the_diagnostics(tmp_path, values, status, message, level):
    python = fake_link(tmp_path, HELLO, state(**values))
    with Cell() as cell:
        cell.run(LinuxcncBridge, "linuxcnc_bridge", python=python)
        assert cell.wait_for_status(status, message).level == bytes([level])


def test_corrections_reach_the_link_and_states_go_out(tmp_path):
    heard = tmp_path / "heard"
    echo = f"while read line; do echo \"$line\" >> {heard}; cat <<'E'\n{state(stamp_ns=7)}\nE\ndone"
    python = fake_link(tmp_path, HELLO, then=echo)
    with Cell() as cell:
        states = cell.collect(cell.wire.topic("machine_joint_states"))
        cell.run(LinuxcncBridge, "linuxcnc_bridge", python=python, home=str(tmp_path))
        correct = Corrector(cell)
        correct(lambda: len(states) > 3, "states", {"X": 1e-6})
        assert list(states[-1].position) == [0.1]
        assert '"corrections": {"X": 1e-06}' in heard.read_text()
        assert cell.call(Trigger, "/linuxcnc_bridge/clear_offsets").success
        cell.wait_until(lambda: "ClearRequest" in heard.read_text(), "the request to clear")


def test_a_link_that_dies_is_told_with_what_it_said(tmp_path):
    python = fake_link(tmp_path, "no record", then="echo 'Traceback: all is lost' >&2; exit 3")
    with Cell() as cell:
        cell.run(LinuxcncBridge, "linuxcnc_bridge", python=python)
        cell.wait_for_status(CONTROLLER, "ended with exit code 3: Traceback: all is lost")


def test_an_interpreter_that_is_not_there_is_refused():
    with Cell() as cell, pytest.raises(ValueError, match="cannot run /nowhere/python3: No such file"):
        cell.run(LinuxcncBridge, "linuxcnc_bridge", python="/nowhere/python3")
