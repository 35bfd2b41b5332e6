"""Whether error motion and joint states belong together, tick by tick, before an offset is computed from them."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Mask
from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.description.stage_limits import StageLimits
from rotary_error_monitor.metrology.error_motion import ErrorMotion
from rotary_error_monitor.pipeline.far_distance import FarDistance
from rotary_error_monitor.pipeline.joints import AxisPositions
from rotary_error_monitor.pipeline.kernel import JudgedTicks, Tolerated, chosen_kernel
from rotary_error_monitor.pipeline.motion_checks import MotionChecks
from rotary_error_monitor.pipeline.verdict import DOUBTS, names_of

MEMORY_NS = 2_000_000_000
"""How long commands are remembered, ns: a joint state is held against that of its own stamp."""

LASTS_NS = 100_000_000
"""How long command and joint states are apart, ns, before their difference has to change for that to be over."""

AGREED_NS = 300_000_000
"""For how long the encoder and the joint states have to agree, ns, once they did not: a rotation in another unit comes
near to them again and again.

It is longer than they may be apart by the age of a joint state, and short beside the second in which all is right
again.
"""

LARGEST_GAP_NS = 50_000_000
"""Commands further apart, ns, say nothing of the time between them."""

_NEVER = -(2**62)
"""A time, ns, long before all others."""

_TOLD = {
    "autocollimator": "tilt from the description: the autocollimator is not used",
    "command": "angular positioning from the description: the command is not used",
    "redundancy": "too few heads to show a further fault",
}


@dataclass(frozen=True)
class Tolerances:
    """How far inputs may be apart: as the settings of the same names of `CompensationSettings`."""

    age_limit_ns: int
    position_tolerance: float
    command_tolerance: float
    stamp_tolerance: float


@dataclass(frozen=True)
class Checked:
    """What m ticks can be used for.

    Attributes:
        usable: (m,) whether an offset can be computed.
        commanded: (m,) command to the monitored axis, rad.
        command: (m,) whether the command is believed, and with it the angular positioning error motion.
        hold: why the last tick cannot be used; empty where it can.
        remarks: what is not as it should be, all the same.
    """

    usable: NDArray[np.bool_]
    commanded: NDArray[np.float64]
    command: NDArray[np.bool_]
    hold: str
    remarks: tuple[str, ...]


class InputChecks:
    """Holds error motion and joint states against one another.

    Attributes:
        motion: which error motion is believed by itself.
    """

    def __init__(self, machine: MachineDescription, tolerances: Tolerances, limits: StageLimits) -> None:
        """Checks for a machine whose monitored axis is a stage with limits; for one without they are never asked."""
        self.motion = MotionChecks(limits)
        self._letter = machine.monitored or ""
        self._column = machine.letters.index(machine.monitored) if machine.monitored else 0
        self._tolerances, self._jitter_ns = tolerances, round(tolerances.stamp_tolerance * 1e9)
        self._compiled = Tolerated(
            largest_gap=LARGEST_GAP_NS,
            age_limit=tolerances.age_limit_ns,
            column=self._column,
            doubt_ring=1 << DOUBTS.index("ring"),
            doubt_unverified=1 << DOUBTS.index("unverified"),
            position=tolerances.position_tolerance,
            command=tolerances.command_tolerance,
        )
        self._verified = False
        self._apart = False
        self._far = FarDistance(tolerances.command_tolerance, steady=False)
        self._far_since_ns: int | None = None
        self._disagreed_ns: int | None = None
        self.forget()

    def forget(self) -> None:
        """Forget commands and error motion of the past."""
        self.motion.forget()
        self._times = np.empty(0, np.int64)
        self._commands = np.empty(0)
        self._disagreed_ns = None

    def joints_are_sound(self) -> bool:
        """Whether the encoder did not contradict the joint states when it spoke last."""
        return not self._apart

    def believe(self) -> None:
        """Believe command and joint states wherever they are."""
        self._believe_command()
        self._disagreed_ns = None

    def _believe_command(self) -> None:
        self._far.clear()
        self._far_since_ns = None

    def judge(self, axes: AxisPositions, motion: ErrorMotion) -> Checked:
        """What the ticks of an estimate can be used for, with the `axes` at these."""
        limits, doubts = self._tolerances, motion.doubts
        commanded = motion.theta - np.where(motion.observable[:, 5], motion.components[:, 5], 0.0)
        self._remember(motion.times_ns, commanded)
        difference, usable, command, fresh, agree, fits, proven = self._judged(axes, doubts)
        usable, agree = self._latched(motion.times_ns, usable, agree)
        command = self._as_before(axes, motion.times_ns, difference, command)
        refused = self.motion.judge(motion)
        if refused is not None:
            usable = usable & ~refused
        self._verified = bool(proven[-1])
        if fresh[-1]:
            self._apart = not agree[-1]
        hold = ""
        if not usable[-1]:
            told_angle = commanded[-1] + difference[-1]
            hold = next(
                reason
                for wrong, reason in (
                    (not axes.known[-1], "no joint states: the positions of the other axes are unknown"),
                    (axes.doubted[-1], "joint states are not believed"),
                    (
                        not fresh[-1],
                        f"joint states {axes.age[-1]:.2f} s old; limit {limits.age_limit_ns * 1e-9:.2f} s",
                    ),
                    (not agree[-1], self._where(commanded[-1], told_angle)),
                    (not fits[-1], "the stage does not fit its description; the estimator's diagnostics say how"),
                    (not proven[-1], "the stage's description has not been held against a whole turn yet"),
                    (self.motion.reason, self.motion.reason),
                )
                if wrong
            )
        return Checked(usable, commanded, command, hold, self._remarks(motion, command[-1], difference[-1]))

    def _latched(self, ticks: NDArray[np.int64], usable: Mask, agree: Mask) -> tuple[Mask, Mask]:
        """What is usable, and where both agree (m,), for long enough by now."""
        if agree.all() and self._disagreed_ns is None:
            return usable, agree
        before = _NEVER if self._disagreed_ns is None else self._disagreed_ns
        last = np.maximum.accumulate(np.where(agree, before, ticks))
        self._disagreed_ns = int(last[-1]) if ticks[-1] - last[-1] < AGREED_NS else None
        lasts = ticks - last >= AGREED_NS
        return usable & lasts, agree & lasts

    def _remember(self, ticks: NDArray[np.int64], commanded: NDArray[np.float64]) -> None:
        times, commands = np.concatenate([self._times, ticks]), np.concatenate([self._commands, commanded])
        kept = slice(int(np.searchsorted(times, ticks[-1] - MEMORY_NS)), None)
        self._times, self._commands = times[kept], commands[kept]

    def _judged(self, axes: AxisPositions, doubts: NDArray[np.int64]) -> JudgedTicks:
        """What ticks can be used for, with the commands in memory."""
        command, behind = self._commands_at(axes.stamps)
        kernel = chosen_kernel()
        if kernel is not None:
            known = (axes.stamped, axes.age, axes.stamps, axes.known, axes.told, axes.doubted)
            commands = (command, behind)
            return kernel.judge(self._compiled, self._times, known, commands, doubts, verified=self._verified)
        limits = self._tolerances
        difference, allowed = self._distance(axes, command, behind)
        fresh = axes.known & (axes.age * 1e9 <= limits.age_limit_ns)
        told = axes.told & fresh
        agree = ~told | (np.abs(difference) <= limits.position_tolerance)
        fits_command = ~told | (np.abs(difference) <= allowed)
        fits = doubts >> DOUBTS.index("ring") & 1 == 0
        verified = doubts >> DOUBTS.index("unverified") & 1 == 0
        proven = np.logical_or.accumulate(verified | self._verified)  # now or at any time before
        usable = fresh & ~axes.doubted & agree & fits & proven
        return JudgedTicks(difference, usable, fits_command, fresh, agree, fits, np.asarray(proven))

    def _commands_at(self, stamps: NDArray[np.int64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(m,) commands at stamps of joint states, rad, and as much before as these may be wrong by."""
        at = np.minimum(np.maximum(stamps, self._times[0]), self._times[-1])
        behind = np.interp(at - self._jitter_ns, self._times, self._commands)
        return np.interp(at, self._times, self._commands), behind

    def _are_known(self, axes: AxisPositions) -> NDArray[np.bool_]:
        """(m,) whether the command is known at the stamp of a joint state."""
        after = np.clip(np.searchsorted(self._times, axes.stamps), 1, max(len(self._times) - 1, 1))
        gap = self._times[np.minimum(after, len(self._times) - 1)] - self._times[after - 1]
        return np.asarray((axes.stamps >= self._times[0]) & (gap <= LARGEST_GAP_NS))

    def _as_before(
        self,
        axes: AxisPositions,
        ticks: NDArray[np.int64],
        difference: NDArray[np.float64],
        command: NDArray[np.bool_],
    ) -> NDArray[np.bool_]:
        """Whether the command is believed at each tick (m,), where what was told at rest is not over at a speed."""
        if not self._far.is_told and command.all():
            return command
        here, behind = self._commands_at(axes.stamps)
        late = self._tolerances.stamp_tolerance
        speeds = (here - behind) / max(late, 1e-9)
        comparable, believed = axes.told & self._are_known(axes), command.copy()
        for i, tick in enumerate(ticks.tolist()):
            apart, speed = float(difference[i]), float(speeds[i])
            if not command[i]:
                self._far.is_far(apart, speed, late)
                self._far_since_ns = tick if self._far_since_ns is None else self._far_since_ns
            elif not self._lasted(tick) or (comparable[i] and self._far.has_changed(apart, speed, 0.0, late)):
                if comparable[i]:
                    self._believe_command()
            else:
                believed[i] = False
        return believed

    def _lasted(self, time_ns: int) -> bool:
        return self._far_since_ns is not None and time_ns - self._far_since_ns >= LASTS_NS

    def _distance(
        self, axes: AxisPositions, command: NDArray[np.float64], behind: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """(m,) joint state less command at the joint state's own stamp, rad, and how much that may be."""
        # the position was told for the stamp; `positions` has been carried on from there to the tick
        difference = axes.stamped[:, self._column] - command
        turned = difference - 2 * np.pi * np.rint(difference / (2 * np.pi))
        allowed = self._tolerances.command_tolerance + np.abs(command - behind)
        return np.where(self._are_known(axes), turned, 0.0), allowed

    def _where(self, commanded: float, told: float) -> str:
        turn = 2 * np.pi
        return (
            f"axis {self._letter} stands at {np.degrees(commanded % turn):.2f}° by its encoder but at "
            f"{np.degrees(told % turn):.2f}° by the joint states; set the encoder's zero"
        )

    def _remarks(self, motion: ErrorMotion, command: np.bool_, difference: np.float64) -> tuple[str, ...]:
        told, seen = names_of(int(motion.doubts[-1])), motion.observable[-1].tolist()
        remarks = [_TOLD[name] for name in told if name in _TOLD]
        if "autocollimator" not in told and not all(seen[3:5]):
            remarks.append("tilt from the description: no autocollimator is heard")
        if not all(seen[:2]):
            remarks.append("radial error motion from the description: too few sensors show it")
        if "command" not in told and not seen[5]:
            remarks.append("angular positioning from the description: nothing is heard that measures it")
        if not command:
            remarks.append(
                "angular positioning from the description: command and joint states are "
                f"{difference * 1e6:.3g} µrad apart"
            )
        return tuple(remarks)


def without_command(motion: ErrorMotion, believed: Mask) -> ErrorMotion:
    """Error motion whose positioning component is not observable where the command is not believed."""
    if believed.all():
        return motion
    observable = motion.observable.copy()
    observable[~believed, 5] = False
    return replace(motion, observable=observable)
