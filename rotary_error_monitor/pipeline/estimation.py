"""The estimator: sample blocks of heads, autocollimator, command and listed sensors in, error motion out.

The same class runs live and in replay. Estimates stand on a grid of ticks fixed in absolute time. A tick is computed
as soon as every stream that is present has the samples for it; a stream that stays behind the others by more than
`patience` counts as absent. Both are judged by stamps, never by when a message happened to arrive. What is believed of
the streams follows from the ticks before (`pipeline.belief`). Should a block come so late live that the estimator went
on without it, the `streams` of the error motion say so; with these, and with what else it says was believed, a replay
repeats the decision.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.streams import AUTOCOLLIMATOR, COMMAND
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.error_motion import ErrorMotion
from rotary_error_monitor.metrology.responses import correct_block
from rotary_error_monitor.pipeline.belief import Belief
from rotary_error_monitor.pipeline.common_turns import CommonTurns
from rotary_error_monitor.pipeline.described_readings import DescribedReadings
from rotary_error_monitor.pipeline.estimator_settings import LONGEST_GAP_NS, EstimatorSettings, EstimatorStatus
from rotary_error_monitor.pipeline.evidence import INDEX as EVIDENCE
from rotary_error_monitor.pipeline.evidence import WINDOW_NS, Evidence
from rotary_error_monitor.pipeline.late_tilt import LateTilt
from rotary_error_monitor.pipeline.listed_sensors import ListedSensors
from rotary_error_monitor.pipeline.mixed_rotation import MixedRotation
from rotary_error_monitor.pipeline.publication import Believed, Decisions, Publication
from rotary_error_monitor.pipeline.repetition import Repetition
from rotary_error_monitor.pipeline.stream_limits import is_saturated, stream_limits
from rotary_error_monitor.pipeline.streams_there import StreamsThere
from rotary_error_monitor.pipeline.ticks import TickMaker
from rotary_error_monitor.signals.arrival import ArrivalCheck
from rotary_error_monitor.signals.blocks import SampleBlock
from rotary_error_monitor.signals.resampling import Resampled, count_decided, rate_around, resample_all, tick_times
from rotary_error_monitor.signals.streams import SampleStream, after_pause

CHUNK = 4096
"""Ticks computed at once at most, so that a replay needs no more memory than a live run."""


class Estimator:
    """Joins the streams of one stage and gives its error motion.

    Attributes:
        status: counts for diagnostics.
        belief: what is believed of the streams, and why not.
    """

    def __init__(
        self,
        stage: StageDescription,
        settings: EstimatorSettings | None = None,
        decisions: Decisions | None = None,
    ) -> None:
        """Estimator of `stage`.

        Args:
            stage: description with the assembly errors that are removed.
            settings: sampling and patience.
            decisions: by stamp (ns) of a tick, as a live run published them; a replay repeats them.
        """
        self._stage = stage
        self._settings = settings or EstimatorSettings()
        self._heads = {f"head_{name}": azimuth for name, azimuth in stage.azimuths.items()}
        self._streams = {
            name: SampleStream(fields, self._settings.patience_ns, limits)
            for name, (fields, limits) in stream_limits(stage).items()
        }
        self._responses = {name: each for name, each in stage.responses.items() if not each.is_ideal}
        self._ranges = {AUTOCOLLIMATOR, *stage.sensors}  # streams of instruments that have an end of their range
        self._arrivals = {name: ArrivalCheck(self._settings.max_age_ns) for name in self._streams}
        # As the wire contract numbers them, also for a stage without autocollimator.
        names = (*self._heads, AUTOCOLLIMATOR, COMMAND, *stage.sensors)
        self._bits = {name: 1 << i for i, name in enumerate(names)}
        self._judged_bits = sum(bit for name, bit in self._bits.items() if name not in stage.sensors)
        self._head_bits = sum(self._bits[name] for name in self._heads)
        self._common_turns = CommonTurns({name: self._bits[name] for name in self._heads})
        heads = self._head_bits
        self._repetition = None if decisions is None else Repetition(decisions, self._bits, tuple(self._streams), heads)
        period_ns, limit = self._settings.period_ns, self._settings.disagreement_limit
        live = decisions is None
        self._there = StreamsThere(self._streams, self._bits, tuple(self._heads), period_ns, live=live)
        self._ticks = TickMaker(stage, self._heads, self._bits, period_ns * 1e-9)
        self._described = DescribedReadings(stage, self._streams, self._bits, self._ticks.layout, period_ns)
        self._joined_ns = self._settings.max_gap_ns if decisions is None else LONGEST_GAP_NS
        self._publication = Publication(stage, self._bits)
        self._mixed = MixedRotation(stage, self._bits) if stage.azimuths else None
        self._late_tilt = LateTilt(stage, {name: self._bits[name] for name in self._heads})
        self.belief = Belief(
            stage, self._heads, self._bits, self._streams, period_ns, limit, self._settings.check_turns
        )
        self._listed = ListedSensors(stage, self._bits, period_ns) if stage.sensors else None
        self.status = EstimatorStatus(streams=self._streams)
        self._begin()

    def _begin(self) -> None:
        self._decided = dict.fromkeys(self._streams, -1)
        self._grown: set[str] = set()
        self._next: int | None = None
        self._watermark = -1
        self._longest_block_ns = 0
        self.status.joined = 0

    @property
    def unrepeated(self) -> Mapping[str, list[NDArray[np.int64]]]:
        """Ticks (ns) that cannot be repeated as the live run published them, by the stream that the recording lacks."""
        return {} if self._repetition is None else self._repetition.unrepeated

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the streams that are taken: `head_<letter>`, `autocollimator`, `command`, listed sensors."""
        return tuple(self._streams)

    @property
    def sensor_conflict(self) -> float:
        """By which the standard deviations of the listed sensors are raised, for they contradict one another."""
        return 1.0 if self._listed is None else self._listed.conflict

    @property
    def reasons(self) -> Iterator[tuple[str, str]]:
        """What is doubted, and why."""
        yield from self.belief.reasons
        if self._listed is not None:
            yield from self._listed.reasons

    def reset(self) -> None:
        """Believe all inputs again, until they are contradicted anew."""
        self.belief.reset()
        if self._listed is not None:
            self._listed.reset()

    def accept(self, name: str, block: SampleBlock, arrival_ns: int | None = None, *, recorded: bool = False) -> None:
        """Take in a block of stream `name` and wait for `advance`: of blocks that came together, one reckoning.

        Args:
            name: of the stream.
            block: its samples, as the instrument gave them.
            arrival_ns: when it arrived, timestamp (ns); without it the stamps are not held against a clock.
            recorded: it arrived at a recorder and is replayed: what was in the future there is refused as live; nothing
                is too old, and no clock is set back.

        Raises:
            InputError: there is no such stream, the block lacks its fields, or its stamps are in the future or too old.
                Of a block that is in the future in part, only these samples are refused, and counted.
        """
        if name not in self._streams:
            raise InputError(f"no stream '{name}' in this stage; it has {', '.join(self._streams)}")
        stream = self._streams[name]
        block.check_fields(name, stream.names)
        if name in self._responses:
            block = correct_block(block, stream.names, self._responses[name])
        until_ns = None if arrival_ns is None else self._check_arrival(name, block, arrival_ns, recorded)
        if name in self._ranges:
            block = self._without_saturated(name, block)
        if stream.push(block, until_ns) == 0:
            return
        newest = stream.newest_ns
        assert newest is not None
        period = self._settings.period_ns
        if self._next is None:
            begin_ns = int(stream.times_ns[0])
            self._next = begin_ns // period + 1
            for each in self._streams.values():
                each.expect(begin_ns)
            if self._repetition is not None:
                self._repetition.begin_ns = begin_ns
        self._watermark = max(self._watermark, newest)
        self._allow_for_blocks(stream.block_duration_ns)
        if self._repetition is not None:
            self._repetition.reach_ns = stream.patience_ns
        self._grown.add(name)

    def advance(self) -> list[ErrorMotion]:
        """Error motion that is complete with what was accepted, in parts of at least one tick."""
        for name in self._grown:
            self._decided[name] = self._decided_until(self._streams[name], self._decided[name])
        self._grown.clear()
        return self._advance()

    def finish(self) -> list[ErrorMotion]:
        """Error motion of the ticks that were still waiting: no more samples will come."""
        return self._advance(last=True)

    def _check_arrival(self, name: str, block: SampleBlock, arrival_ns: int, recorded: bool) -> int:
        """Refuse what is in the future or old; where the clock was set back behind what is known, begin anew.

        Returns the timestamp (ns) beyond which its samples are in the future.

        Raises:
            InputError: the block is refused.
        """
        check = self._arrivals[name]
        newest_ns = check.newest_of(block.times_ns, arrival_ns, block.newest_ns)
        judge = check.judge_ahead if recorded else check.judge
        if refusal := judge(newest_ns, arrival_ns):
            reason = refusal.partition(":")[0]
            self.status.refused[name, reason] += 1
            raise InputError(refusal)
        if not recorded and check.was_set_back(self._streams[name].newest_ns, arrival_ns):
            for stream in self._streams.values():
                stream.clear()
            self._begin()
            self.belief.forget_time()
            if self._listed is not None:
                self._listed.forget_time()
            self.status.restarts += 1
        return arrival_ns + check.ahead_ns

    def _allow_for_blocks(self, duration_ns: int) -> None:
        """A stream is behind the others by a whole block until its own block is complete."""
        if duration_ns > self._longest_block_ns:
            self._longest_block_ns = duration_ns
            for stream in self._streams.values():
                stream.patience_ns = self._settings.patience_ns + duration_ns

    def _without_saturated(self, name: str, block: SampleBlock) -> SampleBlock:
        """A block without the samples at the end of the instrument's range, where they say nothing."""
        saturated = is_saturated(self._stage, name, block)
        if not saturated.any():
            return block
        self.status.saturated[name] += int(saturated.sum())
        return SampleBlock(block.stamp_ns, block.names, block.rows[~saturated])

    def _decided_until(self, stream: SampleStream, before: int) -> int:
        """Index of the first tick for which `stream` still misses samples; `before` is what it was until now."""
        assert self._next is not None and stream.newest_ns is not None
        period, times = self._settings.period_ns, stream.times_ns
        first = max(before, self._next, int(times[0]) // period)
        if len(times) > 1:  # up to the last sample but one all is decided, however long there was none before
            first = max(first, int(times[-2]) // period - 1)
        count = stream.newest_ns // period + 1 - first
        if count <= 0:
            return first
        return first + count_decided(times, first, count, period)

    def _advance(self, last: bool = False) -> list[ErrorMotion]:
        if self._next is None:
            return []
        present = [name for name, stream in self._streams.items() if not stream.is_absent(self._watermark)]
        self.status.absent = tuple(name for name in self._streams if name not in present)
        limit = self._watermark // self._settings.period_ns if last else min(self._decided[name] for name in present)
        if self._next >= limit:
            return []
        found = []
        decided = {} if last else {name: self._decided[name] for name in present}
        self._described.look()
        while self._next < limit:
            parts, count = self._compute(self._next, min(limit - self._next, CHUNK), decided)
            if count == 0:
                break
            found += parts
            streams, begin = self._streams.values(), self._next + count
            self._next = after_pause(streams, begin, limit, self._settings.period_ns, self._joined_ns)
        # what of a window is refused is a part of all its samples, however many ticks were handed over at once
        kept_ns = max(WINDOW_NS, self._settings.period_ns)
        until_ns = min(self._next * self._settings.period_ns - kept_ns, self._described.needed_from_ns(self._next))
        for stream in self._streams.values():
            stream.trim(until_ns)
        return found

    def _compute(self, first: int, count: int, decided: Mapping[str, int]) -> tuple[list[ErrorMotion], int]:
        """Error motion of ticks from `first` on, each choice of streams and each belief in its turn, and of how many.

        They are fewer than `count` where others rest on more than is `decided` by the streams that are waited for.
        """
        settings = self._settings
        ticks = tick_times(first, count, settings.period_ns)
        signals = [(stream.times_ns, stream.values) for stream in self._streams.values()]
        values = resample_all(signals, ticks, settings.period_ns, settings.max_gap_ns)
        if self._repetition is None:
            self.status.note_sparse(settings.max_gap_ns)
        else:
            values = self._repetition.joined(ticks, signals, values, settings.period_ns)
        resampled = dict(zip(self._streams, values, strict=True))
        known = self._described.count_known(ticks, resampled, decided)
        if known < count:
            count, ticks = known, ticks[:known]
            resampled = {name: each.at(np.arange(count)) for name, each in resampled.items()}
            if count == 0:
                return [], 0
        there = self._there.at(ticks, list(resampled.values()))
        self._common_turns.take_out(resampled, there)
        found, begin = [], 0
        while begin < count:
            index = np.arange(begin, count)
            part = resampled if begin == 0 else {name: each.at(index) for name, each in resampled.items()}
            motion, done = self._compute_part(ticks[begin:], part, there[begin:], first + begin)
            found += motion
            begin += done
            if self.belief.turns:
                self._take_out_turns(self.belief.turns, resampled)
        return found, count

    def _take_out_turns(self, turns: int, resampled: Mapping[str, Resampled]) -> None:
        """Count the heads' turns as the command does, from now on."""
        self.status.turns += turns
        self.belief.turns = 0
        for name in self._heads:
            self._streams[name].turn_by(turns)
            resampled[name].values[:, 0] -= 2 * np.pi * turns

    def _compute_part(
        self, ticks: NDArray[np.int64], sampled: Mapping[str, Resampled], there: NDArray[np.int64], first: int
    ) -> tuple[list[ErrorMotion], int]:
        """Error motion of ticks as long as the same heads are believed, and how many ticks these are."""
        heard, there = there, there & ~self.belief.unusable
        own = there & ~self.belief.left_out
        used, decided = (own, {}) if self._repetition is None else self._repetition.choose(ticks, there, own)
        for place, decision in decided.items():  # a head that the live run did not wait for yet was not there for it
            there[place] &= decision.streams | self.belief.left_out | ~self._head_bits
        rates = {name: stream.rate for name, stream in self._streams.items()}
        self.belief.allow_for_rates(rates)
        described, lacking = self._described.at(ticks, sampled, used, self._joined_ns)
        if lacking is not None:
            there, used = there & ~lacking, used & ~lacking
        motion, evidence, disagreement, redundancy = self._make(sampled, (heard, there, used), first, rates, described)
        verdicts, done = self.belief.assess(evidence)
        believed = Believed(verdicts)
        for place, decision in decided.items():
            if place < done:
                believed.repeat(place, decision)
        whole = slice(done)
        late = self._late_tilt.variance(ticks, motion.theta, evidence.values, self._streams, used, done)
        motion, publish = self._publication.finish(
            ticks[whole],
            motion if done == len(ticks) else motion.at(whole),
            evidence.values[whole],
            used[whole] & ~believed.excluded,
            disagreement[whole],
            redundancy[whole],
            believed,
            late,
        )
        mixed = None if self._mixed is None else self._mixed.at(motion.streams)
        known_by = evidence.values[:done]
        seen = (known_by[:, EVIDENCE["heads"]] > 0.0) | (known_by[:, EVIDENCE["commanded"]] > 0.0)
        rows = None
        if self._mixed is not None and mixed is not None and mixed.any():
            rows = self._mixed.take_out(motion, mixed, sampled, rates)
            # beside a command that is not there, or doubted, nothing tells whether a head is wrong
            seen &= ~mixed | (motion.streams & self._bits[COMMAND] != 0)
        if self._listed is not None:
            known = {name: each.at(np.arange(done)) for name, each in sampled.items()}
            said = {at: (each.sensor_scale, each.sensor_conflict) for at, each in decided.items() if at < done}
            near = {each: rate_around(self._streams[each].times_ns, ticks[whole]) for each in self._listed.late}
            usable = publish & seen
            motion = self._listed.complete(first, motion, usable, known, rates, said, known_by, near, late, rows)
        if self._repetition is None:
            self.status.unobservable += int((~seen).sum())
        else:
            published = self._repetition.note(ticks[:done], there[:done])
            seen, publish = seen & published, publish & published
        self.status.withheld += int((seen & ~publish).sum())
        publish &= seen
        self._count(publish, there[whole], float(disagreement[done - 1]))
        if publish.all():
            return [motion], done
        return [motion.at(publish)] if publish.any() else [], done

    def _count(self, publish: NDArray[np.bool_], there: NDArray[np.int64], disagreement: float) -> None:
        """Count what is published, with the streams that were there, for the diagnostics."""
        judged = {name: bit for name, bit in self._bits.items() if bit & self._judged_bits & ~self.belief.unusable}
        self.status.note_unjoined(judged, there, publish)
        self.status.estimates += int(publish.sum())
        self.status.disagreement = disagreement

    def _make(
        self,
        sampled: Mapping[str, Resampled],
        masks: tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]],
        first: int,
        rates: Mapping[str, float],
        described: Resampled | None,
    ) -> tuple[ErrorMotion, Evidence, NDArray[np.float64], NDArray[np.int64]]:
        """Error motion of all ticks, what they say of the streams, contradiction of the heads, and their redundancy.

        The `masks` are of the streams that are heard, those of them that count as evidence, and those that are used.
        """
        heard, there, used = masks
        made = self._ticks.make_each(sampled, there, used, rates, described)
        if made.layout is not None:
            self.status.unseen_orders = self._ticks.unseen_orders(made.layout)
        if self.status.turns:  # the rotor has not moved by what was taken out between two windows
            made.evidence[:, EVIDENCE["theta"]] += 2 * np.pi * self.status.turns
        numbers = first + np.arange(len(there))
        available, heard = there & self._judged_bits, heard & self._judged_bits
        evidence = Evidence(numbers, made.evidence, made.parity, available, heard, made.readings)
        return made.motion, evidence, made.disagreement, made.redundancy
