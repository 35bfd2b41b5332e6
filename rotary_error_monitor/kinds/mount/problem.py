"""A two-axis mount as a problem of diagnosis: the rows are where each star was found, along the ways of both axes.

Nobody knows how a mount was set up: its six angles are sought in the recording, beside the causes, whenever those
change. They are the nuisances of the diagnosis; what only they can explain is no gap.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from rotary_error_monitor.effects.effect import AnyEffect, Cause
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.gap.departures import Departures
from rotary_error_monitor.gap.problem import Array, Candidate, Finding, Rows
from rotary_error_monitor.gap.table import Shapes, TableProblem
from rotary_error_monitor.kinds.mount.description import MountDescription, MountGeometry
from rotary_error_monitor.kinds.mount.effects import MountEffect
from rotary_error_monitor.kinds.mount.modulations import mount_departures
from rotary_error_monitor.kinds.mount.sky import estimate_repeatability, sky_conditions, sky_patches
from rotary_error_monitor.kinds.mount.twin import MountRecording, MountTwin
from rotary_error_monitor.kinds.mount.where import (
    ARCSEC,
    WAYS,
    mount_advice,
    mount_figures,
    mount_quantities,
    mount_shapes,
)

ANOTHER_MOUNT = np.radians(3.0)
"""A rigid mount that misses its stars by this much at the median is another one."""

SAME_NOISE = 0.05
"""Relative change of the noise that is not worth looking at all rows again."""

MOST_EVALUATIONS = 100
"""Evaluations of a fit of the geometry: 15 do as a rule, and beside a cause of no sensible size it has no end."""

_GEOMETRY_STEP = 1e-6


class MountProblem(TableProblem[MountGeometry]):
    """Pointings of a mount beside its twin; where each star was found, against zero.

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

    names = WAYS
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
        self._found_without: Array = np.zeros(6)
        still, std = np.zeros((2, len(self.labels))), np.full(2, mount.noise)
        super().__init__(self.twin.machine, conditions, still, std, effects, known)
        self._learn(*self._repeatability(()))

    def geometry(self, causes: Sequence[Cause]) -> MountGeometry:
        """The six angles that fit best beside causes of these sizes."""
        return self.settled(causes)

    def predict(self, state: MountGeometry, causes: Sequence[Cause]) -> Array:
        """(2, n) pointing minus star, rad, with this geometry."""
        return -self.twin.error(state, causes)

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
        return self.white(np.stack(columns, axis=2))

    def candidates_of(self, effect: AnyEffect) -> Iterator[Candidate]:
        """One effect at every place, harmonics at every order."""
        assert isinstance(effect, MountEffect)
        places, orders = effect.locations(self.twin.machine), effect.harmonic_orders
        trials = len(places) * len(orders)
        for place, order in itertools.product(places, orders):
            start = effect.start(place)
            if order:
                start[effect.slices()["order"]] = order
            yield Candidate(effect, place, start, trials, -float(np.log(trials)))

    def quantities(self) -> Mapping[str, Array]:
        """Hour angle, declination, altitude and time."""
        return mount_quantities(self)

    def shapes(self) -> Shapes:
        """Smooth functions of both readings, side, altitude, time and direction."""
        return mount_shapes(self.recording, self.twin.seen[2])

    def learn_noise(self, causes: Sequence[Cause], findings: Sequence[Finding]) -> bool:
        """Estimate again how well the mount repeats, the causes taken out; whether the rows have changed by it."""
        std, kept = self._repeatability(causes)
        if np.all(np.abs(std / self.std - 1) < SAME_NOISE) and np.array_equal(kept, self.kept):
            return False
        self._learn(std, kept)
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
        geometry, table = self.geometry(causes), self.geometry_columns(causes)
        change = self.twin.error(geometry) - self.twin.error(geometry, causes)
        rows = np.concatenate(list(change))
        fitted, *_ = np.linalg.lstsq(table, rows, rcond=None)
        return np.asarray((rows - table @ fitted).reshape(2, -1), np.float64)

    def geometry_columns(self, causes: Sequence[Cause]) -> Array:
        """(2 n, 6) derivatives of the pointing with respect to the geometry, in its uncertainties, not whitened."""
        rows = self.nuisance(causes)
        return np.concatenate([rows[c] * std for c, std in zip(self.channels, self.std, strict=True)])

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

    def figures(self, causes: Sequence[Cause]) -> Mapping[str, float]:
        """Root mean squares on patches left out, in arcsec: indices only, all of the geometry, and the causes too."""
        return mount_figures(self, causes)

    def settle(self, causes: Sequence[Cause]) -> MountGeometry:
        """The six angles that fit best beside causes of these sizes."""
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

    def _learn(self, std: Array, kept: NDArray[np.bool_]) -> None:
        self.std, self.kept = std, kept
        self._settled.clear()

    def _repeatability(self, causes: Sequence[Cause]) -> tuple[Array, NDArray[np.bool_]]:
        time = self.recording.time / max(float(np.ptp(self.recording.time)), 1.0)
        places = np.column_stack([self.recording.readings, time])
        found, kept = estimate_repeatability(self.error(causes).T, places)
        return np.maximum(found, self.mount.noise), kept
