"""The true motion of the rotor: rotation about its axis and six error motion components."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from .environment import Environment
from .motion import Motion, make_motion
from .noise import Smooth
from .options import Options, Seeds

Array = NDArray[np.float64]
LEVER = 0.15  # m, between the bearings: what turns their asynchronous radial motion into tilt
BEARING_ORDERS = (0.41, 2.83, 5.37, 7.63, 10.9)  # cage, ball spin, outer ring, inner ring, balls
OTHER_ORDERS = (4, 6, 7, 8, 9, 11, 13)


@dataclass(frozen=True)
class Components:
    """Where the rotor is: each member is an array (n,).

    Attributes:
        theta: true rotation in rad.
        exc: displacement along x of the rotor's axis at the ring, in m.
        eyc: displacement along y.
        ezc: displacement along z.
        eac: x component of the tilt as a rotation vector, in rad.
        ebc: y component of the tilt.
        ecc: true rotation minus commanded rotation, in rad.
    """

    theta: Array
    exc: Array
    eyc: Array
    ezc: Array
    eac: Array
    ebc: Array
    ecc: Array


class Rotor:
    """The rotor's true motion as a function of timestamps; called, it gives the components there.

    Attributes:
        start_ns: timestamp (ns) of the begin.
        motion_name: name of the commanded motion.
        motion: the commanded motion, by seconds since the begin.
        environment: force and temperature, by seconds since the begin.
    """

    def __init__(
        self, seeds: Seeds, duration: float, stage: Mapping[str, Any], options: Options, start_ns: int
    ) -> None:
        self.start_ns = start_ns
        self.motion_name, self.motion = make_motion(seeds, duration, options)
        self.environment = Environment(seeds, duration, stage, options)
        rng = seeds.generator("jitter")
        self._jitter = Smooth(rng, duration, rng.uniform(5.0, 18.0))
        self._jitter_size = options.jitter * 2e-6 * rng.uniform(0.5, 1.3)
        self._turned_for = _time_in_motion(self.motion, duration) if options.brake else None
        self._behind, self._late = options.following_error, options.drive_lag
        self._give = _drive_give(self.motion, duration, options) if options.drive_give else None
        spindle = stage.get("spindle", {})
        extra = _other_orders(seeds.generator("other orders"), spindle, options)
        self._synchronous = _Harmonics(spindle, extra, _axial(seeds, spindle, options))
        self._asynchronous = _Bearing(seeds.generator("bearing"), duration, options.asynchronous)
        self._radial_compliance = float(spindle.get("radial_compliance", 0.0))
        self._tilt_compliance = float(spindle.get("tilt_compliance", 0.0))
        self._thermal = np.array(spindle.get("radial_thermal", (0.0, 0.0)), float)
        self._place_drift = options.place_drift

    def __call__(self, times_ns: NDArray[np.int64]) -> Components:
        """Components at the timestamps (n,)."""
        return self.at(np.asarray((np.asarray(times_ns, np.int64) - self.start_ns) * 1e-9, float))

    def at(self, times: Array) -> Components:
        """Components at `times` (n,) in s since the begin."""
        free = times if self._turned_for is None else self._turned_for(times)
        jitter = self._jitter_size * self._jitter(free)[:, 0] if self._jitter_size else np.zeros(len(times))
        if self._behind or self._late:
            jitter = jitter + self._behind + self.motion.angle(times - self._late) - self.motion.angle(times)
        if self._give is not None:
            jitter = jitter - self._give(times)
        theta = self.motion.angle(times) + jitter
        moved = self._synchronous(theta) + self._asynchronous(theta, times)
        if self.environment.has_force:
            force = self.environment.force(times)
            moved[:, :2] += self._radial_compliance * force
            moved[:, 3] -= self._tilt_compliance * force[:, 1]
            moved[:, 4] += self._tilt_compliance * force[:, 0]
        if self.environment.has_temperature:
            moved[:, :2] += self.environment.warmth(times)[:, None] * self._thermal
        for place, drift in self._place_drift.items():
            moved[:, :2] += self.environment.warmth_of(place, times)[:, None] * np.array(drift)
        exc, eyc, ezc, eac, ebc = np.ascontiguousarray(moved.T)
        return Components(theta, exc, eyc, ezc, eac, ebc, jitter)


def _time_in_motion(motion: Motion, duration: float) -> Callable[[Array], Array]:
    """For how long (s) the command has moved until times (n,) in s since the begin."""
    step = 1e-3
    grid = np.arange(-1.0, duration + 1.0, step)
    passed = step * np.cumsum(np.abs(motion.velocity(grid)) > 1e-6)
    return lambda times: np.asarray(np.interp(times, grid, passed), float)


def _drive_give(motion: Motion, duration: float, options: Options) -> Callable[[Array], Array]:
    """What a drive stays behind its command (rad) at times (n,) in s since it accelerates."""
    if not options.drive_settling:
        return lambda times: options.drive_give * motion.acceleration(times)
    step = 1e-4
    grid = np.arange(-1.0, duration + 1.0, step)
    left = np.exp(-step / options.drive_settling)
    settled = lfilter([1.0 - left], [1.0, -left], options.drive_give * motion.acceleration(grid))
    return lambda times: np.asarray(np.interp(times, grid, settled), float)


class _Harmonics:
    """Synchronous error motion: (n, 5) of dx, dy, dz, gx, gy over the rotation."""

    def __init__(self, spindle: Mapping[str, Any], extra: Mapping[str, Any], axial: Mapping[int, Array]) -> None:
        rows: dict[int, Array] = {order: np.zeros((2, 5)) for order in axial}
        for section in (spindle, extra):
            for name, first in (("radial", 0), ("tilt", 3)):
                for row in section.get(name, []):
                    table = rows.setdefault(int(row["order"]), np.zeros((2, 5)))
                    table[:, first] += row["x"]
                    table[:, first + 1] += row["y"]
        for order, waves in axial.items():
            rows[order][:, 2] += waves
        self._orders = sorted(rows)
        self._table = np.concatenate([rows[order] for order in self._orders]) if rows else np.zeros((0, 5))

    def __call__(self, theta: Array) -> Array:
        basis = np.empty((len(theta), 2 * len(self._orders)))
        for i, order in enumerate(self._orders):
            np.cos(order * theta, out=basis[:, 2 * i])
            np.sin(order * theta, out=basis[:, 2 * i + 1])
        return np.asarray(basis @ self._table, float)


class _Bearing:
    """Asynchronous error motion: waves of the bearing's orders, whose phases slip slowly in time."""

    def __init__(self, rng: np.random.Generator, duration: float, size: float) -> None:
        self._size = size
        count = len(BEARING_ORDERS)
        self._orders = np.array(BEARING_ORDERS) * rng.uniform(0.9, 1.1, count)
        weights = rng.uniform(0.3, 1.0, (count, 3))
        weights /= np.sqrt((weights**2).sum(axis=0) / 2.0)
        self._radial, self._axial, self._tilt = (weights * [size, 0.5 * size, size / LEVER]).T
        self._phases = rng.uniform(0.0, 2.0 * np.pi, (count, 3))
        self._slip = Smooth(rng, duration, 0.3, count)

    def __call__(self, theta: Array, times: Array) -> Array:
        moved = np.zeros((len(theta), 5))
        if self._size == 0.0:
            return moved
        slip = self._slip(times)
        for i, order in enumerate(self._orders):
            phase = order * theta + slip[:, i]
            cos, sin = np.cos(phase), np.sin(phase)
            for j, (x, y, size) in enumerate(((0, 1, self._radial[i]), (3, 4, self._tilt[i]))):
                c, s = size * np.cos(self._phases[i, j]), size * np.sin(self._phases[i, j])
                moved[:, x] += c * cos - s * sin
                moved[:, y] += c * sin + s * cos
            c, s = self._axial[i] * np.cos(self._phases[i, 2]), self._axial[i] * np.sin(self._phases[i, 2])
            moved[:, 2] += c * cos - s * sin
        return moved


