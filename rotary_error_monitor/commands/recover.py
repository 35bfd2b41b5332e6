"""`rotary_error_monitor recover`: make the bag of a recorder that was killed readable by every tool."""

from __future__ import annotations

import argparse
from pathlib import Path

from rotary_error_monitor.bags.recovery import recover


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Describe the command's arguments."""
    parser = subparsers.add_parser("recover", help="make the bag of a recorder that was killed readable again")
    parser.add_argument("bag", type=Path, metavar="BAG")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Recover the bag in place and say what is in it."""
    print(recover(arguments.bag))
    return 0
