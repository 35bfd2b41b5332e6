"""The real controller: its kinematics as an oracle, exact offsets, instances that leave each other alone."""

import json
import math
import subprocess
import time
from pathlib import Path

import numpy as np
import pytest

from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.linuxcnc_controller import presence
from rotary_error_monitor.linuxcnc_controller.connection import Connection
from rotary_error_monitor.linuxcnc_controller.instance import Instance
from rotary_error_monitor.linuxcnc_controller.kinematics import RotaryTableKinematics
from rotary_error_monitor.linuxcnc_controller.modules import SYSTEM_PYTHON, system_program
from rotary_error_monitor.linuxcnc_controller.protocol import (
    CorrectionRequest,
    End,
    LinkSettings,
    Observation,
    ObserverSettings,
    State,
)
from rotary_error_monitor.machine.kinematics import arrange_machine, stand

pytestmark = pytest.mark.linuxcnc

UNITS = np.array([1e-3, 1e-3, 1e-3, math.pi / 180, math.pi / 180])
ORACLE = str(Path(__file__).with_name("linuxcnc_oracle.py"))
NAMES = "XYZAC"
DEADLINE = 60.0


def operate(instance, *arguments):
    done = instance.run([*system_program("rotary_error_monitor.linuxcnc_controller.operation"), *arguments])
    assert done.returncode == 0, done.stderr


def random_joints(count):
    """Joint positions (mm, deg) all over the travel."""
    draw = np.random.default_rng(20130829)
    low, high = np.array([[-250, -250, -250, -100, -360], [250, 250, 250, 100, 360]])
    return draw.uniform(low, high, (count, 5))


def ask(instance, joints, *settings):
    """Where LinuxCNC's own forward kinematics put the tool, m and rad; `settings` are halcmd lines."""
    operate(instance, "--prepare", "--off")
    lines = [f"halcmd unlinkp joint.{index}.motor-pos-fb" for index in range(5)]
    lines += [f"halcmd {setting}" for setting in settings]
    done = instance.run(["sh", "-ec", "\n".join(lines)])
    assert done.returncode == 0, done.stderr
    answer = subprocess.run(
        [*instance.enter, SYSTEM_PYTHON, ORACLE],
        input="\n".join(json.dumps(row) for row in joints.tolist()),
        env=instance.environment, capture_output=True, text=True, check=True,
    )  # fmt: skip
    rows = [json.loads(line) for line in answer.stdout.splitlines() if line.startswith("[")]
    assert len(rows) == len(joints)
    return np.array(rows) * UNITS


def test_the_machine_file_has_the_kinematics_of_the_controller(instance):
    joints = random_joints(400)
    expected = ask(instance, joints)
    machine = load_machine("xyzac_trt")
    assert machine.letters == tuple(NAMES)
    ideal = stand(arrange_machine(machine), (joints * UNITS).T, None).tool_in_workpiece()
    assert np.abs(ideal[:, 3].T - expected[:, :3]).max() < 1e-9
    tilt, turn = expected[:, 3], expected[:, 4]
    tool = np.column_stack([np.sin(turn) * np.sin(tilt), np.cos(turn) * np.sin(tilt), np.cos(tilt)])
    assert np.abs(ideal[:, 2].T - tool).max() < 1e-12


def test_the_bridge_has_the_kinematics_of_the_controller_with_every_parameter_set(instance):
    joints = random_joints(200)
    expected = ask(
        instance, joints, "setp xyzac-trt-kins.x-rot-point 3", "setp xyzac-trt-kins.y-rot-point -5",
        "setp xyzac-trt-kins.z-rot-point 7", "setp xyzac-trt-kins.x-offset 11",
        "unlinkp xyzac-trt-kins.tool-offset", "setp xyzac-trt-kins.tool-offset 47",
    )  # fmt: skip
    table = RotaryTableKinematics((0.003, -0.005, 0.007), (0.020, 0.010), 0.047)
    found = np.array([table.to_axes(row) for row in joints * UNITS])
    assert np.abs(found - expected).max() < 1e-14


def wait(condition, what):
    end = time.monotonic() + DEADLINE
    while not condition():
        assert time.monotonic() < end, f"waited {DEADLINE} s for {what}"
        time.sleep(0.01)


