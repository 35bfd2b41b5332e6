"""A program beside a running LinuxCNC: attaches to its memory, looks at it period after period, and ends with it.

Such a program is a process of its own because LinuxCNC ends every HAL component when it shuts down, because its modules
load only in the system's Python, and because the memory of an instance that has ended cannot be let go of otherwise. It
writes records to standard output and reads them from standard input; when that is closed, it ends. Until a LinuxCNC
runs, it waits.
"""

from __future__ import annotations

import argparse
import json
import os
import select
import selectors
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any, Protocol, TypeAlias

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.linuxcnc_controller import presence
from rotary_error_monitor.linuxcnc_controller.clock import Clock, Moment, present
from rotary_error_monitor.linuxcnc_controller.kinematics import LETTERS
from rotary_error_monitor.linuxcnc_controller.modules import load_module
from rotary_error_monitor.linuxcnc_controller.pins import MachinePins, Units
from rotary_error_monitor.linuxcnc_controller.protocol import Absent, End, Hello, Record, decode, encode
from rotary_error_monitor.unwinding import unwinding

ABSENT = "no LinuxCNC runs here"
SHUTDOWN = "LinuxCNC shuts down: it told its HAL components to end"
TASK_ENDED = "LinuxCNC's task process has ended"
_CHUNK = 1 << 16
_STATUS_PATIENCE = 2.0
_STATUS_STEP = 0.02
_PRESENCE_STEP = 0.1
"""Time between two looks whether a LinuxCNC runs, s; each reads one line or two."""


class Looker(Protocol):
    """What a program does with the machine's pins."""

    def handle(self, record: Record, now: Moment) -> None:
        """Take up what the other side says."""

    def look(self, clock: Clock) -> Record:
        """Look at the machine, and say what is seen."""


Start: TypeAlias = Callable[[dict[str, Any], MachinePins], tuple[Looker, float]]
"""Gives what looks, and the time between two looks in s, for settings by name and the machine's pins."""


def serve(
    looker: Looker,
    period: float,
    task: int,
    source: int,
    send: Callable[[Record], None],
    clock: Clock = present,
) -> str:
    """Look at the machine each `period` s and take up what the other side says, until something ends.

    Args:
        looker: what looks.
        period: time between two looks, s.
        task: file descriptor that becomes readable when the task process ends.
        source: file descriptor of the other side's records; when it ends, so does this.
        send: takes each record.
        clock: present time.

    Returns:
        Why it ended; empty when the other side closed.

    Raises:
        InputError: the machine is not there any more.
    """
    os.set_blocking(source, False)
    buffer = b""
    with selectors.DefaultSelector() as selector:
        selector.register(task, selectors.EVENT_READ)
        selector.register(source, selectors.EVENT_READ)
        due = time.monotonic()
        while True:
            ready = {key.fd for key, _ in selector.select(max(0.0, due - time.monotonic()))}
            if task in ready:
                return TASK_ENDED
            if source in ready:
                data = os.read(source, _CHUNK)
                if not data:
                    return ""
                *lines, buffer = (buffer + data).split(b"\n")
                for line in lines:
                    looker.handle(decode(line), clock())
            if time.monotonic() >= due:
                send(looker.look(clock))
                # Looks that come late are left out, not made up for: only the newest state is worth anything.
                due = max(due + period, time.monotonic())


@contextmanager
def attach() -> Iterator[MachinePins]:
    """Pins of the LinuxCNC that runs here.

    Raises:
        InputError: none runs, or it is none that can be used.
    """
    linuxcnc, hal = load_module("linuxcnc"), load_module("hal")
    component = hal.component(f"rotary-error-monitor-{os.getpid()}")
    try:
        component.ready()
        status = linuxcnc.stat()
        _wait_for_status(status)
        # The controller gives its units as how many of them make a millimetre and a degree.
        units = Units(status.linear_units * 1e3, status.angular_units * Units.per_radian)
        names = [letter for bit, letter in enumerate(LETTERS) if status.axis_mask >> bit & 1]
        yield MachinePins(hal, names, units)
    finally:
        component.exit()


def _wait_for_status(status: Any) -> None:  # noqa: ANN401 (LinuxCNC's `stat` carries no types)
    """Wait until a controller that has just started tells of its axes.

    Raises:
        InputError: it does not.
    """
    end = time.monotonic() + _STATUS_PATIENCE
    while True:
        with suppress(SystemError):  # what `poll` ends with where there is no status yet
            status.poll()
            if status.axis_mask:
                return
        if time.monotonic() > end:
            raise InputError(f"LinuxCNC has told of no axes for {_STATUS_PATIENCE:g} s")
        time.sleep(_STATUS_STEP)


def run(
    name: str, start: Callable[[dict[str, Any], MachinePins], tuple[Looker, float]], arguments: list[str] | None
) -> int:
    """Run a program beside LinuxCNC until LinuxCNC or the other side ends.

    Args:
        name: of the program.
        start: makes what looks.
        arguments: of the command line; its only one is a JSON object of settings.

    Returns:
        Exit code: 0 when the other side closed, 1 if LinuxCNC could not be reached or is lost.
    """
    parser = argparse.ArgumentParser(prog=name)
    parser.add_argument("settings", type=json.loads, help="settings by name, as a JSON object")
    settings = parser.parse_args(arguments).settings
    with suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))  # little work, but on time
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole group; the other side decides
    signal.signal(signal.SIGTERM, signal.SIG_DFL)  # so that it unwinds, whatever it did in who started this
    try:
        with unwinding():
            reason = _run(start, settings)
    except SystemExit:  # LinuxCNC, or the user, told this process to end
        reason = SHUTDOWN
    except BrokenPipeError:
        return 0
    except InputError as error:
        reason = str(error)
    with suppress(BrokenPipeError):
        if reason:
            _send(End(reason))
    return 1 if reason else 0


def _run(start: Start, settings: dict[str, Any]) -> str:
    source = sys.stdin.fileno()
    if not _await_controller(source):
        return ""
    with attach() as pins:
        looker, period = start(settings, pins)
        task = presence.open_task()
        try:
            _send(Hello(pins.names))
            return serve(looker, period, task, source, _send_if_taken)
        finally:
            os.close(task)


def _await_controller(source: int) -> bool:
    """Wait for a LinuxCNC without touching its memory; False if the other side closes before. What it says is lost."""
    said = False
    while not presence.runs(presence.SHARED_MEMORY.read_text()):
        if not said:
            _send(Absent(ABSENT))
            said = True
        ready, _, _ = select.select([source], [], [], _PRESENCE_STEP)
        if ready and not os.read(source, _CHUNK):
            return False
    return True


def _send(record: Record) -> None:
    sys.stdout.buffer.write(encode(record))
    sys.stdout.buffer.flush()


def _send_if_taken(record: Record) -> None:
    """Send what a newer record replaces: one that is not taken at once is dropped, for the looks shall go on.

    A pipe that is ready takes as much as a record is long (PIPE_BUF) without waiting.
    """
    if select.select([], [sys.stdout.fileno()], [], 0.0)[1]:
        _send(record)
