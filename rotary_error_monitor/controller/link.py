"""The link to a running LinuxCNC: a small process between its shared memory and whoever speaks `protocol`.

It is a process of its own because LinuxCNC ends every HAL component when it shuts down, because its modules load only
in the system's Python, and because the memory of an instance that has ended cannot be let go of otherwise. It writes
states to standard output and reads corrections from standard input; when that is closed, it ends and leaves the offsets
as they are.
"""

from __future__ import annotations

import argparse
import json
import os
import selectors
import signal
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import asdict
from types import FrameType
from typing import Any

from rotary_error_monitor.controller import presence
from rotary_error_monitor.controller.kinematics import LETTERS, ROTARY
from rotary_error_monitor.controller.modules import load_module
from rotary_error_monitor.controller.offsets import (
    NANOSECONDS,
    Correction,
    OffsetControl,
    OffsetLimits,
    Reading,
    commanded_velocities,
)
from rotary_error_monitor.controller.pins import MachinePins, Units
from rotary_error_monitor.controller.protocol import (
    ClearRequest,
    CorrectionRequest,
    End,
    Hello,
    LinkSettings,
    Record,
    State,
    decode,
    encode,
)
from rotary_error_monitor.errors import InputError

ABSENT = "no LinuxCNC runs here"
SHUTDOWN = "LinuxCNC shuts down: it told its HAL components to end"
TASK_ENDED = "LinuxCNC's task process has ended"
UNKNOWN_KINEMATICS = "the joints do not lie where any kinematics known to the bridge puts them"
_CLEARING = 0.1
"""How long the request to clear stands, s; some servo periods."""
_CHUNK = 1 << 16
_LOOKS_AT_REST = 10
_STATUS_PATIENCE = 2.0
_STATUS_STEP = 0.02


class Link:
    """Reads one machine, follows corrections, and says what it sees; the caller gives it the time."""

    def __init__(self, pins: MachinePins, settings: LinkSettings) -> None:
        """Let the machine take up offsets.

        Raises:
            InputError: its pins are not free.
        """
        self._pins = pins
        self._settings = settings
        largest = tuple(settings.largest_rotary if name in ROTARY else settings.largest_linear for name in pins.names)
        self._limits = OffsetLimits((settings.count,) * len(pins.names), largest, settings.max_age)
        self._control = OffsetControl(pins.names, self._limits)
        self._refused = ""
        self._last_joints: tuple[float, ...] | None = None
        self._pulse: tuple[int, int] | None = None
        self._looks_at_rest = 0
        self._clear_until_ns = 0
        pins.enable()

    @property
    def names(self) -> tuple[str, ...]:
        """Letters of the machine's axes, in the order of its joints."""
        return self._pins.names

    def handle(self, record: Record, now_ns: int) -> None:
        """Take up what the other side says; a correction that cannot be followed is noted, and the last one stays."""
        if isinstance(record, ClearRequest):
            self._control = OffsetControl(self._pins.names, self._limits)
            self._clear_until_ns = now_ns + round(_CLEARING * NANOSECONDS)
            self._pins.clear()
        elif isinstance(record, CorrectionRequest):
            try:
                self._control.accept(self._correction(record), now_ns)
                self._refused = ""
            except InputError as error:
                self._refused = str(error)

    def look(self, now_ns: int) -> State:
        """Read the machine, write the counts that are due, and say how it stands.

        Raises:
            InputError: the servo thread stands still, or the pins are not free any more.
        """
        reading = self._pins.read(now_ns)
        self._check_pulse(reading)
        kinematics = self._pins.kinematics(reading)
        if kinematics is None:
            return self._state(reading, (), UNKNOWN_KINEMATICS, valid=False)
        trouble = "the external offsets are being cleared"
        if now_ns >= self._clear_until_ns:
            if self._clear_until_ns:
                self._pins.enable()
                self._clear_until_ns = 0
            step = self._control.step(reading, kinematics)
            trouble = step.held
            if step.counts is not None and step.counts != reading.counts:
                self._pins.write(step.counts)
        joints = kinematics.to_joints(reading.axes)
        return self._state(reading, joints, trouble, valid=reading.enabled and reading.homed)

    def _correction(self, record: CorrectionRequest) -> Correction:
        names = self._pins.names
        unknown = sorted(set(record.corrections) - set(names))
        if unknown:
            raise InputError(f"correction for {', '.join(unknown)}, but the machine has the axes {' '.join(names)}")
        return Correction(record.stamp_ns, tuple(float(record.corrections.get(name, 0.0)) for name in names))

    def _check_pulse(self, reading: Reading) -> None:
        if self._pulse is None or self._pulse[0] != reading.pulse:
            self._pulse, self._looks_at_rest = (reading.pulse, reading.stamp_ns), 0
        self._looks_at_rest += 1
        still = (reading.stamp_ns - self._pulse[1]) / NANOSECONDS
        # Many looks as well as a long time: after a pause of this process itself, a single look says nothing.
        if still > self._settings.pulse_timeout and self._looks_at_rest > _LOOKS_AT_REST:
            raise InputError(f"LinuxCNC's servo thread has stood still for {still:.3g} s")

    def _state(self, reading: Reading, joints: tuple[float, ...], trouble: str, *, valid: bool) -> State:
        before, self._last_joints = self._last_joints, joints or None
        velocities = commanded_velocities(before or joints, joints, reading.joint_velocities) if joints else ()
        pending = zip(reading.requested, reading.applied, strict=True)
        followed = self._control.correction
        return State(
            stamp_ns=reading.stamp_ns,
            positions=joints,
            velocities=velocities,
            valid=valid,
            offsets=reading.applied,
            lag=max(abs(requested - applied) for requested, applied in pending),
            limited=reading.limited,
            trouble=trouble,
            refused=self._refused,
            takeovers=self._control.takeovers,
            correction_age=-1.0 if followed is None else (reading.stamp_ns - followed.stamp_ns) / NANOSECONDS,
        )


