"""Error motion values of one sensitive direction, each with its uncertainty (ISO 230-7:2015, 3.5; ASME B89.3.4).

A profile P_n(a) is the error motion in turn n at angle a. Its mean over the turns is the synchronous error motion, and

- total: largest minus smallest of all P_n(a);
- synchronous: largest minus smallest of the mean;
- asynchronous: the largest, over the angles, of the largest minus the smallest P_n(a) at one angle;
- fundamental: twice the amplitude of the mean's once-per-turn component; residual synchronous: what is left of the
  mean without it, largest minus smallest. Where the once-per-turn component is a matter of setting up (eccentricity:
  radial motion, and all rotating sensitive directions), it is taken off every value, by the least-squares centre.

Each is a maximum of something noisy, and so too large on average. As the noise grows by a known part the value grows;
from that it is extrapolated to none (simulation extrapolation, Cook and Stefanski 1994, linear in the standard
deviation). What is simulated is Gaussian with the spectrum over the orders that the turns show against their mean.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.metrology.turns import TurnProfiles, TurnSummary

COVERAGE = 2.0
"""Coverage factor of the expanded uncertainty: 95 % of a normal distribution (JCGM 100:2008, 6.2.2)."""

TOTAL, SYNCHRONOUS, ASYNCHRONOUS = "total", "synchronous", "asynchronous"
FUNDAMENTAL, RESIDUAL = "fundamental", "residual_synchronous"

DRAWS = 100
"""Simulated recordings: a standard uncertainty by so many is known to 7 %."""

REPEATS = 10
"""How often each of them is corrected: what so few leave of chance is taken off."""

_MOST_VALUES = 1 << 20
"""Values of profiles that are drawn at once: 8 MB."""

_MOST_KEPT = 1 << 19
"""Random numbers that are kept for the next signal: 8 MB, as for 30 turns of usual orders, so that memory does not grow
with the recording."""

FROM_TWICE = 1 / (math.sqrt(2) - 1)
"""Growth of a value from a noise to its double variance, times this: from no noise to that noise."""

_GENERATOR = 230_7
"""Seed: the same recording gives the same figures."""


@dataclass(frozen=True)
class SignalNoise:
    """What the estimate says of the uncertainty of a signal; standard deviations, in its unit.

    Attributes:
        random: of one sample by itself, as the estimate's covariance has it.
        shape: of what is the same in each turn and no once-per-turn component, such as what is left of a graduation.
        turning: at one angle, of a once-per-turn component, such as an eccentricity that is not told.
    """

    random: float
    shape: float = 0.0
    turning: float = 0.0


@dataclass(frozen=True)
class ErrorMotionValue:
    """An error motion value.

    Attributes:
        value: best estimate, in the signal's unit: as measured, less what noise adds.
        measured: by the definition, noise and all.
        uncertainty: standard uncertainty; times `COVERAGE` it spans 95 %.
    """

    value: float
    measured: float
    uncertainty: float

    @property
    def expanded(self) -> float:
        """Expanded uncertainty."""
        return COVERAGE * self.uncertainty


def sensitive_direction(radial: Array, theta: Array) -> Array:
    """(m,) radial motion (m, 2) along a direction that turns with the rotor (rotating sensitive direction)."""
    return np.asarray(radial[:, 0] * np.cos(theta) + radial[:, 1] * np.sin(theta))


def estimate_values(
    turns: TurnProfiles, signal: int, noise: SignalNoise, *, keeps_fundamental: bool
) -> Mapping[str, ErrorMotionValue]:
    """Error motion values by name; those that need a second turn only where there is one, none without a whole one.

    Args:
        turns: profiles of whole turns.
        signal: number of the signal among them.
        noise: of the signal, by the covariance of the estimate.
        keeps_fundamental: whether the once-per-turn component is error motion (axial, face, tilt in a fixed direction),
            not a matter of setting up.
    """
    from scipy.special import stdtrit  # loads for a third of a second, and a replay tells no values

    count = turns.count
    if count == 0:
        return {}
    summary = turns.summary(signal)
    spectrum = TurnSpectrum.of(turns, signal, summary.mean, noise.random)
    factor = float(stdtrit(spectrum.degrees, 0.975)) / COVERAGE
    of_turns = _Simulation.of_turns(turns, signal, summary, spectrum)
    # what is of the mean alone is simulated as of one turn with its noise: so small that corrections can be repeated
    of_mean = _Simulation.of_mean(summary.mean, spectrum.noise / count, spectrum.between / count)
    found = {}
    for name, define in _definitions(keeps_fundamental, several=count > 1).items():
        simulation = of_turns if name in (TOTAL, ASYNCHRONOUS) else of_mean
        systematic = _systematic(name, noise, spectrum.unseen, keeps_fundamental)
        found[name] = simulation.value(define, factor, systematic)
    # the total holds the others, whatever is taken off each of them for its noise
    least = max(found[name].value for name in (SYNCHRONOUS, ASYNCHRONOUS) if name in found)
    found[TOTAL] = replace(found[TOTAL], value=min(max(found[TOTAL].value, least), found[TOTAL].measured))
    return found


def mean_noise(turns: TurnProfiles, signal: int, mean: Array, random: float) -> float:
    """Standard deviation of the mean over one turn by the noise of the readings: what turns show, or is stated.

    Args:
        turns: profiles of whole turns.
        signal: number of the signal among them.
        mean: (k,) over the turns.
        random: standard deviation of one sample by itself, as the estimate's covariance has it.
    """
    shown = float(TurnSpectrum.of(turns, signal, mean, random).noise[0])
    return math.sqrt(max(shown, random**2 / turns.samples))


def _definitions(keeps_fundamental: bool, several: bool) -> dict[str, Callable[[TurnSummary], Array]]:
    """Values of what profiles show, (…, k), by their names."""

    def total(summary: TurnSummary) -> Array:
        if keeps_fundamental:
            return np.asarray(summary.highest.max(axis=-1) - summary.lowest.min(axis=-1))
        off = _once(summary.mean)
        return np.asarray((summary.highest - off).max(axis=-1) - (summary.lowest - off).min(axis=-1))

    def synchronous(summary: TurnSummary) -> Array:
        profile = summary.mean if keeps_fundamental else summary.mean - _once(summary.mean)
        return np.asarray(np.ptp(profile, axis=-1))

    found: dict[str, Callable[[TurnSummary], Array]] = {TOTAL: total, SYNCHRONOUS: synchronous}
    if several:
        found[ASYNCHRONOUS] = lambda summary: (summary.highest - summary.lowest).max(axis=-1)
    if keeps_fundamental:
        found[FUNDAMENTAL] = lambda summary: np.ptp(_once(summary.mean), axis=-1)
        found[RESIDUAL] = lambda summary: np.ptp(summary.mean - _once(summary.mean), axis=-1)
    return found


def _once(profile: Array) -> Array:
    """Once-per-turn component of profiles (…, k)."""
    waves = _waves(profile.shape[-1])
    return np.asarray((profile @ waves.T) @ waves * (2 / profile.shape[-1]))


def _waves(count: int) -> Array:
    angle = np.arange(count) * (2 * math.pi / count)
    return np.stack([np.cos(angle), np.sin(angle)])


def _systematic(name: str, noise: SignalNoise, unseen: float, keeps_fundamental: bool) -> float:
    """Standard uncertainty that no further turn makes smaller; `unseen` may be of any order.

    Two points of the profile differ by √2 of the deviation at one; twice an amplitude by twice that.
    """
    turning = noise.turning if keeps_fundamental else 0.0
    if name == ASYNCHRONOUS:  # what is the same in each turn cancels
        return 0.0
    if name == FUNDAMENTAL:
        return 2.0 * math.hypot(turning, unseen)
    return math.sqrt(2.0) * math.hypot(noise.shape, unseen, 0.0 if name == RESIDUAL else turning)


@dataclass(frozen=True)
class _Simulation:
    """Recordings as this one might have been: with once more the noise of its readings, and of other turns.

    Attributes:
        measured: what the turns show.
        louder: (d, k) the same with the noise of the readings once more.
        others: (d, k) of other turns.
        corrected: (d, k) others with that noise, r times, by which each is corrected in turn; none, and it is not.
    """

    measured: TurnSummary
    louder: TurnSummary
    others: TurnSummary
    corrected: tuple[TurnSummary, ...] = ()

    @staticmethod
    def of_turns(turns: TurnProfiles, signal: int, summary: TurnSummary, spectrum: TurnSpectrum) -> _Simulation:
        """Of all turns."""
        normals = _Normals(2 * DRAWS * turns.count * len(spectrum.noise))

        def measured() -> Iterator[Array]:
            return (profiles for profiles, _ in turns.parts(signal))

        def mean() -> Iterator[Array]:
            return (np.broadcast_to(summary.mean, profiles.shape) for profiles, _ in turns.parts(signal))

        louder = _summaries(measured, turns.count, spectrum.noise, normals)
        return _Simulation(summary, louder, _summaries(mean, turns.count, spectrum.between, normals))

    @staticmethod
    def of_mean(mean: Array, noise: Array, between: Array) -> _Simulation:
        """Of the mean (k,) as of one turn, with variances (l,) of its orders by the readings and by other turns."""
        shape = (DRAWS, len(mean))
        normals = _Normals((2 + REPEATS) * DRAWS * len(noise))
        louder = mean + _drawn(noise, shape, normals)
        others = mean + _drawn(between, shape, normals)
        more = [others + _drawn(noise, shape, normals) for _ in range(REPEATS)]
        once, noisy, another, *corrected = (TurnSummary(each, each, each) for each in (mean, louder, others, *more))
        return _Simulation(once, noisy, another, tuple(corrected))

    def value(self, define: Callable[[TurnSummary], Array], factor: float, systematic: float) -> ErrorMotionValue:
        """Value by its definition; `factor` goes with the scatter, for turns are few."""
        measured = float(define(self.measured))
        louder = define(self.louder)
        correction = min(max(FROM_TWICE * float(louder.mean() - measured), 0.0), measured)
        drawn = FROM_TWICE * float(louder.std()) / math.sqrt(DRAWS)
        # the correction may be wrong by as much as itself: rectangular (JCGM 100:2008, 4.3.7)
        parts = (factor * self._scatter(define), correction / math.sqrt(3), drawn, systematic)
        return ErrorMotionValue(measured - correction, measured, math.hypot(*parts))

    def _scatter(self, define: Callable[[TurnSummary], Array]) -> float:
        """Standard deviation of the value, corrected where that is repeated, less that of so few repetitions."""
        values = define(self.others)
        if not self.corrected:
            return float(values.std())
        louder = np.stack([define(each) for each in self.corrected])
        corrected = values + FROM_TWICE * (values - louder.mean(axis=0))
        of_few = FROM_TWICE**2 * float(louder.var(axis=0, ddof=1).mean()) / len(louder)
        return math.sqrt(max(float(corrected.var()) - of_few, float(values.var())))


def _summaries(profiles: Callable[[], Iterator[Array]], count: int, spectrum: Array, normals: _Normals) -> TurnSummary:
    """What `DRAWS` simulated recordings show: profiles, given in parts of `count` turns in all, with noise on each.

    However many of them are drawn at once, each has the same noise.
    """
    first = next(profiles())
    found: list[TurnSummary] = []
    if len(first) == count:
        several = max(1, _MOST_VALUES // first.size)
        for begin in range(0, DRAWS, several):
            shape = (min(several, DRAWS - begin), *first.shape)
            found.append(TurnSummary.of(first + _drawn(spectrum, shape, normals)))
    else:
        for _ in range(DRAWS):
            louder = (part + _drawn(spectrum, part.shape, normals) for part in profiles())
            one = TurnSummary.of_parts(louder, count)
            found.append(TurnSummary(one.mean[None], one.lowest[None], one.highest[None]))
    return TurnSummary(
        *(np.concatenate([getattr(each, name) for each in found]) for name in ("mean", "lowest", "highest"))
    )


@dataclass(frozen=True)
class TurnSpectrum:
    """How turns scatter about their mean, by order from 0 on.

    Attributes:
        between: (l,) variance of the complex amplitude of each order from turn to turn, of filtered profiles.
        noise: (l,) the part of it that is noise of the readings.
        unseen: standard deviation at one angle of what the covariance says beyond the noise that the turns show: it is
            the same in each turn, such as the form of a face that a probe looks at.
        degrees: degrees of freedom that the turns give.
    """

    between: Array
    noise: Array
    unseen: float
    degrees: float

    @staticmethod
    def of(turns: TurnProfiles, signal: int, mean: Array, random: float) -> TurnSpectrum:
        """Spectrum of a signal with a mean (k,) over the turns, whose samples have a standard deviation `random`.

        Between turns there is never less than the estimate's covariance says. The noise is what the turns show in the
        upper half of the orders, where no bearing reaches: readings of sensors that are slower than the estimates are
        not independent from one estimate to the next, so that their variance alone does not tell it.
        """
        through = turns.transmission**2
        stated = random**2 / turns.samples * through
        count = turns.count
        freedom = max(count - 1, 1)
        upper = slice(turns.cut_off // 2, turns.cut_off + 1)
        fade = np.sqrt(8 / 3) * np.hanning(turns.points)
        powers, upper_powers = np.zeros(len(through)), np.zeros(len(through))
        for profiles, edges in turns.parts(signal):
            rest = profiles - (mean if count > 1 else 0.0)
            # of a tone between two orders a turn holds no whole waves: what leaks from it upwards is faded out
            cut = np.stack([np.roll(row, -edge) for row, edge in zip(rest, edges, strict=True)])
            powers += _powers(rest)
            upper_powers += _powers(cut * fade)
        faded = upper_powers[upper] / through[upper]
        level = float(faded.mean()) / freedom
        noise = level * through
        unseen = math.sqrt(max(random**2 - level * turns.samples, 0.0))
        shown = powers / freedom
        if count < 2:  # what would be another in the next turn is not told
            return TurnSpectrum(np.maximum(stated, noise), noise, unseen, float(upper.stop - upper.start))
        lacking = max(0.0, 1.0 - float(shown.sum() / max(stated.sum(), np.finfo(float).tiny)))
        between = shown + lacking * stated
        total = float((between**2).sum())
        # each order has two amplitudes; those of a narrow band alone tell little (Welch and Satterthwaite)
        orders = float(between.sum()) ** 2 / total if total > 0 else 1.0
        return TurnSpectrum(between, noise, unseen, 2 * freedom * orders)


def _powers(profiles: Array) -> Array:
    """(l,) squares of the complex amplitudes of each order of profiles (n, k), summed over these."""
    return np.asarray((np.abs(np.fft.rfft(profiles, axis=1) / profiles.shape[1]) ** 2).sum(axis=0))


class _Normals:
    """Complex numbers of normal parts, the same for each signal: to draw them takes longer than all that they are for.

    As many as are kept are drawn once for all signals that need as many; more are drawn by each.
    """

    def __init__(self, count: int) -> None:
        """The first `count` of them."""
        self._kept = _drawn_normals(count) if count <= _MOST_KEPT else None
        self._generator, self._begin = np.random.default_rng(_GENERATOR), 0

    def take(self, shape: tuple[int, ...]) -> NDArray[np.complex128]:
        """The next of a shape."""
        if self._kept is None:
            return _normals(self._generator, shape)
        begin, self._begin = self._begin, self._begin + math.prod(shape)
        return self._kept[begin : self._begin].reshape(shape)


def _normals(generator: np.random.Generator, shape: tuple[int, ...]) -> NDArray[np.complex128]:
    return np.asarray(generator.standard_normal((*shape, 2)).view(np.complex128)[..., 0])


@lru_cache(maxsize=2)
def _drawn_normals(count: int) -> NDArray[np.complex128]:
    """(count,) for the turns of a signal or for their mean; those of the next signal are the same."""
    return _normals(np.random.default_rng(_GENERATOR), (count,))


def _drawn(spectrum: Array, shape: tuple[int, ...], normals: _Normals) -> Array:
    """Profiles of a shape (…, k) of Gaussian noise with the variance of its complex amplitudes (l,) given."""
    taken = normals.take((*shape[:-1], len(spectrum)))
    waves = taken * np.sqrt(spectrum / 2)
    waves[..., 0] = taken[..., 0].real * math.sqrt(spectrum[0])
    return np.asarray(np.fft.irfft(waves, shape[-1], axis=-1) * shape[-1])
