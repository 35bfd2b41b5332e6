"""What an operator does, on a controller that obeys, and on ones that do not."""

import types
from pathlib import Path

import pytest

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.linuxcnc_controller import operation
from rotary_error_monitor.linuxcnc_controller.operation import Operator, main


class FakeLinuxcnc:
    """Stands in for LinuxCNC's module `linuxcnc`; `deaf` names a command that it does not obey."""

    STATE_ESTOP_RESET, STATE_ON, STATE_OFF = 2, 4, 3
    MODE_MANUAL, MODE_AUTO, MODE_MDI = 1, 2, 3
    TRAJ_MODE_FREE, TRAJ_MODE_TELEOP = 1, 3
    INTERP_IDLE, EXEC_DONE, AUTO_RUN = 1, 2, 0
    NML_ERROR, OPERATOR_ERROR, OPERATOR_TEXT = 1, 11, 12

    def __init__(self):
        self.deaf = ""
        self.said = [(self.OPERATOR_ERROR, "an old story")]
        self.ran = []
        self.machine = types.SimpleNamespace(
            estop=1, task_state=1, task_mode=1, motion_mode=self.TRAJ_MODE_TELEOP, homed=(0,) * 9, joints=5,
            interp_state=self.INTERP_IDLE, exec_state=self.EXEC_DONE, inpos=True, poll=lambda: None,
        )  # fmt: skip

    def stat(self):
        return self.machine

    def error_channel(self):
        return types.SimpleNamespace(poll=lambda: self.said.pop(0) if self.said else None)

    def command(self):
        return self

    def wait_complete(self, timeout=5.0):
        return 1

    def state(self, wanted):
        if self.deaf != "state":
            self.machine.estop = 0
            self.machine.task_state = wanted

    def mode(self, wanted):
        if self.deaf != "mode":
            self.machine.task_mode = wanted

    def teleop_enable(self, on):
        self.machine.motion_mode = self.TRAJ_MODE_TELEOP if on else self.TRAJ_MODE_FREE

    def home(self, joint):
        if self.deaf != "home":
            self.machine.homed = (1,) * 5 + (0,) * 4
            self.machine.motion_mode = self.TRAJ_MODE_TELEOP

    def mdi(self, code):
        self.ran.append(code)
        self.said.append((self.OPERATOR_TEXT, "a word from the program"))
        if self.deaf == "mdi":
            self.said.append((self.OPERATOR_ERROR, "would exceed joint 0's limit\n"))

    def program_open(self, path):
        self.ran.append(path)

    def auto(self, command, line):
        self.machine.inpos = self.deaf != "auto"


@pytest.fixture
def linuxcnc(monkeypatch):
    fake = FakeLinuxcnc()
    monkeypatch.setattr(operation, "load_module", lambda name: fake)
    monkeypatch.setattr(operation, "_PATIENCE", 0.05)
    return fake


def test_a_machine_is_prepared_a_program_run_and_the_machine_turned_off(linuxcnc):
    arguments = ["--prepare", "--mdi", "G0 X1", "--mdi", "G0 X2", "--program", "part.ngc", "--off"]
    assert main(arguments) == 0
    assert linuxcnc.ran == ["G0 X1", "G0 X2", "part.ngc"]
    assert linuxcnc.machine.task_state == linuxcnc.STATE_OFF


@pytest.mark.parametrize(
    ("deaf", "arguments", "reason"),
    [
        ("state", ["--prepare"], "the E-stop to be reset"),
        ("home", ["--prepare"], "all joints to be homed"),
        ("mode", ["--mdi", "G0 X1"], "the task mode to change"),
        ("mdi", ["--mdi", "G0 X900"], "while waiting for G0 X900 to end, LinuxCNC says: would exceed joint 0's limit"),
        ("auto", ["--program", "part.ngc", "--deadline", "0.05"], "waited 0.05 s for part.ngc to end"),
    ],
)
def test_what_the_controller_does_not_do_is_said(linuxcnc, capsys, deaf, arguments, reason):
    linuxcnc.deaf = deaf
    assert main(arguments) == 1
    assert reason in capsys.readouterr().err


def test_an_operator_hears_only_what_is_said_while_it_waits(linuxcnc):
    operator = Operator(linuxcnc)
    operator.switch_on()
    linuxcnc.said.append((linuxcnc.NML_ERROR, "no such file"))
    with pytest.raises(InputError, match="while waiting for the task mode to change, LinuxCNC says: no such file"):
        operator.run(Path("part.ngc"), 0.05)
