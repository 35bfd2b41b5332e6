"""The compensator: error motion and joint states in, tool-to-workpiece offsets and axis corrections out.

The same class runs live and in replay. The monitored axis has the components that the estimator measures; what it
cannot observe, and every other axis, comes from the machine's description. An offset is computed as soon as the joint
state of its tick is there; where joint states stay away, nothing is computed and the reason is told.

A machine without a monitored axis is corrected by its description alone: each joint state is a tick of its own.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.machine.correction import remaining_offset, solve_axis_corrections
from rotary_error_monitor.machine.error_model import predict_tool_offset, propagate_covariance
from rotary_error_monitor.machine.kinematics import arrange_machine
from rotary_error_monitor.machine.limits import CorrectionState, Level, axis_limits, initial_state, limit_corrections
from rotary_error_monitor.metrology.error_motion import ErrorMotion
from rotary_error_monitor.pipeline.estimation import error_motion_from_block
from rotary_error_monitor.pipeline.joints import AxisPositions, JointTrack, pack_directions, unpack_directions
from rotary_error_monitor.signals.blocks import SampleBlock, block_from_samples

COLUMNS = ("x", "y", "z", "a", "b", "c", "joint_age", "directions", "temperature")
"""Columns of a block of tool offsets after `t`; the last three say what it was computed from."""

UNKNOWN_UNCERTAINTY = np.nan


@dataclass(frozen=True)
class CompensatorSettings:
    """How the compensator joins its inputs.

    Attributes:
        joint_lag_ns: age at which a joint state counts, ns: longer than it takes to arrive.
        patience_ns: how far joint states may stay behind before ticks go without an offset, ns.
        age_limit_ns: oldest joint state from which an offset is computed, ns.
        correction_period_ns: distance of two corrections, ns.
        report_period_ns: distance of two reports on what remains of the offset, ns.
        position_tolerance: largest difference of the monitored axis between encoder and joint states, rad.
        ring_height: height of the monitored body's origin above the ring, m.
        ring_azimuth: angle from the machine's x to the stage's x about the axis, rad.
        least_reach: how far the tool axis must turn for one rad of a rotary axis for that axis to be used, rad: near a
            pose where it hardly does, an axis would turn far for little.
        linear_limits: of corrections of linear axes: warning (m), error (m), rate (m/s).
        rotary_limits: of corrections of rotary axes: warning (rad), error (rad), rate (rad/s).
    """

    joint_lag_ns: int = 30_000_000
    patience_ns: int = 100_000_000
    age_limit_ns: int = 500_000_000
    correction_period_ns: int = 10_000_000
    report_period_ns: int = 20_000_000
    position_tolerance: float = 0.05
    ring_height: float = 0.0
    ring_azimuth: float = 0.0
    least_reach: float = 0.1
    linear_limits: tuple[float, float, float] = (1e-4, 5e-4, 2e-3)
    rotary_limits: tuple[float, float, float] = (5e-4, 2e-3, 2e-2)


@dataclass(frozen=True)
class InputsUsed:
    """What a live run computed an offset from: a replay repeats it.

    Attributes:
        joint_stamp_ns: stamp of the joint state.
        directions: directions of travel, packed.
        temperature: °C.
    """

    joint_stamp_ns: int
    directions: float
    temperature: float


@dataclass(frozen=True)
class OffsetReport:
    """The offset at one tick, before and after.

    Attributes:
        offset: (6,) tool-to-workpiece offset as the machine is, m and rad.
        covariance: (6, 6) of it, as far as the monitored axis causes it; zero without one.
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
    """What came of one input: offsets of all ticks, and corrections at the slower correction period."""

    offsets: tuple[SampleBlock, ...] = ()
    corrections: tuple[Correction, ...] = ()


