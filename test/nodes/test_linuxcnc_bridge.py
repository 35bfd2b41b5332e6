"""The bridge between LinuxCNC and ROS: against the real controller, and without one."""

import json
import math
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from faults.documenting import Row, shows
from faults.live.other_programs import stated
from received_blocks import block_of
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.linuxcnc_controller import presence
from rotary_error_monitor.linuxcnc_controller.connection import Connection
from rotary_error_monitor.linuxcnc_controller.instance import Instance
from rotary_error_monitor.linuxcnc_controller.kinematics import RotaryTableKinematics
from rotary_error_monitor.linuxcnc_controller.modules import SYSTEM_PYTHON, system_program
from rotary_error_monitor.linuxcnc_controller.protocol import End, Observation, ObserverSettings
from rotary_error_monitor.nodes import messages
from rotary_error_monitor.nodes.diagnostics import status_name
from rotary_error_monitor.nodes.linuxcnc_bridge import LinuxcncBridge
from rotary_error_monitor.nodes.qos import profile
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
    done = cnc.run([*system_program("rotary_error_monitor.linuxcnc_controller.operation"), *arguments])
    assert done.returncode == 0, done.stderr


def where(cnc):
    """Parameters that let a bridge find the instance."""
    return {"enter": " ".join(cnc.enter), "home": cnc.environment["HOME"]}


def latest_ns(states):
    return messages.ns_from_stamp(states[-1].header.stamp)


class CorrectionMaker:
    """Publishes corrections until a condition holds."""

    def __init__(self, cell):
        self.cell, self.topic = cell, cell.wire.topic("axis_corrections")
        self.publisher = cell.node.create_publisher(JointState, self.topic.name, profile(self.topic))

    def send(self, corrections, age_ns=0):
        names, values = list(corrections), list(corrections.values())
        stamp_ns = max(0, time.time_ns() - age_ns)
        self.publisher.publish(messages.joint_state_message(stamp_ns, self.topic.frame, names, values))

    def __call__(self, condition, what, corrections=CORRECTION, age_ns=0):
        def step():
            self.send(corrections, age_ns)
            return condition()

        self.cell.wait_until(step, what)

    def end(self):
        self.cell.node.destroy_publisher(self.publisher)


class Witness:
    """Sees what LinuxCNC makes of program and offsets, and knows nothing of the bridge."""

    def __init__(self, cnc):
        self.seen, self.ends = [], []
        self.kinematics = RotaryTableKinematics((0.0, 0.0, 0.0), (0.020, 0.010))
        self.connection = Connection(ObserverSettings(), self._note, enter=cnc.enter, environment=cnc.environment)

    def _note(self, record):
        if isinstance(record, Observation):
            self.seen.append(record)
        elif isinstance(record, End):
            self.ends.append(record.reason)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.connection.close()

    def nominal(self, observation):
        return self.kinematics.to_joints(observation.axes)

    def effects(self, begin=-1):
        """(n, 5) what the offsets move the joints by, from an observation on."""
        assert not self.ends, f"the witness ended: {self.ends}"
        return np.array([np.subtract(each.joints, self.nominal(each)) for each in self.seen[begin:]])

    def deviation(self, corrections, begin=-1):
        """Largest deviation from the corrections, m or rad, from an observation on; infinite before the first."""
        found = self.effects(begin)
        return np.abs(found - list(corrections.values())).max() if found.size else math.inf

    def deviation_since(self, corrections, begin, cell):
        """The same, once something has been observed since, for it may be late."""
        cell.wait_until(lambda: len(self.seen) > begin, "an observation")
        return self.deviation(corrections, begin)


@pytest.mark.linuxcnc
def test_program_positions_go_out_and_corrections_come_in(cnc):
    operate(cnc, "--prepare", "--mdi", "G21 G90 G0 X10 Y20 Z30 A30 C90")
    with Witness(cnc) as witness, Cell() as cell:
        states = cell.collect(cell.wire.topic("machine_joint_states"))
        applied = cell.collect(cell.wire.topic("applied_corrections"))
        cell.start("linuxcnc_bridge", **where(cnc))
        cell.wait_until(lambda: len(states) > 100, "joint states")
        expected = [-0.02, 0.0013397459621556, 0.0223205080756888, math.radians(30), math.radians(90)]
        assert list(states[-1].name) == list(NAMES)
        assert list(states[-1].position) == pytest.approx(expected, abs=1e-12)
        assert list(states[-1].velocity) == [0.0] * 5
        assert len(states[-1].effort) == 5
        cell.wait_until(lambda: len(applied) > 3, "what is in effect before the first correction")
        assert all(list(each.position) == pytest.approx([0.0] * 5, abs=1e-12) for each in applied)

        correct = CorrectionMaker(cell)
        correct(lambda: witness.deviation(CORRECTION) < 1e-9, "the joints to move, to 1 nm and 1 nrad")
        correct(lambda: cell.status(CORRECTIONS).message == "applied", "the bridge to say so")
        assert list(states[-1].position) == pytest.approx(expected, abs=1e-12), "corrections are left out"
        correct(lambda: near(applied[-1], CORRECTION), "the corrections in effect to be published")
        stamps = [messages.ns_from_stamp(state.header.stamp) for state in states]
        # most of them, for on a busy computer all may stand for a while
        assert np.median(np.diff(stamps)) * 1e-9 < 1 / 50
        cell.wait_for_status(CORRECTIONS, "no correction comes on /machine/axis_corrections")
        begin, count = len(witness.seen), len(applied)
        cell.wait_until(lambda: len(applied) > count + 5, "what is in effect while it is held")
        assert all(near(each, CORRECTION) for each in applied[count:])
        assert witness.deviation_since(CORRECTION, begin, cell) < 1e-9
        assert cell.call(Trigger, "/linuxcnc_bridge/clear_offsets").success
        cell.wait_until(lambda: witness.deviation(dict.fromkeys(NAMES, 0.0)) < 1e-9, "the offsets to clear")
        cell.wait_until(lambda: near(applied[-1], dict.fromkeys(NAMES, 0.0)), "that to be published")