def _size(rows: Iterable[Mapping[str, Any]]) -> float:
    """Root mean square of a motion over a turn, per axis."""
    return float(np.sqrt(sum(np.square([*row["x"], *row["y"]]).sum() for row in rows) / 4.0))


def _other_orders(rng: np.random.Generator, spindle: Mapping[str, Any], options: Options) -> dict[str, Any]:
    """Rows of orders that the description does not have, of the stated part of the described motion."""
    extra: dict[str, Any] = {}
    for name in ("radial", "tilt"):
        described = spindle.get(name, [])
        orders = [k for k in OTHER_ORDERS if k not in {row["order"] for row in described}]
        waves = rng.standard_normal((len(orders), 2, 2)) / np.array(orders, float)[:, None, None]
        rows = [{"order": k, "x": w[0], "y": w[1]} for k, w in zip(orders, waves, strict=True)]
        scale = options.other_orders * _size(described) / _size(rows)
        extra[name] = [{"order": r["order"], "x": r["x"] * scale, "y": r["y"] * scale} for r in rows] if scale else []
    return extra


def _axial(seeds: Seeds, spindle: Mapping[str, Any], options: Options) -> dict[int, Array]:
    """Waves (cos, sin) of the axial error motion by order: as described and a little more, or drawn."""
    if "axial" not in spindle:
        return _drawn_axial(seeds.generator("axial"), options.axial, (1, 2, 3))
    described: dict[int, Array] = {}
    for row in spindle["axial"]:
        described[row["order"]] = described.get(row["order"], np.zeros(2)) + [row["cos"], row["sin"]]
    size = np.sqrt(sum(float((waves**2).sum()) for waves in described.values()) / 2.0)
    orders = [k for k in OTHER_ORDERS if k not in described]
    return described | _drawn_axial(seeds.generator("other axial orders"), options.other_orders * size, orders)


def _drawn_axial(rng: np.random.Generator, size: float, orders: Sequence[int]) -> dict[int, Array]:
    """Waves of the stated size, root mean square over a turn, that fall with their order."""
    if size == 0.0:
        return {}
    waves = rng.standard_normal((len(orders), 2)) / np.array(orders, float)[:, None]
    waves *= size / np.sqrt((waves**2).sum() / 2.0)
    return dict(zip(orders, waves, strict=True))
