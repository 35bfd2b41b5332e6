"""How far and how fast corrections may move an axis, as a pure state machine: state in, state out."""

from __future__ import annotations

import enum
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from rotary_error_monitor.arrays import Array, Mask, differences
from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.errors import InputError


class CorrectionOutcome(enum.IntEnum):
    """What became of a wanted correction, the worst last."""

    FOLLOWED = 0
    RATE_LIMITED = 1
    WARNING = 2
    HELD = 3
    LATCHED = 4


FOLLOWED, RATE_LIMITED, WARNING, HELD, LATCHED = map(int, CorrectionOutcome)
"""The same as they stand in arrays: of an enumeration, Python looks for a member longer than numpy computes."""


@dataclass(frozen=True)
class CorrectionLimits:
    """Limits of the corrections of m axes, each (m,) in m or rad, rates in m/s or rad/s.

    Attributes:
        letters: the axes.
        warning: beyond it a correction is followed and a warning given.
        error: beyond it the correction holds where it is until it is reset.
        rate: how fast the correction may change.
        longest_interval: a longer time between two poses counts as this, s, so that a pause allows no jump.
    """

    letters: tuple[str, ...]
    warning: Array
    error: Array
    rate: Array
    longest_interval: float = 0.1

    def __post_init__(self) -> None:
        shapes = {self.warning.shape, self.error.shape, self.rate.shape}
        if shapes != {(len(self.letters),)}:
            raise InputError(f"limits of shapes {sorted(shapes)}; expected one of each for {', '.join(self.letters)}")
        if not (np.isfinite([self.warning, self.error, self.rate]).all() and self.longest_interval > 0.0):
            raise InputError(f"limits {self}; expected finite numbers and an interval above zero")
        if (self.warning <= 0.0).any() or (self.rate <= 0.0).any() or (self.error < self.warning).any():
            raise InputError(
                f"warning {self.warning}, error {self.error}, rate {self.rate}; "
                "expected 0 < warning <= error and 0 < rate for each axis"
            )


@dataclass(frozen=True)
class CorrectionState:
    """What is remembered from one block of poses to the next.

    Attributes:
        applied: last correction that was given out, one for each axis.
        time_ns: timestamp (ns) of its pose; none before the first.
        latched: an error limit was passed; corrections hold until `reset`.
        reason: why, in words; empty while nothing holds.
    """

    applied: tuple[float, ...]
    time_ns: int | None = None
    latched: bool = False
    reason: str = ""

    def reset(self) -> CorrectionState:
        """The state with the latch open; corrections go on from where they hold, within the rate limit."""
        return replace(self, latched=False, reason="")


@dataclass(frozen=True)
class LimitedCorrections:
    """Corrections within limits.

    Attributes:
        corrections: (n, axes) to be applied; always finite.
        outcomes: (n,) what became of each, as `CorrectionOutcome`.
        state: to be passed with the next poses.
    """

    corrections: Array
    outcomes: NDArray[np.int64]
    state: CorrectionState = field(repr=False)


def axis_limits(machine: MachineDescription, *, linear: Sequence[float], rotary: Sequence[float]) -> CorrectionLimits:
    """Limits of a machine's axes from (warning, error, rate) of its linear (m, m/s) and rotary (rad, rad/s) axes.

    Raises:
        InputError: a limit is not positive and finite, or an error limit lies below its warning limit.
    """
    rows = np.array([linear if axis.kind == "linear" else rotary for axis in machine.axes], dtype=np.float64)
    if rows.ndim != 2 or rows.shape[1] != 3:
        raise InputError(f"limits linear {linear}, rotary {rotary}; expected warning, error and rate for each")
    return CorrectionLimits(machine.letters, rows[:, 0], rows[:, 1], rows[:, 2])


def initial_state(axes: int) -> CorrectionState:
    """The state before the first pose: no correction is applied."""
    return CorrectionState((0.0,) * axes)


