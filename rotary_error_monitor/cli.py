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
COMMANDS = {
    "run": "run a machine cell on mock sensors, record and replay it, print what it reached",
    "run-linuxcnc": "run a five-axis program on a headless LinuxCNC and print the tool error with and without "
    "correction",
    "up": "start the nodes that a parameter file names, and keep them running",
    "replay": "run estimator and compensation over a bag, without ROS",
    "check": "say whether the description of a stage fits a recording of it, or what its sensors tell",
    "recover": "make the bag of a recorder that was killed readable again",
    "convert": "make a bag of third-party drivers' messages one that replay, analyse and diagnose read",
    "calibrate": "measurements to the machine file, and to the tables that controllers load",
    "commission": "find out what a newly built stage is like, and write its stage file",
    "offset": "where a machine's errors put the tool, body by body, and its matrices as formulas",
    "analyse": "say how good a stage is: error motion values (ISO 230-7) of a recording",
    "compare": "hold the radial error motion of a recording against an LVDT or displacement probes in it",
    "trend": "say what changed when: error motion values of all recordings below a folder",
    "diagnose": "say where, why and how far a recording differs from its digital twin",
    "effects": "print the effects that a diagnosis can name, with unit, usual size, and what to do about them",
    "gap-benchmark": "diagnose cases whose truth is sealed in another process, then open and score",
    "reproduce": "carry out a paper's procedure on a simulation with the paper's numbers, and hold the result against "
    "it",
    "wire": "print the topics, types, fields, units and QoS as a Markdown table",
    "security": "SROS2 policies and keys of a cell, least privilege a node; users of its OPC UA server",
}
"""What each does: a list of all needs no command's libraries."""


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
    meant = next((word for word in arguments if word in COMMANDS), None)
    for name, what in COMMANDS.items():
        own = subparsers.add_parser(name, help=what)
        if name == meant:
            module = import_module(f"rotary_error_monitor.commands.{name.replace('-', '_')}")
            own.set_defaults(run=getattr(module, "run", None))  # the steps of some have one each
            module.add(own)
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
