"""The uncertain parameters of a stage as white columns, kept as long as causes leave the signals nearly as they are."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.effects.effect import Cause, values_of
from rotary_error_monitor.effects.rotor import HEAD, StageEffect
from rotary_error_monitor.gap.normal import solve_scaled
from rotary_error_monitor.gap.problem import Rows, SparseRows
from rotary_error_monitor.kinds.stage.distortion import changes, thin_twin
from rotary_error_monitor.kinds.stage.other_twin import OtherTwin
from rotary_error_monitor.kinds.stage.rounding import Rounding
from rotary_error_monitor.noise.whitening import side_by_side
from rotary_error_monitor.sensors.library import instrument_of, is_listed, sensor_of
from rotary_error_monitor.twin.stage import Signals, StageTwin
from rotary_error_monitor.twin.stage_parameters import uncertain_parameters

SAME = 5e-3
"""Part of a signal that causes may change: what a parameter does changes by as much, and the square of it is missed."""


class Nuisances:
    """What the uncertain parameters of a stage do to the signals.

    Where a head stands matters more beside a large graduation error, say: they are made again beside causes that change
    the signals of an instrument more than a little.

    Args:
        twin: the twin as stated.
        others: the twin with each force and slow course of temperature that nobody would have noticed.
        rounding: what is not known of how the instruments round.
        measured: (n, k) what each stream showed.
        whiten: white rows of signals.
        jitter: rotation about the command (n,) at the samples of each head, from their residuals.
    """

    def __init__(
        self,
        twin: StageTwin,
        others: Sequence[OtherTwin],
        rounding: Rounding,
        measured: Signals,
        whiten: Callable[[Signals], Rows],
        jitter: Callable[[Signals], Mapping[str, Array]],
    ) -> None:
        self._twin, self._parameters, self._others = twin, uncertain_parameters(twin.stage), others
        self._rounding, self._measured, self._whiten, self._jitter = rounding, measured, whiten, jitter
        self._kept: dict[str, tuple[tuple[Cause, ...], NDArray[np.intp], Rows]] = {}
        self._last: SparseRows | None = None
        self._looks: dict[str, StageTwin] = {}

    @property
    def count(self) -> int:
        """Number of columns."""
        return len(self._parameters) + len(self._others) + self._rounding.count

    def beside(self, causes: Sequence[Cause]) -> SparseRows:
        """White rows of one standard uncertainty of each, beside causes."""
        rows: Rows = {}
        acting: dict[str, NDArray[np.intp]] = {}
        for instrument in dict.fromkeys(map(instrument_of, self._twin.times)):
            streams = [name for name in self._twin.times if instrument_of(name) == instrument]
            seen = tuple(cause for cause in causes if _touches(cause, streams))
            if instrument not in self._kept or not self._nearly(instrument, seen, streams):
                self._kept[instrument] = (seen, *self._made(instrument, streams, seen))
            _, own, found = self._kept[instrument]
            rows |= found
            acting |= dict.fromkeys(found, own)
        # The same columns as before are the same object, with which their products are kept.
        if self._last is None or not _are_same(rows, self._last.rows):
            self._last = SparseRows(self.count, rows, acting)
        return self._last

    def taken_from(self, raw: Signals) -> Signals:
        """Residuals (n, k) of each stream, those of listed sensors without what uncertain parameters may do to them.

        A target off centre that turns back with the rotor between two samples looks like a spike.
        """
        found = dict(raw)
        for name in filter(is_listed, raw):
            own = [parameter for parameter in self._parameters if name in parameter.seen_by]
            shifted = [parameter.shifted(self._twin.stage, parameter.uncertainty) for parameter in own]
            base = self._twin.predict((), [name])[name][:, 0]
            moved = [self._twin.predict((), [name], stage)[name][:, 0] - base for stage in shifted]
            if moved:
                columns = np.stack(moved, axis=1)
                found[name] = raw[name] - columns @ np.linalg.lstsq(columns, raw[name])[0]
        return found

    def forget(self, instrument: str | None = None) -> None:
        """Make those of one instrument, or all, again when they are wanted: the noise is known better."""
        self._last = None
        for known in list(self._kept) if instrument is None else [instrument]:
            self._kept.pop(known, None)

    def _nearly(self, instrument: str, causes: Sequence[Cause], streams: Sequence[str]) -> bool:
        """Whether causes leave the signals of an instrument nearly as those do beside which its columns were made."""
        before = self._kept[instrument][0]
        if values_of(before) == values_of(causes):
            return True
        if instrument not in self._looks:
            self._looks[instrument] = thin_twin(self._twin, streams)
        thin = self._looks[instrument]
        if max(changes(thin, before, causes).values()) >= SAME:
            return False
        # A drift that is little of a signal may be much of what one degree more does to it.
        return all(_does_the_same(thin, other.beside(thin), before, causes) for other in self._one_of_each())

    def _one_of_each(self) -> list[OtherTwin]:
        """Of the other twins one for each input that is another there, and for each axis of it."""
        return list({other.what: other for other in self._others}.values())

    def _made(self, instrument: str, streams: Sequence[str], causes: Sequence[Cause]) -> tuple[NDArray[np.intp], Rows]:
        """The columns that act on the streams of one instrument, and their white rows."""
        acting = [i for i, parameter in enumerate(self._parameters) if instrument in parameter.seen_by]
        shifted = [self._parameters[i].shifted(self._twin.stage, self._parameters[i].uncertainty) for i in acting]
        moved = [self._twin.predict(causes, streams, stage) for stage in shifted]
        before = len(self._parameters) + len(self._others)
        acting += range(len(self._parameters), before)
        moved += [other.predict(causes, streams) for other in self._others]
        rounded = self._rounding.acting(instrument)
        if not acting and len(rounded) == 0:
            return np.zeros(0, np.intp), {}
        base = self._twin.predict(causes, streams)
        parts = {name: [signals[name] - base[name] for signals in moved] for name in streams if moved}
        stacked = {name: side_by_side(columns) for name, columns in parts.items()}
        read = self._nearer(base, stacked, len(shifted))
        if instrument == HEAD and self._rounding.has_sawteeth(HEAD):
            turned = self._jitter({name: self._measured[name] - read[name] for name in streams})
            read = {name: read[name] + turned[name][:, None] for name in streams}
        for name, errors in self._rounding.errors(read).items():
            stacked[name] = np.concatenate([stacked[name], errors], axis=2) if moved else errors
        return np.append(np.asarray(acting, np.intp), before + rounded), self._whiten(stacked)

    def _nearer(self, base: Signals, columns: Signals, count: int) -> Signals:
        """What an instrument shows (n, k) with the first `count` parameters as what it read has them.

        Where readings change their side of zero is not known as long as its zero is not.
        """
        if count == 0:
            return base
        own = np.concatenate([self._against_noise(name, rows[:, :, :count]) for name, rows in columns.items()])
        rest = [self._against_noise(name, (self._measured[name] - base[name])[:, :, None]) for name in columns]
        errors = self._rounding.errors(base)
        unknown = [self._against_noise(name, errors[name]) for name in columns if name in errors]
        both = np.hstack([own, np.concatenate(unknown)]) if unknown else own
        size = both.shape[1]
        moved = solve_scaled(both.T @ both + np.eye(size), both.T @ np.concatenate(rest))[:count, 0]
        return {name: base[name] + columns[name][:, :, :count] @ moved for name in columns}

    def _against_noise(self, name: str, rows: Array) -> Array:
        """(n k, p) signals (n, k, p) of a stream in standard deviations of its noise."""
        return np.asarray(rows.reshape(-1, rows.shape[2]) / sensor_of(name).noise(self._twin.stage, name), np.float64)


def _does_the_same(thin: StageTwin, other: StageTwin, before: Sequence[Cause], after: Sequence[Cause]) -> bool:
    """Whether an input does nearly the same to each signal beside the one set of causes as beside the other."""
    old, new = (
        np.concatenate([moved - thin.predict(causes)[name] for name, moved in other.predict(causes).items()])
        for causes in (before, after)
    )
    return float(np.linalg.norm(new - old)) <= SAME * float(np.linalg.norm(old))


def _are_same(rows: Rows, others: Rows) -> bool:
    return rows.keys() == others.keys() and all(values is others[channel] for channel, values in rows.items())


def _touches(cause: Cause, streams: Sequence[str]) -> bool:
    effect = cause.effect
    return isinstance(effect, StageEffect) and any(effect.touches(cause.location, name) for name in streams)
