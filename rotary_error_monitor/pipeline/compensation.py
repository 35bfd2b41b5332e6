"""The compensator: error motion and joint states in, tool-to-workpiece offsets and axis corrections out.

The same class runs live and in replay. The monitored axis has the components that the estimator measures; what it
cannot observe, and every other axis, comes from the machine's description. An offset is computed as soon as the joint
state of its tick is there; where joint states stay away, nothing is computed and the reason is told.

A machine without a monitored axis is corrected by its description alone: each joint state is a tick of its own.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.machine.limits import CorrectionState
from rotary_error_monitor.pipeline.corrections import Compensation, CorrectionSettings, Corrector, Poses
from rotary_error_monitor.pipeline.estimation import error_motion_from_block
from rotary_error_monitor.pipeline.joints import AxisPositions, JointTrack, unpack_directions
from rotary_error_monitor.pipeline.live_components import Carrier
from rotary_error_monitor.signals.blocks import SampleBlock, block_from_samples


@dataclass(frozen=True)
class CompensatorSettings(CorrectionSettings):
    """How the compensator joins its inputs, beside how corrections are made.

    Attributes:
        joint_lag_ns: age at which a joint state counts, ns: longer than it takes to arrive.
        patience_ns: how far joint states may stay behind before ticks go without an offset, ns.
        age_limit_ns: oldest joint state from which an offset is computed, ns.
        position_tolerance: largest difference of the monitored axis between encoder and joint states, rad.
        ring_height: height of the monitored body's origin above the ring, m.
        ring_azimuth: angle from the machine's x to the stage's x about the axis, rad.
    """

    joint_lag_ns: int = 30_000_000
    patience_ns: int = 100_000_000
    age_limit_ns: int = 500_000_000
    position_tolerance: float = 0.05
    ring_height: float = 0.0
    ring_azimuth: float = 0.0


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
        self._settings = settings or CompensatorSettings()
        self._corrector = Corrector(machine, self._settings)
        self._carrier = Carrier(self._settings.ring_height, self._settings.ring_azimuth)
        self._decisions = decisions
        self._monitored = machine.letters.index(machine.monitored) if machine.monitored else None
        # Without error motion a tick is the joint state's own, so there is nothing to wait for.
        lag_ns = self._settings.joint_lag_ns if machine.monitored else 0
        self.joints = JointTrack(machine, lag_ns, self._settings.patience_ns)
        self._temperature = machine.reference_temperature
        self._waiting: list[SampleBlock] = []
        self._own_ticks: list[int] = []
        self._last_tick = -1
        self.hold = ""
        self.held = 0
        self.late = 0

    @property
    def state(self) -> CorrectionState:
        """Where the limits stand: last correction, whether an error latched and why."""
        return self._corrector.state

    def reset(self) -> None:
        """Release a latched error; the next offset decides anew."""
        self._corrector.state = self._corrector.state.reset()

    def push_error_motion(self, block: SampleBlock) -> Compensation:
        """Take in a block of error motion and give what can be computed now; see `accept_error_motion`."""
        self.accept_error_motion(block)
        return self.advance()

    def push_joint_state(
        self, stamp_ns: int, positions: Mapping[str, float], velocities: Mapping[str, float]
    ) -> Compensation:
        """Take in one joint state and give what can be computed now; see `accept_joint_state`."""
        self.accept_joint_state(stamp_ns, positions, velocities)
        return self.advance()

    def accept_error_motion(self, block: SampleBlock) -> None:
        """Take in a block of error motion, columns as `pipeline.estimation.COLUMNS`, and wait for `advance`.

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
        if len(block.rows):
            self._last_tick = int(block.times_ns[-1])
            self._waiting.append(block)

    def accept_joint_state(
        self, stamp_ns: int, positions: Mapping[str, float], velocities: Mapping[str, float]
    ) -> None:
        """Take in one joint state, positions and velocities by letter of the axis, and wait for `advance`.

        Raises:
            InputError: an axis of the machine is missing.
        """
        if self.joints.push(stamp_ns, positions, velocities) and self._monitored is None:
            self._own_ticks.append(stamp_ns)

    def push_temperature(self, temperature: float) -> None:
        """Take in the machine's temperature, °C."""
        if np.isfinite(temperature):
            self._temperature = temperature

    def advance(self) -> Compensation:
        """What can be computed of all that was accepted."""
        if self._monitored is None:
            return self._compute_described()
        return self._advance()

    def finish(self) -> Compensation:
        """What was still waiting for joint states: no more will come."""
        return self._advance(last=True)

    def _advance(self, last: bool = False) -> Compensation:
        if not self._waiting:
            return Compensation()
        block = _joined(self._waiting)
        ticks = block.times_ns
        count = len(ticks) if last else self.joints.count_decided(ticks, int(ticks[-1]))
        self._waiting = [block] if count == 0 else []
        if count == 0:
            return Compensation()
        if count < len(ticks):
            self._waiting = [SampleBlock(block.stamp_ns, block.names, block.rows[count:])]
            block = SampleBlock(block.stamp_ns, block.names, block.rows[:count])
        found = self._compute(ticks[:count], block)
        self.joints.trim(int(ticks[count - 1]))
        return found

    def _compute(self, ticks: NDArray[np.int64], block: SampleBlock) -> Compensation:
        motion = error_motion_from_block(block)
        axes, temperature = self._axes_at(ticks)
        commanded = motion.theta - np.where(motion.observable[:, 5], motion.components[:, 5], 0.0)
        usable = self._check_inputs(axes, commanded)
        self.held += int((~usable).sum())
        if not usable.any():
            return Compensation()
        chosen = np.flatnonzero(usable)
        positions = axes.positions[chosen]
        positions[:, self._monitored] = commanded[chosen]
        motion = motion.at(chosen)
        return self._corrector.compensate(
            Poses(
                ticks[chosen],
                positions,
                axes.directions[chosen],
                axes.age[chosen],
                temperature[chosen],
                self._carrier.components(motion),
                lambda index: self._carrier.covariance(motion.at(index)),
            )
        )

    def _compute_described(self) -> Compensation:
        """Compensation at the joint states' own times, from the machine's description alone."""
        if not self._own_ticks:
            return Compensation()
        ticks = np.array(self._own_ticks)
        self._own_ticks.clear()
        axes, temperature = self._axes_at(ticks)
        self.joints.trim(int(ticks[-1]))
        known = np.flatnonzero(axes.known)
        self.held += len(ticks) - len(known)
        self.hold = "" if axes.known[-1] else "no joint states yet that tell the direction of travel"
        if len(known) == 0:
            return Compensation()
        return self._corrector.compensate(
            Poses(
                ticks[known],
                axes.positions[known],
                axes.directions[known],
                axes.age[known],
                temperature[known],
                None,
                lambda index: np.zeros((len(index), 6, 6)),
            )
        )

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


def _joined(blocks: Sequence[SampleBlock]) -> SampleBlock:
    """One block of all rows; blocks that waited together are computed together."""
    if len(blocks) == 1:
        return blocks[0]
    times = np.concatenate([block.times_ns for block in blocks])
    return block_from_samples(times, blocks[0].names[1:], np.concatenate([block.rows[:, 1:] for block in blocks]))