class Bench:
    """A link and an observer on one instance."""

    def __init__(self, instance):
        self.states, self.seen, self.others = [], [], []
        self.link = Connection(LinkSettings(), self._note, enter=instance.enter, environment=instance.environment)
        self.observer = Connection(
            ObserverSettings(), self._note, enter=instance.enter, environment=instance.environment
        )

    def _note(self, record):
        kinds = {State: self.states, Observation: self.seen}
        kinds.get(type(record), self.others).append(record)

    def close(self):
        self.link.close()
        self.observer.close()

    def correct(self, corrections):
        """Send corrections until the joints have moved by them; the largest deviation (m, rad) then."""
        count = len(self.seen)

        def deviation():
            self.link.send(CorrectionRequest(tuple(corrections.tolist())))
            moved = np.subtract(self.seen[-1].joints, self.states[-1].positions)
            return np.abs(moved - corrections).max()

        wait(lambda: len(self.seen) > count + 3 and deviation() < 1e-9, "the joints to be corrected")
        return deviation()


def test_corrections_reach_the_joints_to_a_nanometre_and_a_nanoradian_at_any_pose(instance):
    draw = np.random.default_rng(7)
    operate(instance, "--prepare")
    bench = Bench(instance)
    try:
        for _ in range(6):
            x, y, z, a, c = draw.uniform([-60, -60, 0, -60, -180], [60, 60, 60, 60, 180])
            operate(instance, "--mdi", f"G21 G90 G0 X{x:.3f} Y{y:.3f} Z{z:.3f} A{a:.3f} C{c:.3f}")
            assert bench.correct(draw.uniform(-1, 1, 5) * [3e-5, 3e-5, 3e-5, 2e-4, 2e-4]) < 1e-9
        operate(instance, "--off")
        wait(lambda: bench.states[-1].trouble == "the machine is off", "the machine to be off")
        operate(instance, "--prepare", "--mdi", "G0 X0 Y0 Z0 A10 C20")
        assert bench.correct(np.array([1e-5, 2e-5, -3e-5, 1e-4, -1e-4])) < 1e-9
        assert bench.states[-1].takeovers == 0
    finally:
        bench.close()


def test_two_instances_leave_each_other_alone_and_nothing_behind(linuxcnc_ini):
    with Instance(linuxcnc_ini) as first:
        if not first.isolated:
            pytest.skip("the system allows no namespaces (unshare)")
        operate(first, "--prepare")
        with Instance(linuxcnc_ini) as second:
            operate(second, "--prepare")
            folder = second.folder
        assert not folder.exists()
        assert first.is_running
        assert first.run(["cat", str(presence.SHARED_MEMORY)]).stdout.count("\n") > 1
        operate(first, "--mdi", "G0 X1")
    mine = [
        path for path in Path("/proc").glob("[0-9]*/environ") if _environment(path).get("HOME") == str(first.folder)
    ]
    assert mine == []
    assert not first.is_running


def _processes_at(home):
    return [path for path in Path("/proc").glob("[0-9]*/environ") if _environment(path).get("HOME") == home]


def _environment(path):
    try:
        pairs = path.read_bytes().decode(errors="replace").split("\0")
    except OSError:
        return {}
    return dict(pair.partition("=")[::2] for pair in pairs)


def test_a_program_beside_an_instance_ends_with_it_and_says_why(linuxcnc_ini):
    records = []
    with Instance(linuxcnc_ini) as instance:
        link = Connection(LinkSettings(), records.append, enter=instance.enter, environment=instance.environment)
        wait(lambda: len(records) > 5, "states")
    link.close()
    assert isinstance(records[-1], End)
    assert "LinuxCNC" in records[-1].reason


def test_a_configuration_that_does_not_start_shows_the_log(linuxcnc_ini, tmp_path):
    for path in linuxcnc_ini.parent.iterdir():
        (tmp_path / path.name).write_text(path.read_text().replace("xyzac-trt-kins", "no-such-kins"))
    with (
        pytest.raises(InputError, match=r"(?s)did not start.*insmod for no-such-kins failed"),
        Instance(tmp_path / linuxcnc_ini.name),
    ):
        pass


def test_what_linuxcnc_refuses_is_passed_on(instance):
    operate(instance, "--prepare")
    for arguments, words in ((["--mdi", "G0 X900"], "limit"), (["--program", "/nowhere.ngc"], "nowhere")):
        done = instance.run([*system_program("rotary_error_monitor.linuxcnc_controller.operation"), *arguments])
        assert done.returncode == 1
        assert words in done.stderr
