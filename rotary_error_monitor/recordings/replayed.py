"""What a replay gives: as arrays, or of a recording of any length part by part."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.analysis.signals import radial_at
from rotary_error_monitor.arrays import Times
from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.bags.window import Window
from rotary_error_monitor.metrology.error_motion import ErrorMotion
from rotary_error_monitor.pipeline.corrections import Correction
from rotary_error_monitor.pipeline.estimator_settings import EstimatorStatus
from rotary_error_monitor.recordings.arrays_file import InParts, save_arrays
from rotary_error_monitor.recordings.motion_rows import BlockRows, CorrectionRows, MotionRows
from rotary_error_monitor.signals.rows import Rows, parts_of, place_of

BEFORE_NS = 500_000_000
"""How long before the first estimates of a replay those published live may rest on samples of before it, ns."""

AFTER_NS = 50_000_000
"""How long after the last estimates before a pause others may rest on samples that came in it, ns."""


@dataclass(frozen=True)
class Replay:
    """What estimator and compensation make of a recording, at n ticks.

    With a machine that has no monitored axis the ticks are those of the joint states, and no error motion is measured.

    Attributes:
        motion: as the estimator gave it.
        tool_offset: (n, 6) x y z a b c in m and rad, NaN where the compensation held; None without a machine.
        corrections: at the correction period; empty without a machine.
        status: counts of the estimator.
        damage: what of the bag could not be read, or lies outside of its recording; None for a whole one.
        repeated: whether the bag holds the live run's own decisions, which were repeated.
        unrepeated: (n,) where they could not be: the bag lacks samples that the live run used, and what is given
            follows from those that it has.
        lost_ns: timestamps (ns) of estimates that were published live and are not given at all.
        remarks: what a reader should know: what of the bag could not be read, what its streams lack, what could not be
            repeated.
    """

    motion: ErrorMotion
    tool_offset: NDArray[np.float64] | None
    corrections: tuple[Correction, ...]
    status: EstimatorStatus
    damage: str | None
    repeated: bool
    unrepeated: NDArray[np.bool_]
    lost_ns: Times
    remarks: tuple[str, ...]

    @property
    def stamp_ns(self) -> NDArray[np.int64]:
        """(n,) timestamp (ns) of each estimate."""
        return self.motion.times_ns

    @property
    def theta(self) -> NDArray[np.float64]:
        """(n,) rotation, rad."""
        return self.motion.theta

    @cached_property
    def error_motion(self) -> NDArray[np.float64]:
        """(n, 6) exc eyc ezc eac ebc ecc in m and rad, NaN where not observable."""
        return np.where(self.motion.observable, self.motion.components, np.nan)

    @cached_property
    def covariance(self) -> NDArray[np.float64]:
        """(n, 6, 6) of it, NaN in rows and columns that are not observable."""
        observable = self.motion.observable
        return np.where(observable[:, :, None] & observable[:, None, :], self.motion.covariance, np.nan)

    @property
    def span_ns(self) -> tuple[int, int]:
        """First and last timestamp (ns) of the ticks, of which there is one at least."""
        return int(self.stamp_ns[0]), int(self.stamp_ns[-1])

    @property
    def held(self) -> int | None:
        """Ticks at which the compensation held; None without a machine."""
        return None if self.tool_offset is None else int(np.isnan(self.tool_offset[:, 0]).sum())

    @property
    def correction_count(self) -> int:
        """How many corrections there are."""
        return len(self.corrections)

    @property
    def is_complete(self) -> bool:
        """Whether all that was published live is given, as it was."""
        return not self.unrepeated.any() and not len(self.lost_ns)

    def __len__(self) -> int:
        return len(self.stamp_ns)

    def save(self, path: Path | str, heights: Sequence[float] = ()) -> None:
        """Write the arrays to an .npz file; `tool_offset`, `correction_stamp_ns`, `corrections` only with a machine.

        Args:
            path: of the file.
            heights: above the ring, m, at which radial error motion is given as well: `heights` (h,), `radial`
                (n, h, 2) and `radial_covariance` (n, h, 2, 2), NaN where not observable.

        Raises:
            InputError: the file cannot be written.
        """
        arrays: dict[str, NDArray[Any]] = {}
        if self.tool_offset is not None:
            arrays["correction_stamp_ns"] = np.array([each.stamp_ns for each in self.corrections], np.int64)
            arrays["corrections"] = np.array([each.values for each in self.corrections])
            reports = [(each.stamp_ns, each.report.remaining) for each in self.corrections if each.report is not None]
            arrays["remaining_stamp_ns"] = np.array([stamp for stamp, _ in reports], np.int64)
            arrays["remaining_offset"] = np.array([remaining for _, remaining in reports])
        beside = {name: InParts.of_array(array) for name, array in arrays.items()}
        save_arrays(path, _by_tick(len(self), lambda: (self,), heights, self.lost_ns, bool(arrays)) | beside)


@dataclass(frozen=True)
class LongReplay:
    """What `Replay` says, of a recording of any length: its arrays are read part by part.

    Attributes:
        ticks: error motion as the estimator gave it.
        offsets: of the tool, at those ticks at which the compensation did not hold; None without a machine.
        corrections: at the correction period; empty without a machine.
        status, damage, repeated, lost_ns, remarks: as of `Replay`.
        unrepeated_ns: timestamps (ns, ascending) of ticks at which what the live run did could not be repeated.
    """

    ticks: MotionRows
    offsets: BlockRows | None
    corrections: CorrectionRows
    status: EstimatorStatus
    damage: str | None
    repeated: bool
    unrepeated_ns: Times
    lost_ns: Times
    remarks: tuple[str, ...]

    @property
    def span_ns(self) -> tuple[int, int]:
        """First and last timestamp (ns) of the ticks, of which there is one at least."""
        times = self.ticks.times
        return int(times.read(0, 1)[0]), int(times.read(len(times) - 1, len(times))[0])

    @property
    def held(self) -> int | None:
        """Ticks at which the compensation held; None without a machine."""
        return None if self.offsets is None else len(self) - len(self.offsets)

    @property
    def correction_count(self) -> int:
        """How many corrections there are."""
        return len(self.corrections)

    @property
    def is_complete(self) -> bool:
        """Whether all that was published live is given, as it was."""
        if not len(self.unrepeated_ns):
            return not len(self.lost_ns)
        return not len(self.lost_ns) and not any(part.unrepeated.any() for part in self.parts())

    def __len__(self) -> int:
        return len(self.ticks)

    def part(self, first: int, last: int, corrections: tuple[Correction, ...] = ()) -> Replay:
        """Ticks from `first` to before `last`, with the corrections that are given."""
        motion = self.ticks.part(first, last)
        stamps = motion.times_ns
        return Replay(
            motion,
            None if self.offsets is None else offsets_at(self.offsets, stamps),
            corrections,
            self.status,
            self.damage,
            self.repeated,
            np.isin(stamps, self.unrepeated_ns),
            self.lost_ns,
            self.remarks,
        )

    def parts(self) -> Iterator[Replay]:
        """All ticks, some at a time."""
        return (self.part(first, last) for first, last in parts_of(0, len(self)))

    def save(self, path: Path | str, heights: Sequence[float] = ()) -> None:
        """Write what `Replay.save` writes; memory holds a part of it at a time.

        Raises:
            InputError: the file cannot be written.
        """
        ticks, corrections, with_machine = self.ticks, self.corrections, self.offsets is not None
        rows = {"stamp_ns": ticks.times, "theta": ticks.theta}
        if with_machine:
            rows |= {
                "correction_stamp_ns": corrections.stamp_ns,
                "corrections": corrections.values,
                "remaining_stamp_ns": corrections.remaining_ns,
                "remaining_offset": corrections.remaining,
            }
        whole = {name: InParts.of_rows(each) for name, each in rows.items()}
        save_arrays(path, _by_tick(len(self), self.parts, heights, self.lost_ns, with_machine) | whole)


def _by_tick(
    count: int, parts: Callable[[], Iterable[Replay]], heights: Sequence[float], lost_ns: Times, with_machine: bool
) -> dict[str, InParts]:
    """Arrays of a replay of `count` ticks that comes in parts, those of its machine's corrections left out."""

    def column(give: Callable[[Replay], NDArray[Any]], *shape: int, kind: type = np.float64) -> InParts:
        return InParts(np.dtype(kind), (count, *shape), lambda: map(give, parts()))

    arrays = {
        "stamp_ns": column(lambda part: part.stamp_ns, kind=np.int64),
        "theta": column(lambda part: part.theta),
        "error_motion": column(lambda part: part.error_motion, 6),
        "covariance": column(lambda part: part.covariance, 6, 6),
        "streams": column(lambda part: part.motion.streams, kind=np.int64),
        "doubts": column(lambda part: part.motion.doubts, kind=np.int64),
        "unrepeated": column(lambda part: part.unrepeated, kind=np.bool_),
        "lost_stamp_ns": InParts.of_array(lost_ns),
    }
    if heights:
        high = len(heights)
        arrays["heights"] = InParts.of_array(np.array(heights))
        arrays["radial"] = column(lambda part: _radial(part, heights)[0], high, 2)
        arrays["radial_covariance"] = column(lambda part: _radial(part, heights)[1], high, 2, 2)
    if with_machine:
        arrays["tool_offset"] = column(_tool_offset, 6)
    return arrays


