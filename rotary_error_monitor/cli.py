"""The command `rotary_error_monitor`: what is done without starting a node."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from importlib import import_module

from rotary_error_monitor import __version__
from rotary_error_monitor.errors import InputError

BAD_INPUT = 2
COMMANDS = ("run", "run-linuxcnc", "replay", "recover", "calibrate", "diagnose", "gap-benchmark", "wire")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; give its exit code: 0 for success, 2 for wrong input, others as the command's help says."""
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    parser = argparse.ArgumentParser(
        prog="rotary_error_monitor",
        description="Monitor, compensate and diagnose the error motion of a rotary stage and its machine.",
    )
    parser.add_argument("--version", action="version", version=__version__)
    subparsers = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    # a command's libraries take seconds to load: only those of the command that is meant
    for name in arguments[:1] if arguments[:1] and arguments[0] in COMMANDS else COMMANDS:
        import_module(f"rotary_error_monitor.commands.{name.replace('-', '_')}").add(subparsers)
    chosen = parser.parse_args(arguments)
    try:
        return int(chosen.run(chosen))
    except InputError as error:
        print(f"rotary_error_monitor: {error}", file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        return 130


if __name__ == "__main__":
    sys.exit(main())