def near(message, corrections):
    return np.abs(np.subtract(message.position, list(corrections.values()))).max() < 1e-9


FAR = {**CORRECTION, "X": 4e-4}
WRONG = [
    ({"X": 3e-4}, 0, "missing Y Z A C"),
    ({}, 0, "missing X Y Z A C"),
    ({**CORRECTION, "B": 1e-6}, 0, "not corrected here B"),
    ({**CORRECTION, "Y": math.nan}, 0, "correction of Y is nan"),
    ({**CORRECTION, "A": -math.inf}, 0, "correction of A is -inf"),
    ({**CORRECTION, "C": 1e300}, 0, "correction of C is 1e+300; expected at most 0.005"),
    ({**CORRECTION, "X": 1e-3}, 0, "correction of X is 0.001; expected at most 0.0005"),
    (FAR, 400_000_000, "s old; expected at most 0.1 s"),
    (FAR, -1_000_000_000, "s ahead of the clock"),
    (FAR, -365 * 86_400_000_000_000, "s ahead of the clock"),
    (FAR, 10**19, "without a stamp"),
]


@pytest.mark.linuxcnc
def test_no_wrong_message_moves_the_machine_and_each_is_said(cnc):
    operate(cnc, "--prepare", "--mdi", "G21 G90 G0 X10 Y20 Z30 A30 C90")
    with Witness(cnc) as witness, Cell() as cell:
        cell.start("linuxcnc_bridge", **where(cnc))
        correct = CorrectionMaker(cell)

        def right():
            """The right corrections are applied and that is said."""
            return cell.status(CORRECTIONS).message.startswith("applied") and witness.deviation(CORRECTION) < 1e-9

        for corrections, age_ns, words in WRONG:
            correct(right, "the corrections to be applied")
            begin = len(witness.seen)
            held = f"held for [0-9.]+ s: .*{re.escape(words)}"
            correct(lambda held=held: re.match(held, cell.status(CORRECTIONS).message), words, corrections, age_ns)
            assert cell.status(CORRECTIONS).level == b"\x02"
            assert witness.deviation_since(CORRECTION, begin, cell) < 1e-9, words
        correct(right, "the corrections to be applied")
        figures = cell.figures(CORRECTIONS)
        assert all(
            int(figures[f"refused_{doubt}"]) > 0 for doubt in ("axes", "numbers", "size", "age", "ahead", "stamp")
        )


@pytest.mark.linuxcnc
def test_far_corrections_and_two_that_swing_make_no_step(cnc):
    operate(cnc, "--prepare")
    with Witness(cnc) as witness, Cell() as cell:
        cell.start("linuxcnc_bridge", **where(cnc))
        correct = CorrectionMaker(cell)
        correct(lambda: witness.deviation(CORRECTION) < 1e-9, "the corrections to be applied")
        begin = len(witness.seen) - 1  # where it is, for the next one may be seen late
        correct(lambda: witness.deviation(FAR) < 1e-9, "the far correction to be applied", FAR)
        way = witness.effects(begin)[:, 0]
        stamps = np.array([each.stamp_ns for each in witness.seen[begin : begin + len(way)]])
        left, there = stamps[way <= CORRECTION["X"] + 1e-9][-1], stamps[way >= FAR["X"] - 1e-9][0]
        assert (there - left) * 1e-9 > 0.9 * (FAR["X"] - CORRECTION["X"]) / 2e-3
        assert (np.diff(way) > -1e-9).all()
        assert way.max() < FAR["X"] + 1e-9

        other = CorrectionMaker(cell)

        def swing():
            other.send({**CORRECTION, "X": -4e-4})
            correct.send(FAR)
            return cell.has_status(CORRECTIONS, "2 publishers send corrections at once")

        cell.wait_until(swing, "the second publisher to be said")
        begin = len(witness.seen)

        def rest():
            """For half a second."""
            swing()
            return len(witness.seen) > begin + 60 and np.ptp(witness.effects(-60), axis=0).max() < 1e-9

        cell.wait_until(rest, "the joints to rest while both speak")
        other.end()
        correct(lambda: witness.deviation(CORRECTION) < 1e-9, "the one that is left to be followed")
        correct(lambda: cell.status(CORRECTIONS).message.startswith("applied"), "the bridge to say so")


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
        cell.forget_status(MACHINE)
        cell.wait_for_status(MACHINE, "the machine is off")
        cell.wait_for_silence(states)
        assert latest_ns(states) < off_ns