def _radial(part: Replay, heights: Sequence[float]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Radial error motion (n, h, 2) at heights above the ring, m, and its covariance, NaN where not observable."""
    at = [radial_at(part.error_motion, part.covariance, height) for height in heights]
    motion = np.stack([radial for radial, _ in at], axis=1)
    told = np.asarray(np.isfinite(motion).all(axis=2))[:, :, None, None]
    return motion, np.where(told, np.stack([spread for _, spread in at], axis=1), np.nan)


def _tool_offset(part: Replay) -> NDArray[np.float64]:
    assert part.tool_offset is not None  # of a replay with a machine
    return part.tool_offset


def offsets_at(offsets: BlockRows, stamps: Times) -> NDArray[np.float64]:
    """(n, 6) tool offsets at ascending timestamps (n,), ns, NaN where the compensation held."""
    found = np.full((len(stamps), 6), np.nan)
    if len(stamps) and len(offsets):
        first, last = (place_of(offsets.times, int(stamp)) for stamp in (stamps[0], stamps[-1] + 1))
        times, block = offsets.part(first, last)
        found[np.searchsorted(stamps, times)] = block.rows[:, 1:7]
    return found


def unrepeated_remarks(lacking: Mapping[str, NDArray[np.int64]], first_ns: int | None) -> Iterator[str]:
    """Which ticks (ns) are not those of the live run, and why; `first_ns` is the first tick, where there is one."""
    for what, ticks in lacking.items():
        begin = int(ticks.min()) if first_ns is None else min(int(ticks.min()), first_ns)
        since, until = (int(ticks.min()) - begin) * 1e-9, (int(ticks.max()) - begin) * 1e-9
        yield (
            f"{len(ticks)} ticks from {since:.3f} to {until:.3f} s cannot be repeated: the live run used {what}; "
            "they follow from what it has"
        )


def lost_ticks(live: Iterable[NDArray[np.int64]], given: Rows) -> NDArray[np.int64]:
    """Ticks (ns, ascending) that were published live and are not given again, but for those close to others that are.

    The first ticks of a recording, or after a pause in it, rest on samples from before it; the last ones before a pause
    on samples after their own time.

    Args:
        live: ticks (ns) that were published live, ascending, part after part.
        given: ticks (ns) that are given, ascending.
    """
    found = [np.empty(0, np.int64)]
    for part in live:
        first, last = (place_of(given, int(tick)) for tick in part[[0, -1]])
        near = given.read(max(first - 1, 0), last + 1)
        lost = np.setdiff1d(part, near)
        place = np.searchsorted(near, lost)
        before = np.append(np.int64(-1 << 62), near)[place]
        after = np.append(near, np.int64(1 << 62))[place]
        found.append(lost[(after - lost > BEFORE_NS) & (lost - before > AFTER_NS)])
    return np.concatenate(found)


def lost_remarks(lost: NDArray[np.int64], first_ns: int | None) -> Iterator[str]:
    """Which ticks (ns) of the live run are not given; `first_ns` as above."""
    if len(lost):
        begin = int(lost[0]) if first_ns is None else min(int(lost[0]), first_ns)
        yield (
            f"{len(lost)} estimates that were published live, from {(int(lost[0]) - begin) * 1e-9:.3f} to "
            f"{(int(lost[-1]) - begin) * 1e-9:.3f} s, are not given: the bag lacks the samples that they rest on"
        )


def damage_of(reader: BagReader, window: Window | None) -> str | None:
    """What of the bag could not be read, or lies outside of its recording; None for a whole one."""
    remarks = (reader.damage, window.remark if window is not None else None)
    return "; ".join(remark for remark in remarks if remark) or None


def remarks_of(reader: BagReader, window: Window | None) -> tuple[str, ...]:
    """What a reader of the bag should know."""
    outside = window.remark if window is not None else None
    return (*reader.remarks, outside) if outside else reader.remarks
