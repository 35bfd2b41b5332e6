"""A two-axis mount as a problem of diagnosis: the rows are where each star was found, along the ways of both axes.

Nobody knows how a mount was set up: its six angles are sought in the recording, beside the causes, whenever those
change. They are the nuisances of the diagnosis; what only they can explain is no gap.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from rotary_error_monitor.effects.effect import Cause, Role, among
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.gap.departures import Departures
from rotary_error_monitor.gap.problem import Array, Candidate, Conditions, Finding, Rows, Share
from rotary_error_monitor.gap.views import View
from rotary_error_monitor.kinds.mount.description import MountDescription, MountGeometry
from rotary_error_monitor.kinds.mount.effects import MountEffect
from rotary_error_monitor.kinds.mount.modulations import mount_departures
from rotary_error_monitor.kinds.mount.sky import estimate_repeatability, sky_conditions, sky_patches
from rotary_error_monitor.kinds.mount.twin import MountRecording, MountTwin
from rotary_error_monitor.kinds.mount.where import (
    mount_advice,
    mount_figures,
    mount_structure,
    mount_views,
    mount_where,
)

CHANNELS = ("hour", "declination")

ANOTHER_MOUNT = np.radians(3.0)
"""A rigid mount that misses its stars by this much at the median is another one."""

SAME_NOISE = 0.05
"""Relative change of the noise that is not worth looking at all rows again."""

MOST_EVALUATIONS = 100
"""Evaluations of a fit of the geometry: 15 do as a rule, and beside a cause of no sensible size it has no end."""

_STEP = 1e-2
"""Step of numerical derivatives in usual sizes, some µrad: mounts are linear over it to one part in 10^5."""

_GEOMETRY_STEP = 1e-6


class MountProblem:
    """Pointings of a mount beside its twin.

    Args:
        mount: the description that the twin has.
        recording: readings and stars.
        effects: the known effects.
        known: effects that the twin has.

    Attributes:
        recording: the pointings, arranged patch after patch of the sky.
        labels: (n,) number of the group of patches that a pointing is left out with.
        std: (2,) noise of a pointing along each way, rad.
        kept: (n,) pointings that are no outliers.
    """

    channels = CHANNELS
    m_open = True

    def __init__(
        self,
        mount: MountDescription,
        recording: MountRecording,
        effects: Sequence[MountEffect],
        known: Sequence[Cause] = (),
    ) -> None:
        patches = sky_patches(recording.readings)
        self.mount = mount
        self.recording = recording.chosen(np.concatenate(patches))
        self.effects = tuple(effects)
        self.known = tuple(known)
        self.twin = MountTwin(mount, self.recording, known)
        self._conditions = sky_conditions(patches)
        self.labels = np.repeat(self._conditions.labels, [len(patch) for patch in patches])
        self._index = np.arange(len(recording.time), dtype=np.float64)
        self._geometries: dict[tuple[tuple[str, str, bytes], ...], MountGeometry] = {}
        self._found_without: Array = np.zeros(6)
        self.std: Array = np.full(2, mount.noise)
        self.kept: NDArray[np.bool_] = np.ones(len(self._index), bool)
        self.std, self.kept = self._repeatability(())
        self._geometries.clear()

    @property
    def conditions(self) -> Conditions:
        """Patches of the sky on each side of the pier."""
        return self._conditions

    def times(self, channel: str) -> Array:
        """(n,) number of each pointing."""
        return self._index

    def expected(self, channel: str) -> Array:
        """(n,) 1 for pointings that count, 0 for outliers."""
        return self.kept.astype(np.float64)

    def geometry(self, causes: Sequence[Cause]) -> MountGeometry:
        """The six angles that fit best beside causes of these sizes."""
        fitted = tuple(c for c in causes if np.any(c.values[c.effect.indices(Role.LINEAR)]))
        key = tuple((*cause.key, cause.values.tobytes()) for cause in fitted)
        if key not in self._geometries:
            self._geometries[key] = self._fit_geometry(fitted)
        return self._geometries[key]

    def error(self, causes: Sequence[Cause]) -> Array:
        """(2, n) star minus pointing, rad, the geometry fitted."""
        return self.twin.error(self.geometry(causes), causes)

    def residual(self, causes: Sequence[Cause]) -> Rows:
        """White rows (n, 1) of star minus pointing."""
        return self._rows(self.error(causes)[:, :, None])

    def signature(self, cause: Cause, indices: Sequence[int], others: Sequence[Cause] = ()) -> Rows:
        """White rows of the derivative of the pointing with respect to values of `cause`, beside `others`."""
        causes, columns = among(cause, others), []
        geometry = self.geometry(causes)
        base = self.twin.error(geometry, causes)
        for index in indices:
            step = cause.effect.inward(cause.values, index, _STEP * float(cause.effect.scales()[index]))
            values = cause.values.copy()
            values[index] += step
            columns.append((base - self.twin.error(geometry, among(cause.with_values(values), others))) / step)
        return self._rows(np.stack(columns, axis=2))

    def distortions(self, candidates: Sequence[Candidate], causes: Sequence[Cause]) -> Sequence[float]:
        """None: errors this small add up, whatever else is wrong."""
        return [0.0] * len(candidates)

    def departures(self, causes: Sequence[Cause]) -> tuple[Departures, ...]:
        """Ways in which each cause may depart from its textbook form."""
        return tuple(mount_departures(self, i, causes) for i in range(len(causes)))

    def nuisance(self, causes: Sequence[Cause]) -> Rows:
        """White rows of one standard uncertainty of each angle of the geometry."""
        geometry, uncertainty = self.geometry(causes), self.mount.geometry_uncertainty()
        base, columns = self.twin.error(geometry, causes), []
        for step, size in zip(_GEOMETRY_STEP * np.eye(6), uncertainty, strict=True):
            moved = self.twin.error(geometry.plus(tuple(step)), causes)
            columns.append((base - moved) * (size / _GEOMETRY_STEP))
        return self._rows(np.stack(columns, axis=2))

    def candidates(self, rest: Rows, causes: Sequence[Cause]) -> tuple[Candidate, ...]:
        """Every effect at every place, harmonics at every order."""
        return tuple(candidate for effect in self.effects for candidate in self._of(effect))

    def structure(self, rest: Rows) -> list[Finding]:
        """Tests of what is left against smooth functions of both readings, side, altitude, time and direction."""
        return mount_structure(self, rest)

    def learn_noise(self, causes: Sequence[Cause], findings: Sequence[Finding]) -> bool:
        """Estimate again how well the mount repeats, the causes taken out; whether the rows have changed by it."""
        std, kept = self._repeatability(causes)
        if np.all(np.abs(std / self.std - 1) < SAME_NOISE) and np.array_equal(kept, self.kept):
            return False
        self.std, self.kept = std, kept
        self._geometries.clear()
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

    def where(self, causes: Sequence[Cause], rest: Rows, explained: bool) -> list[Share]:
        """Shares of the two ways."""
        return mount_where(self, causes, rest, explained)

    def advice(self, keys: Sequence[tuple[str, str]], causes: Sequence[Cause]) -> str:
        """Pointings that would tell effects apart."""
        return mount_advice(self, keys, causes)

    def remarks(self, rest: Rows) -> tuple[str, ...]:
        """Noise as found, and outliers that were left out."""
        arcsec = np.degrees(self.std) * 3600
        words = f"neighbouring pointings differ by {arcsec[0]:.1f}″ in hour angle and {arcsec[1]:.1f}″ in declination: "
        lost = int(np.count_nonzero(~self.kept))
        return (
            *self.recording.remarks,
            words + "that is taken for noise",
            *([f"{lost} of {len(self.kept)} pointings are outliers and were left out"] if lost else []),
        )

    def views(self, channels: Sequence[str], causes: Sequence[Cause]) -> list[View]:
        """Residuals over hour angle, declination, altitude and time, before and after the causes, in arcsec."""
        return mount_views(self, channels, causes)

    def figures(self, causes: Sequence[Cause]) -> Mapping[str, float]:
        """Root mean squares on patches left out, in arcsec: indices only, all of the geometry, and the causes too."""
        return mount_figures(self, causes)

    def at_zero(self, key: tuple[str, str]) -> Cause:
        """An effect without size, of the lowest order if it has orders."""
        effect = next(e for e in self.effects if e.name == key[0])
        return next(c for c in self._of(effect) if c.location == key[1]).cause(
            np.zeros(len(effect.indices(Role.LINEAR)))
        )

    def _rows(self, values: Array) -> Rows:
        white = values / self.std[:, None, None] * self.kept[None, :, None]
        return {channel: white[i] for i, channel in enumerate(CHANNELS)}

    def _of(self, effect: MountEffect) -> Iterator[Candidate]:
        places = effect.locations(self.twin.machine)
        orders: tuple[int, ...] = getattr(effect, "harmonic_orders", (0,))
        for place in places:
            for order in orders:
                start = effect.start(place)
                if order:
                    start[effect.slices()["order"]] = order
                trials = len(places) * len(orders)
                yield Candidate(effect, place, start, trials, -float(np.log(trials)))

    def _fit_geometry(self, causes: Sequence[Cause]) -> MountGeometry:
        uncertainty = np.array(self.mount.geometry_uncertainty())

        def misfit(moved: Array) -> Array:
            geometry = self.mount.geometry.plus(tuple(moved * uncertainty))
            white = self.twin.error(geometry, causes) / self.std[:, None] * self.kept
            return np.concatenate([white.ravel(), moved])

        start = self._found_without / uncertainty
        found = least_squares(misfit, start, x_scale="jac", method="lm", max_nfev=MOST_EVALUATIONS)
        if not causes:
            self._found_without = found.x * uncertainty
        return self.mount.geometry.plus(tuple(float(value) for value in found.x * uncertainty))

    def _repeatability(self, causes: Sequence[Cause]) -> tuple[Array, NDArray[np.bool_]]:
        time = self.recording.time / max(float(np.ptp(self.recording.time)), 1.0)
        places = np.column_stack([self.recording.readings, time])
        found, kept = estimate_repeatability(self.error(causes).T, places)
        return np.maximum(found, self.mount.noise), kept
