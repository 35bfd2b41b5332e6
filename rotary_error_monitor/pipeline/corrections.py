"""Offsets of a machine's poses, the corrections that null them within their limits, and what then remains."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import differences
from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.description.stage_limits import StageLimits
from rotary_error_monitor.description.topics import columns_named
from rotary_error_monitor.machine.correction import SolvedCorrections, remaining_offset, solve_axis_corrections
from rotary_error_monitor.machine.kinematics import arrange_machine
from rotary_error_monitor.machine.limits import (
    HELD,
    CorrectionOutcome,
    CorrectionState,
    axis_limits,
    initial_state,
    limit_corrections,
)
from rotary_error_monitor.pipeline.joints import pack_directions
from rotary_error_monitor.pipeline.offset_spread import OffsetSpread, Spread
from rotary_error_monitor.pipeline.poses import TimedPoses
from rotary_error_monitor.signals.blocks import SampleBlock, block_from_samples

OFFSET = ("x", "y", "z", "a", "b", "c")
"""Components of a tool offset, by which its columns are called."""

_SAMPLES = "tool_offset_samples"
"""Key of the offsets in the wire contract."""

FEW_POSES = 32
"""Poses up to which correcting all costs hardly more than correcting one."""


@dataclass(frozen=True)
class CorrectionSettings:
    """How corrections are made.

    Attributes:
        correction_period_ns: distance of two corrections, ns.
        report_period_ns: distance of two reports on what remains of the offset, ns.
        least_reach: how far the tool axis must turn for one rad of a rotary axis for that axis to be used, rad: near a
            pose where it hardly does, an axis would turn far for little.
        linear_limits: of corrections of linear axes: warning (m), error (m), rate (m/s).
        rotary_limits: of corrections of rotary axes: warning (rad), error (rad), rate (rad/s).
        uncertainty_limit: largest standard uncertainty of the tool's position with which corrections are applied, m.
    """

    correction_period_ns: int = 10_000_000
    report_period_ns: int = 50_000_000
    least_reach: float = 0.1
    linear_limits: tuple[float, float, float] = (1e-4, 5e-4, 2e-3)
    rotary_limits: tuple[float, float, float] = (5e-4, 2e-3, 2e-2)
    uncertainty_limit: float = 1e-5


@dataclass(frozen=True)
class OffsetReport:
    """The offset at one tick, before and after.

    Attributes:
        offset: (6,) tool-to-workpiece offset as the machine is, m and rad.
        covariance: (6, 6) of it; NaN where it rests on a description alone that states no uncertainty.
        remaining: (6,) offset with the correction applied.
    """

    offset: NDArray[np.float64]
    covariance: NDArray[np.float64]
    remaining: NDArray[np.float64]


@dataclass(frozen=True)
class Correction:
    """The correction that nulls the offset at one tick.

    Attributes:
        stamp_ns: time of the tick, ns.
        axes: letters of the axes.
        values: (axes,) correction to add to each axis's command, m or rad, within the limits.
        rates: (axes,) its rate of change since the last one, m/s or rad/s.
        outcome: what became of the wanted correction.
        position_spanned: whether the axes reach every offset of the tool tip here.
        direction_spanned: whether they reach every direction of the tool.
        described: whether it comes from the description alone.
        report: what remains; only now and then.
    """

    stamp_ns: int
    axes: tuple[str, ...]
    values: NDArray[np.float64]
    rates: NDArray[np.float64]
    outcome: CorrectionOutcome
    position_spanned: bool
    direction_spanned: bool
    described: bool
    report: OffsetReport | None


@dataclass(frozen=True)
class CompensationOutput:
    """What came of the inputs: offsets of all ticks, and corrections at the slower correction period."""

    offsets: tuple[SampleBlock, ...] = ()
    corrections: tuple[Correction, ...] = ()

    def followed_by(self, other: CompensationOutput) -> CompensationOutput:
        """Both, one after the other."""
        return CompensationOutput(self.offsets + other.offsets, self.corrections + other.corrections)


class CorrectionMaker:
    """Offsets and corrections of one machine, pose after pose: the one place where a correction is believed.

    A correction goes out where the search for it ended, where it is no sudden departure from the one before, where the
    tool's position is known well enough, and within the limits of size and rate.

    Attributes:
        state: where the limits stand: last correction, whether an error latched and why.
        doubt: why corrections are not believed at present; empty while they are.
        deviation: standard uncertainty of the tool's position at the last report, m; NaN before the first, and where
            the description states none.
    """

    def __init__(self, machine: MachineDescription, settings: CorrectionSettings, limits: StageLimits) -> None:
        self._letters = machine.letters
        self._model = arrange_machine(machine)
        self._settings = settings
        self._limits = axis_limits(machine, linear=settings.linear_limits, rotary=settings.rotary_limits)
        self._spread = OffsetSpread(machine, self._model, limits)
        self._last_period = -1
        self._last_report = -1
        self._asked: tuple[int, NDArray[np.float64]] | None = None
        self.state: CorrectionState = initial_state(len(machine.axes))
        self.doubt = ""
        self.deviation = math.nan

    def start_from(self, applied: Sequence[float]) -> None:
        """Say what corrections are in effect, m and rad: the next ones go on from there."""
        self.state = CorrectionState(
            tuple(float(value) for value in applied), None, self.state.latched, self.state.reason
        )

    def implausible(self, applied: Mapping[str, float]) -> str:
        """Why corrections that are said to be in effect, m and rad by axis, cannot be; empty where they can."""
        for letter, most in zip(self._letters, self._limits.error.tolist(), strict=True):
            value = applied.get(letter, 0.0)
            if abs(value) > most:
                return f"{value:.4g} of axis {letter} is beyond the error limit of {most:g}; its unit may be wrong"
        return ""

    def is_ahead_of(self, time_ns: int) -> bool:
        """Whether a correction of that time or later has been given already."""
        return self.state.time_ns is not None and time_ns <= self.state.time_ns

    def forget_time(self) -> None:
        """The clock was set back: what comes is not before what was."""
        self._last_period = self._last_report = -1
        self._asked = None
        self.state = replace(self.state, time_ns=None)

    def distance(self, poses: TimedPoses) -> NDArray[np.float64]:
        """(n,) how far the tool would be moved, m, were the correction that holds replaced by that of the poses."""
        wanted = self._wanted(poses).corrections
        held = np.broadcast_to(np.array(self.state.applied), wanted.shape)
        # a correction of a rotary axis moves the tool as well
        moved = self._remaining(poses, wanted) - self._remaining(poses, held)
        return np.asarray(np.linalg.norm(moved[:, :3], axis=1))

    def compensate(self, poses: TimedPoses, *, described: bool = False, apply: bool = True) -> CompensationOutput:
        """Offsets of all poses, and corrections of those that begin a correction period.

        Args:
            poses: where the machine stands.
            described: whether they rest on the description alone; then only corrections are given.
            apply: whether corrections may go out; if not, all that is known is kept up to date.
        """
        chosen = self._correction_ticks(poses.stamps)
        offset, wanted = self._solve(poses, chosen)
        blocks = () if described else (self._block(poses, offset),)
        if wanted is None:
            return CompensationOutput(blocks)
        corrections = self._correct(poses.at(chosen), offset[chosen], wanted, described=described, apply=apply)
        return CompensationOutput(blocks, corrections)

    @staticmethod
    def _block(poses: TimedPoses, offset: NDArray[np.float64]) -> SampleBlock:
        """Offsets (n, 6), and what they rest on."""
        columns = columns_named(_SAMPLES)
        rows = np.empty((len(offset), len(columns)))
        rows[:, :6], rows[:, 6] = offset, poses.age
        rows[:, 7], rows[:, 8] = pack_directions(poses.directions), poses.temperature
        return block_from_samples(poses.stamps, columns, rows)

    def _solve(
        self, poses: TimedPoses, chosen: NDArray[np.int64]
    ) -> tuple[NDArray[np.float64], SolvedCorrections | None]:
        """(n, 6) offsets of all poses and the corrections of the chosen ones."""
        if len(chosen) and len(poses.stamps) <= FEW_POSES:
            # The search gives the offsets as well, bit for bit: one pass over the machine less.
            wanted = self._wanted(poses)
            return wanted.offset, wanted.at(chosen)
        return poses.offsets(self._model), self._wanted(poses.at(chosen)) if len(chosen) else None

    def _wanted(self, poses: TimedPoses) -> SolvedCorrections:
        return solve_axis_corrections(
            self._model,
            poses.positions,
            direction=poses.directions,
            temperature=poses.temperature,
            monitored=poses.live,
            least_reach=self._settings.least_reach,
        )

    def _correction_ticks(self, stamps: NDArray[np.int64]) -> NDArray[np.int64]:
        """The first tick in each correction period."""
        period = stamps // self._settings.correction_period_ns
        first = _rising(period, self._last_period)
        self._last_period = max(self._last_period, int(period[-1]))
        return first

    def _correct(
        self, poses: TimedPoses, offset: NDArray[np.float64], wanted: SolvedCorrections, *, described: bool, apply: bool
    ) -> tuple[Correction, ...]:
        """Corrections that may be applied: none where they are not believed or an error limit has latched."""
        stamps = poses.stamps
        steady = self._is_steady(stamps, wanted.corrections)
        due = self._reports_due(stamps)
        spread = self._spread.at(poses.at(due), offset[due])
        self._judge(spread, described=described)
        if not apply or self.doubt:
            return ()
        before, before_ns = np.array(self.state.applied), self.state.time_ns
        limited = limit_corrections(self._limits, self.state, stamps, wanted.corrections, wanted.converged & steady)
        self.state = limited.state
        elapsed = differences(stamps, stamps[0] if before_ns is None else before_ns) * 1e-9
        moved = differences(limited.corrections, before)
        rates = np.where(elapsed[:, None] > 0, moved / np.where(elapsed > 0, elapsed, 1.0)[:, None], 0.0)
        reports = self._report(poses.at(due), limited.corrections[due], offset[due], spread.reported)
        by_index = dict(zip(due.tolist(), reports, strict=True))
        return tuple(
            Correction(
                int(stamps[i]),
                self._letters,
                limited.corrections[i],
                rates[i],
                CorrectionOutcome(int(limited.outcomes[i])),
                bool(wanted.position_spanned[i]),
                bool(wanted.direction_spanned[i]),
                described,
                by_index.get(int(i)),
            )
            for i in np.flatnonzero(limited.outcomes < HELD)
        )

    def _is_steady(self, stamps: NDArray[np.int64], wanted: NDArray[np.float64]) -> NDArray[np.bool_]:
        """(n,) whether each correction follows the one before no faster than corrections may change.

        One that departs for a single pose is left out; what lasts is approached at the rate limit.
        """
        before = (stamps[0], wanted[0]) if self._asked is None else self._asked
        passed = differences(stamps, before[0]) * 1e-9
        steps = np.abs(differences(wanted, before[1]))
        self._asked = int(stamps[-1]), wanted[-1]
        late = passed > 2.5e-9 * self._settings.correction_period_ns  # after a pause there is none before
        with np.errstate(invalid="ignore"):
            return np.asarray((steps <= self._limits.rate * passed[:, None] + 1e-12).all(axis=1) | late)

    def _reports_due(self, stamps: NDArray[np.int64]) -> NDArray[np.int64]:
        """The first tick in each report period."""
        period = stamps // self._settings.report_period_ns
        due = _rising(period, self._last_report)
        if len(stamps):
            self._last_report = max(self._last_report, int(period[-1]))
        return due

    def _judge(self, spread: Spread, *, described: bool) -> None:
        """Doubt corrections whose tool position is less certain than it may be, as far as that is known."""
        if len(spread.lasting) == 0:
            return
        known = float(np.sqrt(np.trace(spread.lasting[-1, :3, :3])))
        self.deviation = known if np.isfinite(spread.reported[-1]).all() else math.nan
        self.doubt = ""
        if known > self._settings.uncertainty_limit and not described:
            self.doubt = (
                f"the tool's position is uncertain by {known * 1e6:.3g} µm, more than "
                f"uncertainty_limit of {self._settings.uncertainty_limit * 1e6:.3g} µm"
            )

    def _report(
        self,
        poses: TimedPoses,
        corrections: NDArray[np.float64],
        offset: NDArray[np.float64],
        spread: NDArray[np.float64],
    ) -> list[OffsetReport]:
        if len(offset) == 0:
            return []
        remaining = self._remaining(poses, corrections)
        return [OffsetReport(*each) for each in zip(offset, spread, remaining, strict=True)]

    def _remaining(self, poses: TimedPoses, corrections: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, 6) what corrections (n, axes) leave of the offset, m and rad."""
        return remaining_offset(
            self._model,
            poses.positions,
            corrections,
            direction=poses.directions,
            temperature=poses.temperature,
            monitored=poses.live,
        )


def _rising(numbers: NDArray[np.int64], before: int) -> NDArray[np.int64]:
    """Places of the numbers that are larger than all before them."""
    if len(numbers) <= FEW_POSES:  # then Python is done before numpy has begun
        places = []
        for place, number in enumerate(numbers.tolist()):
            if number > before:
                places.append(place)
                before = number
        return np.array(places, np.int64)
    largest = np.empty(len(numbers) + 1, np.int64)
    largest[0], largest[1:] = before, numbers
    return np.flatnonzero(numbers > np.maximum.accumulate(largest[:-1]))
