"""A command that stands while the rotor turns."""

from __future__ import annotations

from rotary_error_monitor.pipeline.distance_noise import missed_in
from rotary_error_monitor.pipeline.evidence import SIGMAS, EvidenceWindow

STANDS = 1e-3
"""Part of the way that it should have gone by which a command has gone at most if it stands."""


class StandingCommand:
    """Counts how far the rotor has gone away from a command that stands: one that comes nearer to it settles."""

    def __init__(self, following_error: float, noise: float) -> None:
        """Of a drive with a largest `following_error`, and a reading with a `noise`, rad."""
        self._most, self._noise = 0.1 * following_error, noise
        self._gone = 0.0

    def clear(self) -> None:
        """It goes along."""
        self._gone = 0.0

    def judge(self, window: EvidenceWindow, last: EvidenceWindow) -> str:
        """Why the command is wrong; empty where it goes along, or the rotor went no further than a drive does."""
        if self.goes_along((window.mean.theta, window.mean.ecc), (last.mean.theta, last.mean.ecc)):
            self._gone = 0.0
            return ""
        away = abs(window.mean.ecc) - abs(last.mean.ecc)
        self._gone += max(away - missed_in(window) - missed_in(last), 0.0)
        if self._gone < self._most:
            return ""
        return f"the command stands still while the rotor has turned by {self._gone * 1e6:.3g} µrad away from it"

    def goes_along(self, place: tuple[float, float], last: tuple[float, float]) -> bool:
        """Whether the command moves where the rotor does, from one rotation and distance (rad) to the next."""
        command = (place[0] - place[1]) - (last[0] - last[1])
        turned = place[0] - last[0]
        return abs(command) > STANDS * abs(turned) or abs(turned) < SIGMAS * self._noise
