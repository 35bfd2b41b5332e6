"""A distance of the rotor from its command that no drive makes: whether it is there, and whether it is over."""

from __future__ import annotations

from dataclasses import dataclass

from rotary_error_monitor.description.stage_limits import StageLimits


@dataclass(frozen=True)
class _Off:
    """Where a distance was too far, rad, at which speed, rad/s, and by how much, rad."""

    distance: float
    speed: float
    excess: float


class FarDistance:
    """Judges a distance by the following error and the latency of a drive.

    Of a latency counts only what is seen as a delay and what may be hidden of it: a command that is off by an angle is
    none, whatever the speed. What is told at rest is not over because the stage turns and a latency could explain it.
    """

    def __init__(self, limits: StageLimits) -> None:
        """Of a drive with these limits."""
        self._limits = limits
        self._off: _Off | None = None

    def clear(self) -> None:
        """No distance is too far any more."""
        self._off = None

    def judge(self, distance: float, speed: float, late: float, missed: float) -> str:
        """Why a distance (rad) at a speed (rad/s) is too far, with an age of the heads of up to `late` s; else empty.

        Args:
            distance: of the rotor from its command.
            speed: of the rotor.
            late: largest delay of either that can be, s.
            missed: what interpolation may miss of the distance, rad.
        """
        allowed = self._limits.following_error + late * abs(speed)
        excess = abs(distance) - allowed
        if excess <= missed:
            return ""
        self._off = _Off(distance, speed, excess)
        return (
            f"rotation and command are {distance * 1e6:.4g} µrad apart at {speed:.3g} rad/s; following error "
            f"and latency explain {allowed * 1e6:.3g}. Command, its stamps, or the zero of the heads are wrong"
        )

    def has_changed(self, distance: float, speed: float, delay: float, hidden: float) -> bool:
        """Whether a distance is another than where it was too far, with a delay (s) that is seen and what it hides."""
        if self._off is None:
            return True
        faster = speed - self._off.speed
        return abs(distance - self._off.distance + delay * faster) - hidden * abs(faster) >= self._off.excess
