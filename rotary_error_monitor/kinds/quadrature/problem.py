"""Sine and cosine signals as a problem of diagnosis: the rows are the mean radius in narrow cells of the circle.

Without a reference of position the phase itself cannot be tested, but whatever makes it wrong moves the radius too.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from rotary_error_monitor.arrays import Array, Complex
from rotary_error_monitor.effects.effect import AnyEffect, Cause, Role
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.gap.p_values import log_chi_square_tail, log_normal_tail
from rotary_error_monitor.gap.problem import Candidate, Rows, Share, StructureTest
from rotary_error_monitor.gap.table import TableProblem, acting, folded
from rotary_error_monitor.kinds.quadrature.description import QuadratureDescription
from rotary_error_monitor.kinds.quadrature.effects import QuadratureEffect
from rotary_error_monitor.kinds.quadrature.passes import loudest_octave
from rotary_error_monitor.kinds.quadrature.rounding import are_whole, rounding_variance
from rotary_error_monitor.kinds.quadrature.twin import QuadratureRecording, predict_radius, true_phase

SECTORS, FOLDS = 24, 6
CELLS = 1440
"""Cells of the circle, a quarter of a degree wide: narrow beside every order, and beside the corner of a limit."""

WIDE_CELLS = 360
"""Cells in which the scatter about a line is noise."""

ORDERS = 16
PLACES = 180
TELLING = 0.02
OUTLIER = 8.0
AROUND = 9
"""Samples on the circle whose median a sample is held against: up to four that are wrong do not move it."""

NINE_TENTHS = 1.6449
"""Nine tenths of normal numbers are closer to zero than this many standard deviations."""

OFF = 0.5
"""Mean radius, in amplitudes off the twin's, from which the twin is of other signals."""


