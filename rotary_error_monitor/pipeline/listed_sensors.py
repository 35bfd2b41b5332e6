"""The sensors that a stage lists, joined to the error motion that heads and autocollimator show."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.description.stage import ListedSensor, StageDescription
from rotary_error_monitor.metrology.error_motion import COMPONENTS, ErrorMotion, reading_variance
from rotary_error_monitor.metrology.harmonics import angular_sum, planar_sum
from rotary_error_monitor.metrology.rigid_motion import LEAST_VARIANCE, combine
from rotary_error_monitor.pipeline.belief import DOUBTS
from rotary_error_monitor.pipeline.error_motion_rows import (
    COLUMN,
    COLUMNS,
    COVARIANCES,
    MORE_COVARIANCES,
    SENSOR_COLUMNS,
    observable_of,
)
from rotary_error_monitor.pipeline.evidence import INDEX, WindowGrid
from rotary_error_monitor.pipeline.listed_belief import SensorBelief, SensorWindow
from rotary_error_monitor.pipeline.tilt_belief import SIGMAS
from rotary_error_monitor.sensors.library import listed_kind
from rotary_error_monitor.sensors.listed import ListedKind
from rotary_error_monitor.signals.resampling import Resampled

Array = NDArray[np.float64]

UNVERIFIED = 1 << DOUBTS.index("unverified")
LIMIT = 2.0
"""Times what the stage can do at most by which a displacement is no contradiction: the description may be the opposite
of the truth."""


@dataclass(frozen=True)
class Shown:
    """What p sensors show at m ticks.

    Attributes:
        theta: (m,) rotation, rad.
        there: (m, p) whether it can be used.
        raw: (m, p) what the sensor says, m.
        reading: (m, p) displacement, m, less what the sensor says of a perfect axis.
        surplus: (m, p) of that what neither the other sensors nor the description predict, m.
        undescribed: (m, p) what the description alone does not predict, m.
        noise: (m, p) variance of a reading, m².
        systematic: (m, p) variance of what stays as it is from tick to tick, m².
        variance: (m, p) of the surplus, by noise of the sensor and of what is predicted, m².
        others: (m, p) of the surplus by what other sensors have wrong beside their noise, m².
        stamps: (m, p) standard deviation of that part of it which stamps make, m.
        unknown: (m, p) largest displacement by components that nothing else shows, m.
        rate: (m, p) fastest change of that, m/s.
    """

    theta: Array
    there: NDArray[np.bool_]
    raw: Array
    reading: Array
    surplus: Array
    undescribed: Array
    noise: Array
    systematic: Array
    variance: Array
    others: Array
    stamps: Array
    unknown: Array
    rate: Array

    @property
    def bound(self) -> Array:
        """(m, p) largest surplus of a tick that is no contradiction, m."""
        return np.asarray(self.unknown + SIGMAS * np.sqrt(self.variance + self.systematic + self.others))

    def part(self, chosen: slice) -> Shown:
        """The same of some of the ticks."""
        return Shown(*(values[chosen] for values in self._arrays()))

    def followed_by(self, other: Shown) -> Shown:
        """Both, one after the other."""
        pairs = zip(self._arrays(), other._arrays(), strict=True)
        return Shown(*(np.concatenate(pair) for pair in pairs))

    def _arrays(self) -> tuple[Any, ...]:
        return tuple(vars(self).values())


class ListedSensors:
    """Combines each tick's error motion with what the listed sensors show, by weighted least squares.

    The sensors never enter what heads and autocollimator say: those are judged and published without them, and each
    listed sensor is judged beside them.

    Attributes:
        sensitivity: (p, 6) what each sensor sees of the components.
    """

    def __init__(self, stage: StageDescription, bits: Mapping[str, int], period_ns: int) -> None:
        """Sensors of `stage`, with the `bits` of its streams, at ticks that are `period_ns` apart."""
        self._stage, self._grid = stage, WindowGrid(period_ns)
        self._period = period_ns * 1e-9
        self._sensors: dict[str, tuple[ListedSensor, ListedKind]] = {
            stream: (sensor, listed_kind(sensor)) for stream, sensor in stage.sensors.items()
        }
        self._bits = np.array([bits[stream] for stream in self._sensors], np.int64)
        rows = [kind.sensitivity(sensor.place) for sensor, kind in self._sensors.values()]
        self.sensitivity = np.array(rows).reshape(-1, len(COMPONENTS))
        limits = stage.limits
        self._most = LIMIT * np.array([limits.radial, limits.radial, limits.axial, limits.tilt, limits.tilt, 0.0])
        rates = np.array(
            [limits.radial_rate, limits.radial_rate, limits.axial_rate, limits.tilt_rate, limits.tilt_rate, 0.0]
        )
        self._rates = rates
        self._judges = {stream: SensorBelief(sensor) for stream, (sensor, _) in self._sensors.items()}
        self._forms = np.array([sum(row.cos**2 + row.sin**2 for row in s.form) for s, _ in self._sensors.values()])
        self._pending: tuple[int, Shown] | None = None

    @property
    def reasons(self) -> Iterator[tuple[str, str]]:
        """Which sensors are doubted, and why."""
        return ((stream, judge.doubt) for stream, judge in self._judges.items() if judge.doubt)

    def reset(self) -> None:
        """Believe all sensors again."""
        self._pending = None
        for judge in self._judges.values():
            judge.reset()

    def forget_time(self) -> None:
        """The clock was set back: no step is told from what was before."""
        self._pending = None
        for judge in self._judges.values():
            judge.pause()

    def complete(
        self,
        first: int,
        rows: Array,
        usable: NDArray[np.bool_],
        sampled: Mapping[str, Resampled],
        rates: Mapping[str, float],
        decided: Mapping[int, float],
        evidence: Array,
    ) -> Array:
        """(m, k) rows with the columns `COLUMNS` and `SENSOR_COLUMNS`, from rows (m, l) with the first of these.

        Args:
            first: number of the first tick on its grid.
            rows: error motion by heads and autocollimator as it may be published, its streams those that are there.
            usable: (m,) which of the rows may be published: the rotation of the others is not known.
            sampled: each stream at the ticks.
            rates: samples per s of each stream.
            decided: for ticks, by their place, whose choice of streams is that of a live run, its `sensor_scale`.
            evidence: (m, e) what the ticks say, columns as in `pipeline.evidence`.
        """
        shown = self._shown(rows, usable, sampled, _scatter_of(evidence))
        used, scale = self._assess(first, shown, rates)
        for place, said in decided.items():
            used[place], scale[place] = shown.there[place], said
        masks = rows[:, COLUMN["streams"]].astype(np.int64)
        masks &= ~int(self._bits.sum())
        masks |= (used * self._bits).sum(axis=1)
        completed = np.hstack([rows, np.zeros((len(rows), len(SENSOR_COLUMNS)))])
        completed[:, COLUMN["streams"]] = masks
        completed[:, -1] = scale
        variance = shown.noise * scale[:, None] ** 2 + shown.systematic
        observable = completed[:, COLUMN["observable"]].astype(np.int64)
        choices = np.where(used.any(axis=1), (used * self._bits).sum(axis=1), 0)
        for bits, choice in {(b, c) for b, c in zip(observable.tolist(), choices.tolist(), strict=True) if c}:
            chosen = np.flatnonzero((observable == bits) & (choices == choice))
            sensors = np.flatnonzero(self._bits & choice)
            joined = combine(
                _motion(completed[chosen]),
                self.sensitivity[sensors],
                shown.reading[np.ix_(chosen, sensors)],
                variance[np.ix_(chosen, sensors)],
            )
            completed[chosen] = _with_motion(completed[chosen], joined)
        return completed

    def _shown(self, rows: Array, usable: NDArray[np.bool_], sampled: Mapping[str, Resampled], scatter: Array) -> Shown:
        """What the sensors show beside what is known without them."""
        theta, motion = rows[:, COLUMN["theta"]], _motion(np.hstack([rows, np.zeros((len(rows), len(SENSOR_COLUMNS)))]))
        described = self._described(theta)
        expected = np.where(motion.observable, motion.components, described)
        masks, doubts = (rows[:, COLUMN[name]].astype(np.int64) for name in ("streams", "doubts"))
        shape = len(rows), len(self._sensors)
        raw, reading, noise = np.zeros(shape), np.zeros(shape), np.zeros(shape)
        stated = np.zeros(len(self._sensors))
        for place, (stream, (sensor, kind)) in enumerate(self._sensors.items()):
            seen = sampled[stream]
            raw[:, place] = seen.values[:, 0]
            reading[:, place] = kind.displacement(sensor, seen.values[:, 0], theta)
            noise[:, place] = reading_variance(sensor.noise, sensor.resolution, seen.gain, seen.travel[:, 0])
            noise[:, place] = np.maximum(noise[:, place] / sensor.gain**2, LEAST_VARIANCE)
            stated[place] = sensor.uncertainty
        # the form of a target is taken off at the wrong place while the zero of the rotation may be another one
        elsewhere = np.where(doubts & UNVERIFIED, 1.0, 0.0)[:, None] * self._forms
        systematic = stated**2 + elsewhere
        known, noisy, heads, unknown, rate = (np.zeros(shape) for _ in range(5))
        for place, row in enumerate(self.sensitivity):
            for i in np.flatnonzero(row):
                alone = ~motion.observable[:, i]
                unknown[:, place] += np.where(alone, abs(row[i]) * self._most[i], 0.0)
                rate[:, place] += np.where(alone, abs(row[i]) * self._rates[i], 0.0)
                noisy[:, place] += np.where(alone, 0.0, row[i] ** 2 * scatter[:, i])
                if i < 2:  # radial, by the heads
                    heads[:, place] += np.where(alone, 0.0, row[i] ** 2 * scatter[:, i])
                for j in np.flatnonzero(row):
                    known[:, place] += row[i] * row[j] * motion.covariance[:, i, j]
        return Shown(
            theta,
            (masks[:, None] & self._bits != 0) & usable[:, None],
            raw,
            reading,
            reading - self._displacement(expected),
            reading - self._displacement(described),
            noise,
            systematic,
            noise + noisy,
            np.maximum(known - noisy, 0.0),
            np.sqrt(np.maximum(rows[:, COLUMN["head_scale"]] ** 2 - 1.0, 0.0)[:, None] * heads),
            unknown,
            rate,
        )

    def _displacement(self, components: Array) -> Array:
        """(m, p) what each sensor sees of error motion (m, 6), term by term: the bits of a tick are its own."""
        found = np.zeros((len(components), len(self._sensors)))
        for place in range(len(COMPONENTS)):
            found += components[:, place, None] * self.sensitivity[:, place]
        return found

    def _described(self, theta: Array) -> Array:
        """(m, 6) error motion as the description has it."""
        spindle = self._stage.spindle
        motion = np.zeros((len(theta), len(COMPONENTS)))
        motion[:, :2] = planar_sum(spindle.radial, theta)
        motion[:, 2] = angular_sum(spindle.axial, theta)
        motion[:, 3:5] = planar_sum(spindle.tilt, theta)
        return motion

    def _assess(self, first: int, shown: Shown, rates: Mapping[str, float]) -> tuple[NDArray[np.bool_], Array]:
        """(m, p) which sensors are used, and (m,) by which their standard deviations are multiplied.

        What windows say holds for the ticks after them, however many of these come at once.
        """
        count, before = len(shown.there), 0
        pending, self._pending = self._pending, None
        if pending is not None and pending[0] + len(pending[1].there) == first:
            first, before = pending[0], len(pending[1].there)
            shown = pending[1].followed_by(shown)
        used, scale = np.zeros((count, len(self._sensors)), np.bool_), np.ones(count)
        begin = 0
        while begin < len(shown.there):
            end = min((self._grid.number(first + begin) + 1) * self._grid.ticks - first, len(shown.there))
            part = shown.part(slice(begin, end))
            fresh = slice(max(begin - before, 0), end - before)
            used[fresh] = self._allowed(shown.part(slice(max(begin, before), end)))
            scale[fresh] = max((judge.scale for judge in self._judges.values() if not judge.doubt), default=1.0)
            if end - begin == self._grid.ticks:
                self._judge(self._grid.number(first + begin), part, rates)
            elif end == len(shown.there) and (first + begin) % self._grid.ticks == 0:
                self._pending = first + begin, part
            begin = end
        return used, scale

    def _allowed(self, shown: Shown) -> NDArray[np.bool_]:
        judges = list(self._judges.values())
        believed = np.array([not judge.doubt for judge in judges])
        middle, reach = np.array([judge.middle for judge in judges]), np.array([judge.reach for judge in judges])
        near = np.abs(shown.surplus - middle) <= reach
        return np.asarray(shown.there & believed & near & (np.abs(shown.surplus) <= shown.bound))

    def _judge(self, number: int, shown: Shown, rates: Mapping[str, float]) -> None:
        ticks = self._grid.ticks
        for place, (stream, judge) in enumerate(self._judges.items()):
            if not shown.there[:, place].all():
                judge.pause()
                continue
            samples = ticks * min(1.0, rates[stream] * self._period)
            surplus = shown.surplus[:, place]
            judge.judge(
                SensorWindow(
                    number,
                    self._grid.duration,
                    ticks,
                    samples,
                    float(shown.theta.sum() / ticks),
                    float(shown.raw[:, place].sum() / ticks),
                    float(surplus.sum() / ticks),
                    _scatter(surplus),
                    _scatter(shown.undescribed[:, place]),
                    float(shown.noise[:, place].sum() / ticks),
                    float(shown.variance[:, place].sum() / ticks),
                    float(shown.systematic[:, place].max()),
                    float(shown.others[:, place].max()),
                    float(shown.stamps[:, place].max()),
                    float(shown.unknown[:, place].max()),
                    float(shown.rate[:, place].max()),
                )
            )


def _scatter_of(evidence: Array) -> Array:
    """(m, 6) variance of each component by stated noise alone, m² and rad²; what stamps make lasts."""
    variance = np.zeros((len(evidence), len(COMPONENTS)))
    variance[:, :2] = evidence[:, [INDEX["radial_variance"]]]
    variance[:, 3:5] = evidence[:, [INDEX["tilt_variance"]]]
    return variance


def _scatter(values: Array) -> float:
    """Variance of values about a straight line; 0 where they are too few to tell."""
    count = len(values)
    if count < 3:
        return 0.0
    off = values - values.sum() / count
    course = np.arange(count) - 0.5 * (count - 1)
    off = off - course * (float((off * course).sum()) / float((course**2).sum()))
    return float((off**2).sum()) / (count - 2)


def _motion(rows: Array) -> ErrorMotion:
    covariance = np.zeros((len(rows), 6, 6))
    for (i, j), place in _PLACES.items():
        covariance[:, i, j] = covariance[:, j, i] = rows[:, place]
    components = rows[:, [COLUMN[name] for name in COMPONENTS]]
    observable = observable_of(rows[:, COLUMN["observable"]].astype(np.int64))
    return ErrorMotion(rows[:, COLUMN["theta"]], components, observable, covariance)


def _with_motion(rows: Array, motion: ErrorMotion) -> Array:
    rows = rows.copy()
    rows[:, [COLUMN[name] for name in COMPONENTS]] = motion.components
    for (i, j), place in _PLACES.items():
        rows[:, place] = motion.covariance[:, i, j]
    rows[:, COLUMN["observable"]] = (motion.observable << np.arange(6)).sum(axis=1)
    return rows


_PLACES = {key: COLUMN[name] for key, name in COVARIANCES.items()} | {
    key: len(COLUMNS) + SENSOR_COLUMNS.index(name) for key, name in MORE_COVARIANCES.items()
}
