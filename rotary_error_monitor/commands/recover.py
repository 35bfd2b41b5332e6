"""`rotary_error_monitor recover`: make the bag of a recorder that was killed readable by every tool."""

from __future__ import annotations

import argparse
from pathlib import Path

from rotary_error_monitor.bags.recovery import recover
from rotary_error_monitor.commands.values import tell
from rotary_error_monitor.errors import one_line

DAMAGED = 10
"""Exit code: done, and the result is not as one would have it. So ends `replay` as well."""


def add(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments."""
    parser.epilog = (
        "exit codes: 0 the bag can be read by every tool, and lacks at most the end of a recording that was "
        "not closed; 10 it can be read, but more than that is lost, and the damaged file is kept beside it; 2 no bag, "
        "no whole message in it (it stays as it is), no room for a copy, or a bag that is being recorded. What cannot "
        "be recovered, such as a file that is missing, is said on standard error."
    )
    parser.add_argument(
        "bag", type=Path, metavar="BAG", help="folder of a bag, or an mcap file that is to be recovered alone"
    )


def run(arguments: argparse.Namespace) -> int:
    """Recover the bag in place and say what is in it."""
    report = recover(arguments.bag)
    print(one_line(str(report)))
    tell(report.remarks)
    return 0 if report.whole else DAMAGED
