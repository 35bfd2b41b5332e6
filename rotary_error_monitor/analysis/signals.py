"""Signals of which error motion values are told: radial at heights, tilt and axial, each with its uncertainty."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.analysis.rotation import RotationCourse
from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.metrology.encoder_heads import HeadLayout
from rotary_error_monitor.metrology.error_motion import radial_covariance_at, radial_error_motion_at, remove_mirror
from rotary_error_monitor.metrology.spindle_figures import sensitive_direction
from rotary_error_monitor.pipeline.publication import AssemblyVariance
from rotary_error_monitor.signals.rows import parts_of

RADIAL, TILT, AXIAL = "radial", "tilt", "axial"
ROTATING = "rotating"


@dataclass(frozen=True)
class Estimates:
    """What the estimator gives at n times, as a replay of the bag.

    Attributes:
        stamp_ns: (n,) timestamps (ns).
        theta: (n,) rotation, rad.
        error_motion: (n, 6) exc eyc ezc eac ebc ecc in m and rad, NaN where not observable.
        covariance: (n, 6, 6) of it.
        unresolved: (n, 2) root mean square of a vector that turns with the rotor and of which nobody can tell whether
            it is error motion: radial (m) and tilt (rad); part of the covariance.
        head_scale: (n,) by which standard deviations from the heads were multiplied.
        proven: (n,) whether the description had been held against a whole turn by then.
    """

    stamp_ns: NDArray[np.int64]
    theta: Array
    error_motion: Array
    covariance: Array
    unresolved: Array
    head_scale: Array
    proven: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.stamp_ns)

    def read(self, first: int, last: int) -> tuple[NDArray[np.int64], Array]:
        """As `Course.read`."""
        return self.stamp_ns[first:last], self.theta[first:last]

    def place(self, time_ns: int) -> int:
        """As `Course.place`."""
        return int(np.searchsorted(self.stamp_ns, time_ns))

    def part(self, first: int, last: int) -> Estimates:
        """As `LongEstimates.part`."""
        return Estimates(*(getattr(self, each.name)[first:last] for each in fields(self)))


class LongEstimates(RotationCourse, Protocol):
    """The same of any number of times, of which some are looked at at once."""

    def part(self, first: int, last: int) -> Estimates:
        """Estimates from one to before another."""


@dataclass(frozen=True)
class Survey:
    """What must be known of all times that count before a part of them is looked at.

    Attributes:
        seen: (6,) which components were observable at some time.
        tilt_read: (2,) mean over the times of the variance that a tilt about x and about y has by its reading, rad².
        proven: whether the description had been held against a whole turn at some time.
    """

    seen: NDArray[np.bool_]
    tilt_read: Array
    proven: bool


@dataclass(frozen=True)
class SignalName:
    """Which signal it is.

    Attributes:
        quantity: `radial`, `tilt` or `axial`.
        direction: `rotating` (with the rotor), or `x`, `y`, `z`.
        height: above the ring, m; None where it does not matter.
    """

    quantity: str
    direction: str
    height: float | None

    @property
    def key(self) -> str:
        """Stable name, such as `radial_rotating_at_16mm`, `tilt_x`, `axial_z`."""
        place = "" if self.height is None else f"_at_{self.height * 1e3:g}mm".replace("-", "minus_")
        return f"{self.quantity}_{self.direction}{place}"

    @property
    def unit(self) -> str:
        """`m` or `rad`."""
        return "rad" if self.quantity == TILT else "m"

    @property
    def keeps_fundamental(self) -> bool:
        """Whether a once-per-turn component is error motion, not a matter of setting up (ISO 230-7, 3.5)."""
        return self.quantity != RADIAL and self.direction != ROTATING


@dataclass(frozen=True)
class Signal(SignalName):
    """One signal over n times.

    Attributes:
        values: (n,) m or rad, NaN where not observable.
        variance: (n,) of it, all in all.
        turning: (n,) variance of what turns with the rotor once a turn and is not told from error motion.
        still: (n,) variance of what stands still at one speed, as a displacement by stamps that are apart does: it is
            taken off with the centre.
        shape: variance of what is the same in each turn otherwise.
    """

    values: Array
    variance: Array
    turning: Array
    still: Array
    shape: float

    @property
    def name(self) -> SignalName:
        """Which it is, without its values."""
        return SignalName(self.quantity, self.direction, self.height)


def default_heights(stage: StageDescription) -> tuple[float, ...]:
    """Heights above the ring at which somebody looks: of ring, reference, and displacement probes, m, ascending."""
    probes = [sensor.place["height"] for sensor in stage.sensors.values() if "height" in sensor.place]
    own = [] if stage.reference is None else [stage.reference.height]
    return tuple(sorted({0.0, *own, *probes}))


def survey(estimates: LongEstimates, runs: Sequence[tuple[int, int]], stage: StageDescription) -> Survey:
    """What is to be known of the times in some runs, first and the one after the last of each."""
    assembly = AssemblyVariance.of(stage)
    seen, read, count, proven = np.zeros(6, np.bool_), np.zeros(2), np.zeros(2), False
    for first, last in runs:
        for part in (estimates.part(*each) for each in parts_of(first, last)):
            seen |= np.isfinite(part.error_motion).any(axis=0)
            proven |= bool(part.proven.any())
            tilt = part.error_motion[:, 3:5]
            variance = assembly.tilt_by_reading(tilt, tilt[:, ::-1])
            known = np.isfinite(variance)
            read += np.where(known, variance, 0.0).sum(axis=0)
            count += known.sum(axis=0)
    with np.errstate(invalid="ignore"):  # of a tilt that was never seen there is no mean
        return Survey(seen, read / count, proven)


def signals_of(
    part: Estimates, speed: Array, known: Survey, stage: StageDescription, heights: Sequence[float]
) -> Iterator[Signal]:
    """Signals of a part of the times: those that were observable at some of all times.

    Args:
        part: estimates at m times.
        speed: (m,) rad/s.
        known: of all times.
        stage: as described.
        heights: above the ring at which radial error motion is told, m.
    """
    unresolved = 0.5 * part.unresolved**2  # of a turning vector each component has half of the square
    assembly = AssemblyVariance.of(stage)
    late = 0.5 * (stage.timing("autocollimator") * np.hypot(*stage.mirror.tilt) * speed) ** 2
    mirror = assembly.mirror + unresolved[:, 1] + late
    nothing = np.zeros(len(part))
    if known.seen[[0, 1]].all():
        still = _stamps_apart(part, speed, stage, assembly)
        for height in heights:
            if height and not known.seen[[3, 4]].all():
                continue
            moved, spread = radial_at(part.error_motion, part.covariance, height)
            lever = height**2
            turning = assembly.eccentricity + unresolved[:, 0] + lever * mirror
            shape = assembly.graduation + lever * assembly.flatness
            yield from _radial(moved, spread, part.theta, turning, still, shape, height)
    yield from _tilt(part, mirror, known, stage, assembly)
    if known.seen[2]:
        axial, variance = part.error_motion[:, 2], part.covariance[:, 2, 2]
        yield Signal(AXIAL, "z", None, axial, variance, nothing, nothing, 0.0)


def _tilt(
    part: Estimates, turning: Array, known: Survey, stage: StageDescription, assembly: AssemblyVariance
) -> Iterator[Signal]:
    """Tilt about x and y; what gain and roll are off by goes with the reading, of which the mirror's part turns."""
    tilt = part.error_motion[:, 3:5]
    reading = tilt - remove_mirror(np.zeros_like(tilt), part.theta, stage.mirror)
    zero = np.full(len(part), assembly.zero)
    for axis, direction in enumerate("xy"):
        if known.seen[3 + axis]:
            read = np.nan_to_num(assembly.tilt_by_reading(reading[:, axis], reading[:, 1 - axis]))
            own = float(known.tilt_read[axis])
            variance = part.covariance[:, 3 + axis, 3 + axis]
            lasting = turning + np.maximum(read - own, 0.0)
            yield Signal(TILT, direction, None, tilt[:, axis], variance, lasting, zero, assembly.flatness + own)


