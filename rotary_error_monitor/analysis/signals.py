"""Signals of which error motion values are told: radial at heights, tilt and axial, each with its uncertainty."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.analysis.runs import speeds
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.metrology.encoder_heads import HeadLayout
from rotary_error_monitor.metrology.error_motion import radial_covariance_at, radial_error_motion_at, remove_mirror
from rotary_error_monitor.metrology.spindle_figures import SignalNoise, sensitive_direction
from rotary_error_monitor.pipeline.publication import AssemblyVariance

Array = NDArray[np.float64]

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


@dataclass(frozen=True)
class Signal:
    """One signal over n times.

    Attributes:
        quantity: `radial`, `tilt` or `axial`.
        direction: `rotating` (with the rotor), or `x`, `y`, `z`.
        height: above the ring, m; None where it does not matter.
        values: (n,) m or rad, NaN where not observable.
        variance: (n,) of it, all in all.
        turning: (n,) variance of what turns with the rotor once a turn and is not told from error motion.
        still: (n,) variance of what stands still at one speed, as a displacement by stamps that are apart does: it is
            taken off with the centre.
        shape: variance of what is the same in each turn otherwise.
    """

    quantity: str
    direction: str
    height: float | None
    values: Array
    variance: Array
    turning: Array
    still: Array
    shape: float

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

    def noise(self, chosen: NDArray[np.bool_]) -> SignalNoise:
        """Its uncertainty at the chosen times."""
        variance, turning = float(np.mean((self.variance - self.still)[chosen])), float(np.mean(self.turning[chosen]))
        random = max(variance - turning - self.shape, 0.0)
        return SignalNoise(random**0.5, self.shape**0.5, turning**0.5)


def default_heights(stage: StageDescription) -> tuple[float, ...]:
    """Heights above the ring at which somebody looks: the ring, the LVDT, and displacement probes, m, ascending."""
    probes = [sensor.place["height"] for sensor in stage.sensors.values() if "height" in sensor.place]
    lvdt = [] if stage.lvdt is None else [stage.lvdt.height]
    return tuple(sorted({0.0, *lvdt, *probes}))


def signals_of(
    estimates: Estimates, stage: StageDescription, heights: Sequence[float], chosen: NDArray[np.intp]
) -> Iterator[Signal]:
    """Signals that were observable at some of the chosen times."""
    components = estimates.error_motion[chosen]
    covariance = estimates.covariance[chosen]
    theta = estimates.theta[chosen]
    unresolved = 0.5 * estimates.unresolved[chosen] ** 2  # of a turning vector each component has half of the square
    assembly = AssemblyVariance.of(stage)
    seen = np.asarray(np.isfinite(components).any(axis=0))
    nothing = np.zeros(len(theta))
    if seen[[0, 1]].all():
        still = _stamps_apart(estimates, stage, assembly, chosen)
        for height in heights:
            if height and not seen[[3, 4]].all():
                continue
            moved, spread = radial_at(components, covariance, height)
            lever = height**2
            turning = assembly.eccentricity + unresolved[:, 0] + lever * (assembly.mirror + unresolved[:, 1])
            shape = assembly.graduation + lever * assembly.flatness
            yield from _radial(moved, spread, theta, turning, still, shape, height)
    yield from _tilt(components, covariance, theta, assembly.mirror + unresolved[:, 1], stage, assembly)
    if seen[2]:
        yield Signal(AXIAL, "z", None, components[:, 2], covariance[:, 2, 2], nothing, nothing, 0.0)


def _tilt(
    components: Array,
    covariance: Array,
    theta: Array,
    turning: Array,
    stage: StageDescription,
    assembly: AssemblyVariance,
) -> Iterator[Signal]:
    """Tilt about x and y; what gain and roll are off by goes with the reading, of which the mirror's part turns."""
    tilt = components[:, 3:5]
    reading = tilt - remove_mirror(np.zeros_like(tilt), theta, stage.mirror)
    zero = np.full(len(theta), assembly.zero)
    for axis, direction in enumerate("xy"):
        if np.isfinite(tilt[:, axis]).any():
            read = np.nan_to_num(assembly.tilt_by_reading(reading[:, axis], reading[:, 1 - axis]))
            own = float(np.nanmean(assembly.tilt_by_reading(tilt[:, axis], tilt[:, 1 - axis])))
            variance = covariance[:, 3 + axis, 3 + axis]
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


def _stamps_apart(
    estimates: Estimates, stage: StageDescription, assembly: AssemblyVariance, chosen: NDArray[np.intp]
) -> Array:
    """(m,) variance at the ring by stamps of the heads that are apart, which is part of the factor of their variance.

    The factor's square is that of what the heads contradict one another, times one and the stamps' variance over that
    of the readings. Beside listed sensors, which share in the estimate, it is not told: then it counts as any other.
    """
    if stage.encoder is None or stage.sensors:
        return np.zeros(len(chosen))
    weights = HeadLayout(tuple(stage.azimuths.values())).weights[1:]
    speed = speeds(estimates.stamp_ns, estimates.theta)[0][chosen]
    apart = (stage.timing("encoder") * speed * stage.encoder.disc_radius) ** 2 * float((weights**2).sum(axis=1).min())
    variance = np.nan_to_num(estimates.covariance[chosen, 0, 0])
    scaled = np.maximum(variance - assembly.radial - 0.5 * estimates.unresolved[chosen, 0] ** 2, 0.0)
    square = np.maximum(estimates.head_scale[chosen] ** 2, 1.0)
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