def command(cnc, *lines):
    """Run lines of Python with LinuxCNC's command channel `c` and module `linuxcnc`."""
    text = "; ".join(["import linuxcnc", "c = linuxcnc.command()", *lines])
    done = cnc.run([SYSTEM_PYTHON, "-c", text])
    assert done.returncode == 0, done.stderr


OFF = ("c.state(linuxcnc.STATE_OFF)", "c.wait_complete()")
ESTOP = ("c.state(linuxcnc.STATE_ESTOP)", "c.wait_complete()")
UNHOME = (
    "c.mode(linuxcnc.MODE_MANUAL)", "c.wait_complete()", "c.teleop_enable(0)", "c.wait_complete()", "c.unhome(-1)",
    "c.wait_complete()",
)  # fmt: skip


@shows(
    Row(
        "corrections",
        "The machine is off, in emergency stop, or not homed",
        "`machine` and `corrections` of the bridge: held, the machine is off",
        "corrections stay as they are; what comes meanwhile is not followed",
        "no joint states and no corrections in effect of a machine that may be anywhere",
        "once it is on and homed, from where it is, at the rate limit",
    )
)
@pytest.mark.linuxcnc
def test_a_machine_that_goes_off_in_any_way_holds_and_goes_on_from_where_it_is(cnc):
    """Corrections keep coming meanwhile, also before it is homed."""
    zero = dict.fromkeys(NAMES, 0.0)
    with Witness(cnc) as witness, Cell() as cell:
        applied = cell.collect(cell.wire.topic("applied_corrections"))
        cell.start("linuxcnc_bridge", **where(cnc))
        correct = CorrectionMaker(cell)
        correct(lambda: cell.has_status(CORRECTIONS, "held: the machine is off"), "the bridge to say so")
        assert applied == []
        assert witness.deviation(zero) < 1e-12
        for fault, reason in ((OFF, "is off"), (ESTOP, "is off"), (UNHOME, "is not homed"), (OFF, "is off")):
            operate(cnc, "--prepare")
            correct(lambda: witness.deviation(CORRECTION) < 1e-9, "the corrections to be applied")
            correct(lambda: near(applied[-1], CORRECTION), "the corrections in effect to be published")
            correct(lambda: cell.status(CORRECTIONS).message.startswith("applied"), "the bridge to say so")
            command(cnc, *fault)
            off_ns = time.time_ns()
            correct(lambda reason=reason: cell.has_status(CORRECTIONS, f"held: the machine {reason}"), "the hold", FAR)
            begin = len(witness.seen)
            correct(lambda begin=begin: len(witness.seen) > begin + 30, "time to pass", FAR)
            assert latest_ns(applied) < off_ns, "nothing is published of a machine that may be anywhere"
            assert np.ptp(witness.effects(begin), axis=0).max() < 1e-12


@contextmanager
def swinging(correct):
    """Corrections that move meanwhile, X by 50 µm, from a thread of their own."""
    ending = threading.Event()

    def send():
        while not ending.wait(0.01):
            correct.send({**CORRECTION, "X": 5e-5 * math.sin(3.0 * time.monotonic())})

    sender = threading.Thread(target=send)
    sender.start()
    try:
        yield
    finally:
        ending.set()
        sender.join()


@pytest.mark.linuxcnc
def test_a_machine_that_goes_off_while_corrections_move_is_told_as_off(cnc):
    """Its joints lie beside what offsets in motion say, and LinuxCNC zeroes these: no kinematics, and no hand."""
    with Cell() as cell:
        heard = cell.collect(cell.wire.topic("diagnostics"))
        cell.start("linuxcnc_bridge", **where(cnc))
        with swinging(CorrectionMaker(cell)):
            for fault in (OFF, ESTOP, OFF, OFF):
                operate(cnc, "--prepare")
                cell.wait_until(lambda: cell.has_status(CORRECTIONS, "applied"), "the corrections to be applied")
                cell.spin_for(0.3)
                command(cnc, *fault)
                cell.wait_until(lambda: cell.has_status(CORRECTIONS, "held: the machine is off"), "the hold")
        said = {each.message for array in heard for each in array.status}
        assert not [words for words in said if "kinematics" in words or "another hand" in words]


@pytest.mark.linuxcnc
def test_counts_at_the_end_of_their_pins_are_said_and_begin_anew_when_the_offsets_are_cleared(cnc):
    """As another bridge with smaller counts may leave them."""
    for letter in "xyzac":
        assert cnc.run(["halcmd", "setp", f"axis.{letter}.eoffset-counts", str(2**31 - 1000)]).returncode == 0
    operate(cnc, "--prepare")
    with Witness(cnc) as witness, Cell() as cell:
        cell.start("linuxcnc_bridge", **where(cnc))
        correct = CorrectionMaker(cell)
        correct(lambda: cell.has_status(CORRECTIONS, "end of their 32 bits: clear the external offsets"), "the end")
        begin = len(witness.seen)
        assert cell.call(Trigger, "/linuxcnc_bridge/clear_offsets").success
        correct(lambda: witness.deviation(CORRECTION) < 1e-9, "the corrections to be applied")
        way = witness.effects(begin)
        # X Y Z arrive with the tilt's offset on its way; counts that were taken for a motion were 0.2 m
        assert (np.abs(way).max(axis=0) < np.abs(list(CORRECTION.values())) + 1e-6).all()


