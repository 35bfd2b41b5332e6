"""The rotary stage as a problem of diagnosis: rows, blocks, nuisances, and the search for orders and moments."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from typing import ClassVar

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.streams import COMMAND
from rotary_error_monitor.description.topics import samples_topic
from rotary_error_monitor.effects.effect import Cause, Role, among, values_of
from rotary_error_monitor.effects.rotor import HEAD, StageEffect
from rotary_error_monitor.gap.departures import SHARE, Departures, amplitude_sizes, in_proportion, modulated, spread_out
from rotary_error_monitor.gap.noise_level import NOISIER
from rotary_error_monitor.gap.problem import Candidate, Columns, Rows, Share, SparseRows, StructureTest
from rotary_error_monitor.gap.proportion import amplitudes_of
from rotary_error_monitor.gap.structure import Track
from rotary_error_monitor.gap.views import View
from rotary_error_monitor.kinds.stage.added_forms import AddedForms, has_added_forms
from rotary_error_monitor.kinds.stage.admission import check_extent, check_noise, motion_remarks, noise_remarks
from rotary_error_monitor.kinds.stage.another import check_stage, left_out
from rotary_error_monitor.kinds.stage.distortion import distortions
from rotary_error_monitor.kinds.stage.experiments import advise
from rotary_error_monitor.kinds.stage.modulations import (
    IN_PLACE_OF_JUMPS,
    StageModulations,
    goes_by_another_name,
    linear_values,
    neighbouring,
    next_order,
    one_by_one,
)
from rotary_error_monitor.kinds.stage.noise_learning import NoiseLearning
from rotary_error_monitor.kinds.stage.nuisances import Nuisances
from rotary_error_monitor.kinds.stage.of_whole import OfWhole
from rotary_error_monitor.kinds.stage.offset import offset_figures
from rotary_error_monitor.kinds.stage.predictions import KEPT, KeptPredictions
from rotary_error_monitor.kinds.stage.rounding import Rounding
from rotary_error_monitor.kinds.stage.row_weights import row_weights
from rotary_error_monitor.kinds.stage.search import StageSearch, effects_in
from rotary_error_monitor.kinds.stage.signatures import KeptSignatures
from rotary_error_monitor.kinds.stage.tracks import Tracks
from rotary_error_monitor.kinds.stage.where import stage_where
from rotary_error_monitor.noise.channels import noise_std
from rotary_error_monitor.noise.stage_noise import StageNoise
from rotary_error_monitor.noise.whitening import side_by_side
from rotary_error_monitor.sensors.library import instrument_of, sensor_of
from rotary_error_monitor.twin.recording import StageRecording, fields_of
from rotary_error_monitor.twin.stage import Signals, StageTwin, twin_of

_DERIVATIVE_STEP = 1e-3
"""Step of numerical derivatives in usual sizes: far above rounding, far below curvature."""


class StageProblem:
    """A recording of a stage beside its twin.

    Args:
        stage: the description that the twin has.
        recording: what was measured.
        effects: the known effects.
        known: effects that the twin has besides its parameters.
        whole: what is known of the whole, where the recording is a stretch of a longer one.

    Attributes:
        conditions: blocks of constant commanded speed, cut to at least a second.
    """

    m_open = False

    keeps_signatures: ClassVar[bool] = True
    """Whether signatures of effects without size are kept, which takes most of the memory."""

    def __init__(
        self,
        stage: StageDescription,
        recording: StageRecording,
        effects: Sequence[StageEffect],
        known: Sequence[Cause] = (),
        whole: OfWhole | None = None,
    ) -> None:
        self.stage = stage
        self.recording = recording
        self.effects = effects_in(stage, recording, effects)
        self.twin: StageTwin = twin_of(stage, recording, tuple(known), None if whole is None else whole.inputs)
        check_noise(self.twin.times, noise_std(stage))
        left = self._left_of_head if whole is None else None
        whole = whole or OfWhole.of(stage, recording, self.twin)
        self._predictions = KeptPredictions(self.twin, KEPT if self.keeps_signatures else 1)
        self._measured = {name: recording.streams[name].values for name in self.twin.times}
        others = [other.beside(self.twin) for other in whole.others]
        self._nuisances = Nuisances(
            self.twin, others, Rounding(stage, whole.steps), self._measured, self._white, self._jitter
        )
        raw = self.raw_residual(())
        unspiked, weights = self._nuisances.taken_from(raw), row_weights(self.twin, whole.steps, whole.force_noise)
        self.noise = StageNoise(stage, recording, unspiked, weights=weights)
        self.conditions, self.play = whole.conditions, whole.play
        self._search = StageSearch(self)
        self._expected: dict[str, Array] = {}
        self._starts: dict[tuple[str, str], Array] = {}
        self._tracks = Tracks(self)
        self._signatures = KeptSignatures()
        self._learning = NoiseLearning(self, self._signatures, self._nuisances, self._search, self._expected)
        self._learning.begin(raw)
        self._modulations = StageModulations(self.twin, recording.duration, self.play)
        self._added = AddedForms(self.twin, self.play, self._modulations, self._derivatives, left)
        self._arc = whole.arc

    @property
    def channels(self) -> tuple[str, ...]:
        """Channels of rows: with heads `command` and each head, each component of the other sensors."""
        return self.noise.channels

    @property
    def instants(self) -> int:
        """Number of instants at which the heads were read; of a stage without heads, its fastest sensor."""
        return len(self.noise.grid.time) or max(len(self.times(channel)) for channel in self.channels)

    def times(self, channel: str) -> Array:
        """(m,) time of each row, s."""
        return self.noise.times(channel)

    def expected(self, channel: str) -> Array:
        """(m,) expected square of each row under noise alone."""
        if channel not in self._expected:
            self._expected |= self.noise.expected()
        return self._expected[channel]

    def residual(self, causes: Sequence[Cause]) -> Rows:
        """White rows (m, 1) of measured minus predicted."""
        return self.noise.whiten({name: values[:, :, None] for name, values in self.raw_residual(causes).items()})

    def _left_of_head(self, name: str, causes: Sequence[Cause]) -> tuple[Array, Array]:
        """Times (m,) and white rows (m,) of a head beside causes."""
        return self.times(name), self.residual(causes)[name][:, 0]

    def raw_residual(self, causes: Sequence[Cause]) -> Signals:
        """Measured minus predicted (n, k) of each stream, in its unit."""
        predicted = self._predictions.beside(causes) if self.keeps_signatures else self.twin.predict(causes)
        return {name: self._measured[name] - values for name, values in predicted.items()}

    def signature(self, cause: Cause, indices: Sequence[int], others: Sequence[Cause] = ()) -> Columns:
        """White rows of the derivative of the prediction with respect to values of `cause`, beside `others`."""
        return self.own_signature(cause, indices, others)

    def own_signature(self, cause: Cause, indices: Sequence[int], others: Sequence[Cause]) -> Rows:
        """The same as rows that are kept.

        Those of effects without size are wanted again when the jitter is known better, which changes one channel.
        """
        key = (*cause.key, cause.values.tobytes(), tuple(indices))
        alone = all(other.key == cause.key for other in others)
        at_zero = alone and not np.any(cause.values[cause.effect.indices(Role.LINEAR)])
        beside = (*key, values_of(others))
        kept = self._signatures.get(key) if at_zero else self._signatures.recent.get(beside)
        if kept is not None:
            return kept
        stacked = self._derivatives(cause, indices, others)
        rows = self._white(stacked)
        if not at_zero and self.keeps_signatures:
            self._signatures.keep_recent(beside, rows)
        if at_zero and self.keeps_signatures:
            shared = self.noise.shared(stacked)[0] if COMMAND in rows else None
            self._signatures.keep(key, rows, shared)
        return rows

    def distortions(self, candidates: Sequence[Candidate], causes: Sequence[Cause]) -> Sequence[float]:
        """How far causes scale, delay or turn what each candidate shows."""
        return distortions(self.twin, candidates, causes)

    def _derivatives(
        self, cause: Cause, indices: Sequence[int], others: Sequence[Cause], twin: StageTwin | None = None
    ) -> Signals:
        """Derivatives (n, k, len(indices)) of the signals that the cause moves; by another twin, if there is one."""
        effect = cause.effect
        assert isinstance(effect, StageEffect)
        streams = [name for name in self.twin.times if effect.touches(cause.location, name)]
        scales = effect.scales()
        causes = among(cause, others)
        base = twin.predict(causes, streams) if twin else self._predictions.beside_sized(causes)
        columns: dict[str, list[Array]] = {name: [] for name in streams}
        for index in indices:
            step = effect.inward(cause.values, index, float(scales[index]) * _DERIVATIVE_STEP)
            values = cause.values.copy()
            values[index] += step
            moved = (twin or self.twin).predict(among(cause.with_values(values), others), streams)
            for name in streams:
                columns[name].append((moved[name] - base[name]) / step)
        return {name: side_by_side(parts) for name, parts in columns.items()}

    def departures(self, causes: Sequence[Cause]) -> tuple[Departures, ...]:
        """Ways in which each cause may depart from its textbook form."""
        return tuple(self.own_departures(i, causes) for i in range(len(causes)))

    def own_departures(self, place: int, causes: Sequence[Cause]) -> Departures:
        """Those of the cause at one place among the causes, as rows that are kept."""
        cause = causes[place]
        if goes_by_another_name(cause):
            return Departures(place, (), (), np.zeros(0), {})
        linear, amplitudes = linear_values(cause)
        sizes, form_told = amplitude_sizes(cause), self._arc.tells_form(cause)
        neighbours = self._arc.neighbours(cause, neighbouring(cause))
        places = self._modulations.around(cause, neighbours) if self._arc.goes_around(cause) else ()
        around = [self._derivatives(neighbour, linear, ()) for neighbour in neighbours]
        jumps, slow = self._modulations.jumps(cause), self._modulations.may_wander(cause) and form_told
        signatures = self._derivatives(cause, linear, causes)
        added = self._added.of(cause, causes, signatures, jumps)
        of_components = self._modulations.of_components(cause, signatures)
        white: Rows = {}
        labels = {"": spread_out((), amplitudes, sizes)}
        proportional: dict[str, tuple[Array, ...]] = {}
        # One instrument after the other: as signals and white they take more room than all else.
        for names in _by_instrument(signatures):
            stacked: Signals = {}
            for name in names:
                signature = signatures[name]
                modulations = self._modulations.of_state(self.twin.state(name), places, jumps, slow)
                if form_told:
                    modulations += self._modulations.of_size(cause, signature @ amplitudes, name)
                modulations += of_components(len(signature))
                beside = [SHARE * sizes * rows[name] for rows in around]
                beside += [form.signals[name] for form in added if name in form.signals]
                stacked[name] = modulated(signature, amplitudes, sizes, modulations, beside)
                labels[name] = spread_out(modulations, amplitudes, sizes)
                proportional[name] = in_proportion(modulations, sizes, sum(rows.shape[2] for rows in beside))
            white |= self._white(stacked)
        kinds, words, changes = labels[next(reversed(signatures), "")]
        orders = one_by_one(neighbours, SHARE * sizes)
        others = [form for form in added for _ in range(form.count)]
        return Departures(
            place,
            (*kinds, *(order.location for order in orders), *(form.kind for form in others)),
            (*words, *(partial(next_order, order.location) for order in orders), *(form.words for form in others)),
            np.append(changes, np.zeros(len(orders) + len(others))),
            white,
            (*(None for _ in kinds), *orders, *(None for _ in others)),
            proportional.get(next(reversed(signatures), ""), ()),
            frozenset(form.kind for form in added if form.whole) | (IN_PLACE_OF_JUMPS if jumps else frozenset()),
            amplitudes_of(cause),
        )

    def departs_as_whole(self, cause: Cause) -> bool:
        """As `DepartingAsWhole` asks."""
        effect = cause.effect
        assert isinstance(effect, StageEffect)
        return has_added_forms(effect, self._modulations.jumps(cause))

    def turning(self, cause: Cause) -> tuple[Array, float]:
        """As `Reversing` asks."""
        found = self.play.reversals if self._modulations.jumps(cause) else []
        return np.unique(np.concatenate([np.zeros(0), *found])), self.play.duration

    def slipped(self, place: int, causes: Sequence[Cause], moments: Array) -> Columns:
        """As `Reversing` asks."""
        stacked: Signals = {}
        for name, rows in self._added.staying(causes[place], causes).items():
            since = self.play.since(moments, self.twin.times[name])
            stacked[name] = (rows[:, :, None] * since[:, None, :, None]).reshape(*rows.shape[:2], -1)
        return self._white(stacked)

    def independent(self, cause: Cause) -> float:
        """As `Resembled` asks: of a wave on an arc fewer directions are."""
        return self._arc.independent(cause)

    def doubt(self, causes: Sequence[Cause]) -> str:
        """As `Resembled` asks: more orders than an arc tells apart."""
        return self._arc.doubt(causes, self.channels)

    def nuisance(self, causes: Sequence[Cause]) -> Columns:
        """White rows of one standard uncertainty of each uncertain parameter."""
        return self.own_nuisance(causes)

    @property
    def nuisances(self) -> int:
        """Number of uncertain parameters."""
        return self._nuisances.count

    def own_nuisance(self, causes: Sequence[Cause]) -> SparseRows:
        """The same as rows that are kept."""
        return self._nuisances.beside(causes)

    def candidates(self, rest: Rows, causes: Sequence[Cause]) -> tuple[Candidate, ...]:
        """Every effect at every place, orders and moments as found in what is left."""
        found = self._search.candidates(rest)
        self._starts |= {candidate.key: candidate.start for candidate in found}
        return found

    def tracks(self, rest: Rows) -> Iterator[Track]:
        """White rows with what they may depend on, for tests of structure, one channel at a time."""
        return self._tracks.of(rest)

    def structure(self, rest: Rows) -> list[StructureTest]:
        """Tests of each channel against orders, lines, places and times; of those of one instrument together."""
        return self._tracks.structure(rest)

    def learn_noise(self, causes: Sequence[Cause]) -> bool:
        """Estimate level, slow noise and spectrum of the jitter again with the causes taken out.

        Says whether any differs beyond its scatter.
        """
        found = self._learning.learn_levels(causes), self._learning.learn_jitter(causes)
        return self._learning.learn_slow_noise(causes) or any(found)

    def check_plausible(self) -> None:
        """Refuse a recording too short to hold anything out, and a twin whose statements are another stage's.

        Raises:
            InputError: the recording lasts too little, or the twin describes another stage.
        """
        raw = self.raw_residual(())
        check_extent(self.recording, raw, self.noise.std)
        check_stage(self.recording, raw, self.twin, self.effects, self.noise.std)

    def without_slow_noise(self, columns: Columns) -> Columns | None:
        """Columns as beside white noise alone; None where that is what they are."""
        return self._learning.without_slow_noise(columns)

    def where(self, causes: Sequence[Cause], rest: Rows, explained: bool) -> list[Share]:
        """Shares of the channels in topics and fields."""
        return stage_where(self, causes, explained)

    def figures(self, causes: Sequence[Cause]) -> Mapping[str, float]:
        """How wrong the causes make the tool's offset."""
        return offset_figures(self, causes)

    def advice(self, keys: Sequence[tuple[str, str]], causes: Sequence[Cause]) -> str:
        """The measurement that would tell effects apart."""
        return advise(self, keys, causes)

    def remarks(self, rest: Rows) -> tuple[str, ...]:
        """What was left out of the recording, and sensors noisier than the twin says."""
        found = [*self.recording.remarks, *left_out(self.twin, partial(self.raw_residual, ()), self.noise.std)]
        found += [f"{name}: spikes left out: {count}" for name, count in self.spikes().items() if count]
        found += motion_remarks(self.recording, sum(int(noise.uncommanded.sum()) for noise in self.noises))
        found += noise_remarks(self.noises, self.twin.inputs.command)
        for track in self.tracks(rest):
            # Neighbouring rows differ by noise alone, whatever slow thing is left in them.
            level = float(np.sqrt(0.5 * np.mean(np.square(np.diff(track.rows))))) * self._stated(track.channel)
            if level > 1 + max(NOISIER, 5 / np.sqrt(len(track.rows))):
                found.append(f"{track.channel}: noise is {level:.2f} times what the twin states")
        return tuple(found)

    @property
    def noises(self) -> Sequence[StageNoise]:
        """Noise of each stretch of the recording."""
        return (self.noise,)

    def _stated(self, channel: str) -> float:
        """How many times the noise that the stage states a channel is taken to have."""
        if channel == COMMAND:
            return 1.0
        instrument = instrument_of(channel)
        shown = [noise for noise in self.noises if instrument in map(instrument_of, noise.spikes)]
        return float(np.sqrt(np.mean([noise.levels[instrument] ** 2 for noise in shown])))

    def spikes(self) -> dict[str, int]:
        """Number of samples of each sensor that are spikes."""
        return {name: int(spikes.sum()) for name, spikes in self.noise.spikes.items()}

    def views(self, channels: Sequence[str], causes: Sequence[Cause]) -> list[View]:
        """Residuals of channels over rotation and over time, before and after the causes, in µrad or µm."""
        before, after = self.raw_residual(()), self.raw_residual(causes)
        found = []
        for channel in channels:
            topic, _, field = channel.partition(".")
            stream = next(name for name in self.recording.streams if samples_topic(name) == topic)
            axis = fields_of(stream).index(field)
            if stream == COMMAND:
                stream = self.recording.heads[0]
            state, unit = self.twin.state(stream), sensor_of(stream).small_unit
            pair = 1e6 * before[stream][:, axis], 1e6 * after[stream][:, axis]
            found.append(View(channel, "rotation, °", np.degrees(np.mod(state.command, 2 * np.pi)), *pair, unit))
            found.append(View(channel, "time, s", state.time, *pair, unit))
        return found

    def known_start(self, key: tuple[str, str]) -> Array | None:
        """Values from which a candidate that was proposed before is fitted."""
        return self._starts.get(key)

    def _jitter(self, residual: Signals) -> Signals:
        time, jitter = self.noise.grid.time, self.noise.jitter_of(residual)
        return {name: np.interp(self.twin.times[name], time, jitter) for name in residual}

    def _white(self, stacked: Signals) -> Rows:
        return {channel: rows for channel, rows in self.noise.whiten(stacked).items() if np.any(rows)}


def _by_instrument(streams: Iterable[str]) -> list[list[str]]:
    """Streams that are made white together: all heads, which come first, and each of the others on its own."""
    heads = [name for name in streams if instrument_of(name) == HEAD]
    return [*([heads] if heads else []), *([name] for name in streams if name not in heads)]
