"""A long replay as the analysis takes it: a part of its estimates at a time."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from rotary_error_monitor.analysis.health import FallOut, FallOuts
from rotary_error_monitor.analysis.result import ToolOffset
from rotary_error_monitor.analysis.signals import Estimates
from rotary_error_monitor.arrays import Array, Times
from rotary_error_monitor.metrology.error_motion import ErrorMotion
from rotary_error_monitor.pipeline.verdict import DOUBTS
from rotary_error_monitor.recordings.replayed import LongReplay, Replay
from rotary_error_monitor.signals.rows import parts_of, place_of

_UNPROVEN = sum(1 << DOUBTS.index(name) for name in ("unverified", "unverified_tilt"))


def estimates_of(replay: Replay) -> Estimates:
    """What an analysis takes of a replay."""
    motion = replay.motion
    return Estimates(
        motion.times_ns,
        motion.theta,
        replay.error_motion,
        replay.covariance,
        np.stack([motion.unresolved, motion.unresolved_tilt], axis=1),
        motion.head_scale,
        np.asarray(motion.doubts & _UNPROVEN == 0),
    )


@dataclass(frozen=True)
class ReplayedEstimates:
    """Estimates of a replay with two ticks at least."""

    replay: LongReplay

    def __len__(self) -> int:
        return len(self.replay)

    def read(self, first: int, last: int) -> tuple[Times, Array]:
        """Timestamps (ns) and rotation (rad) from one tick to before another."""
        ticks = self.replay.ticks
        return ticks.times.read(first, last), ticks.theta.read(first, last)

    def place(self, time_ns: int) -> int:
        """Number of the first tick that is not before a time."""
        return place_of(self.replay.ticks.times, time_ns)

    def part(self, first: int, last: int) -> Estimates:
        """Estimates from one tick to before another."""
        return estimates_of(self.replay.part(first, last))

    def motion(self, first: int, last: int) -> tuple[Times, ErrorMotion]:
        """Timestamps (ns) and error motion from one tick to before another."""
        motion = self.replay.ticks.part(first, last)
        return motion.times_ns, motion

    def deviation(self, first: int, last: int) -> Array:
        """Rotation less command from one tick to before another, rad, NaN where not observable."""
        motion = self.replay.ticks.part(first, last)
        return np.where(motion.observable[:, 5], motion.components[:, 5], np.nan)

    @cached_property
    def period_ns(self) -> int:
        """Smallest distance of two ticks, ns."""
        return min(int(np.diff(self.read(first, last + 1)[0]).min()) for first, last in parts_of(0, len(self) - 1))

    @property
    def turned(self) -> float:
        """From the smallest to the largest rotation, rad."""
        courses = (self.read(first, last)[1] for first, last in parts_of(0, len(self)))
        ends = [(float(theta.min()), float(theta.max())) for theta in courses]
        return max(high for _, high in ends) - min(low for low, _ in ends)

    def fall_outs(self, bits: dict[str, int]) -> tuple[FallOut, ...]:
        """Times in which instruments were not used, by their bits."""
        found = FallOuts(bits, self.period_ns)
        for first, last in parts_of(0, len(self)):
            motion = self.replay.ticks.part(first, last)
            found.add(motion.times_ns, motion.streams)
        return found.found

    @property
    def tool_offset(self) -> ToolOffset | None:
        """As the machine is, and with the corrections; None without a machine, or where none was made."""
        offsets, remaining = self.replay.offsets, self.replay.corrections.remaining
        if offsets is None:
            return None
        before, after = _Sizes(), _Sizes()
        for first, last in parts_of(0, len(offsets)):
            rows = offsets.part(first, last)[1].rows[:, 1:7]
            before.add(rows[np.isfinite(rows).all(axis=1), :3])
        for first, last in parts_of(0, len(remaining)):
            after.add(remaining.read(first, last)[:, :3])
        if not before.count or not after.count:
            return None
        return ToolOffset(before.rms, before.largest, after.rms, after.largest)


class _Sizes:
    """Sizes of vectors, as they come."""

    def __init__(self) -> None:
        self.count = 0
        self.largest = 0.0
        self._squares = 0.0

    def add(self, rows: Array) -> None:
        """Take vectors (m, 3)."""
        if len(rows):
            size = np.linalg.norm(rows, axis=1)
            self.count += len(size)
            self.largest = max(self.largest, float(size.max()))
            self._squares += float((size**2).sum())

    @property
    def rms(self) -> float:
        """Root mean square of the sizes."""
        return float(np.sqrt(self._squares / self.count))