@pytest.mark.linuxcnc
def test_constant_corrections_of_axes_that_move_are_held_and_said_until_they_change(cnc):
    operate(cnc, "--prepare", "--mdi", "G21 G90 G0 X10 Y20 Z30 A30 C90")
    with Witness(cnc) as witness, Cell() as cell:
        cell.start("linuxcnc_bridge", **where(cnc))
        correct = CorrectionMaker(cell)
        correct(lambda: cell.status(CORRECTIONS).message == "applied", "corrections at rest to be applied")
        begin = len(witness.seen)
        correct(lambda: len(witness.seen) > begin + 100, "a rest that is longer than corrections may stand")
        assert cell.figures(CORRECTIONS)["refused_stands"] == "0"
        program = [*system_program("rotary_error_monitor.linuxcnc_controller.operation"), "--mdi", "G1 X40 F600"]
        with subprocess.Popen([*cnc.enter, *program], env=cnc.environment) as moving:
            correct(lambda: moving.poll() is not None, "the axis to move")
            assert moving.returncode == 0
        correct(lambda: cell.has_status(CORRECTIONS, "the same to the last bit while the axes move"), "the hold")
        assert witness.deviation_since(CORRECTION, len(witness.seen), cell) < 1e-9
        with swinging(correct):
            cell.wait_until(lambda: cell.status(CORRECTIONS).message.startswith("applied"), "those that change")


@shows(
    Row(
        "corrections",
        "The bridge to LinuxCNC is stopped (SIGSTOP) and goes on",
        "its diagnostics and joint states fail to come",
        "the program beside LinuxCNC holds the last correction and turns it with the table",
        "nothing",
        "within 1 s after it goes on; what waited for it is refused for its age",
    )
)
@pytest.mark.linuxcnc
def test_while_the_bridge_is_stopped_held_corrections_turn_with_the_table_and_then_it_goes_on(cnc):
    """The program beside LinuxCNC goes on looking, though nobody takes what it says."""
    operate(cnc, "--prepare", "--mdi", "G21 G90 G0 X10 Y20 Z30 A30 C90")
    with Witness(cnc) as witness, Cell() as cell:
        correct = CorrectionMaker(cell)
        bridge = cell.start("linuxcnc_bridge", **where(cnc), max_age=1.0)  # the tests share few cores
        correct(lambda: witness.deviation(CORRECTION) < 1e-9, "the corrections to be applied")
        bridge.pause()
        begin = time.monotonic()
        correct(lambda: time.monotonic() - begin > 1.0, "a full pipe", FAR)
        operate(cnc, "--mdi", "G0 X-10 Y5 A-20 C30")
        correct(lambda: witness.deviation(CORRECTION) < 1e-9, "the corrections to have turned with the table", FAR)
        with stated("corrections followed again", 1.0):
            bridge.go_on()
            correct(lambda: witness.deviation(FAR) < 1e-9, "corrections to be followed again", FAR)


def link_of(bridge):
    """Process id of the program beside LinuxCNC that a bridge has started."""
    pids = [bridge.pid]
    for pid in pids:
        for task in Path(f"/proc/{pid}/task").iterdir():
            pids += map(int, (task / "children").read_text().split())
    words = {pid: Path(f"/proc/{pid}/cmdline").read_bytes() for pid in reversed(pids)}
    return next(pid for pid, said in words.items() if b"linuxcnc_controller.link" in said)


@shows(
    Row(
        "corrections",
        "The program beside LinuxCNC is stopped (SIGSTOP) and goes on",
        "`corrections` of the bridge within 0.5 s: held, the link to the controller is silent",
        "LinuxCNC keeps the offsets; `clear_offsets` says that it cannot",
        "no joint states",
        "within 1 s after it goes on, with the next correction: what waited for it is not followed",
    )
)
@pytest.mark.linuxcnc
def test_what_waits_for_a_link_that_is_stopped_is_not_followed(cnc):
    """Its pipe is full of the first corrections, far away, and has no room for the newest, which are right."""
    operate(cnc, "--prepare")
    with Witness(cnc) as witness, Cell() as cell:
        correct = CorrectionMaker(cell)
        bridge = cell.start("linuxcnc_bridge", **where(cnc))
        correct(lambda: witness.deviation(CORRECTION) < 1e-9, "the corrections to be applied")
        link = link_of(bridge)
        os.kill(link, signal.SIGSTOP)
        try:
            for _ in range(100):
                for _ in range(15):
                    correct.send(FAR)
                cell.spin_for(0.01)
            correct(lambda: cell.has_status(CORRECTIONS, "held: the link to the controller is silent"), "the hold")
            cleared = cell.call(Trigger, "/linuxcnc_bridge/clear_offsets")
            assert not cleared.success
            assert "silent" in cleared.message
            begin = len(witness.seen)
        finally:
            with stated("corrections followed again", 1.0):
                os.kill(link, signal.SIGCONT)
                correct(lambda: cell.status(CORRECTIONS).message.startswith("applied"), "the bridge to say so")
        correct(lambda: len(witness.seen) > begin + 50, "time to pass")
        assert witness.deviation(CORRECTION, begin) < 1e-9


