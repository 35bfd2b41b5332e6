"""What an operator does at the controller: machine on, home, run a program. Works under the system's Python."""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.linuxcnc_controller.modules import load_module

_PATIENCE = 10.0
_STEP = 0.01


class Operator:
    """Sends commands to the LinuxCNC that runs here and waits until they are done."""

    def __init__(self, linuxcnc: Any) -> None:  # noqa: ANN401 (LinuxCNC's module `linuxcnc` carries no types)
        """Reach LinuxCNC through its module `linuxcnc`."""
        self._linuxcnc = linuxcnc
        self._command = linuxcnc.command()
        self._status = linuxcnc.stat()
        self._errors = linuxcnc.error_channel()
        while self._errors.poll() is not None:
            pass  # what was said before is no answer to what is asked now

    def switch_on(self) -> None:
        """Reset the E-stop and turn the machine on.

        Raises:
            InputError: it stays off.
        """
        cnc = self._linuxcnc
        self._command.state(cnc.STATE_ESTOP_RESET)
        self._wait(lambda: not self._status.estop, "the E-stop to be reset")
        self._command.state(cnc.STATE_ON)
        self._wait(lambda: self._status.task_state == cnc.STATE_ON, "the machine to be on")

    def switch_off(self) -> None:
        """Turn the machine off.

        Raises:
            InputError: it stays on.
        """
        self._command.state(self._linuxcnc.STATE_OFF)
        self._wait(lambda: self._status.task_state != self._linuxcnc.STATE_ON, "the machine to be off")

    def home(self) -> None:
        """Home all joints.

        Raises:
            InputError: they are not homed in time.
        """
        self._enter_mode(self._linuxcnc.MODE_MANUAL)
        self._command.teleop_enable(0)
        self._wait(lambda: self._status.motion_mode == self._linuxcnc.TRAJ_MODE_FREE, "joint mode")
        self._command.home(-1)
        self._wait(lambda: all(self._status.homed[: self._status.joints]), "all joints to be homed")
        self._wait(lambda: self._status.motion_mode != self._linuxcnc.TRAJ_MODE_FREE, "the axes to be in command")

    def execute(self, code: str, deadline: float = _PATIENCE) -> None:
        """Run one line of G-code.

        Raises:
            InputError: it is not done within `deadline` s, or LinuxCNC refuses it.
        """
        self._enter_mode(self._linuxcnc.MODE_MDI)
        self._command.mdi(code)
        self._finish(code, deadline)

    def run(self, program: Path, deadline: float) -> None:
        """Run a G-code program to its end.

        Raises:
            InputError: it does not end within `deadline` s, or LinuxCNC stops it.
        """
        self._enter_mode(self._linuxcnc.MODE_AUTO)
        self._command.program_open(str(program))
        self._command.wait_complete()
        self._command.auto(self._linuxcnc.AUTO_RUN, 0)
        self._finish(str(program), deadline)

    def _finish(self, what: str, deadline: float) -> None:
        self._command.wait_complete(deadline)
        cnc = self._linuxcnc

        def is_done() -> bool:
            status = self._status
            return bool(status.interp_state == cnc.INTERP_IDLE and status.exec_state == cnc.EXEC_DONE and status.inpos)

        self._wait(is_done, f"{what} to end", deadline)

    def _enter_mode(self, mode: int) -> None:
        self._command.mode(mode)
        self._wait(lambda: self._status.task_mode == mode, "the task mode to change")

    def _wait(self, condition: Callable[[], bool], what: str, deadline: float | None = None) -> None:
        self._command.wait_complete()
        deadline = _PATIENCE if deadline is None else deadline
        end = time.monotonic() + deadline
        while True:
            while (said := self._errors.poll()) is not None:
                if said[0] in (self._linuxcnc.NML_ERROR, self._linuxcnc.OPERATOR_ERROR):
                    raise InputError(f"while waiting for {what}, LinuxCNC says: {said[1].strip()}")
            self._status.poll()
            if condition():
                return
            if time.monotonic() > end:
                raise InputError(f"waited {deadline:g} s for {what}")
            time.sleep(_STEP)


def main(arguments: list[str] | None = None) -> int:
    """Turn the machine on, home it, and run what the arguments name; 0, or 1 with the reason on standard error."""
    parser = argparse.ArgumentParser(prog="rotary_error_monitor.linuxcnc_controller.operation", description=__doc__)
    parser.add_argument("--prepare", action="store_true", help="turn the machine on and home it")
    parser.add_argument("--mdi", action="append", default=[], help="line of G-code to run; may be given several times")
    parser.add_argument("--program", type=Path, help="G-code program to run to its end")
    parser.add_argument("--off", action="store_true", help="turn the machine off at the end")
    parser.add_argument("--deadline", type=float, default=600.0, help="how long a program may take, s")
    options = parser.parse_args(arguments)
    try:
        operator = Operator(load_module("linuxcnc"))
        if options.prepare:
            operator.switch_on()
            operator.home()
        for code in options.mdi:
            operator.execute(code, options.deadline)
        if options.program is not None:
            operator.run(options.program, options.deadline)
        if options.off:
            operator.switch_off()
    except InputError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