class QuadratureProblem(TableProblem[float]):
    """Signals beside their twin: the mean radius of each cell that holds a sample, in rising order of its phase.

    Args:
        description: that the twin has.
        recording: the samples.
        effects: the known effects.
        known: effects that the twin has.

    Attributes:
        samples: (n,) all signals, those that are outliers left out, cosine + i sine.
        signals: (m,) mean signal of each cell, at the mean phase.
        scatter: noise of the radius of one sample, counts.
        std: (1,) the same, as loud as it is over some degrees of the circle.
    """

    names = MappingProxyType({"radius": "/quadrature/signals.radius"})
    unit = ("counts", 1.0)
    m_open = True

    def __init__(
        self,
        description: QuadratureDescription,
        recording: QuadratureRecording,
        effects: Sequence[QuadratureEffect],
        known: Sequence[Cause] = (),
    ) -> None:
        self.description = description
        self.recording = recording
        scatter, kept = radius_scatter(recording.signals, description.noise)
        self.samples = recording.signals[kept]
        noise = max(scatter, description.noise)
        self.phase, self.radius, cells = _cell_means(self.samples)
        self.signals = self.radius * np.exp(1j * self.phase)
        count = np.bincount(cells).astype(np.float64)
        self.scatter, noise = noise, noise * float(np.sqrt(loudest_octave(self.samples, cells)))
        rounding = rounding_variance(self.samples, cells, scatter) if are_whole(self.samples) else 0.0
        self._scale: Array = 1 / np.sqrt(noise**2 / count + rounding)
        sectors = folded(np.linspace(0, len(count), SECTORS + 1), FOLDS, "sectors")
        real, imaginary = self.samples.real, self.samples.imag
        self._ends = (real.max(), -real.min(), imaginary.max(), -imaginary.min())
        super().__init__(description, sectors, self.radius[None], np.array([noise]), effects, known)

    def settle(self, causes: Sequence[Cause]) -> float:
        """Radius of the ideal circle, counts, that fits best."""
        best = float(np.mean(self.radius))
        for _ in range(3):
            column = self._scale * self._grown(best, causes)
            left = self._scale * (self.radius - self._predicted(best, causes))
            best += float(column @ left / (column @ column))
        return best

    def predict(self, state: float, causes: Sequence[Cause]) -> Array:
        """(1, m) radius of the twin with this amplitude, counts."""
        return self._predicted(state, causes)[None]

    def white(self, values: Array) -> Rows:
        """White rows of values (1, m, p): those of means of many samples."""
        return {"radius": values[0] * self._scale[:, None]}

    def distortions(self, candidates: Sequence[Candidate], causes: Sequence[Cause]) -> Sequence[float]:
        """Where signals are cut off, a gain shows all otherwise."""
        effects = [candidate.effect for candidate in candidates]
        beside = [bool(causes) and isinstance(effect, QuadratureEffect) and effect.rescales for effect in effects]
        return [np.inf if renewed else 0.0 for renewed in beside]

    def nuisance(self, causes: Sequence[Cause]) -> Rows:
        """White rows (m, 1) of one standard uncertainty of the amplitude."""
        column = self._grown(self.settled(causes), causes)
        return self.white(self.description.uncertainty * column[None, :, None])

    def candidates_of(self, effect: AnyEffect) -> Iterator[Candidate]:
        """One effect; harmonics of every order; clipping where the samples end."""
        for candidate in super().candidates_of(effect):
            if isinstance(effect, QuadratureEffect) and effect.ends:
                candidate.start[effect.slices()["level"]] = self._ends
            yield candidate

    def quantities(self) -> Mapping[str, Array]:
        """The phase, once round and folded to a quarter."""
        degrees = np.degrees(self.phase)
        return {"phase, °": degrees, "phase within a quarter, °": np.mod(degrees, 90.0)}

    def structure(self, rest: Rows) -> list[StructureTest]:
        """Tests of every order of the radius up to 16, and of every place on the circle."""
        white = rest["radius"][:, 0]
        findings = []
        for order in range(1, ORDERS + 1):
            waves = np.exp(1j * order * self.phase) * self._scale
            power = 2 * abs(np.dot(waves, white)) ** 2 / float(np.sum(np.square(self._scale)))
            chance = log_chi_square_tail(power, 2)
            findings.append(StructureTest("radius", "order", chance, max(0.0, power - 2), f"phase: order {order}"))
        place = (self.phase * PLACES / (2 * np.pi)).astype(np.intp) % PLACES
        squares = np.bincount(place, np.square(self._scale), PLACES)
        z = np.bincount(place, self._scale * white, PLACES) / np.sqrt(np.maximum(squares, 1e-300))
        best = int(np.argmax(np.abs(z)))
        chance = min(0.0, log_normal_tail(abs(float(z[best]))) + float(np.log(2 * PLACES)))
        words = f"phase: place {(best + 0.5) * 360 / PLACES:.0f}°"
        return [*findings, StructureTest("radius", "place", chance, max(0.0, float(z[best]) ** 2 - 1), words)]

    def check_plausible(self) -> None:
        """Refuse signals of another size.

        Raises:
            InputError: the circle is far larger or smaller than the twin says, or hardly any of its places were met.
        """
        met, fewest = len(np.unique((self.phase * WIDE_CELLS / (2 * np.pi)).astype(np.intp))), 2 * ORDERS + 1
        if met < fewest:
            raise InputError(
                f"the signals were at {met} of {WIDE_CELLS} degrees of the circle; expected {fewest} or more, "
                "twice the highest order of the radius and one: record while moving slowly over one period or more"
            )
        mean = float(np.mean(self.radius))
        if abs(mean - self.description.amplitude) > OFF * self.description.amplitude:
            raise InputError(
                f"the signals' mean radius is {mean:.4g} counts, the twin's amplitude is "
                f"{self.description.amplitude:.4g}: it is of other signals; set its amplitude"
            )

    def where(self, causes: Sequence[Cause], rest: Rows, explained: bool) -> list[Share]:
        """The radius, with the orders of phase that the gap depends on."""
        values = (self.error(()) - self.error(causes))[0] if explained else rest["radius"][:, 0] / self._scale
        weight = np.square(self._scale) / np.sum(np.square(self._scale))
        used = values - weight @ values
        floor = 0.0 if explained else float(np.sum(weight / np.square(self._scale)))
        power = float(weight @ np.square(used)) - floor
        if power <= 0:
            return []
        waves = np.exp(-1j * np.outer(np.arange(1, ORDERS + 1), self.phase))
        parts = 2 * np.square(np.abs(waves @ (weight * used))) / power
        told = [k for k in np.argsort(-parts)[:4] if parts[k] > TELLING]
        words = ", ".join(f"order {k + 1} ({min(parts[k], 1.0):.0%})" for k in told) or "no single order"
        return [
            Share(self.names["radius"], 1.0, float(np.sqrt(power)), float(self.std[0]), f"phase: {words}", self.unit)
        ]

    def advice(self, keys: Sequence[tuple[str, str]], causes: Sequence[Cause]) -> str:
        """What tells effects apart that have the same radius."""
        shares = [self._alike(tuple(keys[0]), key, causes) for key in keys[1:]]
        words = f"in radius alone they agree to {max(shares):.1%} of its change"
        return (
            f"move steadily over many periods and look at the phase itself, or change the signals' amplitude: {words}"
        )

    def remarks(self, rest: Rows) -> tuple[str, ...]:
        """Noise as found, and outliers that were left out."""
        louder = self.std[0] > self.scatter
        lost, count = len(self.recording.signals) - len(self.samples), len(self.recording.signals)
        return (
            f"the radius scatters by {self.scatter:.2f} counts at one phase: that is taken for noise",
            *([f"successive samples err alike: turns differ as by {self.std[0]:.2f} counts"] if louder else []),
            *([f"{lost} of {count} samples are outliers and were left out"] if lost else []),
        )

    def figures(self, causes: Sequence[Cause]) -> Mapping[str, float]:
        """Spread of the radius before and after, and what the causes do to the phase, in counts, rad and the unit."""
        amplitude, both = self.settled(causes), (*self.known, *causes)
        change = np.angle(np.exp(1j * true_phase(self.samples, amplitude, both)) * np.conj(self.samples))
        radius = np.abs(self.samples)
        before = radius - predict_radius(self.samples, self.settled(()), self.known)
        after = radius - predict_radius(self.samples, amplitude, both)
        per_radian = self.description.period / (2 * np.pi)
        return {
            "amplitude_counts": amplitude,
            "radius_std_before_counts": float(np.std(before)),
            "radius_std_after_counts": float(np.std(after)),
            "noise_counts": self.scatter,
            "phase_error_rms_rad": float(np.std(change)),
            "phase_error_largest_rad": float(np.max(np.abs(change))),
            "position_error_rms_nm": 1e9 * per_radian * float(np.std(change)),
            "position_error_largest_nm": 1e9 * per_radian * float(np.max(np.abs(change))),
        }

    def _predicted(self, amplitude: float, causes: Sequence[Cause]) -> Array:
        return predict_radius(self.signals, amplitude, (*self.known, *acting(causes)))

    def _grown(self, amplitude: float, causes: Sequence[Cause]) -> Array:
        """(m,) change of the radius with the amplitude."""
        step = 1e-4 * amplitude
        return np.asarray((self._predicted(amplitude + step, causes) - self._predicted(amplitude, causes)) / step)

    def _alike(self, first: tuple[str, ...], second: tuple[str, str], causes: Sequence[Cause]) -> float:
        """Part of the first's change of the radius that the second can make, beyond what the amplitude can."""
        cause, other = next(c for c in causes if c.key == first), self.at_zero(second)
        base = self.white(self._grown(self.settled(()), ())[None, :, None])["radius"][:, 0]

        def columns(of: Cause) -> Array:
            white = self.signature(of, of.effect.indices(Role.LINEAR))["radius"]
            return np.asarray(white - np.outer(base, base @ white / (base @ base)), np.float64)

        wanted, table = columns(cause) @ cause.values[cause.effect.indices(Role.LINEAR)], columns(other)
        fitted, *_ = np.linalg.lstsq(table, wanted, rcond=None)
        return max(0.0, 1 - float(np.sum(np.square(wanted - table @ fitted)) / np.sum(np.square(wanted))))