def limit_corrections(
    limits: CorrectionLimits,
    state: CorrectionState,
    times_ns: NDArray[np.int64],
    wanted: ArrayLike,
    usable: Mask | None = None,
) -> LimitedCorrections:
    """Follow the wanted corrections as far and as fast as the limits allow.

    A correction beyond the error limit latches: it and all that follow hold the last one applied. A correction that is
    not finite or not usable holds for its own pose only. The rate limit shortens the step of all axes alike: on the
    straight way between two corrections the tool stays on the way between its two places, which axes that run into
    limits one by one would leave. The first pose ever holds zero, for no time has passed to move in.

    Args:
        limits: of the m axes.
        state: from the poses before, at first `initial_state`.
        times_ns: (n,) timestamp (ns) of each pose, not falling.
        wanted: (n, m) corrections in m or rad.
        usable: (n,) whether each may be used, such as `SolvedCorrections.converged`; none: all.

    Raises:
        InputError: shapes do not fit the limits, or times fall.
    """
    asked = np.asarray(wanted, dtype=np.float64)
    interval = _intervals(limits, state, times_ns, asked)
    if len(interval) == 0:
        return LimitedCorrections(asked.copy(), np.zeros(0, dtype=np.int64), state)
    may_follow = len(interval) == 1 and not state.latched and (usable is None or bool(usable[0]))
    if may_follow and _is_followed(limits, state, asked[0].tolist(), float(interval[0])):
        new = replace(state, applied=tuple(asked[0].tolist()), time_ns=int(times_ns[0]))
        return LimitedCorrections(asked.copy(), np.zeros(1, np.int64), new)

    finite: Mask = np.all(np.isfinite(asked), axis=1)
    use = finite if usable is None else finite & usable
    size = np.abs(np.where(use[:, None], asked, 0.0))
    over: Mask = np.any(size > limits.error, axis=1)
    latched = np.logical_or.accumulate(over | np.bool_(state.latched))
    follow = use & ~latched
    reach = limits.rate * np.minimum(interval, limits.longest_interval)[:, None]
    corrections, shortened = _follow(np.array(state.applied), np.where(use[:, None], asked, 0.0), follow, reach)

    outcomes = np.where(shortened, RATE_LIMITED, FOLLOWED).astype(np.int64)
    outcomes[(size > limits.warning).any(axis=1)] = WARNING
    outcomes[~use] = HELD
    outcomes[latched] = LATCHED
    newly = bool(latched[-1]) and not state.latched
    reason = _why_latched(limits, asked, times_ns, int(np.argmax(over))) if newly else state.reason
    new = CorrectionState(tuple(corrections[-1].tolist()), int(times_ns[-1]), bool(latched[-1]), reason)
    return LimitedCorrections(corrections, outcomes, new)


def _intervals(limits: CorrectionLimits, state: CorrectionState, times_ns: NDArray[np.int64], asked: Array) -> Array:
    """(n,) time from the pose before to each, s.

    Raises:
        InputError: as `limit_corrections`.
    """
    count, axes = len(times_ns), len(limits.warning)
    if asked.shape != (count, axes) or len(state.applied) != axes:
        raise InputError(
            f"corrections of shape {asked.shape} and a state of {len(state.applied)} axes; expected ({count}, {axes})"
        )
    if count == 0:
        return np.zeros(0)
    interval = differences(times_ns, times_ns[0] if state.time_ns is None else state.time_ns) * 1e-9
    if (interval < 0.0).any():
        place = int(np.argmax(interval < 0.0))
        raise InputError(f"pose {place} is {-interval[place]:.9f} s before the one before it; expected times that rise")
    return np.asarray(interval, np.float64)


def _why_latched(limits: CorrectionLimits, asked: Array, times_ns: NDArray[np.int64], pose: int) -> str:
    axis = int(np.argmax(np.abs(asked[pose]) > limits.error))
    return (
        f"correction {asked[pose, axis]:.3e} of axis {limits.letters[axis]} at {int(times_ns[pose])} ns "
        f"is beyond the error limit {limits.error[axis]:.3e}"
    )


def _is_followed(limits: CorrectionLimits, state: CorrectionState, wanted: Sequence[float], interval: float) -> bool:
    """Whether a single correction is finite and passes no limit: live it mostly does, and numpy takes longer to ask."""
    passed = min(interval, limits.longest_interval)
    return all(
        abs(value) <= warning and abs(value - before) <= rate * passed
        for value, before, warning, rate in zip(
            wanted, state.applied, limits.warning.tolist(), limits.rate.tolist(), strict=True
        )
    )


def _follow(start: Array, wanted: Array, follow: Mask, reach: Array) -> tuple[Array, Mask]:
    """Corrections (n, m) that follow the wanted ones from `start` by steps within `reach` (n, m); which are shorter."""
    corrections = np.empty_like(wanted)
    shortened = np.zeros(len(wanted), dtype=bool)
    steps = np.abs(differences(wanted, start))
    if follow.all() and (steps <= reach).all():
        return wanted.copy(), shortened
    applied = start  # each pose starts from where the one before it ended: no way round a loop
    for pose in range(len(wanted)):
        if follow[pose]:
            step = wanted[pose] - applied
            fast = np.abs(step) > reach[pose]
            shortened[pose] = fast.any()
            fraction = np.min(reach[pose][fast] / np.abs(step[fast])) if shortened[pose] else 1.0
            applied = applied + fraction * step if shortened[pose] else wanted[pose]
        corrections[pose] = applied
    return corrections, shortened
