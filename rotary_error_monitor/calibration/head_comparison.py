"""Reading heads held against one another over a turn, and the mirror, before and after calibration (Lou et al. 2019).

Between centres all that heads disagree in is eccentricity and graduation (their Figures 7 and 9), all that an
autocollimator sees is the mirror (their Figure 8). What is left once both are taken off is what the calibration misses:
noise, what the recording does not tell, and what repeats with a direction of rotation only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.harmonics import AngularHarmonic
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.metrology.error_motion import rotate
from rotary_error_monitor.metrology.harmonics import angular_sum, planar_sum
from rotary_error_monitor.metrology.mirror_assembly import MirrorAssembly
from rotary_error_monitor.metrology.ring_assembly import RingAssembly
from rotary_error_monitor.metrology.shaft_recording import ShaftRecording, check_heads

PARTS = (360, 180, 120, 72, 36)
"""Parts of a turn over which readings of one direction may be averaged to be compared: of 1 to 10 degrees."""

TO_A_PART = 10
"""Readings of a direction to a part: they bring its noise down to a third."""

FINE = 1024
"""Parts of a turn from whose means orders are taken: four and more to the shortest wave that is looked for."""


@dataclass(frozen=True)
class ComparedSignal:
    """Something over the rotation, before and after what was calibrated is taken off.

    Attributes:
        name: such as `A - B`.
        theta: (m,) rotation, rad.
        forward: (m,) whether the shaft turned forward.
        before, after: (m,) rad.
    """

    name: str
    theta: Array
    forward: NDArray[np.bool_]
    before: Array
    after: Array

    def by_direction(self, values: Array) -> tuple[Array, Array, Array]:
        """Middle of each part of the turn, rad, and means of values (m,) there, forward and backward; NaN for none."""
        (means, _), parts = self._means(values), self._parts
        middles = np.asarray((np.arange(parts) + 0.5) * (2 * np.pi / parts), np.float64)
        return middles, means[0], means[1]

    @property
    def reversal(self) -> tuple[float, float] | None:
        """Root mean square over the turn of what is left forward less backward, and what scatter makes of it, rad.

        None where one direction only was recorded. Scatter is that within parts of the turn, which independent noise
        makes; of heads whose resolution is coarser than their noise neighbouring readings round alike, which adds some.
        """
        means, variances = self._means(self.after)
        apart = means[0] - means[1]
        seen = np.isfinite(apart)
        if not seen.any():
            return None
        return float(np.sqrt(np.mean(apart[seen] ** 2))), float(np.sqrt(variances.sum(axis=0)[seen].mean()))

    @property
    def _parts(self) -> int:
        least = min((int(way.sum()) for way in (self.forward, ~self.forward) if way.any()), default=0)
        return next((parts for parts in PARTS if least >= TO_A_PART * parts), PARTS[-1])

    def _means(self, values: Array) -> tuple[Array, Array]:
        """(2, parts) means forward and backward, and their variances by the scatter within the parts."""
        parts = self._parts
        index = np.floor(self.theta / (2 * np.pi) * parts).astype(np.int64) % parts
        means, variances = np.full((2, parts), np.nan), np.full((2, parts), np.nan)
        for way, chosen in enumerate((self.forward, ~self.forward)):
            if not chosen.any():
                continue
            at, own = index[chosen], values[chosen]
            counts = np.bincount(at, minlength=parts)
            seen = counts > 0
            means[way, seen] = np.bincount(at, own, parts)[seen] / counts[seen]
            square = float(np.sum((own - means[way, at]) ** 2)) / max(1, len(own) - int(seen.sum()))
            variances[way, seen] = square / counts[seen]
        return means, variances

    def spectrum(self, highest: int) -> tuple[Array, Array]:
        """(highest,) amplitudes of orders 1, 2, … before and after, rad."""
        both = np.stack([self.before, self.after], axis=1)
        amplitudes = order_amplitudes(self.theta, both, highest)
        return amplitudes[:, 0], amplitudes[:, 1]


@dataclass(frozen=True)
class HeadPair(ComparedSignal):
    """What one head reads less what another does.

    Attributes:
        opposed: whether they stand about half a turn apart; else they are neighbours.
        chord: distance of their places on a ring of radius 1.
    """

    opposed: bool
    chord: float


@dataclass(frozen=True)
class AssemblyComparison:
    """Heads against one another, and the mirror by its axes.

    Attributes:
        pairs: opposed heads first.
        mirror: of x and y; none without an autocollimator.
        radius: of the ring, m.
        highest: highest order that was looked for in the heads.
        tilt_highest: and in the autocollimator.
    """

    pairs: tuple[HeadPair, ...]
    mirror: tuple[ComparedSignal, ...]
    radius: float
    highest: int
    tilt_highest: int

    def displacement(self, pair: HeadPair, difference: float) -> float:
        """Displacement of the ring, m, that makes two heads differ by so much, rad: r tan((A-B)/2) of opposed ones.

        It is along the line that is square to their chord (Lou et al. 2019, Equation 3).
        """
        return self.radius * difference / pair.chord


def compare_assembly(
    stage: StageDescription, recording: ShaftRecording, ring: RingAssembly, mirror: MirrorAssembly | None
) -> AssemblyComparison:
    """Differences between heads and tilts of the mirror of a recording between centres.

    Args:
        stage: as it was described, for azimuths and radius.
        recording: of the shaft between centres.
        ring: as it was found.
        mirror: as it was found; None without one.
    """
    readings = check_heads(stage, recording)
    azimuths = np.array([stage.azimuths[name] for name in recording.heads])
    (x, y), radius = ring.eccentricity, stage.ring.disc_radius
    # eccentricity is order 1 of the graduation
    rows = (AngularHarmonic(1, y / radius, -x / radius), *ring.graduation, *ring.kept)
    theta = (readings - angular_sum(rows, azimuths - readings)).mean(axis=1)
    offsets = np.array(ring.head_offsets)
    left = readings - offsets - theta[:, None] - angular_sum(rows, azimuths - theta[:, None])
    forward = recording.speed > 0
    pairs = [
        HeadPair(
            f"{recording.heads[i].upper()} - {recording.heads[j].upper()}",
            theta,
            forward,
            readings[:, i] - readings[:, j] - (offsets[i] - offsets[j]),
            left[:, i] - left[:, j],
            opposed,
            float(2 * abs(np.sin((azimuths[i] - azimuths[j]) / 2))),
        )
        for i, j, opposed in _pairs(azimuths)
    ]
    found = () if mirror is None else _mirror(recording, theta, mirror)
    told = 1 if mirror is None else mirror.highest
    return AssemblyComparison(tuple(pairs), found, radius, ring.highest, told)


def _pairs(azimuths: Array) -> list[tuple[int, int, bool]]:
    """Numbers of heads that stand opposed, to 15 degrees, and of those that are next to each other round the ring."""
    apart = {(i, j): _between(azimuths[i], azimuths[j]) for i, j in combinations(range(len(azimuths)), 2)}
    opposed = [pair for pair, angle in apart.items() if angle > np.radians(165)]
    round_ = [int(k) for k in np.argsort(azimuths % (2 * np.pi))]
    beside = {(min(i, j), max(i, j)) for i, j in zip(round_, [*round_[1:], round_[0]], strict=True) if i != j}
    # heads at one place would show nothing
    neighbours = [pair for pair in sorted(beside - set(opposed)) if apart[pair] > np.radians(1)]
    return [(*pair, True) for pair in opposed] + [(*pair, False) for pair in neighbours]


def _between(one: float, other: float) -> float:
    """Angle between two azimuths, rad, 0 to pi."""
    return float(abs(np.angle(np.exp(1j * (one - other)))))


def _mirror(recording: ShaftRecording, theta: Array, mirror: MirrorAssembly) -> tuple[ComparedSignal, ...]:
    assert recording.tilt is not None  # of which the mirror was found
    valid = np.ones(len(theta), np.bool_) if recording.tilt_valid is None else recording.tilt_valid
    at = (theta - recording.speed * mirror.delay)[valid]
    before = recording.tilt[valid] - np.array(mirror.line_of_sight)
    after = before - rotate(mirror.tilt, at) - planar_sum((*mirror.flatness, *mirror.kept), at)
    forward = recording.speed[valid] > 0
    return tuple(
        ComparedSignal(f"tilt about {name}", at, forward, before[:, axis], after[:, axis])
        for axis, name in enumerate("xy")
    )


def order_amplitudes(theta: Array, values: Array, highest: int) -> Array:
    """(highest, c) amplitudes of orders 1, 2, … of values (m, c), fitted together to their means over parts of a turn.

    A mean over a part is smaller than its middle, by sin(x)/x of half the phase that it spans: that is taken out.
    """
    index = np.floor(theta / (2 * np.pi) * FINE).astype(np.int64) % FINE
    counts = np.bincount(index, minlength=FINE)
    seen = counts > 0
    means = np.stack([np.bincount(index, column, FINE)[seen] / counts[seen] for column in values.T], axis=1)
    angles = np.bincount(index, np.mod(theta, 2 * np.pi), FINE)[seen] / counts[seen]
    orders = np.arange(1, highest + 1)
    phase = angles[:, None] * orders
    design = np.concatenate([np.ones((len(angles), 1)), np.cos(phase), np.sin(phase)], axis=1)
    weights = np.sqrt(counts[seen])[:, None]
    found = np.linalg.lstsq(weights * design, weights * means, rcond=None)[0]
    size = np.hypot(found[1 : highest + 1], found[highest + 1 :])
    return np.asarray(size / np.sinc(orders / FINE)[:, None])


def figures(values: Sequence[float] | Array) -> tuple[float, float]:
    """Half of the range, and root mean square, of values."""
    return float(np.ptp(values)) / 2, float(np.sqrt(np.mean(np.square(values))))