@shows(
    Row(
        "corrections",
        "The bridge to LinuxCNC is killed",
        "its joint states fail to come; `corrections` of its successor: held, no correction has come yet",
        "the offsets stay in LinuxCNC; the successor takes them over without a step",
        "nothing until the successor is there",
        "with the first right correction after its start",
    )
)
@pytest.mark.linuxcnc
def test_a_bridge_that_is_killed_leaves_the_offsets_and_its_successor_takes_them_over_without_a_step(cnc):
    operate(cnc, "--prepare", "--mdi", "G21 G90 G0 X10 Y20 Z30 A30 C90")
    with Witness(cnc) as witness, Cell() as cell:
        applied = cell.collect(cell.wire.topic("applied_corrections"))
        correct = CorrectionMaker(cell)
        bridge = cell.start("linuxcnc_bridge", "first", **where(cnc))
        correct(lambda: witness.deviation(CORRECTION) < 1e-9, "the corrections to be applied")
        begin = len(witness.seen)
        bridge.stop(signal.SIGKILL)
        count = len(applied)
        cell.start("linuxcnc_bridge", "second", **where(cnc))
        cell.wait_for_status("second: corrections", "held: no correction has come yet")
        cell.wait_until(lambda: len(applied) > count + 3, "what is in effect to be published")
        assert all(near(each, CORRECTION) for each in applied[count:])
        correct(lambda: cell.status("second: corrections").message.startswith("applied"), "corrections to be applied")
        assert witness.deviation_since(CORRECTION, begin, cell) < 1e-9


@shows(
    Row(
        "corrections",
        "LinuxCNC ends, or its task process is killed",
        "`controller` of the bridge: its task process has ended, or no LinuxCNC runs here",
        "the bridge lets go of it and looks for another",
        "no joint state and no correction in effect from 0.5 s after its end on",
        "when a LinuxCNC is there and its machine is on and homed",
    )
)
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
        cell.wait_for_silence(states)
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
def test_a_linuxcnc_that_comes_back_is_found_again_and_corrected(place):
    """It runs unisolated as far as it knows: as on a machine of one's own. Corrections come all the time."""
    host = Path(__file__).with_name("linuxcnc_host.py")
    with Cell() as cell:
        cell.start("linuxcnc_bridge", enter=" ".join(place))
        applied = cell.collect(cell.wire.topic("applied_corrections"))
        correct = CorrectionMaker(cell)
        for kills in (False, True):
            correct(lambda: cell.has_status(CONTROLLER, "no LinuxCNC runs here"), "the bridge to say so")
            correct(lambda: cell.has_status(CORRECTIONS, "held: the controller is out of reach"), "the hold")
            command = [*place, "--mount", "--net", sys.executable, str(host), str(config("linuxcnc/xyzac_trt.ini"))]
            linuxcnc = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
            try:
                assert linuxcnc.stdout.readline() == "refused: another LinuxCNC runs here\n"
                correct(lambda: cell.has_status(CORRECTIONS, "held: the machine is off"), "the bridge to be connected")
                correct(lambda: cell.has_status(CONTROLLER, "connected"), "the bridge to say so")
                linuxcnc.stdin.write("prepare\n")
                linuxcnc.stdin.flush()
                assert linuxcnc.stdout.readline() == "prepared 0\n"
                applied.clear()
                correct(lambda: applied and near(applied[-1], CORRECTION), "corrections in effect")
                if kills:
                    listing = subprocess.run([*place, "halcmd", "show", "comp"], capture_output=True, text=True).stdout
                    task = str(presence.component_pid(listing, presence.TASK))
                    subprocess.run([*place, "kill", "-9", task], check=True)
                    correct(lambda: cell.has_status(CORRECTIONS, "held: the controller is out of reach"), "the hold")
            finally:
                linuxcnc.communicate()
            assert linuxcnc.returncode == 0


@pytest.mark.linuxcnc
@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_the_bridge_and_the_program_beside_linuxcnc(cnc, number):
    """In how long is a matter of what else the computer does; `stop` waits for a minute."""
    operate(cnc, "--prepare")
    with Cell() as cell:
        bridge = cell.start("linuxcnc_bridge", **where(cnc))
        cell.wait_for_status(CONTROLLER, "connected")
        assert bridge.stop(number) == 0
    assert "rotary-error-monitor" not in cnc.run(["halcmd", "show", "comp"]).stdout


FAKE = """#!{python}
import json, os, select, sys, time
first, state = json.loads({first!r}), json.loads({state!r})
for record in first:
    print(json.dumps(record), flush=True)
while state is not None or {waits}:
    if select.select([0], [], [], 0.02)[0]:
        lines = os.read(0, 1 << 16)
        if not lines:
            break
        with open({heard!r}, "ab") as heard:
            heard.write(lines)
    if state is not None:
        state["stamp_ns"] = time.time_ns()
        print(json.dumps(state), flush=True)
sys.stderr.write({error!r})
sys.exit({code})
"""


def fake_link(tmp_path, *first, state=None, waits=False, error="", code=0):
    """An interpreter that answers as the link would: some records, then a state again and again."""
    path = tmp_path / "python3"
    values = {"first": json.dumps(first), "state": json.dumps(state), "heard": str(tmp_path / "heard")}
    path.with_suffix(".new").write_text(
        FAKE.format(python=sys.executable, waits=waits, error=error, code=code, **values)
    )
    path.with_suffix(".new").chmod(0o755)
    path.with_suffix(".new").rename(path)
    return str(path)


def heard(tmp_path):
    """What the link that is none was told so far."""
    path = tmp_path / "heard"
    return path.read_text() if path.is_file() else ""