def _cell_means(samples: Complex) -> tuple[Array, Array, NDArray[np.intp]]:
    """(m,) mean phase and mean radius of each cell of the circle that holds samples, and (n,) number of each one's."""
    phase = np.mod(np.angle(samples), 2 * np.pi)
    place = np.minimum((phase * CELLS / (2 * np.pi)).astype(np.intp), CELLS - 1)
    _, cells, count = np.unique(place, return_inverse=True, return_counts=True)
    mean_phase, mean_radius = (np.bincount(cells, values) / count for values in (phase, np.abs(samples)))
    return mean_phase, mean_radius, cells.astype(np.intp)


def radius_scatter(signals: Complex, least: float = 0.0) -> tuple[float, NDArray[np.bool_]]:
    """Noise of the radius at one phase, counts, and (n,) no outlier: what lines through cells of the circle leave.

    `least` is the standard deviation, counts, that the noise has at least where outliers are sought.
    """
    phase, radius = np.mod(np.angle(signals), 2 * np.pi), np.abs(signals)
    cell = np.minimum((phase * WIDE_CELLS / (2 * np.pi)).astype(np.intp), WIDE_CELLS - 1)
    within = phase * WIDE_CELLS / (2 * np.pi) - cell - 0.5
    kept, spread = _not_gross(phase, radius, least), 1.0
    for _ in range(3):
        weight = kept.astype(np.float64)
        n, x, y = (np.bincount(cell, weight * v, WIDE_CELLS) for v in (np.ones(len(phase)), within, radius))
        xx, xy = (np.bincount(cell, weight * within * v, WIDE_CELLS) for v in (within, radius))
        n = np.maximum(n, 1.0)
        slope = (xy - x * y / n) / np.maximum(xx - x**2 / n, 1e-9)
        left = radius - (y / n)[cell] - slope[cell] * (within - (x / n)[cell])
        dof = max(float(kept.sum()) - 2 * float(np.count_nonzero(n > 2)), 1.0)
        spread = float(np.sqrt(np.sum(np.square(left[kept])) / dof))
        kept = np.abs(left) <= OUTLIER * spread  # of signals without noise nothing is left, and no sample is an outlier
    return spread, kept


def _not_gross(phase: Array, radius: Array, least: float) -> NDArray[np.bool_]:
    """(n,) samples that are not far from the median of their neighbours on the circle.

    A sample alone in its cell, or at the end of the line through it, leaves nothing of itself, however wrong it is.
    """
    order = np.argsort(phase)
    away = np.abs(radius[order] - median_filter(radius[order], AROUND, mode="wrap"))
    kept = np.ones(len(phase), bool)
    kept[order] = away <= OUTLIER * max(float(np.quantile(away, 0.9)) / NINE_TENTHS, least)
    return kept
