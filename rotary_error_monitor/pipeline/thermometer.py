"""The one place where a temperature is believed: within its range, no faster than iron warms, and fresh."""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import dataclass

from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.pipeline.joint_checks import PROVEN
from rotary_error_monitor.signals.admission import NOT_FINITE

BEYOND = "beyond its range"
FAST = "faster than a machine warms"

JITTER = 0.5
"""What noise and resolution of a thermometer may add to a change, K: it is off by no more than half of that."""

_ROUNDING = 1e-9
"""What differences of float64 temperatures may be off by, K: far above 1e-13, far below any thermometer."""


@dataclass(frozen=True)
class Warmth:
    """Temperature of a machine and how well it is known, °C and K."""

    temperature: float
    deviation: float


class MachineThermometer:
    """The machine's temperature, from a sensor that may be absent, silent or wrong.

    The first one may be what a driver says that is not connected yet: it is as uncertain as its range until others have
    agreed with it for `PROVEN`, and one that contradicts it before takes its place. A temperature that is not believed
    after that is replaced by the last one that was, with an uncertainty that grows as fast as a machine can warm;
    without any by the reference temperature, uncertain by all that its range allows.

    What is believed is held against a follower that goes to it no faster than the machine warms. While the sensor is
    off by no more than half of `JITTER`, so is the follower, and nothing sound is refused; what warms faster leaves it
    behind, at any rate of messages: the jitter counts once, not anew with each of them.

    Attributes:
        refused: temperatures that were not believed, by reason.
        doubt: why the last one was not; empty where it was.
    """

    def __init__(self, machine: MachineDescription) -> None:
        self._limits = machine.limits
        self._reference = machine.reference_temperature
        self.needed = any(axis.expansion != 0.0 for axis in machine.axes)
        self.refused: Counter[str] = Counter()
        self.doubt = ""
        self._last: tuple[int, float] | None = None
        self._since_ns: int | None = None  # the first that all after it agree with; none once it is proven
        self._proven = False
        self._followed: tuple[int, float] | None = None
        self._heard_ns = 0
        self._silent = 0.0  # s, since the last one that was believed

    def reset(self) -> None:
        """Believe the next temperature wherever it is in its range."""
        self._last, self._followed, self._since_ns, self._proven, self.doubt = None, None, None, False, ""

    @property
    def last_ns(self) -> int | None:
        """Timestamp (ns) of the last temperature that was believed."""
        return None if self._last is None else self._last[0]

    @property
    def has_spoken(self) -> bool:
        """Whether a temperature was believed yet."""
        return self._last is not None

    def push(self, stamp_ns: int, temperature: float) -> bool:
        """Take in a temperature (°C) measured at `stamp_ns`, timestamp (ns); give whether it is believed."""
        if self._last is not None:
            since = (stamp_ns - self._heard_ns) * 1e-9
            self._silent += since if since > self._limits.temperature_age else 0.0
        self._heard_ns = stamp_ns if self._last is None else max(self._heard_ns, stamp_ns)
        warmed = self._warmed(stamp_ns)
        self.doubt = self._judge(stamp_ns, temperature, warmed)
        if self.doubt and (self._proven or self._last is None or not self._is_possible(temperature)):
            return False
        if self.doubt or self._since_ns is None:
            self._since_ns, self._followed = stamp_ns, None
        self._follow(stamp_ns, temperature, warmed)
        self._last, self._silent = (stamp_ns, temperature), 0.0
        self._proven = self._proven or stamp_ns - self._since_ns >= PROVEN * 1e9
        return not self.doubt

    def at(self, time_ns: int) -> Warmth:
        """What is known at `time_ns`, timestamp (ns)."""
        low, high = self._limits.temperature
        widest = (high - low) / math.sqrt(12.0)
        if self._last is None:
            return Warmth(self._reference, widest if self.needed else 0.0)
        stamp_ns, temperature = self._last
        if not self._proven and self.needed:
            return Warmth(temperature, widest)
        old = max(0.0, (time_ns - stamp_ns) * 1e-9 - self._limits.temperature_age)
        return Warmth(temperature, min(widest, self._limits.temperature_rate * old))

    def trouble(self, time_ns: int) -> str:
        """What is wrong with the temperature at `time_ns`; empty where nothing is."""
        if self.doubt:
            return f"temperature not believed: {self.doubt}"
        if self._last is None:
            return "no temperature: that of reference stands in" if self.needed else ""
        if not self._proven and self.needed:
            return f"{self._last[1]:.4g} °C is the first temperature: no other has confirmed it yet"
        age = (time_ns - self._last[0]) * 1e-9
        return f"temperature is {age:.0f} s old" if age > self._limits.temperature_age else ""

    def _warmed(self, stamp_ns: int) -> float:
        """What the machine can have warmed by until `stamp_ns`, timestamp (ns), since it was followed last, K."""
        if self._followed is None:
            return math.inf
        # A jump does not become true by lasting, but in a silence nobody saw the machine warm.
        elapsed = (stamp_ns - self._followed[0]) * 1e-9
        passed = max(min(max(elapsed, 0.0), self._limits.temperature_age), self._silent)
        return self._limits.temperature_rate * passed

    def _follow(self, stamp_ns: int, temperature: float, warmed: float) -> None:
        """Go to a temperature that is believed, by no more than the machine can have warmed, K."""
        if self._followed is None:
            self._followed = stamp_ns, temperature
            return
        followed_ns, followed = self._followed
        step = min(max(temperature - followed, -warmed), warmed)
        self._followed = max(stamp_ns, followed_ns), followed + step

    def _judge(self, stamp_ns: int, temperature: float, warmed: float) -> str:
        if not math.isfinite(temperature):
            return self._refuse(NOT_FINITE, f"{temperature} is {NOT_FINITE}")
        if not self._is_possible(temperature):
            low, high = self._limits.temperature
            return self._refuse(BEYOND, f"{temperature:g} °C is {BEYOND} of {low:g} to {high:g} °C")
        if self._last is not None and self._followed is not None:
            away = temperature - self._followed[1]
            if abs(away) > warmed + JITTER + _ROUNDING:
                limit, since = self._limits.temperature_rate, (stamp_ns - self._last[0]) * 1e-9
                return self._refuse(
                    FAST,
                    f"{temperature:.4g} °C, {since:.3g} s after {self._last[1]:.4g} °C, is {abs(away):.3g} K away from "
                    f"one that changes at {limit:g} K/s: {FAST}",
                )
        return ""

    def _is_possible(self, temperature: float) -> bool:
        low, high = self._limits.temperature
        return low <= temperature <= high

    def _refuse(self, reason: str, words: str) -> str:
        self.refused[reason] += 1
        return words
