"""The compensator: error motion and joint states in, tool-to-workpiece offsets and axis corrections out.

The same class runs live and in replay. The monitored axis has the components that the estimator measures; what it
cannot observe, and every other axis, comes from the machine's description. An offset is computed as soon as the joint
state of its tick is there; where inputs stay away or contradict one another, nothing is computed, the last correction
holds, and the reason is told. Where that lasts and the joint states are sound, the correction goes on, at the rate
limit, to what the description alone says (`pipeline.holding`).

A machine without a monitored axis is corrected by its description alone: each joint state is a tick of its own.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.description.stage_limits import StageLimits
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.machine.limits import CorrectionState
from rotary_error_monitor.metrology.error_motion import ErrorMotion
from rotary_error_monitor.pipeline.corrections import CompensationOutput, CorrectionMaker, CorrectionSettings
from rotary_error_monitor.pipeline.holding import Holding
from rotary_error_monitor.pipeline.input_checks import InputChecks, Tolerances, without_command
from rotary_error_monitor.pipeline.joints import AxisPositions, JointTrack, unpack_directions
from rotary_error_monitor.pipeline.live_components import Carrier
from rotary_error_monitor.pipeline.poses import TimedPoses
from rotary_error_monitor.pipeline.thermometer import MachineThermometer
from rotary_error_monitor.signals.admission import LATE


@dataclass(frozen=True)
class CompensationSettings(CorrectionSettings):
    """How the compensator joins its inputs, beside how corrections are made.

    Attributes:
        joint_lag_ns: age at which a joint state counts, ns: longer than it takes to arrive.
        patience_ns: how far joint states may stay behind before ticks go without an offset, ns.
        age_limit_ns: oldest joint state from which an offset is computed, ns.
        position_tolerance: largest difference of the monitored axis between encoder and joint states, rad.
        command_tolerance: difference of command and joint states at one stamp from which the command is not believed,
            rad; beside it counts what the axis turns within `stamp_tolerance`.
        stamp_tolerance: how far the stamps of command and joint states may be apart, s.
        ring_height: height of the monitored body's origin above the ring, m.
        ring_azimuth: angle from the machine's x to the stage's x about the axis, rad.
        hold_limit_ns: how long a correction is held before it goes on to what the description alone says, ns.
        temperature_patience_ns: how long to wait for the first temperature, ns.
    """

    joint_lag_ns: int = 30_000_000
    patience_ns: int = 100_000_000
    age_limit_ns: int = 500_000_000
    position_tolerance: float = 0.05
    command_tolerance: float = 2e-4
    stamp_tolerance: float = 2e-3
    ring_height: float = 0.0
    ring_azimuth: float = 0.0
    hold_limit_ns: int = 2_000_000_000
    temperature_patience_ns: int = 2_500_000_000


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
        joints, thermometer: which joint states and temperatures are believed.
        holding: how long a correction has been held.
        remarks: what is not as it should be while corrections go on.
        forbidden: why no correction may go out, whatever the inputs say; empty where they may.
        unrepeated: ticks (ns) at which the live run used a joint state that the recording lacks; they follow from those
            that it has.
    """

    def __init__(
        self,
        machine: MachineDescription,
        settings: CompensationSettings | None = None,
        decisions: Mapping[int, InputsUsed] | None = None,
        limits: StageLimits | None = None,
    ) -> None:
        """Compensator of `machine`.

        Args:
            machine: that is corrected.
            settings: how inputs are joined and corrections made.
            decisions: inputs by stamp (ns) of a tick, as a live run published them; a replay repeats them.
            limits: of the stage that is the monitored axis: how wrong its description can be at most.
        """
        self._machine = machine
        self._settings = settings or CompensationSettings()
        limits = limits or StageLimits()
        self._corrector = CorrectionMaker(machine, self._settings, limits)
        self._carrier = Carrier(self._settings.ring_height, self._settings.ring_azimuth)
        self._decisions = decisions
        self._monitored = machine.letters.index(machine.monitored) if machine.monitored else None
        # Without error motion a tick is the joint state's own, so there is nothing to wait for.
        lag_ns = self._settings.joint_lag_ns if machine.monitored else 0
        self.joints = JointTrack(machine, lag_ns, self._settings.patience_ns)
        self.thermometer = MachineThermometer(machine)
        self.holding = Holding(self._settings.hold_limit_ns)
        chosen = self._settings
        tolerances = Tolerances(
            chosen.age_limit_ns, chosen.position_tolerance, chosen.command_tolerance, chosen.stamp_tolerance
        )
        self._checks = InputChecks(machine, tolerances, limits)
        self._first_ns: int | None = None
        self._waiting: list[ErrorMotion] = []
        self._own_ticks: list[int] = []
        self._last_tick = -1
        self.hold = ""
        self.held = 0
        self.late = 0
        self.remarks: tuple[str, ...] = ()
        self.forbidden = ""
        self.unrepeated: list[NDArray[np.int64]] = []
        self._begin_ns: int | None = None

    @property
    def state(self) -> CorrectionState:
        """Where the limits stand: last correction, whether an error latched and why."""
        return self._corrector.state

    @property
    def lacks_temperature(self) -> bool:
        """Whether the reference temperature stands in for one that is needed and was not told or not believed."""
        return self._decisions is None and self.thermometer.needed and not self.thermometer.has_spoken

    @property
    def refused_motion(self) -> Counter[str]:
        """Ticks of error motion that are not used for what they say, by reason."""
        return self._checks.motion.refused

    @property
    def deviation(self) -> float:
        """Standard uncertainty of the tool's position at the last report, m; NaN before it, or where none is stated."""
        return self._corrector.deviation

    def reset(self) -> None:
        """Release a latched error and believe the next inputs wherever they are; the next offset decides anew."""
        self._corrector.state = self._corrector.state.reset()
        self.joints.reset()
        self.thermometer.reset()
        self._checks.believe()

    def start_from(self, applied: Mapping[str, float]) -> None:
        """Say what corrections (by axis, m and rad) the controller has in effect: the next ones go on from there."""
        self._corrector.start_from([applied.get(letter, 0.0) for letter in self._machine.letters])

    def implausible(self, applied: Mapping[str, float]) -> str:
        """Why corrections (by axis, m and rad) that a controller says are in effect cannot be; empty where they can."""
        return self._corrector.implausible(applied)

    def forget_time(self) -> None:
        """The clock was set back: forget all that was stamped before."""
        self.joints.clear()
        self.thermometer.reset()
        self._corrector.forget_time()
        self.holding.forget_time()
        self._checks.forget()
        self._waiting.clear()
        self._own_ticks.clear()
        self._last_tick, self._first_ns = -1, None

    def accept_error_motion(self, motion: ErrorMotion) -> None:
        """Take in error motion at one time at least, and wait for `advance`.

        Raises:
            InputError: the machine has no monitored axis.
        """
        if self._monitored is None:
            raise InputError(f"machine {self._machine.name} has no monitored axis that error motion could belong to")
        if not self._waiting and self.joints.stream.newest_ns is None:
            self.joints.stream.expect(int(motion.times_ns[0]))
        times = motion.times_ns
        rising = len(times) > 0 and times[0] > self._last_tick and bool((times[1:] > times[:-1]).all())
        if not rising:
            fresh = times > np.maximum.accumulate(np.concatenate([[self._last_tick], times[:-1]]))
            self.late += int((~fresh).sum())
            motion = motion.at(fresh)
        if len(motion.times_ns):
            self._last_tick = int(motion.times_ns[-1])
            self._waiting.append(motion)

    def accept_joint_state(self, stamp_ns: int, positions: Mapping[str, float], velocities: Mapping[str, float]) -> str:
        """Take in one joint state, positions and velocities by letter of the axis, and wait for `advance`.

        Given is why it is not used; nothing where it is.

        Raises:
            InputError: an axis of the machine is missing.
        """
        if not self.joints.push(stamp_ns, positions, velocities):
            return self.joints.doubt or LATE
        self._first_ns = stamp_ns if self._first_ns is None else self._first_ns
        if self._monitored is None or self.holding.is_over(stamp_ns):
            self._own_ticks.append(stamp_ns)
        return ""

    def push_temperature(self, temperature: float, stamp_ns: int | None = None) -> bool:
        """Take in the machine's temperature, °C, by default of the last joint state; give whether it is believed."""
        newest_ns = self.joints.stream.newest_ns or 0
        return self.thermometer.push(newest_ns if stamp_ns is None else stamp_ns, temperature)

    def advance(self) -> CompensationOutput:
        """What can be computed of all that was accepted."""
        if self._monitored is None:
            return self._compute_described()
        found = self._advance()
        return found if not self._own_ticks else found.followed_by(self._stand_in())

    def finish(self) -> CompensationOutput:
        """What was still waiting for joint states: no more will come."""
        return self._advance(last=True)

    def distance(self) -> float:
        """How far the description would move the tool from where the held correction has it, m; NaN if unknown."""
        newest = self.joints.stream.newest_ns
        if newest is None or self.joints.doubt:
            return float("nan")
        poses = self._described_poses(np.array([newest]))
        return float("nan") if poses is None else float(self._corrector.distance(poses)[0])

    def _advance(self, last: bool = False) -> CompensationOutput:
        if not self._waiting:
            return CompensationOutput()
        motion = ErrorMotion.joined(self._waiting)
        ticks = motion.times_ns
        count = len(ticks) if last else self.joints.count_decided(ticks, int(ticks[-1]))
        self._waiting = [motion.at(slice(count, None))] if count < len(ticks) else []
        if count == 0:
            return CompensationOutput()
        found = self._compute(motion if count == len(ticks) else motion.at(slice(count)))
        self.joints.trim(int(ticks[count - 1]))
        return found

    def _compute(self, motion: ErrorMotion) -> CompensationOutput:
        assert self._monitored is not None
        ticks = motion.times_ns
        axes, temperature = self._axes_at(ticks)
        checked = self._checks.judge(axes, motion)
        usable, self.hold = checked.usable, checked.hold
        if usable.any() and (reason := self._missing(int(ticks[-1]))):
            usable, self.hold = np.zeros(len(ticks), np.bool_), reason
        self.held += int((~usable).sum())
        if not usable.any():
            self.holding.begin(int(ticks[-1]))
            return CompensationOutput()
        motion, commanded = without_command(motion, checked.command), checked.commanded
        if not usable.all():
            chosen = np.flatnonzero(usable)
            motion, axes, commanded, temperature = (
                motion.at(chosen),
                axes.at(chosen),
                commanded[chosen],
                temperature[chosen],
            )
        positions = axes.positions.copy()
        positions[:, self._monitored] = commanded
        warmth = self.thermometer.at(int(ticks[-1]))
        found = self._corrector.compensate(
            TimedPoses(
                motion.times_ns,
                positions,
                axes.directions,
                axes.turned,
                axes.age,
                temperature,
                np.full(len(positions), warmth.deviation),
                self._carrier.components(motion),
                lambda index: self._carrier.covariance(motion.at(index)),
            ),
            apply=not self.forbidden,
        )
        self._note_flow(found, int(ticks[-1]), checked.remarks)
        return found

    def _note_flow(self, found: CompensationOutput, time_ns: int, remarks: Sequence[str]) -> None:
        """Whether corrections flow, and what is not as it should be."""
        warmth = self.thermometer.trouble(time_ns)
        said = self.joints.checks.velocities.remarks
        self.remarks = tuple(remark for remark in (*remarks, *said, warmth) if remark)
        if self._corrector.doubt and not self.hold:  # with what may have raised the uncertainty
            self.hold = "; ".join((self._corrector.doubt, *self.remarks))
        if found.corrections:
            self.holding.flow(found.corrections[-1].stamp_ns)
        elif self.hold:
            self.holding.begin(time_ns)
        elif self._corrector.is_ahead_of(time_ns):
            # Those of the description alone are of later joint states: they end, or live ones would never be the later.
            self.holding.flow(time_ns)

    def _missing(self, time_ns: int) -> str:
        """What is not there yet without which the first corrections would be wrong; empty where nothing is."""
        thermometer, first = self.thermometer, self._first_ns
        if self._decisions is not None or not thermometer.needed or thermometer.has_spoken or first is None:
            return ""
        waited, patience = (time_ns - first) * 1e-9, self._settings.temperature_patience_ns * 1e-9
        return f"no temperature yet; after {patience:g} s that of reference stands in" if waited < patience else ""

    def _stand_in(self) -> CompensationOutput:
        """Corrections from the description alone, at the joint states' own times, after too long a hold."""
        ticks = np.array(self._own_ticks)
        self._own_ticks.clear()
        sound = self._checks.joints_are_sound()
        poses = self._described_poses(ticks) if sound else None
        if poses is None or not self.holding.is_over(int(ticks[-1])):
            return CompensationOutput()
        return self._corrector.compensate(poses, described=True, apply=not self.forbidden)

    def _compute_described(self) -> CompensationOutput:
        """Compensation at the joint states' own times, from the machine's description alone."""
        if not self._own_ticks:
            return CompensationOutput()
        ticks = np.array(self._own_ticks)
        self._own_ticks.clear()
        poses = self._described_poses(ticks)
        self.joints.trim(int(ticks[-1]))
        self.hold = "" if poses is not None else "no joint states yet that tell the direction of travel"
        self.hold = self.hold or self._missing(int(ticks[-1]))
        if poses is None or self.hold:
            self.held += len(ticks)
            return CompensationOutput()
        self.held += len(ticks) - len(poses.stamps)
        found = self._corrector.compensate(poses, apply=not self.forbidden)
        self._note_flow(found, int(ticks[-1]), ())
        return found

    def _described_poses(self, ticks: NDArray[np.int64]) -> TimedPoses | None:
        """Poses at the times of joint states, without error motion.

        None before the direction of travel is known, and where joint states do not name the monitored axis: its
        position is then told by the error motion alone.
        """
        if self._decisions is None:
            # of its own time a joint state needs no extrapolation, but one before it tells the direction
            axes = self.joints.at(ticks, None if self._monitored is None else ticks)
            temperature = np.array([self.thermometer.at(int(tick)).temperature for tick in ticks])
        else:
            axes, temperature = self._axes_at(ticks)
        known = np.flatnonzero(axes.known & axes.told)
        if len(known) == 0:
            return None
        unknown = np.full((6, 6), np.nan)
        deviation = np.array([self.thermometer.at(int(tick)).deviation for tick in ticks[known]])
        return TimedPoses(
            ticks[known],
            axes.positions[known],
            axes.directions[known],
            axes.turned[known],
            axes.age[known],
            temperature[known],
            deviation,
            None,
            lambda index: np.tile(unknown, (len(index), 1, 1)),
        )

    def _axes_at(self, ticks: NDArray[np.int64]) -> tuple[AxisPositions, NDArray[np.float64]]:
        if self._decisions is None:
            return self.joints.at(ticks), np.full(len(ticks), self.thermometer.at(int(ticks[-1])).temperature)
        none = InputsUsed(-1, 0.0, self._machine.reference_temperature)
        used = [self._decisions.get(int(tick), none) for tick in ticks]
        stamps = np.array([each.joint_stamp_ns for each in used])
        found = self.joints.at(ticks, stamps)
        self._begin_ns = int(ticks[0]) if self._begin_ns is None else self._begin_ns
        # the first ticks of a recording that was begun in mid-run rest on joint states from before it
        lost = (stamps >= 0) & ~found.known & (ticks >= self._begin_ns + self._settings.patience_ns)
        if lost.any():  # what the live run used is not there: what is, counts by the rule
            self.unrepeated.append(ticks[lost])
            found = found.replaced(lost, self.joints.at(ticks))
        packed = np.array([each.directions for each in used])
        directions = unpack_directions(packed, len(self._machine.letters))
        temperature = np.array([each.temperature for each in used])
        return replace(found, directions=directions), temperature
