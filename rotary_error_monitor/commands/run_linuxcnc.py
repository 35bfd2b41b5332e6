"""`rotary_error_monitor run-linuxcnc`: a five-axis program on a real controller, with and without correction."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

FAILED = 1


def add(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments."""
    parser.description = "Exit code 0 where the tool error falls as far as it must, 1 where it does not."
    parser.add_argument("--machine", default="xyzac_trt", help="machine YAML, or the name of one that ships")
    parser.add_argument("--stage", type=Path, help="stage YAML (default: config/stage.yaml)")
    parser.add_argument("--ini", type=Path, help="LinuxCNC configuration (default: config/linuxcnc/xyzac_trt.ini)")
    parser.add_argument("--program", type=Path, help="G-code (default: five_axis.ngc beside the configuration)")
    parser.add_argument("--seed", type=int, default=1, help="of the mock stage under the table")


def run(arguments: argparse.Namespace) -> int:
    """Run the demonstration; its exit code."""
    # ROS is imported only where it is used, so that the commands without it start fast and work without it
    from rotary_error_monitor.linuxcnc_demonstration import run as linuxcnc_run

    options = linuxcnc_run.LinuxcncRun(
        arguments.machine, arguments.stage, arguments.ini, arguments.program, arguments.seed
    )
    try:
        return linuxcnc_run.run(options)
    except (RuntimeError, TimeoutError) as error:
        print(f"rotary_error_monitor: {error}", file=sys.stderr)
        return FAILED
