"""Error motion beside the reference LVDT: at the heights at which it stood, which the recording itself shows."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.analysis.rotation import ArrayCourse, Course, span_of
from rotary_error_monitor.description.stage import Lvdt
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.error_motion import ErrorMotion, rotate
from rotary_error_monitor.metrology.lvdt_comparison import MAX_GAP_NS, LvdtAgreement, LvdtComparison, compare_with_lvdt
from rotary_error_monitor.signals.resampling import resample
from rotary_error_monitor.signals.rows import parts_of

Array = NDArray[np.float64]
Times = NDArray[np.int64]

WINDOW_NS = 1_000_000_000
"""Time in which a height is found, ns: with some 10 µrad of tilt and 0.05 µm of noise to a tenth of a millimetre."""

MOVED = 5e-3
"""Height by which the LVDT is elsewhere, m: at 20 µrad of tilt an estimate that is off by 0.1 µm looks like this."""

LONG = 3
"""Windows at one height from which the LVDT stood there."""

SETTLING_NS = 500_000_000
"""Left out at both ends of a stay, ns."""

_REACH_NS = 5 * MAX_GAP_NS
"""Time around an estimate in which all samples are that a value at it rests on, ns."""


@dataclass(frozen=True)
class Stay:
    """The LVDT at one height.

    Attributes:
        height: above the ring, m; as described where the recording shows no other.
        begin_ns, end_ns: timestamps (ns).
        comparison: of estimate and LVDT.
    """

    height: float
    begin_ns: int
    end_ns: int
    comparison: LvdtAgreement


class LongMotion(Course, Protocol):
    """Error motion over time, of which a part is looked at at once."""

    def motion(self, first: int, last: int) -> tuple[Times, ErrorMotion]:
        """Timestamps (ns) and error motion from one estimate to before another."""
        ...


class LongSamples(Protocol):
    """Samples of the LVDT over time, of which a part is looked at at once."""

    def between(self, begin_ns: int, end_ns: int) -> tuple[Times, Array]:
        """Timestamps (ns), ascending, and samples (k, 2), m, from one time to before another."""
        ...


@dataclass(frozen=True)
class ArrayMotion(ArrayCourse):
    """Error motion that is in memory."""

    measured: ErrorMotion

    def motion(self, first: int, last: int) -> tuple[Times, ErrorMotion]:
        """As `LongMotion.motion`."""
        return self.times_ns[first:last], self.measured.at(np.arange(first, min(last, len(self))))


@dataclass(frozen=True)
class ArraySamples:
    """Samples (k, 2), m, at timestamps (k,), ns, that are in memory."""

    times_ns: Times
    values: Array

    def between(self, begin_ns: int, end_ns: int) -> tuple[Times, Array]:
        """As `LongSamples.between`."""
        inside = slice(*np.searchsorted(self.times_ns, [begin_ns, end_ns]).tolist())
        return self.times_ns[inside], self.values[inside]


def compare_stays(stamp_ns: Times, motion: ErrorMotion, lvdt: Lvdt, times_ns: Times, radial: Array) -> tuple[Stay, ...]:
    """Comparison at each height, of what is in memory.

    Args:
        stamp_ns: (n,) times of the estimate.
        motion: error motion at these times.
        lvdt: as described.
        times_ns: (k,) times of the LVDT's samples.
        radial: (k, 2) the samples, m.
    """
    if len(stamp_ns) < 2 or len(times_ns) < 2:
        return ()
    estimates = ArrayMotion(stamp_ns, motion.theta, motion)
    return stays_of(estimates, int(np.diff(stamp_ns).min()), lvdt, ArraySamples(times_ns, radial))


def stays_of(estimates: LongMotion, period_ns: int, lvdt: Lvdt, samples: LongSamples) -> tuple[Stay, ...]:
    """Comparison at each height.

    Args:
        estimates: error motion, two times of it at least.
        period_ns: distance of two estimates, ns.
        lvdt: as described.
        samples: of the LVDT.
    """
    found = []
    for height, begin, end in _stays(estimates, lvdt, samples, period_ns):
        described = abs(height - lvdt.height) < MOVED
        instrument = lvdt if described else replace(lvdt, height=height)
        compared = LvdtAgreement.of(_compared(estimates, instrument, samples, period_ns, begin, end))
        if compared is not None:  # else they have nothing in common
            found.append(Stay(instrument.height, begin, end, compared))
    return tuple(found)


def _compared(
    estimates: LongMotion, lvdt: Lvdt, samples: LongSamples, period_ns: int, begin_ns: int, end_ns: int
) -> Iterator[LvdtComparison]:
    """Comparisons with the samples of a stay, part after part."""
    first, last = estimates.place(begin_ns), estimates.place(end_ns)
    for a, b in parts_of(first, last):
        stamp_ns, motion = estimates.motion(a, b)
        # those of before and after the stay do not count
        near = samples.between(max(int(stamp_ns[0]) - _REACH_NS, begin_ns), min(int(stamp_ns[-1]) + _REACH_NS, end_ns))
        with contextlib.suppress(InputError):  # nothing in common
            yield compare_with_lvdt(stamp_ns, motion, lvdt, *near, period_ns)


def _stays(estimates: LongMotion, lvdt: Lvdt, samples: LongSamples, period_ns: int) -> Iterator[tuple[float, int, int]]:
    """Height, begin and end of each stay; all of it at the described height where no tilt shows any other."""
    windows = np.array(list(_heights(estimates, lvdt, samples, period_ns))).reshape(-1, 3)
    edges = np.flatnonzero(np.abs(np.diff(windows[:, 0])) > MOVED) + 1
    stays: list[Array] = []
    for part in np.split(windows, edges):
        if len(part) < LONG:
            continue
        if stays and abs(float(np.median(part[:, 0])) - float(np.median(stays[-1][:, 0]))) <= MOVED:
            stays[-1] = np.concatenate([stays[-1], part])  # what lay between was no other height, but a bad window
        else:
            stays.append(part)
    if len(stays) < 2:
        height = float(np.median(stays[0][:, 0])) if stays else lvdt.height
        begin_ns, end_ns = span_of(estimates)
        yield height, begin_ns, end_ns + 1
        return
    for part in stays:
        yield float(np.median(part[:, 0])), int(part[0, 1]) + SETTLING_NS, int(part[-1, 2]) - SETTLING_NS


def _heights(
    estimates: LongMotion, lvdt: Lvdt, samples: LongSamples, period_ns: int
) -> Iterator[tuple[float, int, int]]:
    """Height that fits best in each window in which the rotor turns, with the window's begin and end."""
    begin_ns, end_ns = span_of(estimates)
    for begin in range(begin_ns, end_ns, WINDOW_NS):
        first, last = estimates.place(begin), estimates.place(begin + WINDOW_NS)
        if first == last:
            continue
        stamp_ns, motion = estimates.motion(first, last)
        near = samples.between(int(stamp_ns[0]) - _REACH_NS, int(stamp_ns[-1]) + _REACH_NS)
        sampled = resample(*near, stamp_ns, period_ns, MAX_GAP_NS)
        good = sampled.valid & motion.observable[:, [0, 1, 3, 4]].all(axis=1)
        if good.sum() < 3:
            continue
        exc, eyc, eac, ebc = (motion.components[good, i] for i in (0, 1, 3, 4))
        artefact = rotate(lvdt.artefact_eccentricity, motion.theta[good])
        measured = sampled.values[good] - artefact - np.stack([exc, eyc], axis=1)
        lever = np.stack([ebc, -eac], axis=1)
        centred = lever - lever.mean(axis=0)
        tilt = float((centred**2).sum())
        deviation = lvdt.noise / np.sqrt(tilt) if tilt > 0 else np.inf
        if deviation < MOVED / 4:  # else the window tells no height
            yield float((centred * measured).sum() / tilt), begin, begin + WINDOW_NS
