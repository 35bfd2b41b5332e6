"""Watches what a running LinuxCNC makes of program and external offsets, and touches nothing.

A program beside LinuxCNC (see `session`): the independent witness of what the drives were told.
"""

from __future__ import annotations

from typing import Any

from rotary_error_monitor.linuxcnc_controller import session
from rotary_error_monitor.linuxcnc_controller.clock import Clock, Moment
from rotary_error_monitor.linuxcnc_controller.pins import MachinePins
from rotary_error_monitor.linuxcnc_controller.protocol import Observation, ObserverSettings, Record


class Observer:
    """Says where the program has the axes, and where the drives are sent."""

    def __init__(self, pins: MachinePins) -> None:
        """Watch one machine."""
        self._pins = pins

    def handle(self, record: Record, now: Moment) -> None:
        """Nothing is asked of an observer."""

    def look(self, clock: Clock) -> Observation:
        """Axes and joints of one servo period."""
        reading = self._pins.read(clock)
        return Observation(reading.stamp_ns, reading.axes, reading.joints)


def start(settings: dict[str, Any], pins: MachinePins) -> tuple[Observer, float]:
    """The observer with `ObserverSettings` by name, and its period, s."""
    return Observer(pins), ObserverSettings(**settings).period


def main(arguments: list[str] | None = None) -> int:
    """Run the observer; 0 when the other side closed, 1 if LinuxCNC could not be reached or is lost."""
    return session.run("observer", start, arguments)


if __name__ == "__main__":
    raise SystemExit(main())
