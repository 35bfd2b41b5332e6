"""Runs commands of the package, each in a forked child with limits on memory and processor time.

A line of JSON on standard input asks for one run, `{"arguments": [...], "cpu": s, "memory": bytes, "output": file}`; a
line of JSON answers it. What the package needs is loaded once, before the first fork: a run costs milliseconds.
"""

from __future__ import annotations

import json
import os
import resource
import select
import signal
import sys
import traceback
from importlib import import_module
from pathlib import Path

LOADED = (
    "commands.calibrate",
    "commands.check",
    "commands.diagnose",
    "commands.recover",
    "commands.replay",
    "commands.wire",
    "codec.decoding",
    "kinds.machine.kind",
    "kinds.stage.kind",
    "kinds.mount.kind",
    "gap.sentences",
    "kinds.stage.stretches",
    "kinds.quadrature.kind",
    "recordings.diagnosis",
    "linuxcnc_demonstration.run",
    "mock_cell.figures",
)
"""Modules that commands load late; a child would load them again in each run."""

LONGEST = 120.0
"""Time (s) by the clock after which a run is ended that uses no processor: it waits for something."""


def main() -> None:
    cli = import_module("rotary_error_monitor.cli")
    for name in LOADED:
        import_module(f"rotary_error_monitor.{name}")
    print(json.dumps({"ready": True}), flush=True)
    for line in sys.stdin:
        print(json.dumps(run(cli.main, json.loads(line))), flush=True)


def run(command, job):
    """Exit code (None where a signal ended it), signal, processor time (s) of one run."""
    child = os.fork()
    if child == 0:
        work(command, job)
    if not wait(child):
        os.kill(child, signal.SIGKILL)
    _, status, usage = os.wait4(child, 0)
    ended = os.WTERMSIG(status) if os.WIFSIGNALED(status) else None
    code = os.WEXITSTATUS(status) if os.WIFEXITED(status) else None
    return {"code": code, "signal": ended, "cpu": usage.ru_utime + usage.ru_stime}


def wait(child: int) -> bool:
    handle = os.pidfd_open(child)
    try:
        return bool(select.select([handle], [], [], LONGEST)[0])
    finally:
        os.close(handle)


def work(command, job) -> None:
    code = 1
    try:
        output = os.open(job["output"], os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        os.dup2(output, 1)
        os.dup2(output, 2)
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        resource.setrlimit(resource.RLIMIT_AS, (address_space() + job["memory"],) * 2)
        resource.setrlimit(resource.RLIMIT_CPU, (job["cpu"], job["cpu"] + 5))
        arguments = job["arguments"]
        code = LOADERS[arguments[0]](Path(arguments[1])) if arguments[0] in LOADERS else command(arguments)
        sys.stdout.flush()
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 1
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stderr.flush()
        os._exit(code)


def load_wire(folder: Path) -> int:
    """The wire contract of a folder, which no command takes: as a command would."""
    from rotary_error_monitor.description import wire
    from rotary_error_monitor.errors import InputError

    try:
        print(wire.markdown_table(wire.load_wire(folder=folder)))
    except InputError as error:
        print(f"rotary_error_monitor: {error}", file=sys.stderr)
        return 2
    return 0


def load_parameters(path: Path) -> int:
    """The parameter file of a node: as the process of a node reads it before anything else."""
    import rclpy
    from rclpy.signals import SignalHandlerOptions

    try:
        options = ["--ros-args", "--params-file", str(path)]
        rclpy.init(args=options, signal_handler_options=SignalHandlerOptions.NO)
    except RuntimeError as error:
        print(f"rotary_error_monitor: {error}", file=sys.stderr)
        return 2
    return 0


def misbehave(how: Path) -> int:
    """What the sandbox is there for."""
    if how.name == "loop":
        while True:
            pass
    if how.name == "grow":
        return len(bytearray(2 << 30)) and 0
    if how.name == "crash":
        os.kill(os.getpid(), signal.SIGSEGV)
    if how.name == "raise":
        raise KeyError("nobody expects it")
    if how.name == "warn":
        print("x.py:1: RuntimeWarning: overflow")
    if how.name == "chatter":
        print("rotary_error_monitor: " + "x" * 100_000)
    return 2


LOADERS = {"load_wire": load_wire, "load_parameters": load_parameters, "misbehave": misbehave}
"""Files that a node or a library call takes and no command; and what tests the sandbox itself."""


def address_space() -> int:
    """Bytes of address space that this process has: what is loaded already does not count against a run's memory."""
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    return pages * os.sysconf("SC_PAGE_SIZE")


if __name__ == "__main__":
    main()
