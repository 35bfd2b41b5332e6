"""`rotary_error_monitor convert`: a bag of third-party drivers' messages, as one that the cell would have recorded."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from rotary_error_monitor.errors import excerpt, one_line

INCOMPLETE = 10
"""Exit code: written, and messages were refused, or drivers have none in the bag."""


def add(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments."""
    parser.epilog = (
        "exit codes: 0 done; 10 done, and messages were refused or a driver has none; 2 wrong input. BAG stays "
        "as it is."
    )
    parser.add_argument(
        "bag", type=Path, metavar="BAG", help="with JointState, Vector3Stamped, WrenchStamped, Temperature"
    )
    parser.add_argument(
        "--cell-file",
        type=Path,
        required=True,
        metavar="CELL.yaml",
        help="parameter file of the cell, as for `up`: source, topic, joint and unit of each instrument",
    )
    parser.add_argument("--stage", type=Path, help="YAML of the stage (default: as CELL.yaml says)")
    parser.add_argument("--cell", default="", metavar="/NS", help="namespace of relative topics (default: none)")
    parser.add_argument(
        "--stamps",
        choices=("header", "log"),
        default="header",
        help="when samples were measured: as the drivers say, or when the bag recorded them (default: header)",
    )
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="OUT", help="new folder of the bag")


def run(arguments: argparse.Namespace) -> int:
    """Convert, and say what became of each driver's messages."""
    from rotary_error_monitor.recordings.conversion import convert

    given = arguments
    streams = convert(given.bag, given.cell_file, given.stage, given.output, given.stamps, given.cell)
    for each in streams:
        print(f"{one_line(each.heard)}: {each.samples} samples on {each.topic.name}")
        for reason, count in each.refused.most_common():
            print(
                f"note: {one_line(each.heard)}: {count} refused, such as: {excerpt(each.words[reason])}",
                file=sys.stderr,
            )
    print(f"written to {one_line(str(given.output))}")
    return INCOMPLETE if any(each.refused or not each.samples for each in streams) else 0
