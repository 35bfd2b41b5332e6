"""A two-axis mount as a problem of diagnosis: the rows are where each star was found, along the ways of both axes.

Nobody knows how a mount was set up: its six angles are sought in the recording, beside the causes, whenever those
change. They are the nuisances of the diagnosis; what only they can explain is no gap.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import cached_property, partial
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.effects.effect import AnyEffect, Cause, Role
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.gap.departures import SHARE, Departures
from rotary_error_monitor.gap.known_effects import KnownEffects
from rotary_error_monitor.gap.problem import Candidate, Columns, LateRows, Rows, SparseRows, StructureTest
from rotary_error_monitor.gap.table import Shapes, TableProblem
from rotary_error_monitor.kinds.mount.advice import mount_advice
from rotary_error_monitor.kinds.mount.course import GROUP as TIME
from rotary_error_monitor.kinds.mount.course import POWERS, TimeCourses
from rotary_error_monitor.kinds.mount.description import MountDescription, MountGeometry
from rotary_error_monitor.kinds.mount.effects import MountEffect
from rotary_error_monitor.kinds.mount.modulations import mount_departures
from rotary_error_monitor.kinds.mount.periods import AxisPeriods
from rotary_error_monitor.kinds.mount.refraction import LOWEST
from rotary_error_monitor.kinds.mount.sky import MOST_OUTLIERS, estimate_repeatability, sky_conditions, sky_patches
from rotary_error_monitor.kinds.mount.slow_noise import (
    SAME_NOISE,
    SlowPointings,
    are_alike,
    root_mean_square,
    whitening,
    without_slow_courses,
)
from rotary_error_monitor.kinds.mount.twin import FEWEST_POINTINGS, MountRecording, MountTwin
from rotary_error_monitor.noise.slow_noise import SlowNoise
from rotary_error_monitor.units import ARCSEC

ORDERS = 4
"""Orders of either axis that are looked for in what is left: gears and runout of a mount's axes make one to three."""

ANOTHER_MOUNT = np.radians(3.0)
"""A rigid mount that misses its stars by this much at the median is another one."""

BELOW = np.radians(-2.0)
"""Altitude without refraction below which no star is seen: the air lifts those at the horizon by 0.6°, from a high
mountain it lies a degree and a half lower."""

MOST_EVALUATIONS = 100
"""Evaluations of a fit of the geometry: 15 do as a rule, and beside a cause of no sensible size it has no end."""

_GEOMETRY_STEP = 1e-6
"""Step of numerical derivatives, rad, 0.2 arcsec: far above rounding, and curvature makes a millionth of it."""


