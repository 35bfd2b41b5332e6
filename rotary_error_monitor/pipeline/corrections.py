"""Offsets of a machine's poses, the corrections that null them within their limits, and what then remains."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.machine.correction import AxisCorrections, remaining_offset, solve_axis_corrections
from rotary_error_monitor.machine.error_model import predict_tool_offset, propagate_covariance
from rotary_error_monitor.machine.kinematics import arrange_machine
from rotary_error_monitor.machine.limits import CorrectionState, Level, axis_limits, initial_state, limit_corrections
from rotary_error_monitor.pipeline.joints import pack_directions
from rotary_error_monitor.signals.blocks import SampleBlock, block_from_samples

COLUMNS = ("x", "y", "z", "a", "b", "c", "joint_age", "directions", "temperature")
"""Columns of a block of tool offsets after `t`; the last three say what it was computed from."""

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
    """

    correction_period_ns: int = 10_000_000
    report_period_ns: int = 50_000_000
    least_reach: float = 0.1
    linear_limits: tuple[float, float, float] = (1e-4, 5e-4, 2e-3)
    rotary_limits: tuple[float, float, float] = (5e-4, 2e-3, 2e-2)


@dataclass(frozen=True)
class Poses:
    """Poses at n ticks, as the machine model takes them.

    Attributes:
        stamps: (n,) time of each tick, ns.
        positions, directions: (n, axes) in m or rad; sign of travel.
        age: (n,) of the joint state that they come from, s.
        temperature: (n,) °C.
        live: (n, 6) live components of the monitored axis; none for a machine without.
        covariance: gives the (k, 6, 6) covariance of the live components of some of the ticks.
    """

    stamps: NDArray[np.int64]
    positions: NDArray[np.float64]
    directions: NDArray[np.float64]
    age: NDArray[np.float64]
    temperature: NDArray[np.float64]
    live: NDArray[np.float64] | None
    covariance: Callable[[NDArray[np.int64]], NDArray[np.float64]]

    def at(self, chosen: NDArray[np.int64]) -> Poses:
        """Some of the poses."""
        return Poses(
            self.stamps[chosen],
            self.positions[chosen],
            self.directions[chosen],
            self.age[chosen],
            self.temperature[chosen],
            None if self.live is None else self.live[chosen],
            lambda index: self.covariance(chosen[index]),
        )


@dataclass(frozen=True)
class OffsetReport:
    """The offset at one tick, before and after.

    Attributes:
        offset: (6,) tool-to-workpiece offset as the machine is, m and rad.
        covariance: (6, 6) of it.
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
        level: what became of the wanted correction.
        direction_spanned: whether the axes reach every direction of the tool here.
        report: what remains; only now and then.
    """

    stamp_ns: int
    axes: tuple[str, ...]
    values: NDArray[np.float64]
    rates: NDArray[np.float64]
    level: Level
    direction_spanned: bool
    report: OffsetReport | None


@dataclass(frozen=True)
class Compensation:
    """What came of the inputs: offsets of all ticks, and corrections at the slower correction period."""

    offsets: tuple[SampleBlock, ...] = ()
    corrections: tuple[Correction, ...] = ()


class Corrector:
    """Offsets and corrections of one machine, pose after pose.

    Attributes:
        state: where the limits stand: last correction, whether an error latched and why.
    """

    def __init__(self, machine: MachineDescription, settings: CorrectionSettings) -> None:
        self._letters = machine.letters
        self._model = arrange_machine(machine)
        self._settings = settings
        self._limits = axis_limits(machine, linear=settings.linear_limits, rotary=settings.rotary_limits)
        self._last_period = -1
        self._last_report = -1
        self.state: CorrectionState = initial_state(len(machine.axes))

    def compensate(self, poses: Poses) -> Compensation:
        """Offsets of all poses, and corrections of those that begin a correction period."""
        chosen = self._correction_ticks(poses.stamps)
        offset, wanted = self._solve(poses, chosen)
        rows = np.column_stack([offset, poses.age, pack_directions(poses.directions), poses.temperature])
        blocks = (block_from_samples(poses.stamps, COLUMNS, rows),)
        if wanted is None:
            return Compensation(blocks)
        return Compensation(blocks, self._correct(poses.at(chosen), offset[chosen], wanted))

    def _solve(self, poses: Poses, chosen: NDArray[np.int64]) -> tuple[NDArray[np.float64], AxisCorrections | None]:
        """(n, 6) offsets of all poses and the corrections of the chosen ones."""
        if len(chosen) and len(poses.stamps) <= FEW_POSES:
            # The search gives the offsets as well, bit for bit: one pass over the machine less.
            wanted = self._wanted(poses)
            return wanted.offset, wanted.at(chosen)
        offset = predict_tool_offset(
            self._model,
            poses.positions,
            direction=poses.directions,
            temperature=poses.temperature,
            monitored=poses.live,
        )
        return offset, self._wanted(poses.at(chosen)) if len(chosen) else None

    def _wanted(self, poses: Poses) -> AxisCorrections:
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
        first = np.flatnonzero(np.diff(period, prepend=self._last_period) > 0)
        self._last_period = int(period[-1])
        return first

    def _correct(self, poses: Poses, offset: NDArray[np.float64], wanted: AxisCorrections) -> tuple[Correction, ...]:
        """Corrections that may be applied: none where the search failed or an error limit has latched."""
        stamps = poses.stamps
        before = np.array(self.state.applied)
        before_ns = self.state.time_ns
        limited = limit_corrections(self._limits, self.state, stamps, wanted.corrections, wanted.converged)
        self.state = limited.state
        elapsed = np.diff(stamps, prepend=stamps[0] if before_ns is None else before_ns) * 1e-9
        moved = np.diff(limited.corrections, axis=0, prepend=before[None])
        rates = np.where(elapsed[:, None] > 0, moved / np.where(elapsed > 0, elapsed, 1.0)[:, None], 0.0)
        usable = np.flatnonzero(limited.levels < Level.HELD)
        due = usable[self._reports_due(stamps[usable])]
        reports = self._report(poses.at(due), limited.corrections[due], offset[due])
        by_index = dict(zip(due.tolist(), reports, strict=True))
        return tuple(
            Correction(
                int(stamps[i]),
                self._letters,
                limited.corrections[i],
                rates[i],
                Level(int(limited.levels[i])),
                bool(wanted.direction_spanned[i]),
                by_index.get(int(i)),
            )
            for i in usable
        )

    def _reports_due(self, stamps: NDArray[np.int64]) -> NDArray[np.int64]:
        """The first tick in each report period."""
        period = stamps // self._settings.report_period_ns
        due = np.flatnonzero(np.diff(period, prepend=self._last_report) > 0)
        if len(stamps):
            self._last_report = int(period[-1])
        return due

    def _report(
        self, poses: Poses, corrections: NDArray[np.float64], offset: NDArray[np.float64]
    ) -> list[OffsetReport]:
        if len(offset) == 0:
            return []
        remaining = remaining_offset(
            self._model,
            poses.positions,
            corrections,
            direction=poses.directions,
            temperature=poses.temperature,
            monitored=poses.live,
        )
        spread = poses.covariance(np.arange(len(offset)))
        if poses.live is not None:
            spread = propagate_covariance(self._model, poses.positions, spread)
        return [OffsetReport(*each) for each in zip(offset, spread, remaining, strict=True)]