def radial_at(components: Array, covariance: Array, height: float) -> tuple[Array, Array]:
    """Radial error motion (n, 2) at a height above the ring, m, and its covariance (n, 2, 2).

    Args:
        components: (n, 6) exc eyc ezc eac ebc ecc in m and rad, NaN where not observable; so is the result.
        covariance: (n, 6, 6) of it, NaN where not observable; of the result 0 there.
        height: m.
    """
    # without a tilt, the height is that of the ring, where tilt does not count
    motion = components if height else np.where(np.isfinite(components) | (np.arange(6) < 3), components, 0.0)
    # what is not observable does not count here, or the value itself is missing
    return radial_error_motion_at(motion, height), radial_covariance_at(np.nan_to_num(covariance), height)


def _stamps_apart(part: Estimates, speed: Array, stage: StageDescription, assembly: AssemblyVariance) -> Array:
    """(m,) variance at the ring by stamps of the heads that are apart, which is part of the factor of their variance.

    The factor's square is that of what the heads contradict one another, times one and the stamps' variance over that
    of the readings. Beside listed sensors, which share in the estimate, it is not told: then it counts as any other.
    """
    if stage.encoder is None or stage.sensors:
        return np.zeros(len(part))
    weights = HeadLayout(tuple(stage.azimuths.values())).weights[1:]
    apart = (stage.timing("encoder") * speed * stage.encoder.disc_radius) ** 2 * float((weights**2).sum(axis=1).min())
    variance = np.nan_to_num(part.covariance[:, 0, 0])
    scaled = np.maximum(variance - assembly.radial - 0.5 * part.unresolved[:, 0] ** 2, 0.0)
    square = np.maximum(part.head_scale**2, 1.0)
    reading = scaled / square
    return np.asarray(scaled * apart / np.maximum(reading + apart, np.finfo(float).tiny))


def _radial(
    motion: Array, spread: Array, theta: Array, turning: Array, still: Array, shape: float, height: float
) -> Iterator[Signal]:
    cos, sin = np.cos(theta), np.sin(theta)
    along = spread[:, 0, 0] * cos**2 + 2 * spread[:, 0, 1] * cos * sin + spread[:, 1, 1] * sin**2
    yield Signal(RADIAL, ROTATING, height, sensitive_direction(motion, theta), along, turning, still, shape)
    for axis, direction in enumerate("xy"):
        yield Signal(RADIAL, direction, height, motion[:, axis], spread[:, axis, axis], turning, still, shape)