class MountProblem(TableProblem[MountGeometry]):
    """Pointings of a mount beside its twin; where each star was found, against zero.

    Args:
        mount: the description that the twin has.
        recording: readings and stars.
        effects: the known effects.
        known: effects that the twin has.

    Raises:
        InputError: stars stand below the horizon, or too few well above it.

    Attributes:
        recording: the pointings, arranged patch after patch of the sky.
        labels: (n,) number of the group of patches that a pointing is left out with.
        std: (2,) noise of a pointing along each way, rad.
        kept: (n,) pointings that are no outliers.
        slow: for each way (n, q) one standard deviation of each slow course of the noise, in that of `std`.
    """

    names = MappingProxyType({"hour": "/mount/pointing.hour_angle", "declination": "/mount/pointing.declination"})
    unit = ("arcsec", ARCSEC)
    m_open = True

    def __init__(
        self,
        mount: MountDescription,
        recording: MountRecording,
        effects: Sequence[MountEffect],
        known: Sequence[Cause] = (),
    ) -> None:
        patches = sky_patches(recording.readings)
        conditions = sky_conditions(patches)
        self.mount = mount
        self.recording = recording.chosen(np.concatenate(patches))
        self.twin = MountTwin(mount, self.recording, known)
        self.labels = np.repeat(conditions.labels, [len(patch) for patch in patches])
        self._check_altitudes()
        self._courses = TimeCourses(self.recording.time, self.twin.side)
        poses = [shape for group, rows in self.shapes().items() if group != TIME for _, shape in rows]
        turned = np.stack([np.cos(self.recording.stars[:, 1]), self.twin.side])
        axes = zip(("hour angle", "declination"), self.recording.readings.T, turned, strict=True)
        self._periods = {name: AxisPeriods(position, moved, ORDERS) for name, position, moved in axes}
        self._slow_pointings = SlowPointings(self.recording, turned, np.stack(poses, axis=1), mount.noise)
        self._found_without: Array = np.zeros(6)
        still, std = np.zeros((2, len(self.labels))), np.full(2, mount.noise)
        super().__init__(self.twin.machine, conditions, still, std, effects, known)
        self.slow: tuple[Array, ...] = (without_slow_courses(len(self.labels)),) * 2
        self._learn(*self._repeatability(()), self.slow)

    def predict(self, state: MountGeometry, causes: Sequence[Cause]) -> Array:
        """(2, n) pointing minus star, rad, with this geometry."""
        return -self.twin.error(state, causes)

    def departures(self, causes: Sequence[Cause]) -> tuple[Departures, ...]:
        """Ways in which each cause may depart from its textbook form."""
        units, found = dict(zip(self.channels, map(float, self.std), strict=True)), []
        for i, cause in enumerate(causes):
            # What is modulated is what the cause does, not what slow noise leaves to be seen of it.
            own = super().white(self.derivative(cause, cause.effect.indices(Role.LINEAR), causes))
            plain = mount_departures(self.twin, i, cause, own, units)
            found.append(replace(plain, columns=self._beside_slow_noise(plain.columns)))
        return tuple(found)

    def white(self, values: Array) -> Rows:
        """White rows (n, p) of values (2, n, p): slow noise as well."""
        return self._beside_slow_noise(super().white(values))

    def without_slow_noise(self, columns: Columns) -> Columns | None:
        """Columns as they would be beside white noise alone; None where that is what they are."""
        if not any(courses.shape[1] for courses in self.slow):
            return None
        assert not isinstance(columns, LateRows)
        rows = columns.rows if isinstance(columns, SparseRows) else columns
        plain = {c: slow.plain(rows[c]) for c, slow in zip(self.channels, self._slow_noise, strict=True) if c in rows}
        return replace(columns, rows=plain) if isinstance(columns, SparseRows) else plain

    def nuisance(self, causes: Sequence[Cause]) -> Rows:
        """White rows of one standard uncertainty of each angle of the geometry."""
        return self.white(self._moved(causes))

    def _moved(self, causes: Sequence[Cause]) -> Array:
        """(2, n, 6) change of the prediction by one standard uncertainty of each angle of the geometry, rad."""
        geometry, uncertainty = self.settled(causes), self.mount.geometry_uncertainty()
        base, columns = self.twin.error(geometry, causes), []
        for step, size in zip(_GEOMETRY_STEP * np.eye(6), uncertainty, strict=True):
            moved = self.twin.error(geometry.plus(tuple(step)), causes)
            columns.append((base - moved) * (size / _GEOMETRY_STEP))
        return np.stack(columns, axis=2)

    def candidates_of(self, effect: AnyEffect) -> Iterator[Candidate]:
        """One effect at every place, harmonics at every order."""
        assert isinstance(effect, MountEffect)
        places, orders = effect.locations(self.twin.machine), effect.harmonic_orders
        trials = len(places) * len(orders)
        for place, order in itertools.product(places, orders):
            start = effect.start(place)
            if order:
                start[effect.slices()["order"]] = order
            yield Candidate(effect, place, start, -float(np.log(trials)))

    def quantities(self) -> Mapping[str, Array]:
        """Hour angle, declination, altitude and time, in the units that people use."""
        time, (hour, declination) = self.recording.time, np.degrees(self.recording.readings.T)
        return {
            "hour axis, °": hour,
            "declination axis, °": declination,
            "altitude, °": np.degrees(np.arcsin(self.twin.seen[2])),
            "time, h": (time - time.min()) / 3600,
        }

    def shapes(self) -> Shapes:
        """Smooth functions of both readings, side, altitude, time and direction."""
        (hour, declination), direction, upward = self.recording.readings.T, self.recording.direction, self.twin.seen[2]
        time = (self.recording.time - self.recording.time.mean()) / max(float(np.ptp(self.recording.time)), 1.0)
        waves = [
            [
                (f"order {k}, {wave.__name__}", wave(k * angle))
                for k in range(1, ORDERS + 1)
                for wave in (np.cos, np.sin)
            ]
            for angle in (hour, declination)
        ]
        products = [
            (f"{a.__name__} of hour angle, {b.__name__} of declination", a(hour) * b(declination))
            for a, b in itertools.product((np.cos, np.sin), repeat=2)
        ]
        return {
            "pose, hour angle": waves[0],
            "pose, declination": waves[1],
            "pose, both axes": products,
            "pose, side of the pier": [("step", self.twin.side), ("slope", self.twin.side * hour)],
            "pose, altitude": [("sine", upward), ("cosine", np.sqrt(np.maximum(1 - upward**2, 0)))],
            TIME: [(f"power {k}", time**k) for k in range(1, POWERS + 1)],
            "direction": [("of hour axis", direction[:, 0]), ("of declination axis", direction[:, 1])],
        }

    def structure(self, rest: Rows) -> list[StructureTest]:
        """Tests of every shape, of courses in time, and of short periods of each axis along its way."""
        found = []
        for channel, slow in zip(self.channels, self._slow_noise, strict=True):
            for group, rows in self.shapes().items():
                if group != TIME:
                    seen = slow.whiten(np.stack([shape for _, shape in rows], axis=1))
                    white = {group: [(name, seen[:, i]) for i, (name, _) in enumerate(rows)]}
                    found += self.findings({channel: rest[channel]}, white)
            found.append(self._courses.findings(rest[channel][:, 0], self.kept, channel, slow))
        for channel, (words, periods) in zip(self.channels, self._periods.items(), strict=True):
            found.append(periods.finding(rest[channel][:, 0], self.kept, channel, words))
        return found

    def learn_noise(self, causes: Sequence[Cause]) -> bool:
        """Estimate again how well the mount repeats, the causes taken out; whether the rows have changed by it."""
        std, kept, slow = self._noise_beside(causes)
        same = np.all(np.abs(std / self.std - 1) < SAME_NOISE) and all(map(are_alike, slow, self.slow))
        if same and np.array_equal(kept, self.kept):
            return False
        self._learn(std, kept, slow)
        return True

    def check_plausible(self) -> None:
        """Refuse a recording that no rigid mount comes near to.

        Raises:
            InputError: the readings are not of a mount like the twin.
        """
        off = float(np.median(np.hypot(*self.error(()))))
        if off > ANOTHER_MOUNT:
            raise InputError(
                f"the twin is off by {np.degrees(off):.1f}° at the median, whatever its geometry: "
                "the recording is not of an equatorial mount, or its latitude is wrong"
            )

    def shown(self, causes: Sequence[Cause]) -> Array:
        """(2, n) what the causes do to the pointing beyond what geometry can do, rad."""
        geometry, table = self.settled(causes), self._kept_rows(self._moved(causes))
        rows = np.concatenate(list(self.twin.error(geometry) - self.twin.error(geometry, causes)))
        fitted, *_ = np.linalg.lstsq(table, rows, rcond=None)
        return np.asarray((rows - table @ fitted).reshape(2, -1), np.float64)

    def _kept_rows(self, values: Array) -> Array:
        """(2 n, p) both ways of values (2, n, p), rad, one after the other; 0 for outliers."""
        return np.concatenate(list(values * self.kept[:, None]))

    def advice(self, keys: Sequence[tuple[str, str]], causes: Sequence[Cause]) -> str:
        """Pointings that would tell effects apart."""
        first, rivals = next(c for c in causes if c.key == tuple(keys[0])), [self.at_zero(key) for key in keys[1:]]
        return mount_advice(self.twin, self.settled((first,)), self.std, first, rivals)

    def remarks(self, rest: Rows) -> tuple[str, ...]:
        """Noise as found, and outliers that were left out."""
        hour, declination = self.std * ARCSEC
        slow = self.std * [root_mean_square(own) for own in self.slow] * ARCSEC
        words = f"neighbouring pointings differ by {hour:.1f}″ in hour angle and {declination:.1f}″ in declination: "
        shared = f"{slow[0]:.1f}″ in hour angle and {slow[1]:.1f}″ in declination are shared"
        lost = int(np.count_nonzero(~self.kept & ~self.twin.too_low))
        return (
            words + "that is taken for noise",
            *([f"{shared} by pointings one after the other: that is noise as well"] if np.any(slow) else []),
            *([f"{self._low_in_words()}; they were left out"] if np.any(self.twin.too_low) else []),
            *([f"{lost} of {len(self.kept)} pointings are outliers and were left out"] if lost else []),
        )

    def figures(self, causes: Sequence[Cause]) -> Mapping[str, float]:
        """Root mean squares on the sky, arcsec, of patches predicted from all others; noise; and the geometry itself.

        With indices only, all of the geometry, and the causes too. Sums of squares of both ways, as pointing analysis
        gives its `sky RMS`; outliers are left out.
        """
        plain, geometry = self._kept_rows(self._moved(())), self.settled(causes)
        indices = self.mount.geometry.plus((*self.settled(()).as_tuple()[:2], 0.0, 0.0, 0.0, 0.0))
        found = {
            "held_out_indices_arcsec": self._held_out(self.twin.error(indices), plain[:, :2]),
            "held_out_geometry_arcsec": self._held_out(self.error(()), plain),
        }
        if causes:
            linear = [cause.effect.indices(Role.LINEAR) for cause in causes]
            own = [self._kept_rows(self.derivative(c, i, causes)) for c, i in zip(causes, linear, strict=True)]
            sizes = np.concatenate([cause.values[i] for cause, i in zip(causes, linear, strict=True)])
            columns = np.concatenate([self._kept_rows(self._moved(causes)), *own], axis=1)
            added = (columns[:, 6:] @ sizes).reshape(2, -1)
            found["held_out_causes_arcsec"] = self._held_out(self.twin.error(geometry, causes) + added, columns)
        found["noise_arcsec"] = float(np.hypot(*self._noise) * ARCSEC)
        names = ("hour_index", "declination_index", "orthogonality", "collimation", "polar_tilt_x", "polar_tilt_y")
        angles = np.array(geometry.as_tuple()) * ARCSEC
        return found | {f"{name}_arcsec": float(angle) for name, angle in zip(names, angles, strict=True)}

    def _held_out(self, error: Array, columns: Array) -> float:
        """Root mean square on the sky, arcsec, of (2, n) less what columns (2 n, p) do, fitted on the other patches.

        Both ways count alike, as they do in the figure.
        """
        kept, values = np.tile(self.kept, 2), error.ravel()
        table, left = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300), np.zeros(len(values))
        for label in np.unique(self.labels):
            test = np.tile(self.labels == label, 2)
            train = kept & ~test
            fitted, *_ = np.linalg.lstsq(table[train], values[train], rcond=None)
            left[test] = (values - table @ fitted)[test]
        return float(np.sqrt(np.sum(np.square(left[kept])) / self.kept.sum()) * ARCSEC)

    def settle(self, causes: Sequence[Cause]) -> MountGeometry:
        """The six angles that fit best beside causes of these sizes."""
        uncertainty = np.array(self.mount.geometry_uncertainty())

        def misfit(moved: Array) -> Array:
            geometry = self.mount.geometry.plus(tuple(moved * uncertainty))
            white = self.white(self.twin.error(geometry, causes)[:, :, None])
            return np.concatenate([*(white[channel][:, 0] for channel in self.channels), moved])

        start = self._found_without / uncertainty
        found = least_squares(misfit, start, x_scale="jac", method="lm", max_nfev=MOST_EVALUATIONS)
        if not causes:
            self._found_without = found.x * uncertainty
        return self.mount.geometry.plus(tuple(float(value) for value in found.x * uncertainty))

    @property
    def _noise(self) -> Array:
        """(2,) standard deviation of noise along each way, slow noise counted, rad."""
        return np.asarray(self.std * np.hypot(1.0, [root_mean_square(own) for own in self.slow]), np.float64)

    @cached_property
    def _slow_noise(self) -> tuple[SlowNoise, ...]:
        return tuple(whitening(courses, self.kept) for courses in self.slow)

    def _beside_slow_noise(self, columns: Columns) -> Rows:
        assert isinstance(columns, dict)
        return {c: slow.whiten(columns[c]) for c, slow in zip(self.channels, self._slow_noise, strict=True)}

    def _learn(self, std: Array, kept: NDArray[np.bool_], slow: tuple[Array, ...]) -> None:
        self.std, self.kept, self.slow = std, kept, slow
        self.__dict__.pop("_slow_noise", None)
        self._settled.clear()

    def _noise_beside(self, causes: Sequence[Cause]) -> tuple[Array, NDArray[np.bool_], tuple[Array, ...]]:
        """Noise (2,) of a pointing along each way, rad, pointings (n,) that are kept, and slow noise beside that."""
        std, kept = self._repeatability(causes)
        known, angles = KnownEffects(self, causes, self.residual(causes)), self._moved(causes)
        found = [
            self._slow_pointings.noise_along(
                way, errors, float(std[way]), kept, angles[way], known, partial(self._shown_along, way)
            )
            for way, errors in enumerate(self.error(causes))
        ]
        return np.array([level for level, _ in found]), kept, tuple(slow for _, slow in found)

    def _shown_along(self, way: int, std: float, columns: Columns) -> Array:
        """(n, p) of columns along one way, beside white noise alone of that level.

        What moves the tube along this way by less of what it does along the other than causes depart by shows there: it
        goes with the errors themselves, since the ways are those at the star, and would describe them all.
        """
        plain = self.without_slow_noise(columns) or columns
        assert isinstance(plain, dict)
        sizes = [np.linalg.norm(plain[c], axis=0) * level for c, level in zip(self.channels, self.std, strict=True)]
        shows = sizes[way] > SHARE * sizes[1 - way]
        return np.asarray(plain[self.channels[way]] * (shows * float(self.std[way] / std)), np.float64)

    def _repeatability(self, causes: Sequence[Cause]) -> tuple[Array, NDArray[np.bool_]]:
        errors = self.error(causes).T
        on_sky, kept = estimate_repeatability(errors, self._slow_pointings.places)
        kept &= ~self.twin.too_low
        return np.maximum(self._courses.noise(errors, on_sky, kept), self.mount.noise), kept

    def _check_altitudes(self) -> None:
        sunk = int(np.count_nonzero(np.arcsin(np.clip(self.twin.sought[2], -1.0, 1.0)) < BELOW))
        if sunk > MOST_OUTLIERS * len(self.labels):  # fewer are single mistakes
            raise InputError(
                f"{sunk} of {len(self.labels)} stars stand below the horizon at the latitude of "
                f"{np.degrees(self.twin.latitude):+.1f}°: its sign, or sidereal time, is wrong"
            )
        if int(np.count_nonzero(~self.twin.too_low)) < FEWEST_POINTINGS:
            raise InputError(f"{self._low_in_words()}; at least {FEWEST_POINTINGS} others are needed")

    def _low_in_words(self) -> str:
        low, count, lowest = np.count_nonzero(self.twin.too_low), len(self.twin.too_low), np.degrees(LOWEST)
        return f"{low} of {count} pointings are lower than {lowest:.0f}°, where refraction is not known well enough"
