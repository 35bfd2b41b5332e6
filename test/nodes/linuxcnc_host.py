"""Runs a LinuxCNC that is not isolated until standard input ends; a program for the tests beside it."""

import sys
from pathlib import Path

from rotary_error_monitor.controller.instance import Instance
from rotary_error_monitor.errors import InputError

with Instance(Path(sys.argv[1]), isolated=False):
    try:
        with Instance(Path(sys.argv[1]), isolated=False):
            print("started twice", flush=True)
    except InputError as error:
        print(f"refused: {str(error).split(';')[0]}", flush=True)
    sys.stdin.read()
