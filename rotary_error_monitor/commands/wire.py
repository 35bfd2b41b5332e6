"""`rotary_error_monitor wire`: the wire contract as a table."""

from __future__ import annotations

import argparse

from rotary_error_monitor.description.wire import load_wire, markdown_table


def add(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments."""


def run(arguments: argparse.Namespace) -> int:
    """Print the table."""
    print(markdown_table(load_wire(None)), end="")
    return 0
