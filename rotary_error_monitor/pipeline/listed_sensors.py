"""The sensors that a stage lists, joined to the error motion that heads and autocollimator show."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.streams import AUTOCOLLIMATOR
from rotary_error_monitor.metrology.agreement import chi_square_bound
from rotary_error_monitor.metrology.error_motion import COMPONENTS, ErrorMotion
from rotary_error_monitor.metrology.rigid_motion import Seen, combine, disagreement, disagreements, extend
from rotary_error_monitor.pipeline.evidence import INDEX as EVIDENCE
from rotary_error_monitor.pipeline.evidence import LONG, SHORT, SIGMAS, WindowGrid
from rotary_error_monitor.pipeline.head_belief import WEAK
from rotary_error_monitor.pipeline.joint_limits import JointLimits
from rotary_error_monitor.pipeline.listed_belief import SensorBelief
from rotary_error_monitor.pipeline.listed_readings import ListedReadings, ListedTicks
from rotary_error_monitor.pipeline.listed_windows import sensor_windows
from rotary_error_monitor.pipeline.mixed_rotation import MixedRows, with_positioning
from rotary_error_monitor.pipeline.tilt_by_others import TILT, TiltByOthers
from rotary_error_monitor.pipeline.verdict import DOUBTS
from rotary_error_monitor.signals.resampling import Resampled

AUTOCOLLIMATOR_DOUBTED = 1 << DOUBTS.index("autocollimator")

ECC = COMPONENTS.index("ecc")

RAISES = 8
"""Times that a contradiction is weighed anew at most: each takes the square root of what is left of it."""

EXPLAINED = 1.1
"""Chi-square over its degrees of freedom up to which what was raised explains a contradiction: 5 % of the deviation."""


class _Used(NamedTuple):
    """What m ticks rest on beside heads that tell all, and autocollimator.

    Attributes:
        choices: (m,) bit masks of the listed sensors.
        reading, variance: (m, p) what each field of all sensors says, and how sure.
        heads: rows of heads that do not tell rotation and displacement apart.
    """

    choices: NDArray[np.int64]
    reading: Array
    variance: Array
    heads: MixedRows | None


class ListedSensors:
    """Joins what the listed sensors show to each tick's error motion, by weighted least squares.

    The sensors never enter what heads and autocollimator say: those are judged and published without them, and each
    listed sensor is judged beside them, and all beside one another. A sensor of several fields is believed as a whole.

    Attributes:
        sensitivity: (p, 6) what each field of the sensors sees of the components.
        late: streams of the sensors whose latency is uncertain.
    """

    def __init__(self, stage: StageDescription, bits: Mapping[str, int], period_ns: int) -> None:
        """Sensors of `stage`, with the `bits` of its streams, at ticks that are `period_ns` apart."""
        self._grid, self._period = WindowGrid(period_ns), period_ns * 1e-9
        self._readings = ListedReadings(stage, self._period)
        self.sensitivity = self._readings.sensitivity
        fields = self._readings.fields
        self._streams = [field.stream for field in fields]
        self.late = tuple(dict.fromkeys(self._readings.late))
        self._bits = np.array([bits[stream] for stream in self._streams], np.int64)
        self._first = np.array([column for column, field in enumerate(fields) if field.place == 0], np.intp)
        self._owner = np.array([field.number for field in fields], np.intp)
        self._judges = [SensorBelief(field.sensor) for field in fields]
        self._pending: tuple[int, ListedTicks] | None = None
        self._conflicts: deque[float] = deque(maxlen=SHORT)
        self._limits, self._impossible = JointLimits(stage.limits), np.zeros(len(fields), np.bool_)
        self._alone = stage.encoder is None
        self._tilt, self._tilt_bit = TiltByOthers(), bits[AUTOCOLLIMATOR] if stage.autocollimator else 0
        self._tilt_doubted = False
        self._unless: dict[str, str] = {}  # what may be wrong in the place of a sensor, by its stream

    @property
    def reasons(self) -> Iterator[tuple[str, str]]:
        """Which sensors are doubted, and why: for what the first of its fields that is doubted shows."""
        found: dict[str, str] = {}
        for field, judge in zip(self._readings.fields, self._judges, strict=True):
            if judge.doubt:
                which = f"{field.kind.fields[field.place]}: " if len(field.kind.fields) > 1 else ""
                found.setdefault(field.stream, which + judge.doubt + self._unless.get(field.stream, ""))
        if self._tilt.doubt:
            found[AUTOCOLLIMATOR] = self._tilt.doubt
        for place in np.flatnonzero(self._impossible):
            found.setdefault(self._streams[place], self._limits.doubt)
        return iter(found.items())

    def reset(self) -> None:
        """Believe all sensors again."""
        self._pending = None
        self._conflicts.clear()
        self._limits.reset()
        self._tilt.reset()
        self._tilt_doubted = False
        self._unless.clear()
        self._impossible[:] = False
        for judge in self._judges:
            judge.reset()

    def forget_time(self) -> None:
        """The clock was set back: no step is told from what was before."""
        self._pending = None
        for judge in self._judges:
            judge.pause()

    def complete(
        self,
        first: int,
        motion: ErrorMotion,
        usable: NDArray[np.bool_],
        sampled: Mapping[str, Resampled],
        rates: Mapping[str, float],
        decided: Mapping[int, tuple[float, float]],
        evidence: Array,
        near: Mapping[str, Array],
        late_tilt: Array | None,
        heads: MixedRows | None = None,
    ) -> ErrorMotion:
        """Error motion with what the listed sensors show, and what of them was used.

        Args:
            first: number of the first tick on its grid.
            motion: by heads and autocollimator as it may be published, its streams those that are there.
            usable: (m,) which of it may be published: the rotation at the other ticks is not known.
            sampled: each stream at the ticks.
            rates: samples per s of each stream.
            decided: for ticks, by their place, whose choice of streams is that of a live run, its `sensor_scale` and
                `sensor_conflict`.
            evidence: (m, e) what the ticks say, columns as in `pipeline.evidence`.
            near: (m,) samples per s around each tick of the sensors that may be `late`.
            late_tilt: (m, 2) variance of the tilt by when the autocollimator read it, rad², where that is uncertain.
            heads: what heads see that do not tell rotation and displacement apart.
        """
        there = (motion.streams[:, None] & self._bits != 0) & usable[:, None]
        whole = motion
        motion, refused = self._without_refused(motion, evidence)
        turned = None if heads is None else heads.turned
        shown = self._readings.make(motion, evidence, there, sampled, near, late_tilt, refused, turned)
        used, scale, conflict = self._assess(first, shown, rates)
        done = len(used)
        motion, there, shown = motion.at(slice(done)), there[:done], shown.part(slice(done))
        for place, said in decided.items():
            if place < done:
                used[place], (scale[place], conflict[place]) = there[place], said
        bits = self._bits[self._first]
        choices = (used[:, self._first] * bits).sum(axis=1)
        variance = shown.noise * scale[:, None] ** 2 + shown.systematic + shown.common
        begin = None if heads is None else heads.at(slice(done))
        alone = np.full(done, self._alone) if begin is None else self._alone | (begin.kinds > 0)
        if alone.any():
            found = self._conflict_of(motion, _Used(choices, shown.reading, variance, begin))
            conflict = np.where(alone, np.maximum(conflict, found), conflict)
        streams = motion.streams & ~int(bits.sum()) | choices
        used_too = replace(motion, streams=streams, sensor_scale=scale, sensor_conflict=conflict)
        raised = variance * conflict[:, None] ** 2
        part = self._joined(used_too, _Used(choices, shown.reading, raised, begin))
        if done == len(whole.theta):
            return part
        # from here on the autocollimator is taken no more, or again
        rest, index = slice(done, None), np.arange(done, len(whole.theta))
        others = self.complete(
            first + done,
            whole.at(rest),
            usable[rest],
            {name: each.at(index) for name, each in sampled.items()},
            rates,
            {place - done: said for place, said in decided.items() if place >= done},
            evidence[rest],
            {name: each[rest] for name, each in near.items()},
            None if late_tilt is None else late_tilt[rest],
            None if heads is None else heads.at(rest),
        )
        return ErrorMotion.joined([part, others])

    def _without_refused(self, motion: ErrorMotion, evidence: Array) -> tuple[ErrorMotion, Array]:
        """Error motion without the tilt of an autocollimator that is contradicted; that (m, 3), as in `ListedTicks`."""
        refused = np.full((len(motion.theta), 3), np.nan)
        if not self._tilt.doubt:
            return motion, refused
        taken: NDArray[np.bool_] = np.asarray(motion.observable[:, TILT].all(axis=1))
        refused[taken, :2] = motion.components[taken, TILT]
        refused[taken, 2] = evidence[taken, EVIDENCE["tilt_variance"]]
        whole = replace(
            motion,
            components=motion.components.copy(),
            observable=motion.observable.copy(),
            covariance=motion.covariance.copy(),
            streams=np.where(taken, motion.streams & ~self._tilt_bit, motion.streams),
            doubts=np.where(taken, motion.doubts | AUTOCOLLIMATOR_DOUBTED, motion.doubts),
        )
        whole.hide(taken, range(TILT.start, TILT.stop))
        return whole, refused

    def _conflict_of(self, motion: ErrorMotion, used: _Used) -> Array:
        """(m,) by which the standard deviations of the chosen sensors are raised for what a tick itself shows.

        Where no heads show the radial error motion, a wrong probe is in it until the next window tells.
        """
        found = np.ones(len(used.choices))
        for step in range(RAISES):
            ratio = np.zeros(len(found))
            for chosen, known, seen in self._seen(motion, used._replace(variance=used.variance * found[:, None] ** 2)):
                chi_square, freedom = disagreements(known, seen)
                ratio[chosen] = chi_square / max(freedom, 1)
            # beside heads that are less sure, the sensors have to be raised further until they explain it themselves
            further = (ratio > WEAK**2) if step == 0 else (found > 1.0) & (ratio > EXPLAINED)
            if not further.any():
                break
            found[further] *= np.sqrt(ratio[further])
        return found

    def _joined(self, motion: ErrorMotion, used: _Used) -> ErrorMotion:
        """With what the chosen sensors, bit masks (m,), show."""
        found = motion.components.copy(), motion.observable.copy(), motion.covariance.copy()
        for chosen, known, seen in self._seen(motion, used):
            extended = extend(known, seen)
            if not extended.observable[0, ECC] and motion.observable[chosen[0], ECC]:
                extended = with_positioning(extended, motion.at(chosen))
            upper = np.triu(extended.covariance)  # the two halves differ by rounding, and one half is published
            symmetric = upper + np.triu(upper, 1).swapaxes(1, 2)
            for whole, part in zip(found, (extended.components, extended.observable, symmetric), strict=True):
                whole[chosen] = part
        return replace(motion, components=found[0], observable=found[1], covariance=found[2])

    def _seen(self, motion: ErrorMotion, used: _Used) -> Iterator[tuple[NDArray[np.intp], ErrorMotion, Seen]]:
        """Places of ticks that rest on the same sensors, what is known there without these, and what they see."""
        choices, reading, variance, heads = used
        observable = np.packbits(motion.observable, axis=1)[:, 0]
        some = np.zeros_like(choices) if heads is None else heads.kinds
        keys = zip(observable.tolist(), choices.tolist(), some.tolist(), strict=True)
        for bits, choice, group in {key for key in keys if key[1]}:
            chosen = np.flatnonzero((observable == bits) & (choices == choice) & (some == group))
            sensors = np.flatnonzero(self._bits & choice)
            at = np.ix_(chosen, sensors)
            known, seen = motion.at(chosen), Seen(self.sensitivity[sensors], reading[at], variance[at])
            if heads is not None and group:
                known, seen = heads.at(chosen).joined(known, seen)
            yield chosen, known, seen

    def _assess(
        self, first: int, shown: ListedTicks, rates: Mapping[str, float]
    ) -> tuple[NDArray[np.bool_], Array, Array]:
        """(m, p) which fields are used, and (m,) each by which their standard deviations are multiplied: for noise
        beyond what is stated, and for contradictions among them.

        What windows say holds for the ticks after them, however many of these come at once. It ends where the
        autocollimator is taken no more, or again: what the ticks after that show is held against something else.
        """
        count, before = len(shown.there), 0
        pending, self._pending = self._pending, None
        if pending is not None and pending[0] + len(pending[1].there) == first:
            first, before = pending[0], len(pending[1].there)
            shown = pending[1].followed_by(shown)
        used, scale, conflict = np.zeros((count, len(self._judges)), np.bool_), np.ones(count), np.ones(count)
        begin, taken = 0, not self._tilt.doubt
        while begin < len(shown.there):
            if taken == bool(self._tilt.doubt):
                return used[: begin - before], scale[: begin - before], conflict[: begin - before]
            end = min((self._grid.number(first + begin) + 1) * self._grid.ticks - first, len(shown.there))
            part = shown.part(slice(begin, end))
            fresh = slice(max(begin - before, 0), end - before)
            used[fresh] = self._allowed(shown.part(slice(max(begin, before), end)))
            conflict[fresh] = self.conflict
            scale[fresh] = max((self._judges[column].scale for column in self._believed().nonzero()[0]), default=1.0)
            if end - begin == self._grid.ticks:
                self._judge(self._grid.number(first + begin), part, rates)
                self._contradict(part, rates)
            elif end == len(shown.there) and (first + begin) % self._grid.ticks == 0:
                self._pending = first + begin, part
            begin = end
        return used, scale, conflict

    @property
    def conflict(self) -> float:
        """By which standard deviations of the sensors are raised, for they contradict one another.

        A contradiction cannot be laid at one of them: the uncertainty of all is what it was seen to be (Birge 1932).
        """
        return max(self._conflicts, default=1.0)

    def _contradict(self, shown: ListedTicks, rates: Mapping[str, float]) -> None:
        """Take in how far the sensors that are believed contradict one another over a window."""
        chosen = np.flatnonzero(self._believed() & shown.there.all(axis=0)).tolist()
        if not chosen or not (shown.observable == shown.observable[0]).all():
            return
        ticks = self._grid.ticks
        samples = np.array([max(1.0, ticks * min(1.0, rates[self._streams[place]] * self._period)) for place in chosen])
        motion = ErrorMotion.of(
            shown.theta[:1],
            np.asfortranarray(shown.components).sum(axis=0, keepdims=True) / ticks,
            shown.observable[:1],
            shown.covariance.sum(axis=0, keepdims=True) / ticks,
        )
        reading = shown.reading[:, chosen].sum(axis=0) / ticks
        # held against what is stated, also while more counts: it may cease to from one window to the next
        variance = shown.noise[:, chosen].sum(axis=0) / ticks / samples + self._readings.stated[chosen]
        variance += (shown.turned[:, chosen] ** 2 + shown.late[:, chosen] ** 2).max(axis=0)
        seen = Seen(self.sensitivity[chosen], reading[None], variance[None])
        joined = self._hold_against_limits(motion, seen)
        off = np.mean(shown.refused, axis=0)
        if self._tilt.doubt and joined.observable[0, TILT].all():
            slower = max(1.0, ticks * min(1.0, rates.get(AUTOCOLLIMATOR, 0.0) * self._period))
            std = np.sqrt(off[2] / slower + np.diagonal(joined.covariance[0])[TILT])
            self._tilt.follow(self._grid.duration, off[:2] - joined.components[0, TILT], std)
        chi_square, freedom = disagreement(motion, seen)
        ratio = chi_square / freedom if freedom else 0.0
        self._conflicts.append(math.sqrt(ratio) if freedom and ratio > chi_square_bound(freedom) else 1.0)

    def _hold_against_limits(self, motion: ErrorMotion, seen: Seen) -> ErrorMotion:
        """Use none of the sensors that together show what the stage cannot do, until they do not any more.

        Gives what they show, with what is known.
        """
        joined, known = combine(motion, seen), motion.observable[0]
        pose, std = joined.components[0], np.sqrt(np.diagonal(joined.covariance[0]))
        self._limits.judge(self._grid.duration, float(motion.theta[0]), joined.observable[0] & ~known, pose, std)
        self._impossible[:] = self.sensitivity[:, ~known].any(axis=1) if self._limits.doubt else False
        return joined

    def _allowed(self, shown: ListedTicks) -> NDArray[np.bool_]:
        """(m, p) which fields of a part of a window can be used: those of sensors of which all can."""
        judges = self._judges
        middle, reach = np.array([judge.middle for judge in judges]), np.array([judge.reach for judge in judges])
        near = np.abs(shown.surplus - middle) <= reach
        able = shown.there & self._believed() & ~self._impossible
        return self._whole(able & near & (np.abs(shown.surplus) <= shown.bound))

    def _believed(self) -> NDArray[np.bool_]:
        """(p,) which fields are of sensors that are believed."""
        return self._whole(np.array([not judge.doubt for judge in self._judges], np.bool_))

    def _whole(self, fields: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """(..., p) the fields of sensors all of whose fields are true."""
        return np.asarray(np.logical_and.reduceat(fields, self._first, axis=-1)[..., self._owner])

    def _judge(self, number: int, shown: ListedTicks, rates: Mapping[str, float]) -> None:
        windows = dict(sensor_windows(number, self._grid, self._period, shown, self._streams, rates))
        tilt_shown = bool(shown.observable[:, TILT].all())
        doubted = self._tilt_doubted
        self._tilt_doubted = bool(shown.doubts[0] & AUTOCOLLIMATOR_DOUBTED)
        if self._tilt_doubted and not doubted:
            self._retract(number)
        doubtful = {stream for stream, judge in zip(self._streams, self._judges, strict=True) if judge.doubt}
        self._unless = {stream: instead for stream, instead in self._unless.items() if stream in doubtful}
        open_ = [bool(self._unless.get(stream)) for stream in self._streams]
        believed = self._believed() | self._whole(np.array(open_, np.bool_))
        changes = {
            place: change
            for place, window in windows.items()
            if believed[place] and (change := self._judges[place].change(window)) is not None
        }
        checked = self._readings.checked(shown.observable[0], self._believed() & shown.there.all(axis=0))
        for place, judge in enumerate(self._judges):
            if place in windows:
                judge.judge(windows[place], checked=bool(checked[place]))
            else:
                judge.pause()
        if tilt_shown:
            self._blame(number, changes)

    def _blame(self, number: int, changes: Mapping[int, tuple[float, float]]) -> None:
        """Who is wrong where sensors show what the autocollimator does not, doubted from this window on or before."""
        doubted = [
            self._streams[place]
            for place in changes
            if self._judges[place].doubt
            and (self._judges[place].since == number or self._unless.get(self._streams[place]))
        ]
        if not doubted and all(abs(change) < SIGMAS * std for change, std in changes.values()):
            return
        instead = self._tilt.blame(self.sensitivity, self._owner, changes)
        self._unless.update(dict.fromkeys(doubted, instead))
        if self._tilt.doubt:
            self._retract(number)

    def _retract(self, number: int) -> None:
        """The autocollimator is wrong, and so is what was doubted of late for it was held against that."""
        for place in np.flatnonzero(self.sensitivity[:, TILT].any(axis=1)).tolist():
            judge, stream = self._judges[place], self._streams[place]
            if not judge.doubt or judge.since >= number - LONG or self._unless.pop(stream, ""):
                judge.retract()
