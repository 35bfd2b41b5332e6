"""A long recording of a stage as a problem of diagnosis, worked through stretch by stretch so that memory holds one.

Rows of one column (residuals, what is left) are kept whole: they take a hundredth of the memory that the signatures of
all effects and parameters take, which are made for one stretch at a time. Noise is learnt in each stretch on its own.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.streams import COMMAND
from rotary_error_monitor.effects.effect import Cause, Role
from rotary_error_monitor.effects.rotor import HEAD, StageEffect
from rotary_error_monitor.gap.departures import Departures
from rotary_error_monitor.gap.problem import Columns, Conditions, LateRows, Rows, SparseRows, StretchedConditions
from rotary_error_monitor.kinds.stage.admission import check_noise
from rotary_error_monitor.kinds.stage.conditions import MOST_BLOCKS
from rotary_error_monitor.kinds.stage.forces import with_shaft_force
from rotary_error_monitor.kinds.stage.gross_inputs import without_gross_inputs
from rotary_error_monitor.kinds.stage.jumping import with_jumps_told
from rotary_error_monitor.kinds.stage.of_whole import OfWhole
from rotary_error_monitor.kinds.stage.problem import StageProblem
from rotary_error_monitor.kinds.stage.search import StageSearch, effects_in
from rotary_error_monitor.kinds.stage.stuck import without_stuck
from rotary_error_monitor.kinds.stage.thermometers import with_useful_inputs
from rotary_error_monitor.kinds.stage.tracks import Tracks
from rotary_error_monitor.noise.channels import noise_std
from rotary_error_monitor.noise.stage_noise import StageNoise
from rotary_error_monitor.twin.recording import FEWEST_SAMPLES, SignalStream, StageRecording
from rotary_error_monitor.twin.stage import twin_of

STRETCH = 40.0
"""Length of a stretch, s: the spectrum of the jitter is well known from it, and its columns fill half a gigabyte."""

LONGEST = 60.0
"""Length of a recording, s, up to which it is taken as one stretch."""


def stage_problem(
    stage: StageDescription,
    recording: StageRecording,
    effects: Sequence[StageEffect],
    known: Sequence[Cause] = (),
) -> StageProblem:
    """The problem of a recording of any length, without what is off, stuck or useless; arguments as `StageProblem`."""
    sound = without_stuck(stage, without_gross_inputs(stage, recording))
    stage, recording = with_shaft_force(*with_useful_inputs(stage, sound))
    recording = with_jumps_told(stage, recording)
    kind = LongStageProblem if recording.duration > LONGEST else StageProblem
    return kind(stage, recording, effects, known)


class LongStageProblem(StageProblem):
    """A recording too long for its signatures to be kept; arguments as `StageProblem`."""

    keeps_signatures = False

    def __init__(
        self,
        stage: StageDescription,
        recording: StageRecording,
        effects: Sequence[StageEffect],
        known: Sequence[Cause] = (),
    ) -> None:
        self.stage, self.recording, self.effects = stage, recording, effects_in(stage, recording, effects)
        self.twin = replace(twin_of(stage, recording, tuple(known)), keeps_states=False)
        self._measured = {name: recording.streams[name].values for name in self.twin.times}
        self._search, self._tracks = StageSearch(self), Tracks(self)
        self._starts: dict[tuple[str, str], Array] = {}
        self._expected: dict[str, Array] = {}
        bounds = np.linspace(0.0, recording.duration, max(2, round(recording.duration / STRETCH)) + 1)
        pieces = [cut_recording(recording, a, b) for a, b in itertools.pairwise(bounds)]
        read = [i for i, piece in enumerate(pieces) if (piece.heads if recording.heads else piece.sensors)]
        check_noise(self.twin.times, noise_std(stage))
        whole = OfWhole.of(stage, recording, self.twin)
        self._stretches: list[_Stretch] = []
        for i in read:
            self._stretches.append(_Stretch(stage, pieces[i], effects, known, whole))
            self._stretches[-1].forget()
        self._opened = 0
        self.noise, self._arc = self._stretches[0].noise, whole.arc
        self._channels = tuple(dict.fromkeys(c for s in self._stretches for c in s.channels))
        self._times = self._joined_times()
        self.conditions = self._stretched(whole.conditions, bounds, read)

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels of rows: with heads `command` and each head, each component of the other sensors."""
        return self._channels

    @property
    def instants(self) -> int:
        """Number of instants at which the heads were read; of a stage without heads, its fastest sensor."""
        return sum(stretch.instants for stretch in self._stretches)

    @property
    def noises(self) -> Sequence[StageNoise]:
        """Noise of each stretch of the recording."""
        return [stretch.noise for stretch in self._stretches]

    def times(self, channel: str) -> Array:
        """(m,) time of each row, s."""
        return self._times[channel]

    def expected(self, channel: str) -> Array:
        """(m,) expected square of each row under noise alone."""
        if not self._expected:
            # In single precision: it is kept as long as the problem is, and no more exact than the noise is known.
            found = self._joined(lambda s: {c: s.expected(c).astype(np.float32) for c in s.channels})
            self._expected = _without_copies(found)
        return self._expected[channel]

    def residual(self, causes: Sequence[Cause]) -> Rows:
        """White rows (m, 1) of measured minus predicted."""
        return self._joined(lambda stretch: stretch.residual(causes))

    def signature(self, cause: Cause, indices: Sequence[int], others: Sequence[Cause] = ()) -> Columns:
        """White rows of the derivative of the prediction with respect to values of `cause`, beside `others`."""
        effect = cause.effect
        assert isinstance(effect, StageEffect)
        if not any(effect.touches(cause.location, name) for name in self.twin.times):
            return {}
        return LateRows(len(indices), lambda i: self._open(i).own_signature(cause, indices, others))

    def own_departures(self, place: int, causes: Sequence[Cause]) -> Departures:
        """Those of the cause at one place among the causes, made for one stretch at a time."""
        first = self._stretches[self._first_with(causes[place])].own_departures(place, causes)

        def rows_of(stretch: int) -> Rows | SparseRows:
            if not self._is_shown(causes[place], stretch):
                return {}
            made = self._open(stretch).own_departures(place, causes).columns
            assert not isinstance(made, LateRows)
            return made

        return replace(first, columns=LateRows(len(first.kinds), rows_of))

    def departs_as_whole(self, cause: Cause) -> bool:
        """As `DepartingAsWhole` asks."""
        return self._stretches[self._first_with(cause)].departs_as_whole(cause)

    def turning(self, cause: Cause) -> tuple[Array, float]:
        """As `Reversing` asks."""
        return self._stretches[self._first_with(cause)].turning(cause)

    def slipped(self, place: int, causes: Sequence[Cause], moments: Array) -> Columns:
        """As `Reversing` asks, made for one stretch at a time."""

        def rows_of(stretch: int) -> Rows | SparseRows:
            if not self._is_shown(causes[place], stretch):
                return {}
            made = self._open(stretch).slipped(place, causes, moments)
            assert not isinstance(made, LateRows)
            return made

        return LateRows(len(moments) * len(causes[place].effect.indices(Role.LINEAR)), rows_of)

    def _first_with(self, cause: Cause) -> int:
        """The first stretch with a stream that a cause acts on: a sensor may begin late, or fall silent."""
        return next((i for i in range(len(self._stretches)) if self._is_shown(cause, i)), 0)

    def _is_shown(self, cause: Cause, stretch: int) -> bool:
        """Whether a stretch has a stream that a cause acts on."""
        effect = cause.effect
        assert isinstance(effect, StageEffect)
        return any(effect.touches(cause.location, name) for name in self._stretches[stretch].twin.times)

    @property
    def nuisances(self) -> int:
        """Number of uncertain parameters."""
        return self._stretches[0].nuisances

    def nuisance(self, causes: Sequence[Cause]) -> Columns:
        """White rows of one standard uncertainty of each uncertain parameter."""
        return LateRows(self.nuisances, lambda i: self._open(i).own_nuisance(causes)) if self.nuisances else {}

    def without_slow_noise(self, columns: Columns) -> Columns | None:
        """Columns as beside white noise alone; None where that is what they are."""
        if not isinstance(columns, LateRows) or not any(noise.has_slow_noise for noise in self.noises):
            return None

        def rows_of(stretch: int) -> Rows | SparseRows:
            made = columns.of(stretch)
            plain = self._open(stretch).without_slow_noise(made)
            assert not isinstance(plain, LateRows)
            return made if plain is None else plain

        return LateRows(columns.width, rows_of)

    def learn_noise(self, causes: Sequence[Cause]) -> bool:
        """Estimate the jitter's spectrum again in each stretch; says whether it differs in any."""
        changed = [self._open(i).learn_noise(causes) for i in range(len(self._stretches))]
        self._expected = {}
        return any(changed)

    def spikes(self) -> dict[str, int]:
        """Number of samples of each sensor that are spikes."""
        names = dict.fromkeys(name for stretch in self._stretches for name in stretch.noise.spikes)
        counts = [stretch.spikes() for stretch in self._stretches]
        return {name: sum(count.get(name, 0) for count in counts) for name in names}

    def _open(self, index: int) -> _Stretch:
        """A stretch to work in; the one before forgets what it can compute again."""
        if index != self._opened:
            self._stretches[self._opened].forget()
            self._opened = index
        return self._stretches[index]

    def _joined(self, of_stretch: Callable[[_Stretch], Rows]) -> Rows:
        """Rows of all stretches, one after the other."""
        parts: dict[str, list[Array]] = {}
        for i in range(len(self._stretches)):
            for channel, rows in of_stretch(self._open(i)).items():
                parts.setdefault(channel, []).append(rows)
        return {channel: np.concatenate(rows) for channel, rows in parts.items()}

    def _joined_times(self) -> dict[str, Array]:
        """(m,) time of each row by channel, s: one array for all that have the same, for each takes as much room as a
        signal.
        """
        found: dict[str, Array] = {}
        joined: dict[tuple[str, ...], Array] = {}
        for channel in self._channels:
            with_it = [stretch for stretch in self._stretches if channel in stretch.channels]
            stream = HEAD if channel in (COMMAND, *self.recording.heads) else channel.partition(".")[0]
            key = (stream, *(str(id(stretch)) for stretch in with_it))
            if key not in joined:
                joined[key] = self._joined_time(channel, with_it)
            found[channel] = joined[key]
        return found

    def _joined_time(self, channel: str, with_it: Sequence[_Stretch]) -> Array:
        parts = [stretch.times(channel) for stretch in with_it]
        whole = self.recording.streams.get(channel.partition(".")[0])
        on_grid = channel in (COMMAND, *self.recording.heads)
        if whole is not None and not on_grid and len(whole.time) == sum(map(len, parts)):
            return whole.time
        time = np.concatenate(parts)
        if on_grid:
            ends = np.cumsum(list(map(len, parts)))
            for stretch, part in zip(with_it, np.split(time, ends[:-1]), strict=True):
                stretch.noise.share_time(part)
        return time

    def _stretched(self, plain: Conditions, bounds: Array, read: Sequence[int]) -> StretchedConditions:
        """Conditions whose spans end where stretches do, several spans of one condition to a block."""
        edges = np.unique(np.concatenate([plain.edges[1:-1], bounds[1:-1]]))
        starts = np.concatenate([[-np.inf], edges])
        stretch = np.searchsorted(bounds[1:-1], starts, side="right")
        kept = np.flatnonzero(np.isin(stretch, read))
        labels = plain.labels[np.searchsorted(plain.edges[1:-1], starts, side="right")][kept]
        blocks = np.zeros(len(kept), np.intp)
        owners: list[int] = []
        each = max(1, MOST_BLOCKS // len(plain.names))
        for label in np.unique(labels):
            spans = np.flatnonzero(labels == label)
            count = min(each, len(spans))
            blocks[spans] = len(owners) + np.arange(len(spans)) * count // len(spans)
            owners += [int(label)] * count
        lengths = {c: [len(s.times(c)) if c in s.channels else 0 for s in self._stretches] for c in self._channels}
        return StretchedConditions(
            np.concatenate([starts[kept], [np.inf]]),
            np.asarray(owners, np.intp),
            plain.names,
            blocks,
            np.searchsorted(np.asarray(read), stretch[kept]),
            {channel: np.concatenate([[0], np.cumsum(count)]).astype(np.intp) for channel, count in lengths.items()},
        )


class _Stretch(StageProblem):
    """One stretch of a long recording; what drives the stage is known from the whole."""

    keeps_signatures = False

    def forget(self) -> None:
        """Give back the memory of what can be computed again."""
        self.twin.forget()
        self.noise.forget()
        self._predictions.forget()
        self._nuisances.forget()
        self._expected.clear()


def _without_copies(rows: Rows) -> Rows:
    """The same with one array for channels whose rows are equal, as those of the heads and of both axes of a sensor."""
    found: Rows = {}
    for channel, values in rows.items():
        found[channel] = next((known for known in found.values() if np.array_equal(known, values)), values)
    return found


def cut_recording(recording: StageRecording, start: float, stop: float) -> StageRecording:
    """The sensors' samples from `start` to before `stop`, s; a sensor with hardly any is left out.

    Command, force and temperature are kept whole: they are inputs, and one cut needs the samples around it.
    """
    whole = {name: stream for name, stream in recording.streams.items() if name not in recording.sensors}
    cut = {}
    for name in recording.sensors:
        stream = recording.streams[name]
        last = start + np.inf if stop >= recording.duration else stop
        part = slice(*np.searchsorted(stream.time, [start, last]))
        if part.stop - part.start >= FEWEST_SAMPLES:
            cut[name] = SignalStream(stream.time[part], stream.values[part])
    return StageRecording(recording.start_ns, whole | cut)
