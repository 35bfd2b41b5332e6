"""Corrections that stand to the last bit while the axes move: those of no description do, let alone of error motion."""

from __future__ import annotations

from collections.abc import Sequence

from rotary_error_monitor.linuxcnc_controller.clock import NANOSECONDS
from rotary_error_monitor.linuxcnc_controller.kinematics import Position

MOVED = 1e-3
"""By how much an axis has moved, m or rad, before corrections should have: errors of 1 µm/m change them by 1 nm then.
Even of a description whose errors are the same everywhere the last bits are other ones from place to place."""

LASTS = 0.5
"""For how long they stand after that, s, before they are refused: they come some hundredths after their place."""


class CorrectionStands:
    """Tells corrections that are those of the message before, bit for bit, though an axis that they are for has moved.

    They are followed until then, so it is where they have led that is held. At rest they may stand; so may those that
    are all 0, of a machine without errors. Reads no clock, and takes times of one that never steps (ns).
    """

    def __init__(self, places: Sequence[int], pause: float) -> None:
        """Watch the axes at `places`; messages further apart than `pause` (s) say nothing of one another."""
        self._places = tuple(places)
        self._pause_ns = round(pause * NANOSECONDS)
        self._before: Position = ()
        self._heard_ns = 0
        self._origin: Position | None = None
        self._moved_ns: int | None = None

    def note_axes(self, positions: Sequence[float], steady_ns: int) -> None:
        """Take note of where the program has the axes, m or rad."""
        here = tuple(positions[place] for place in self._places)
        if self._origin is None:
            self._origin = here
        elif self._moved_ns is None:
            away = max(abs(now - then) for now, then in zip(here, self._origin, strict=True))
            self._moved_ns = steady_ns if away > MOVED else None

    def judge(self, corrections: Position, steady_ns: int) -> str:
        """Why these stand, m or rad; empty where they do not, or may."""
        pause_ns, self._heard_ns = steady_ns - self._heard_ns, steady_ns
        if corrections != self._before or not any(corrections) or pause_ns > self._pause_ns:
            self._before, self._origin, self._moved_ns = corrections, None, None
        if self._moved_ns is None or steady_ns - self._moved_ns < LASTS * NANOSECONDS:
            return ""
        return "corrections are the same to the last bit while the axes move: their publisher is stuck"