class Compensator:
    """Applies the multi-body model to what the estimator and the controller say.

    Attributes:
        hold: why nothing is computed at present; empty while all is well.
        held: ticks that went without an offset.
        late: ticks refused because they were not after the last one.
    """

    def __init__(
        self,
        machine: MachineDescription,
        settings: CompensatorSettings | None = None,
        decisions: Mapping[int, InputsUsed] | None = None,
    ) -> None:
        """Compensator of `machine`; `decisions` by stamp (ns) of a tick let a replay repeat a live run."""
        self._machine = machine
        self._model = arrange_machine(machine)
        self._settings = settings or CompensatorSettings()
        self._decisions = decisions
        self._monitored = machine.letters.index(machine.monitored) if machine.monitored else None
        # Without error motion a tick is the joint state's own, so there is nothing to wait for.
        lag_ns = self._settings.joint_lag_ns if machine.monitored else 0
        self.joints = JointTrack(machine, lag_ns, self._settings.patience_ns)
        self._temperature = machine.reference_temperature
        self._waiting: list[SampleBlock] = []
        self._limits = axis_limits(machine, linear=self._settings.linear_limits, rotary=self._settings.rotary_limits)
        self._state = initial_state(len(machine.axes))
        self._last_period = -1
        self._last_report = -1
        self._last_tick = -1
        self.hold = ""
        self.held = 0
        self.late = 0

    @property
    def state(self) -> CorrectionState:
        """Where the limits stand: last correction, whether an error latched and why."""
        return self._state

    def reset(self) -> None:
        """Release a latched error; the next offset decides anew."""
        self._state = self._state.reset()

    def push_error_motion(self, block: SampleBlock) -> Compensation:
        """Take in a block of error motion, columns as `pipeline.estimation.COLUMNS`.

        Raises:
            InputError: the block lacks a column, or the machine has no monitored axis.
        """
        if self._monitored is None:
            raise InputError(f"machine {self._machine.name} has no monitored axis that error motion could belong to")
        if not self._waiting and self.joints.stream.newest_ns is None:
            self.joints.stream.expect(int(block.times_ns[0]))
        fresh = block.times_ns > self._last_tick
        if not fresh.all():
            self.late += int((~fresh).sum())
            block = SampleBlock(block.stamp_ns, block.names, block.rows[fresh])
        if len(block.rows) == 0:
            return Compensation()
        self._last_tick = int(block.times_ns[-1])
        self._waiting.append(block)
        return self._advance()

    def push_joint_state(
        self, stamp_ns: int, positions: Mapping[str, float], velocities: Mapping[str, float]
    ) -> Compensation:
        """Take in one joint state, positions and velocities by letter of the axis.

        Raises:
            InputError: an axis of the machine is missing.
        """
        if not self.joints.push(stamp_ns, positions, velocities):
            return Compensation()
        return self._advance() if self._monitored is not None else self._compute_described(stamp_ns)

    def push_temperature(self, temperature: float) -> None:
        """Take in the machine's temperature, °C."""
        if np.isfinite(temperature):
            self._temperature = temperature

    def finish(self) -> Compensation:
        """What was still waiting for joint states: no more will come."""
        return self._advance(last=True)

    def _advance(self, last: bool = False) -> Compensation:
        offsets: list[SampleBlock] = []
        corrections: list[Correction] = []
        while self._waiting:
            block = self._waiting[0]
            ticks = block.times_ns
            watermark = int(self._waiting[-1].times_ns[-1])
            count = len(ticks) if last else self.joints.count_decided(ticks, watermark)
            if count == 0:
                break
            found = self._compute(ticks[:count], SampleBlock(block.stamp_ns, block.names, block.rows[:count]))
            offsets += found.offsets
            corrections += found.corrections
            self._waiting[:1] = (
                [] if count == len(ticks) else [SampleBlock(block.stamp_ns, block.names, block.rows[count:])]
            )
            self.joints.trim(int(ticks[count - 1]))
        return Compensation(tuple(offsets), tuple(corrections))

    def _compute(self, ticks: NDArray[np.int64], block: SampleBlock) -> Compensation:
        motion = error_motion_from_block(block)
        axes, temperature = self._axes_at(ticks)
        commanded = motion.theta - np.where(motion.observable[:, 5], motion.components[:, 5], 0.0)
        usable = self._check_inputs(axes, commanded)
        self.held += int((~usable).sum())
        if not usable.any():
            return Compensation()
        positions = axes.positions[usable]
        positions[:, self._monitored] = commanded[usable]
        live, covariance = self._live_components(motion, usable)
        poses = _Poses(positions, axes.directions[usable], temperature[usable], live)
        return self._compensate(ticks[usable], poses, axes.age[usable], covariance)

    def _compute_described(self, tick: int) -> Compensation:
        """Compensation at a joint state's own time, from the machine's description alone."""
        ticks = np.array([tick])
        axes, temperature = self._axes_at(ticks)
        self.joints.trim(tick)
        if not axes.known.all():
            self.hold = "no joint states yet that tell the direction of travel"
            self.held += 1
            return Compensation()
        self.hold = ""
        return self._compensate(
            ticks, _Poses(axes.positions, axes.directions, temperature, None), axes.age, np.zeros((1, 6, 6))
        )

    def _compensate(
        self, stamps: NDArray[np.int64], poses: _Poses, age: NDArray[np.float64], covariance: NDArray[np.float64]
    ) -> Compensation:
        offset = predict_tool_offset(
            self._model,
            poses.positions,
            direction=poses.directions,
            temperature=poses.temperature,
            monitored=poses.live,
        )
        rows = np.column_stack([offset, age, pack_directions(poses.directions), poses.temperature])
        blocks = (block_from_samples(stamps, COLUMNS, rows),)
        chosen = self._correction_ticks(stamps)
        return Compensation(blocks, self._correct(stamps[chosen], poses.at(chosen), offset[chosen], covariance[chosen]))

    def _axes_at(self, ticks: NDArray[np.int64]) -> tuple[AxisPositions, NDArray[np.float64]]:
        if self._decisions is None:
            return self.joints.at(ticks), np.full(len(ticks), self._temperature)
        none = InputsUsed(-1, 0.0, self._machine.reference_temperature)
        used = [self._decisions.get(int(tick), none) for tick in ticks]
        found = self.joints.at(ticks, np.array([each.joint_stamp_ns for each in used]))
        packed = np.array([each.directions for each in used])
        directions = unpack_directions(packed, len(self._machine.letters))
        temperature = np.array([each.temperature for each in used])
        return AxisPositions(found.positions, directions, found.age, found.known), temperature

    def _check_inputs(self, axes: AxisPositions, commanded: NDArray[np.float64]) -> NDArray[np.bool_]:
        """Which ticks have fresh joint states that agree with the encoder; says why where the last one has not."""
        limit = self._settings.age_limit_ns * 1e-9
        fresh = axes.known & (axes.age <= limit)
        letter = self._machine.monitored
        told = axes.positions[:, self._monitored]
        difference = told - commanded
        difference = difference - 2 * np.pi * np.rint(difference / (2 * np.pi))
        agree = np.abs(difference) <= self._settings.position_tolerance
        if not axes.known[-1]:
            self.hold = "no joint states: the positions of the other axes are unknown"
        elif not fresh[-1]:
            self.hold = f"joint states {axes.age[-1]:.2f} s old; limit {limit:.2f} s"
        elif not agree[-1]:
            self.hold = (
                f"axis {letter} stands at {np.degrees(commanded[-1] % (2 * np.pi)):.2f}° by its encoder but at "
                f"{np.degrees(told[-1] % (2 * np.pi)):.2f}° by the joint states; set the encoder's zero"
            )
        else:
            self.hold = ""
        return np.asarray(fresh & agree)

    def _live_components(
        self, motion: ErrorMotion, usable: NDArray[np.bool_]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Components of the monitored axis at its body's origin in the machine's directions, NaN where not observable.

        The covariance has NaN on the diagonal there.
        """
        live = np.where(motion.observable, motion.components, np.nan)[usable]
        covariance = motion.covariance[usable]
        carry = _transfer(self._settings.ring_height, self._settings.ring_azimuth)
        missing = ~motion.observable[usable]
        # what depends on a missing component is missing as well
        lost = np.stack([(missing & (carry[i] != 0)).any(axis=1) for i in range(6)], axis=1)
        known = np.where(missing, 0.0, live)
        moved = np.stack([_dot(carry[i], known) for i in range(6)], axis=1)
        half = np.stack([_dot(carry[i], covariance) for i in range(6)], axis=2)
        full = np.stack([_dot(carry[i], np.moveaxis(half, 2, 1).swapaxes(1, 2)) for i in range(6)], axis=1)
        diagonal = np.arange(6)
        full[:, diagonal, diagonal] = np.where(lost, UNKNOWN_UNCERTAINTY, full[:, diagonal, diagonal])
        return np.where(lost, np.nan, moved), full

    def _correction_ticks(self, stamps: NDArray[np.int64]) -> NDArray[np.int64]:
        """The first tick in each correction period."""
        period = stamps // self._settings.correction_period_ns
        first = np.flatnonzero(np.diff(period, prepend=self._last_period) > 0)
        self._last_period = int(period[-1])
        return first

    def _correct(
        self, stamps: NDArray[np.int64], poses: _Poses, offset: NDArray[np.float64], covariance: NDArray[np.float64]
    ) -> tuple[Correction, ...]:
        """Corrections that may be applied: none where the search failed or an error limit has latched."""
        if len(stamps) == 0:
            return ()
        wanted = solve_axis_corrections(
            self._model,
            poses.positions,
            direction=poses.directions,
            temperature=poses.temperature,
            monitored=poses.live,
            least_reach=self._settings.least_reach,
        )
        before = np.array(self._state.applied)
        before_ns = self._state.time_ns
        limited = limit_corrections(self._limits, self._state, stamps, wanted.corrections, wanted.converged)
        self._state = limited.state
        elapsed = np.diff(stamps, prepend=stamps[0] if before_ns is None else before_ns) * 1e-9
        moved = np.diff(limited.corrections, axis=0, prepend=before[None])
        rates = np.where(elapsed[:, None] > 0, moved / np.where(elapsed > 0, elapsed, 1.0)[:, None], 0.0)
        usable = np.flatnonzero(limited.levels < Level.HELD)
        due = self._reports_due(stamps[usable])
        reports = self._report(
            poses.at(usable[due]), limited.corrections[usable[due]], offset[usable[due]], covariance[usable[due]]
        )
        by_index = dict(zip(usable[due].tolist(), reports, strict=True))
        return tuple(
            Correction(
                int(stamps[i]),
                self._machine.letters,
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
        self,
        poses: _Poses,
        corrections: NDArray[np.float64],
        offset: NDArray[np.float64],
        covariance: NDArray[np.float64],
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
        spread = covariance
        if self._monitored is not None:
            spread = propagate_covariance(self._model, poses.positions, covariance)
        return [OffsetReport(*each) for each in zip(offset, spread, remaining, strict=True)]


@dataclass(frozen=True)
class _Poses:
    """Poses for the machine model: positions, directions (n, axes), temperature (n,), live components (n, 6) if any."""

    positions: NDArray[np.float64]
    directions: NDArray[np.float64]
    temperature: NDArray[np.float64]
    live: NDArray[np.float64] | None

    def at(self, chosen: NDArray[np.int64]) -> _Poses:
        """Some of the poses."""
        live = None if self.live is None else self.live[chosen]
        return _Poses(self.positions[chosen], self.directions[chosen], self.temperature[chosen], live)


def _transfer(height: float, azimuth: float) -> NDArray[np.float64]:
    """(6, 6) from components at the ring, in the stage's directions, to those at the body's origin in the machine's."""
    cos, sin = np.cos(azimuth), np.sin(azimuth)
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    abbe = np.eye(6)
    abbe[0, 4], abbe[1, 3] = height, -height
    both = np.zeros((6, 6))
    both[:3, :3] = both[3:, 3:] = turn
    carried = both @ abbe
    carried[np.abs(carried) < 1e-15] = 0.0
    return np.asarray(carried)


def _dot(weights: NDArray[np.float64], columns: NDArray[np.float64]) -> NDArray[np.float64]:
    """Weighted sum over the second axis, written out so that the bits do not depend on the batch."""
    total = np.zeros(columns.shape[:1] + columns.shape[2:])
    for i, weight in enumerate(weights):
        if weight != 0.0:
            total = total + weight * columns[:, i]
    return total