def state(**values):
    """What the link says."""
    return {
        "kind": "State", "stamp_ns": 0, "positions": [0.1], "velocities": [0.0], "is_exact": True, "commands": [0.3],
        "speeds": [0.2],
        "valid": True, "offsets": [1e-6], "effect": [2e-6], "to_go": [0.0], "slowed": False, "lag": 0.0,
        "limited": False, "trouble": "", "takeovers": 0,
    } | values  # fmt: skip


HELLO = {"kind": "Hello", "names": ["X"]}
ABSENT = {"kind": "Absent", "reason": "no LinuxCNC runs here"}


def test_without_linuxcnc_the_bridge_says_so_and_looks_again(tmp_path):
    """Whether the link waits for one or ends."""
    python = fake_link(tmp_path, ABSENT, {"kind": "End", "reason": "LinuxCNC shuts down"}, code=1)
    with Cell() as cell:
        cell.run(LinuxcncBridge, "linuxcnc_bridge", python=python)
        assert cell.wait_for_status(CONTROLLER, "LinuxCNC shuts down").level == b"\x02"
        assert not cell.call(Trigger, "/linuxcnc_bridge/clear_offsets").success
        assert cell.status(MACHINE).level == b"\x03"
        assert cell.status(CORRECTIONS).message == "held: the controller is out of reach"
        fake_link(tmp_path, ABSENT, waits=True)
        cell.wait_for_status(CONTROLLER, "no LinuxCNC runs here")


def test_why_a_controller_was_lost_is_said_until_it_is_back(tmp_path):
    python = fake_link(tmp_path, HELLO, state(), {"kind": "End", "reason": "LinuxCNC shuts down"}, code=1)
    with Cell() as cell:
        cell.run(LinuxcncBridge, "linuxcnc_bridge", python=python)
        cell.wait_for_status(CONTROLLER, "LinuxCNC shuts down")
        fake_link(tmp_path, ABSENT, waits=True)
        cell.wait_for_status(CONTROLLER, "LinuxCNC shuts down; now: no LinuxCNC runs here")


def test_a_controller_that_comes_back_is_connected(tmp_path):
    python = fake_link(tmp_path, {"kind": "End", "reason": "LinuxCNC shuts down"}, code=1)
    with Cell() as cell:
        cell.run(LinuxcncBridge, "linuxcnc_bridge", python=python)
        cell.wait_for_status(CONTROLLER, "LinuxCNC shuts down")
        fake_link(tmp_path, HELLO, state=state())
        cell.wait_for_status(CONTROLLER, "connected")


@pytest.mark.parametrize(
    ("values", "status", "message", "level"),
    [
        ({}, CORRECTIONS, "applied", 0),
        ({"limited": True}, CORRECTIONS, "applied; soft limits of the controller clip the offsets", 1),
        ({"slowed": True}, CORRECTIONS, "applied; slowed by the bridge's limits", 1),
        ({"lag": 3e-6}, CORRECTIONS, "the controller does not follow (OFFSET_AV_RATIO of its axes?)", 1),
        ({"trouble": "the machine is in joint mode"}, CORRECTIONS, "held: the machine is in joint mode", 1),
        ({"valid": False, "trouble": "the machine is off"}, CORRECTIONS, "held: the machine is off", 1),
        ({"valid": False, "trouble": "the machine is off"}, MACHINE, "the machine is off; no joint states", 1),
        ({}, MACHINE, "on and homed", 0),
    ],
)
def test_what_the_link_says_is_in_the_diagnostics(tmp_path, values, status, message, level):
    python = fake_link(tmp_path, HELLO, state=state(**values))
    with Cell() as cell:
        cell.run(LinuxcncBridge, "linuxcnc_bridge", python=python)
        correct = CorrectionMaker(cell)
        correct(lambda: cell.has_status(status, message), message, {"X": 1e-6})
        assert cell.status(status).level == bytes([level])


def test_a_link_that_falls_silent_is_noticed(tmp_path):
    python = fake_link(tmp_path, HELLO, {**state(), "stamp_ns": time.time_ns() + 3600 * 10**9}, waits=True)
    with Cell() as cell:
        cell.run(LinuxcncBridge, "linuxcnc_bridge", python=python)
        assert cell.wait_for_status(CONTROLLER, "the link has been silent for").level == b"\x02"
        assert cell.has_status(CORRECTIONS, "held: the link to the controller is silent")


def test_corrections_reach_the_link_and_states_go_out(tmp_path):
    python = fake_link(tmp_path, HELLO, state=state())
    with Cell() as cell:
        states = cell.collect(cell.wire.topic("machine_joint_states"))
        applied = cell.collect(cell.wire.topic("applied_corrections"))
        cell.run(LinuxcncBridge, "linuxcnc_bridge", python=python, home=str(tmp_path))
        correct = CorrectionMaker(cell)
        correct(lambda: len(states) > 3 and len(applied) > 3, "states", {"X": 1e-6})
        assert list(states[-1].position) == [0.1]
        assert list(applied[-1].position) == [2e-6]
        correct(lambda: '"positions": [1e-06]' in heard(tmp_path), "the corrections to be passed on", {"X": 1e-6})
        other = CorrectionMaker(cell)
        correct(lambda: cell.has_status(CORRECTIONS, "2 publishers of corrections are there"), "the hold", {"X": 1e-6})
        cell.wait_until(lambda: "HaltRequest" in heard(tmp_path), "the request to halt")
        other.end()
        assert cell.call(Trigger, "/linuxcnc_bridge/clear_offsets").success
        cell.wait_until(lambda: "ClearRequest" in heard(tmp_path), "the request to clear")


