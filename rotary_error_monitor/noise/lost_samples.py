"""Spans of a recording in which something is missing, and how signals are carried across them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array, Mask
from rotary_error_monitor.effects.rotor import AT_REST
from rotary_error_monitor.noise.head_grid import HeadGrid, HeadRows
from rotary_error_monitor.twin.recording import SignalStream, StageRecording

USUAL = 8.0
"""Medians of what scatter alone does beyond which it jumps: more than five standard deviations of it."""

SAME_TIME = 1e-3
"""Part of what a command is off by, below which it is the same for two heads."""

MOST_TURNING = 0.05
"""Part of a recording that may be left out because the direction of travel is not known there."""


def input_gaps(recording: StageRecording) -> Array:
    """(n, 2) spans of time in which nothing can be predicted: command or force were not recorded, or not yet."""
    command = recording.streams["command"]
    first, last = float(command.time[0]), float(command.time[-1])
    spans: list[tuple[float, float]] = []
    for name in ("command", "force"):
        stream: SignalStream | None = recording.streams.get(name)
        if stream is not None:
            longest = 3.5 * stream.period
            wide = np.flatnonzero(np.diff(stream.time) > longest)
            spans += [(float(stream.time[i]), float(stream.time[i + 1])) for i in wide]
            if name == "force":  # that which begins with the command stays as it is to the end
                spans += [(-np.inf, float(stream.time[0]))] if stream.time[0] - first > longest else []
                spans += [(float(stream.time[-1]), np.inf)] if last - stream.time[-1] > longest else []
    spans += [(-np.inf, first), (last, np.inf)]
    return np.asarray(spans)


def between_samples(command: SignalStream, time: Array, least: float | Array) -> NDArray[np.bool_]:
    """(m,) whether the command is off by more than `least`, rad, where it is interpolated to times (m,).

    A speed that jumps by d within an interval h, which nothing around it tells, puts a cubic on angles and speeds off
    by up to d h / 8; its second differences are d and then -d. An acceleration that jumps by a puts it off by less than
    a h^2 / 128 and shows as a third difference of a h / 2. A speed with three derivatives is off by a 384th of its
    third difference times h. What the speeds scatter throughout, as a driver's that takes them from differences of
    counts, is noise of the command, and is left to be seen as such.
    """
    speed, intervals = command.values[:, 1], len(command.time) - 1
    second, third = np.diff(speed, 2), np.abs(np.diff(speed, 3))
    there_and_back = np.where(second[1:] * second[:-1] < 0, np.minimum(np.abs(second[1:]), np.abs(second[:-1])), 0.0)
    off = _around(np.maximum(there_and_back / 8, third / 64), intervals) * np.diff(command.time)
    interval = np.clip(np.searchsorted(command.time, time, side="right") - 1, 0, intervals - 1)
    return np.asarray(off[interval] > np.maximum(least, USUAL * float(np.median(off))), bool)


def apart_between_samples(command: SignalStream, grid: HeadGrid, times: Mapping[str, Array], least: float) -> Mask:
    """(m,) rows of heads whose times in an interval of the command are so far apart that it is off by more than `least`
    at one of them and not at the other.

    What is off goes from nothing at both ends of an interval h to all of it within half of that.

    Args:
        command: of the rotation.
        grid: the heads side by side.
        times: (n,) s of the samples of each head.
        least: rad.
    """
    found = np.zeros(len(grid.time), bool)
    if not grid.heads:
        return found
    late = HeadRows.of(grid, grid.present, np.ones(len(grid.time)), times).late
    share = np.minimum(1.0, np.ptp(late, axis=0) * 4 / command.period)
    for name in grid.heads if np.any(share > SAME_TIME) else ():
        rows = grid.rows[name]
        found[rows] |= between_samples(command, times[name], least / np.maximum(share[rows], SAME_TIME))
    return found


def _around(differences: Array, intervals: int) -> Array:
    """(intervals,) the largest of the third differences into which both ends of an interval enter."""
    largest = np.zeros(intervals)
    for first in range(3):
        reach = largest[first : first + len(differences)]
        np.maximum(reach, differences, out=reach)
    return largest


def turning_points(command: SignalStream) -> Array:
    """(n, 2) spans of time between two samples of a command within which it starts, stops or reverses.

    When it does is not known, and by a sample of another direction of travel what depends on it would be wrong as a
    whole. Of a command that does so throughout, as one that dithers at rest, nothing is gained by leaving it out.
    """
    speed = command.values[:, 1]
    way = np.where(np.abs(speed) > AT_REST, np.sign(speed), 0.0)
    last = np.flatnonzero(np.diff(way))
    spans = np.stack([command.time[last], command.time[last + 1]], axis=1)
    rare = np.diff(spans, axis=1).sum() < MOST_TURNING * np.ptp(command.time)
    return spans if rare else np.zeros((0, 2))


def in_motion(command: SignalStream, time: Array) -> Mask:
    """(m,) whether a command says at times (m,) that the rotor turns."""
    speed = np.abs(command.values[:, 1])
    return np.asarray(np.interp(time, command.time, speed > AT_REST) > 0.0, bool)


def inside(time: Array, spans: Array) -> NDArray[np.bool_]:
    """(m,) whether times (m,) lie inside any of the spans (n, 2)."""
    begun = np.searchsorted(np.sort(spans[:, 0]), time, side="left")
    ended = np.searchsorted(np.sort(spans[:, 1]), time, side="right")
    return np.asarray(begun > ended, bool)


def bridge(rows: Array, missing: NDArray[np.bool_]) -> Array:
    """Rows (n, p) with straight lines across the missing ones, for signal and signatures alike."""
    if not missing.any() or missing.all():
        return rows
    good, bad = np.flatnonzero(~missing), np.flatnonzero(missing)
    after = np.clip(np.searchsorted(good, bad), 1, len(good) - 1)
    left, right = good[after - 1], good[after]
    share = np.clip((bad - left) / (right - left), 0.0, 1.0)[:, None]
    bridged = rows.copy(order="K")
    bridged[bad] = (1 - share) * rows[left] + share * rows[right]
    return bridged
