"""`rotary_error_monitor up`: the nodes of a cell, kept running."""

from __future__ import annotations

import argparse
import asyncio
from pathlib import Path

from rotary_error_monitor.supervision.served_sensors import checked_nodes, unserved_sensors
from rotary_error_monitor.supervision.supervisor import Supervisor
from rotary_error_monitor.supervision.systemd import unit


def add(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments."""
    parser.description = (
        "Starts a node for each section of the file (/**/encoder_head_a, /left/compensation, …) with the "
        "file as its parameters, starts again what ends, and ends all in order on SIGINT, SIGTERM or SIGHUP, or once "
        "nobody reads the pipe it writes to any more. Exit code 2 where a node's input is wrong at its first start "
        "or a sensor that the stage lists has no node, 1 where one had to be killed at the end."
    )
    parser.add_argument("cell", type=Path, help="ROS parameter file, such as a copy of config/real_cell.yaml")
    parser.add_argument("--namespace", default="", help="of all nodes whose section names none, such as /left")
    parser.add_argument(
        "--systemd",
        action="store_true",
        help="print a unit of systemd that does this, in place of doing it: for ~/.config/systemd/user/",
    )


def run(arguments: argparse.Namespace) -> int:
    """Run the cell until a signal, or print the unit."""
    nodes = checked_nodes(arguments.cell, arguments.namespace)
    if arguments.systemd:
        print(unit(arguments.cell, ["--namespace", arguments.namespace] if arguments.namespace else []), end="")
        return 0
    for remark in unserved_sensors(arguments.cell, arguments.namespace):
        _say(remark)
    supervisor = Supervisor(nodes, ["--params-file", str(arguments.cell)], say=_say)
    return asyncio.run(supervisor.run())


def _say(text: str) -> None:
    print(f"up: {text}", flush=True)
