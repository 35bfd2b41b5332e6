"""Nodes as processes of their own, started as a user would, their output kept for when something goes wrong."""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator, Mapping, Sequence
from types import FrameType

from rotary_error_monitor.testing.domains import LOCALHOST, discovery_environment

_PATIENCE = 60.0
"""How long to wait for the end of a process, s. Nodes end by themselves within five seconds of what they have to put
away; where many processes wait for each core, that and the start of one that shall fail take many times as long."""

_LAST_WORDS = 2.0
_STACKS = {"PYTHONFAULTHANDLER": "1"}
"""Makes a process that is aborted write where each of its threads stood."""

_UNWINDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class NodeProcess:
    """One executable of the package in a process of its own.

    Attributes:
        name: name of the node.
        expected: whether its end is no surprise any more.
        judged: whether its exit code was handed out, to be judged by who asked.
    """

    def __init__(
        self,
        executable: str,
        name: str,
        domain: int,
        ros_args: Sequence[str],
        *,
        reach: str = LOCALHOST,
        within: Sequence[str] = (),
    ) -> None:
        """Start `executable` as node `name` in a ROS domain.

        Args:
            executable: of the package.
            name: of its node.
            domain: id of the ROS domain.
            ros_args: further arguments behind `--ros-args`.
            reach: how far nodes find one another: `LOCALHOST` or `SUBNET`.
            within: command that starts the process in place of itself, such as `taskset -c 0`.
        """
        self.name = name
        self.expected = False
        self.judged = False
        self._output = tempfile.TemporaryFile()  # noqa: SIM115 (close() closes it)
        self._process = subprocess.Popen(
            [
                *within,
                sys.executable,
                "-m",
                "rotary_error_monitor.start",
                executable,
                "--ros-args",
                "-r",
                f"__node:={name}",
                *ros_args,
            ],
            env={**os.environ, **discovery_environment(reach), **_STACKS, "ROS_DOMAIN_ID": str(domain)},
            stdin=subprocess.DEVNULL,
            stdout=self._output,
            stderr=subprocess.STDOUT,
        )

    @property
    def pid(self) -> int:
        """Process id."""
        return self._process.pid

    @property
    def exit_code(self) -> int | None:
        """Exit code, negative for a signal; None while it runs."""
        return self._process.poll()

    @property
    def ending(self) -> str:
        """How it ended and what it wrote, in words."""
        return f"{self.name} ended with exit code {self.exit_code}; it wrote:\n{self.output}"

    @property
    def output(self) -> str:
        """What it wrote so far on standard output and standard error."""
        # the process writes at the place that it shares with this file: reading must not move it
        file = self._output.fileno()
        return os.pread(file, os.fstat(file).st_size, 0).decode("utf-8", "replace")

    def send(self, number: signal.Signals) -> None:
        """Send a signal, after which its end is no surprise."""
        self.expected = True
        self._process.send_signal(number)

    def pause(self) -> None:
        """Stop it where it stands, as a computer that has no time for it; `go_on` lets it go on.

        When this returns, all of its threads stand: on a busy computer some go on for a while after the signal.
        """
        self._process.send_signal(signal.SIGSTOP)
        os.waitid(os.P_PID, self.pid, os.WSTOPPED | os.WEXITED | os.WNOWAIT)

    def go_on(self) -> None:
        """Let it go on after `pause`."""
        self._process.send_signal(signal.SIGCONT)

    def stop(self, number: signal.Signals = signal.SIGINT, deadline: float = _PATIENCE) -> int:
        """Ask it to end by a signal and wait; give its exit code.

        Raises:
            TimeoutError: it did not end within `deadline` s and was killed.
        """
        if self.exit_code is None:
            self.send(number)
        return self.wait(deadline)

    def wait(self, deadline: float = _PATIENCE) -> int:
        """Wait for its end; give its exit code.

        Raises:
            TimeoutError: it did not end within `deadline` s and was killed; the message says where its threads stood.
        """
        self.expected = self.judged = True
        try:
            return self._process.wait(deadline)
        except subprocess.TimeoutExpired:
            self._process.send_signal(signal.SIGABRT)
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(_LAST_WORDS)
            self._process.kill()
            self._process.wait()
            raise TimeoutError(f"{self.name} did not end within {deadline} s; it wrote:\n{self.output}") from None

    def close(self) -> None:
        """Kill it if it still runs, and forget its output."""
        if self.exit_code is None:
            self._process.kill()
            self._process.wait()
        self._output.close()


@contextlib.contextmanager
def postponed_signals() -> Iterator[None]:
    """Hold back what unwinds this process until the block is through: a child that nobody knows would outlive it."""
    came: list[int] = []

    def note(number: int, frame: FrameType | None) -> None:
        came.append(number)

    # only the main thread runs handlers and may set them
    ours = _UNWINDING if threading.current_thread() is threading.main_thread() else ()
    kept = {number: signal.signal(number, note) for number in ours if callable(signal.getsignal(number))}
    try:
        yield
    finally:
        for number, handler in kept.items():
            signal.signal(number, handler)
        for late in came:
            signal.raise_signal(late)


def parameter_arguments(parameters: Mapping[str, object]) -> list[str]:
    """Arguments `-p name:=value`, values written as YAML reads them back."""
    return [part for name, value in parameters.items() for part in ("-p", f"{name}:={_yaml(value)}")]


def _yaml(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_yaml, value)) + "]"
    return repr(value) if isinstance(value, int | float) else f"'{value}'"
