"""Runs a LinuxCNC that is not isolated until standard input ends; a program for the tests beside it.

Before, a line of standard input stands for each time that the machine is to be turned on and homed.
"""

import sys
from pathlib import Path

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.linuxcnc_controller.instance import Instance
from rotary_error_monitor.linuxcnc_controller.modules import system_program

with Instance(Path(sys.argv[1]), isolated=False) as running:
    try:
        with Instance(Path(sys.argv[1]), isolated=False):
            print("started twice", flush=True)
    except InputError as error:
        print(f"refused: {str(error).split(';')[0]}", flush=True)
    for _ in sys.stdin:
        done = running.run([*system_program("rotary_error_monitor.linuxcnc_controller.operation"), "--prepare"])
        print(f"prepared {done.returncode}{done.stderr}", flush=True)
