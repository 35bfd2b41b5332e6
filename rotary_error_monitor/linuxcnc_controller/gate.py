"""The gate where a correction message is believed: whole, finite, in range, of now, and after the one before."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

from rotary_error_monitor.errors import InputError, one_line
from rotary_error_monitor.linuxcnc_controller.clock import NANOSECONDS
from rotary_error_monitor.linuxcnc_controller.kinematics import Position

_ROUNDING = 1e-9
"""What a step may be larger by than the speed allows, m or rad; and 5 % beside it, for a stamp is rounded as well."""

_LONGEST_QUOTE = 120
"""Characters of a message's own text that a reason repeats: what anybody sends shall not fill logs."""


class RefusalReason(Enum):
    """Why a correction message is not believed; the value is its name in figures."""

    FRAME = "frame"
    AXES = "axes"
    NUMBERS = "numbers"
    SIZE = "size"
    STEP = "step"
    STANDS = "stands"
    STAMP = "stamp"
    AGE = "age"
    AHEAD = "ahead"
    ORDER = "order"
    PUBLISHERS = "publishers"


class RefusalError(InputError):
    """A message that is not believed, with its kind."""

    def __init__(self, doubt: RefusalReason, reason: str) -> None:
        """Refuse because of `doubt`, in words `reason`."""
        super().__init__(reason)
        self.doubt = doubt


@dataclass(frozen=True)
class CorrectionMessage:
    """Corrections as they come, m or rad: nothing is known of them yet.

    Attributes:
        stamp_ns: when they were computed, timestamp (ns).
        names: of the axes.
        positions: corrections to add to the commanded joints.
        velocities: their rates; may be left out.
        frame: in which they are said.
    """

    stamp_ns: int
    names: Sequence[str]
    positions: Sequence[float]
    velocities: Sequence[float] = ()
    frame: str = ""


@dataclass(frozen=True)
class AcceptedCorrection:
    """Corrections that are believed, m or rad, one for each axis of the controller, computed at `stamp_ns` (ns)."""

    stamp_ns: int
    positions: Position


@dataclass(frozen=True)
class GateLimits:
    """What is believed.

    Attributes:
        axes: of the controller, in its order.
        largest: largest correction of each, m or rad.
        corrected: those that each message names; the others are not corrected.
        max_age: oldest stamp, s.
        clock_tolerance: how far a stamp may lie in the future, s: as two synchronised clocks may differ.
        frame: in which messages are said, as the wire contract has it; none where nothing tells.
        speed: how fast the correction of each axis may change from message to message, m/s or rad/s; none where nothing
            tells.
    """

    axes: tuple[str, ...]
    largest: Position
    corrected: tuple[str, ...]
    max_age: float = 0.1
    clock_tolerance: float = 0.005
    frame: str | None = None
    speed: Position | None = None

    def __post_init__(self) -> None:
        unknown = [name for name in self.corrected if name not in self.axes]
        if unknown or not self.corrected or len(set(self.corrected)) < len(self.corrected):
            raise InputError(
                f"corrected axes '{' '.join(self.corrected)}'; expected some of the controller's "
                f"{' '.join(self.axes)}, each once"
            )
        if len(self.largest) != len(self.axes):
            raise InputError(f"{len(self.largest)} largest corrections for the axes {' '.join(self.axes)}")


