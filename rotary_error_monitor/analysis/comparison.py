"""Error motion beside a reference: at the heights at which it stood, which the recording itself shows."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Protocol

import numpy as np

from rotary_error_monitor.analysis.rotation import ArrayCourse, RotationCourse, span_of
from rotary_error_monitor.arrays import Array, Times
from rotary_error_monitor.description.two_axis_section import RadialReference
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.error_motion import ErrorMotion, rotate
from rotary_error_monitor.metrology.radial_comparison import (
    MAX_GAP_NS,
    RadialAgreement,
    RadialComparison,
    compare_radial,
)
from rotary_error_monitor.metrology.reference_fit import ReferenceFit, fit_reference
from rotary_error_monitor.signals.resampling import resample
from rotary_error_monitor.signals.rows import parts_of

WINDOW_NS = 1_000_000_000
"""Time in which a height is found, ns: with some 10 µrad of tilt and 0.05 µm of noise to a tenth of a millimetre."""

MOVED = 5e-3
"""Height by which a reference is elsewhere, m: at 20 µrad of tilt an estimate that is off by 0.1 µm looks like it."""

LONG = 3
"""Windows at one height from which the reference stood there."""

SETTLING_NS = 500_000_000
"""Left out at both ends of a stay, ns."""

NEAREST = 1e-3
"""Height, m, below which one that no reference has is taken for metres given as millimetres: no stylus is so low."""

MEANT = 0.02
"""Part by which a height in another unit may be off one that was recorded to be taken for it."""

APART = 6.0
"""Standard uncertainties by which two heights must differ to be two: many, for stays are chosen by their difference."""

DESCRIBED = "as described"
SHOWN = "as the tilt of the recording shows it"

_REACH_NS = 5 * MAX_GAP_NS
"""Time around an estimate in which all samples are that a value at it rests on, ns."""


@dataclass(frozen=True)
class Stay:
    """The reference at one height.

    Attributes:
        height: above the ring, m; as described where the recording shows no other.
        begin_ns, end_ns: timestamps (ns).
        comparison: of estimate and reference.
    """

    height: float
    begin_ns: int
    end_ns: int
    comparison: RadialAgreement


class LongMotion(RotationCourse, Protocol):
    """Error motion over time, of which a part is looked at at once."""

    def motion(self, first: int, last: int) -> tuple[Times, ErrorMotion]:
        """Timestamps (ns) and error motion from one estimate to before another."""


class LongSamples(Protocol):
    """Samples of the reference over time, of which a part is looked at at once."""

    def between(self, begin_ns: int, end_ns: int) -> tuple[Times, Array]:
        """Timestamps (ns), ascending, and samples (k, 2), m, from one time to before another."""


@dataclass(frozen=True)
class ArrayMotion(ArrayCourse):
    """Error motion that is in memory."""

    measured: ErrorMotion

    def motion(self, first: int, last: int) -> tuple[Times, ErrorMotion]:
        """As `LongMotion.motion`."""
        return self.times_ns[first:last], self.measured.at(slice(first, last))


@dataclass(frozen=True)
class ArraySamples:
    """Samples (k, 2), m, at timestamps (k,), ns, that are in memory."""

    times_ns: Times
    values: Array

    def between(self, begin_ns: int, end_ns: int) -> tuple[Times, Array]:
        """As `LongSamples.between`."""
        inside = slice(*np.searchsorted(self.times_ns, [begin_ns, end_ns]).tolist())
        return self.times_ns[inside], self.values[inside]


@dataclass(frozen=True)
class Stand:
    """A reference at one height, as a comparison takes it.

    Attributes:
        height: above the ring at which both are compared, m.
        stated: what the height rests on, in words.
        recorded: heights that may name it, m: as described, and as the recording shows.
        begin_ns, end_ns: timestamps (ns) from and until which it stood there.
    """

    height: float
    stated: str
    recorded: tuple[float, ...]
    begin_ns: int
    end_ns: int


def stands_of_reference(
    stamp_ns: Times, motion: ErrorMotion, reference: RadialReference, times_ns: Times, radial: Array
) -> tuple[Stand, ...]:
    """Where the reference stood: at its described height, unless it was moved while it was recorded.

    A height by the tilt comes from the estimate that is to be verified. So it counts only beside another one that the
    reference was moved from, never against the description of one that stayed.

    Args:
        stamp_ns: (n,) times of the estimate.
        motion: error motion at these times.
        reference: as described; of its artefact the eccentricity need not be known.
        times_ns: (k,) times of the reference's samples.
        radial: (k, 2) the samples, m.
    """
    if len(stamp_ns) < 2 or len(times_ns) < 2:
        return ()
    period = int(np.diff(stamp_ns).min())
    whole = int(stamp_ns[0]), int(stamp_ns[-1]) + 1
    fit = _fitted(stamp_ns, motion, times_ns, radial, period)
    if fit is None:
        return (Stand(reference.height, DESCRIBED, (reference.height,), *whole),)
    known = replace(reference, artefact_eccentricity=(float(fit.joint[0]), float(fit.joint[1])))
    stays = list(_stays(ArrayMotion(stamp_ns, motion.theta, motion), known, ArraySamples(times_ns, radial), period))
    if len(stays) == 1 or not _are_apart(stays, stamp_ns, motion, times_ns, radial, period):
        is_told = fit.higher_std < MOVED / 4 and abs(fit.higher - reference.height) >= MOVED
        shown = (fit.higher,) if is_told else ()
        return (Stand(reference.height, DESCRIBED, (reference.height, *shown), *whole),)
    found = []
    for height, begin, end in stays:
        described = abs(height - reference.height) < MOVED
        at = reference.height if described else height
        found.append(Stand(at, DESCRIBED if described else SHOWN, (at,), begin, end))
    if all(stand.stated == DESCRIBED for stand in found):  # none is off the description: it did not move
        return (Stand(reference.height, DESCRIBED, (reference.height,), *whole),)
    return tuple(found)


def stands_at(stands: Mapping[str, Sequence[Stand]], height: float) -> list[tuple[str, Stand]]:
    """References that stood at a height which somebody names, and where: both are compared at that height.

    Args:
        stands: of each reference by its name.
        height: above the ring, m.

    Raises:
        InputError: none stood within `MOVED` of it; the message says where they did.
    """
    found = []
    for name, own in stands.items():
        near = [min((abs(height - each) for each in stand.recorded), default=np.inf) for stand in own]
        if near and min(near) < MOVED and not _is_in_metres(height, own):
            best = own[int(np.argmin(near))]
            found.append((name, replace(best, height=height, stated="as given")))
    if found:
        return found
    every = sorted({each for own in stands.values() for stand in own for each in stand.recorded})
    where = ", ".join(f"{each * 1e3:.4g}" for each in every)
    meant = [each for each in every for factor in (1e3, 1e-3) if each and abs(height * factor / each - 1) < MEANT]
    hint = f"; {meant[0] * 1e3:.4g} (mm) may be meant" if meant else ""
    raise InputError(f"no reference was recorded there, but at {where} mm above the ring{hint}")


def _is_in_metres(height: float, stands: Sequence[Stand]) -> bool:
    """Whether a height is one of those in metres that was taken for millimetres."""
    recorded = [each for stand in stands for each in stand.recorded if each]
    return abs(height) < NEAREST and any(abs(height * 1e3 / each - 1) < MEANT for each in recorded)


def _fitted(
    stamp_ns: Times, motion: ErrorMotion, times_ns: Times, radial: Array, period_ns: int
) -> ReferenceFit | None:
    """The artefact's eccentricity and the height above the ring, whatever is described; None of less than `LONG`."""
    sampled = resample(times_ns, radial, stamp_ns, period_ns, MAX_GAP_NS)
    good = np.flatnonzero(sampled.valid & motion.observable[:, [0, 1, 3, 4]].all(axis=1))
    windows, number = np.unique((stamp_ns[good] - stamp_ns[:1]) // WINDOW_NS, return_inverse=True)
    if len(windows) < LONG:
        return None
    exc, eyc, eac, ebc = (motion.components[good, i] for i in (0, 1, 3, 4))
    lever = np.stack([ebc, -eac], axis=1)
    difference = sampled.values[good] - np.stack([exc, eyc], axis=1)
    return fit_reference(motion.theta[good], difference, lever, np.eye(2), np.zeros(len(good), np.intp), number)


def _are_apart(
    stays: Sequence[tuple[float, int, int]],
    stamp_ns: Times,
    motion: ErrorMotion,
    times_ns: Times,
    radial: Array,
    period_ns: int,
) -> bool:
    """Whether stays differ by more than their uncertainty as the scatter from window to window has it.

    What errors of the estimate, which are no white noise, make of a window's height is not in the reference's noise.
    """
    fits = []
    for _, begin, end in stays:
        when = np.flatnonzero((stamp_ns >= begin) & (stamp_ns < end))
        there = (times_ns >= begin) & (times_ns < end)
        fits.append(_fitted(stamp_ns[when], motion.at(when), times_ns[there], radial[there], period_ns))
    found = [(fit.higher, fit.higher_std) for fit in fits if fit is not None]
    return len(found) == len(stays) and all(
        abs(one - other) > max(MOVED, APART * float(np.hypot(std, other_std)))
        for (one, std), (other, other_std) in pairwise(found)
    )


def stays_of(
    estimates: LongMotion, period_ns: int, reference: RadialReference, samples: LongSamples
) -> tuple[Stay, ...]:
    """Comparison at each height.

    Args:
        estimates: error motion, two times of it at least.
        period_ns: distance of two estimates, ns.
        reference: as described.
        samples: of the reference.
    """
    found = []
    for height, begin, end in _stays(estimates, reference, samples, period_ns):
        described = abs(height - reference.height) < MOVED
        instrument = reference if described else replace(reference, height=height)
        compared = RadialAgreement.of(_compared(estimates, instrument, samples, period_ns, begin, end))
        if compared is not None:  # else they have nothing in common
            found.append(Stay(instrument.height, begin, end, compared))
    return tuple(found)


def _compared(
    estimates: LongMotion, reference: RadialReference, samples: LongSamples, period_ns: int, begin_ns: int, end_ns: int
) -> Iterator[RadialComparison]:
    """Comparisons with the samples of a stay, part after part."""
    first, last = estimates.place(begin_ns), estimates.place(end_ns)
    for a, b in parts_of(first, last):
        stamp_ns, motion = estimates.motion(a, b)
        # those of before and after the stay do not count
        near = samples.between(max(int(stamp_ns[0]) - _REACH_NS, begin_ns), min(int(stamp_ns[-1]) + _REACH_NS, end_ns))
        with contextlib.suppress(InputError):  # nothing in common
            yield compare_radial(stamp_ns, motion, reference, *near, period_ns)


def _stays(
    estimates: LongMotion, reference: RadialReference, samples: LongSamples, period_ns: int
) -> Iterator[tuple[float, int, int]]:
    """Height, begin and end of each stay; all of it at the described height where no tilt shows any other."""
    windows = np.array(list(_heights(estimates, reference, samples, period_ns))).reshape(-1, 3)
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
        height = float(np.median(stays[0][:, 0])) if stays else reference.height
        begin_ns, end_ns = span_of(estimates)
        yield height, begin_ns, end_ns + 1
        return
    for part in stays:
        yield float(np.median(part[:, 0])), int(part[0, 1]) + SETTLING_NS, int(part[-1, 2]) - SETTLING_NS


def _heights(
    estimates: LongMotion, reference: RadialReference, samples: LongSamples, period_ns: int
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
        artefact = rotate(reference.artefact_eccentricity, motion.theta[good])
        measured = sampled.values[good] - artefact - np.stack([exc, eyc], axis=1)
        lever = np.stack([ebc, -eac], axis=1)
        centred = lever - lever.mean(axis=0)
        tilt = float((centred**2).sum())
        deviation = reference.noise / np.sqrt(tilt) if tilt > 0 else np.inf
        if deviation < MOVED / 4:  # else the window tells no height
            yield float((centred * measured).sum() / tilt), begin, begin + WINDOW_NS