def test_corrections_of_some_axes_only_are_taken_where_it_is_said_so(tmp_path):
    hello = {"kind": "Hello", "names": ["X", "Z", "C"]}
    three = {
        name: [0.0] * 3 for name in ("positions", "velocities", "commands", "speeds", "offsets", "effect", "to_go")
    }
    python = fake_link(tmp_path, hello, state=state(**three))
    with Cell() as cell:
        cell.run(LinuxcncBridge, "linuxcnc_bridge", python=python, corrected="C X")
        correct = CorrectionMaker(cell)
        correct(lambda: cell.has_status(CORRECTIONS, "applied"), "corrections", {"X": 1e-6, "C": 2e-6})
        cell.wait_until(lambda: '"positions": [1e-06, 0.0, 2e-06]' in heard(tmp_path), "them to be passed on")


def test_corrected_axes_that_the_controller_has_not_are_named(tmp_path):
    python = fake_link(tmp_path, HELLO, state=state())
    with Cell() as cell:
        cell.run(LinuxcncBridge, "linuxcnc_bridge", python=python, corrected="XB")
        status = cell.wait_for_status(CORRECTIONS, "parameter 'corrected': corrected axes 'X B'; expected some of")
        assert status.level == b"\x02"


def test_another_hand_at_the_offsets_is_said(tmp_path):
    python = fake_link(tmp_path, HELLO, state(), state=state(takeovers=1))
    with Cell() as cell:
        cell.run(LinuxcncBridge, "linuxcnc_bridge", python=python)
        correct = CorrectionMaker(cell)
        correct(lambda: cell.has_status(CORRECTIONS, "another hand has changed the offsets"), "it", {"X": 1e-6})


def test_a_link_that_dies_is_told_with_what_it_said(tmp_path):
    python = fake_link(tmp_path, "no record", error="Traceback: all is lost", code=3)
    with Cell() as cell:
        cell.run(LinuxcncBridge, "linuxcnc_bridge", python=python)
        cell.wait_for_status(CONTROLLER, "ended with exit code 3: Traceback: all is lost")


def test_an_interpreter_that_is_not_there_is_refused():
    with Cell() as cell, pytest.raises(ValueError, match="cannot run /nowhere/python3: No such file"):
        cell.run(LinuxcncBridge, "linuxcnc_bridge", python="/nowhere/python3")


@pytest.mark.parametrize(
    ("parameters", "words"),
    [
        ({"enter": "nsenter --target '4711"}, r"parameter 'enter' is .* \(No closing quotation\)"),
        ({"count": 1e-11, "largest_rotary": 0.05}, r"count 1e-11; expected more than 2\.328e-11"),
    ],
)
def test_what_no_link_could_be_started_with_is_refused(parameters, words):
    with Cell() as cell, pytest.raises(InputError, match=words):
        cell.run(LinuxcncBridge, "linuxcnc_bridge", **parameters)


def test_simulated_time_is_refused():
    with Cell() as cell, pytest.raises(ValueError, match="parameter 'use_sim_time' is true; expected false"):
        cell.run(LinuxcncBridge, "linuxcnc_bridge", use_sim_time=True)


def told_command(cell):
    """Samples of the command that came, and the messages for people."""
    return cell.collect(cell.wire.topic("command_samples")), cell.collect(cell.wire.topic("command_joint_states"))


TABLE = {"kind": "Hello", "names": list("XYZAC")}
FIVE = {name: [0.0] * 5 for name in ("positions", "velocities", "offsets", "effect", "to_go")} | {
    "commands": [0.0, 0.0, 0.0, 0.1, 0.3], "speeds": [0.0, 0.0, 0.0, -0.1, 0.2],
}  # fmt: skip


def test_what_the_drive_of_the_monitored_axis_is_told_is_the_command_of_the_stage(tmp_path):
    python = fake_link(tmp_path, TABLE, state=state(**FIVE))
    with Cell() as cell:
        blocks, people = told_command(cell)
        states = cell.collect(cell.wire.topic("machine_joint_states"))
        cell.run(LinuxcncBridge, "linuxcnc_bridge", python=python, machine="xyzac_trt", block_period=0.05)
        cell.wait_until(lambda: len(blocks) > 3 and people and len(states) > 10, "the command")
        block = block_of(blocks[1])
        assert block.names[1:] == cell.wire.topic("command_samples").columns
        np.testing.assert_array_equal(block.rows[:, 1:], [[0.3, 0.2]] * len(block.rows))
        stamps = {messages.ns_from_stamp(each.header.stamp) for each in states}
        assert {*block.times_ns.tolist()} <= stamps, "those of the joint states, of one look each"
        assert (list(people[0].name), list(people[0].position), list(people[0].velocity)) == (["stage"], [0.3], [0.2])
        cell.wait_for_status("linuxcnc_bridge: /stage/command/samples", "alive")