def serve(
    link: Link,
    period: float,
    task: int,
    source: int,
    send: Callable[[Record], None],
    clock_ns: Callable[[], int] = time.time_ns,
) -> str:
    """Look at the machine each `period` s and take up what the other side says, until something ends.

    Args:
        link: the link to serve.
        period: time between two looks, s.
        task: file descriptor that becomes readable when the task process ends.
        source: file descriptor of the other side's records; its end ends the link.
        send: takes each state.
        clock_ns: present time, timestamp (ns).

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
                    link.handle(decode(line), clock_ns())
            if time.monotonic() >= due:
                send(link.look(clock_ns()))
                # Looks that come late are left out, not made up for: only the newest state is worth anything.
                due = max(due + period, time.monotonic())


@contextmanager
def attach(settings: LinkSettings) -> Iterator[tuple[Link, int]]:
    """Link to the LinuxCNC that runs here, and a file descriptor that becomes readable when its task process ends.

    Raises:
        InputError: none runs, or it is none that can be served.
    """
    if not presence.runs(presence.SHARED_MEMORY.read_text()):
        raise InputError(ABSENT)
    linuxcnc, hal = load_module("linuxcnc"), load_module("hal")
    component = hal.component(f"rotary-error-monitor-{os.getpid()}")
    try:
        component.ready()
        status = linuxcnc.stat()
        _wait_for_status(status)
        # The controller gives its units as how many of them make a millimetre and a degree.
        units = Units(status.linear_units * 1e3, status.angular_units * Units.per_radian)
        names = [letter for bit, letter in enumerate(LETTERS) if status.axis_mask >> bit & 1]
        yield Link(MachinePins(hal, names, units, settings.count), settings), presence.open_task()
    finally:
        component.exit()


def _wait_for_status(status: Any) -> None:  # noqa: ANN401 (LinuxCNC's `stat` carries no types)
    """Wait until a controller that has just started tells of its axes.

    Raises:
        InputError: it does not.
    """
    end = time.monotonic() + _STATUS_PATIENCE
    status.poll()
    while not status.axis_mask:
        if time.monotonic() > end:
            raise InputError(f"LinuxCNC has told of no axes for {_STATUS_PATIENCE:g} s")
        time.sleep(_STATUS_STEP)
        status.poll()


class _Terminated(Exception):  # noqa: N818 (no error: how LinuxCNC takes leave)
    """LinuxCNC, or the user, told this process to end."""


def _terminate(number: int, frame: FrameType | None) -> None:
    raise _Terminated


def main(arguments: list[str] | None = None) -> int:
    """Run the link until LinuxCNC or the other side ends; 0, or 1 if LinuxCNC could not be reached or is lost."""
    parser = argparse.ArgumentParser(prog="rotary_error_monitor.controller.link", description=__doc__)
    parser.add_argument("settings", type=json.loads, help=f"JSON object such as {json.dumps(asdict(LinkSettings()))}")
    settings = LinkSettings(**parser.parse_args(arguments).settings)
    signal.signal(signal.SIGTERM, _terminate)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole group; the other side decides

    def send(record: Record) -> None:
        sys.stdout.buffer.write(encode(record))
        sys.stdout.buffer.flush()

    try:
        with attach(settings) as (link, task):
            send(Hello(link.names))
            reason = serve(link, settings.period, task, sys.stdin.fileno(), send)
    except _Terminated:
        reason = SHUTDOWN
    except BrokenPipeError:
        return 0
    except InputError as error:
        reason = str(error)
    with suppress(BrokenPipeError):
        if reason:
            send(End(reason))
    return 1 if reason else 0


if __name__ == "__main__":
    sys.exit(main())
