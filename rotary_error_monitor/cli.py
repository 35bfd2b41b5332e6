"""The command `rotary_error_monitor`: what is done without starting a node."""

from __future__ import annotations

import argparse
import os
import select
import signal
import sys
from collections.abc import Sequence
from importlib import import_module

from rotary_error_monitor import __version__
from rotary_error_monitor.errors import InputError, excerpt, printable
from rotary_error_monitor.start import command
from rotary_error_monitor.unwinding import unwinding

BAD_INPUT = 2
COMMANDS = (
    "run",
    "run-linuxcnc",
    "up",
    "replay",
    "check",
    "recover",
    "convert",
    "calibrate",
    "commission",
    "offset",
    "analyse",
    "compare",
    "trend",
    "diagnose",
    "effects",
    "gap-benchmark",
    "reproduce",
    "wire",
    "security",
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; give its exit code: 0 for success, 2 for wrong input, others as the command's help says."""
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    # Matrices here are small: threads of linear algebra wait for one another longer than they work.
    os.environ.setdefault("OMP_NUM_THREADS", "1")
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
        with unwinding():
            code = int(chosen.run(chosen))
            sys.stdout.flush()
            return code
    except InputError as error:
        print(f"rotary_error_monitor: {printable(str(error))}", file=sys.stderr)
        return BAD_INPUT
    except MemoryError:
        print("rotary_error_monitor: not enough memory for what was given; give a smaller file", file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:
        if not _output_is_closed():
            raise
        return 128 + signal.SIGPIPE
    except OSError as error:
        if error.filename is None:
            raise
        # A path that cannot be used, in whatever way: too long, not allowed, on a disk that is full.
        print(f"rotary_error_monitor: {excerpt(error.filename)}: {error.strerror}", file=sys.stderr)
        return BAD_INPUT


def _output_is_closed() -> bool:
    """Whether who reads the output has read enough, as `head` has; Python then does not write to it at its end."""
    try:
        output = sys.stdout.fileno()
    except OSError:  # kept in memory, as tests do
        return False
    polled = select.poll()
    polled.register(output, select.POLLOUT)
    closed = any(event & select.POLLERR for _, event in polled.poll(0))
    if closed:
        os.dup2(os.open(os.devnull, os.O_WRONLY), output)
    return closed


if __name__ == "__main__":
    sys.exit(command())