def test_a_command_of_which_nobody_can_say_when_it_was_told_is_left_out(tmp_path):
    python = fake_link(tmp_path, TABLE, state=state(**FIVE, is_exact=False))
    with Cell() as cell:
        blocks, _ = told_command(cell)
        states = cell.collect(cell.wire.topic("machine_joint_states"))
        cell.run(LinuxcncBridge, "linuxcnc_bridge", python=python, machine="xyzac_trt")
        cell.wait_until(lambda: len(states) > 20, "joint states, which are needed to a few milliseconds alone")
        cell.wait_for_status("linuxcnc_bridge: /stage/command/samples", "nothing has been sent yet")
        assert blocks == []


@pytest.mark.parametrize(
    ("parameters", "message"),
    [
        ({"machine": "xyzac_trt", "stage_command": False}, None),
        ({"machine": "grinder_zhou2023"}, None),
        ({}, "not published: parameter 'machine' is empty"),
        ({"stage_command": False}, None),
    ],
)
def test_no_command_is_published_where_it_is_not_the_bridges_to_tell(tmp_path, parameters, message):
    python = fake_link(tmp_path, TABLE, state=state(**FIVE))
    with Cell() as cell:
        node = cell.run(LinuxcncBridge, "linuxcnc_bridge", python=python, **parameters)
        cell.wait_for_status(MACHINE, "on and homed")

        def published():
            return {name for name, _ in node.get_publisher_names_and_types_by_node("linuxcnc_bridge", "/")}

        cell.wait_until(lambda: "/machine/joint_states" in published(), "the graph to know its publishers")
        assert not {"/stage/command/samples", "/stage/command/joint_states"} & published()
        name = "linuxcnc_bridge: /stage/command/samples"
        if message is None:
            assert status_name(name) not in cell.statuses
        else:
            assert cell.wait_for_status(name, message).level == b"\x01"


@pytest.mark.parametrize(
    ("hello", "values", "message", "level"),
    [
        (HELLO, {}, "no command: the controller has the axes X, not the monitored one, C", 2),
        (TABLE, FIVE | {"valid": False, "trouble": "the machine is off"}, "no command: the machine is off", 1),
    ],
)
def test_why_there_is_no_command_is_said(tmp_path, hello, values, message, level):
    python = fake_link(tmp_path, hello, state=state(**values))
    with Cell() as cell:
        blocks, _ = told_command(cell)
        cell.run(LinuxcncBridge, "linuxcnc_bridge", python=python, machine="xyzac_trt")
        assert cell.wait_for_status("linuxcnc_bridge: /stage/command/samples", message).level == bytes([level])
        assert blocks == []


SERVO_PERIOD = 1e-3
"""Of the shipped configuration, s."""


def narrowest(values, part):
    """Width of the narrowest interval that holds a part of values."""
    ascending = np.sort(values)
    held = math.ceil(part * len(ascending))
    return (ascending[held - 1 :] - ascending[: len(ascending) - held + 1]).min()


@pytest.mark.linuxcnc
def test_the_command_is_that_of_the_servo_thread_with_its_corrections(cnc):
    """At an even speed each servo period tells the same step, so that what is told says when it was told."""
    operate(cnc, "--prepare", "--mdi", "G21 G90 G0 C0")
    with Cell() as cell:
        blocks, _ = told_command(cell)
        states = cell.collect(cell.wire.topic("machine_joint_states"))
        cell.start("linuxcnc_bridge", **where(cnc), machine="xyzac_trt", block_period=0.02)
        correct = CorrectionMaker(cell)

        def stands_there():
            told = block_of(blocks[-1]).column("angle")[-1] if blocks else math.nan
            return told == pytest.approx(CORRECTION["C"], abs=1e-8)

        correct(stands_there, "the drive to stand where the correction puts it")
        assert states[-1].position[4] == pytest.approx(0.0, abs=1e-12), "the program does not"
        del blocks[:], states[:]
        operation = [*system_program("rotary_error_monitor.linuxcnc_controller.operation"), "--mdi", "G0 C120"]
        with subprocess.Popen([*cnc.enter, *operation], env=cnc.environment) as moving:
            correct(lambda: moving.poll() is not None, "the table to turn")
        target = math.radians(120) + CORRECTION["C"]
        # the command ends within a tolerance of where it is in position, and the last block comes later still
        correct(
            lambda: block_of(blocks[-1]).column("angle")[-1] == pytest.approx(target, abs=1e-8), "it to stand there"
        )
        made = [block_of(each) for each in blocks]
        times = np.concatenate([each.times_ns for each in made])
        angle, speed = (np.concatenate([each.column(name) for each in made]) for name in ("angle", "velocity"))
        assert (np.diff(times) > 0).all()
        top = np.abs(speed).max()
        even = np.flatnonzero(np.abs(speed - top) < 1e-6 * top)[3:-3]
        assert len(even) > 100
        periods = (angle[even] - angle[even[0]]) / (top * SERVO_PERIOD)
        assert np.abs(periods - np.rint(periods)).max() < 1e-6, "each is what one servo period told"
        late = (times[even] - times[even[0]]) * 1e-9 - np.rint(periods) * SERVO_PERIOD
        # of a third of the looks, however late the others came to run on a busy computer
        assert narrowest(late, 1 / 3) < 0.1 * SERVO_PERIOD, "looks at any time have a third of it"
        assert angle[-1] == pytest.approx(target, abs=1e-8)