class CorrectionGate:
    """Believes correction messages, one after the other, or refuses them with a reason.

    A message is believed as a whole or not at all: it is in the contract's frame, names each corrected axis once and no
    other, with a finite number within its range for each, and a stamp that is neither old nor ahead nor not after the
    one before. A stamp before it counts only while it is not ahead itself: after the clock was set back, nothing would
    ever come after it.

    The message before it, whatever its size, has to lead to it: a compensation keeps its corrections within a speed.
    What steps is refused, and where each message steps, as of an axis in another unit that passes zero, all are; of
    corrections that go on from somewhere else the first one is, and the second is believed.
    """

    def __init__(self, limits: GateLimits) -> None:
        """Believe what keeps within `limits`."""
        self.limits = limits
        self._last_ns: int | None = None
        self._before: AcceptedCorrection | None = None  # the message before, believed or too large or a step itself

    def judge(self, message: CorrectionMessage, now_ns: int) -> AcceptedCorrection:
        """What is believed of `message` at `now_ns`, timestamp (ns).

        Raises:
            RefusalError: nothing of it.
        """
        self._check_frame(message.frame)
        self._check_axes(message.names)
        self._check_numbers(message)
        by_name = dict(zip(message.names, message.positions, strict=True))
        positions = tuple(float(by_name.get(name, 0.0)) for name in self.limits.axes)
        self._check_stamp(message.stamp_ns, now_ns)
        told = AcceptedCorrection(message.stamp_ns, positions)
        before, self._before = self._before, told
        self._check_size(positions)
        if before is not None:
            self._check_step(before, told)
        self._last_ns = message.stamp_ns
        return told

    def _check_frame(self, frame: str) -> None:
        expected = self.limits.frame
        if expected is not None and frame != expected:
            told = _quote([frame]) if frame else ""
            raise RefusalError(RefusalReason.FRAME, f"corrections in the frame '{told}'; expected '{expected}'")

    def _check_axes(self, names: Sequence[str]) -> None:
        expected = self.limits.corrected
        # Short of counting what may be a million names: whoever sends more than expected is wrong anyway.
        counts = Counter(names[: len(expected) + 1])
        twice = [name for name, count in counts.items() if count > 1]
        unknown = [name for name in counts if name not in expected]
        missing = [name for name in expected if name not in counts]
        what = [
            f"{words} {_quote(found)}"
            for words, found in (("twice", twice), ("not corrected here", unknown), ("missing", missing))
            if found
        ]
        if what:
            once = f"expected each of {' '.join(expected)} once: {', '.join(what)}"
            raise RefusalError(RefusalReason.AXES, f"corrections of the axes {_quote(names)}; {once}")

    def _check_numbers(self, message: CorrectionMessage) -> None:
        names, positions, velocities = len(message.names), len(message.positions), len(message.velocities)
        if positions != names or velocities not in (0, names):
            raise RefusalError(
                RefusalReason.NUMBERS,
                f"{names} names, {positions} positions, {velocities} velocities; expected as many of each "
                "(velocities may be left out)",
            )
        for what, values in (("correction", message.positions), ("rate", message.velocities)):
            for name, value in zip(message.names, values, strict=False):
                if not math.isfinite(value):
                    raise RefusalError(
                        RefusalReason.NUMBERS, f"{what} of {_quote([name])} is {value}; expected a finite number"
                    )

    def _check_size(self, positions: Position) -> None:
        for name, value, largest in zip(self.limits.axes, positions, self.limits.largest, strict=True):
            if abs(value) > largest:
                raise RefusalError(
                    RefusalReason.SIZE, f"correction of {name} is {value:g}; expected at most {largest:g} (m, rad)"
                )

    def _check_step(self, before: AcceptedCorrection, told: AcceptedCorrection) -> None:
        passed = (told.stamp_ns - before.stamp_ns) / NANOSECONDS
        if self.limits.speed is None or passed <= 0.0:  # the clock was set back
            return
        rows = zip(self.limits.axes, before.positions, told.positions, self.limits.speed, strict=True)
        for name, was, value, speed in rows:
            if abs(value - was) > 1.05 * speed * passed + _ROUNDING:
                raise RefusalError(
                    RefusalReason.STEP,
                    f"correction of {name} steps from {was:g} to {value:g} within {passed:.3g} s; expected at most "
                    f"{speed:g} a second (m, rad)",
                )

    def _check_stamp(self, stamp_ns: int, now_ns: int) -> None:
        age = (now_ns - stamp_ns) / NANOSECONDS
        if stamp_ns <= 0:
            raise RefusalError(RefusalReason.STAMP, "correction without a stamp; expected when it was computed")
        if age < -self.limits.clock_tolerance:
            raise RefusalError(
                RefusalReason.AHEAD,
                f"correction is {-age:.3g} s ahead of the clock; expected at most {self.limits.clock_tolerance:g} s",
            )
        if age > self.limits.max_age:
            raise RefusalError(
                RefusalReason.AGE, f"correction is {age:.3g} s old; expected at most {self.limits.max_age:g} s"
            )
        last_ns = self._last_ns
        is_known = last_ns is not None and last_ns - now_ns <= self.limits.clock_tolerance * NANOSECONDS
        if last_ns is not None and is_known and stamp_ns <= last_ns:
            raise RefusalError(
                RefusalReason.ORDER,
                f"correction is {(last_ns - stamp_ns) / NANOSECONDS:.3g} s before the last one believed; "
                "expected after it",
            )


def _quote(names: Sequence[str]) -> str:
    text = " ".join(one_line(str(name)[: _LONGEST_QUOTE + 1]) for name in names[:_LONGEST_QUOTE]) or "(none)"
    return text if len(text) <= _LONGEST_QUOTE else f"{text[:_LONGEST_QUOTE]}…"
