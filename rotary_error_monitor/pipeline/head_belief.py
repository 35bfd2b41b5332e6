"""Whether the read heads are believed, and how far: judged over time, not tick by tick."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping, Sequence

from rotary_error_monitor.description.stage_limits import StageLimits
from rotary_error_monitor.description.stage_section import Encoder
from rotary_error_monitor.metrology.agreement import chi_square_bound
from rotary_error_monitor.metrology.encoder_heads import HeadLayout
from rotary_error_monitor.metrology.error_motion import KINK
from rotary_error_monitor.pipeline.evidence import (
    AGREEMENT,
    EVERYWHERE,
    PERSISTENT,
    SHORT,
    EvidenceWindow,
    Windows,
)
from rotary_error_monitor.pipeline.head_history import HeadHistory, Shown
from rotary_error_monitor.pipeline.heads_own import HeadsOwn
from rotary_error_monitor.pipeline.lasting_contradiction import LastingContradiction
from rotary_error_monitor.pipeline.ring_scatter import StampsScatter
from rotary_error_monitor.pipeline.ring_steps import RingSteps
from rotary_error_monitor.pipeline.wrong_head import fault_in_words, wrong_head

WEAK = 3.0
"""Lasting contradiction, in standard deviations, from which the head that causes it is left out once it is known."""

RETURNED = 0.1
"""Part of the contradiction, as chi-square, below which a head that was off counts as back: a third of its fault."""

TRIES = 5
"""Windows from one attempt to find the wrong head to the next."""


class HeadBelief:
    """Judges the heads of one ring, window by window.

    What lasts of their contradiction raises their uncertainty, so that it holds for what the contradiction lets
    through (Birge 1932). A head that is known to cause it is left out. One that is beyond the limit and belongs to
    nobody is the reason to believe none, until all have agreed for `AGREEMENT`. Heads without redundancy contradict
    nothing; a step that no bearing makes is the reason then.

    Attributes:
        doubted: why a head is left out, by its name.
        contradiction: why none is believed; empty while they are.
        contradicted: by how much they contradict one another beyond what they state: by which their standard deviations
            are raised at least.
        scale: by which stated standard deviations are to be multiplied, for the stamps as well: what two opposed heads
            make of theirs contradicts no other head.
        rotation: standard deviation of the rotation against its command, rad, by what heads may have lost alike.
        contradicting: whether the heads contradicted one another in the last window, beyond what is borne.
        redundant: whether a further fault of a head would show.
        uneven: whether some heads have many more samples per s than others; whoever knows sets it.
        reach: where the part of the radial error motion that is not described can be at the next ticks, where only that
            tells a fault.
    """

    def __init__(
        self, heads: Mapping[str, float], encoder: Encoder, limits: StageLimits, limit: float, timing: float
    ) -> None:
        """Judge of a ring.

        Args:
            heads: azimuth of each head by its name, rad.
            encoder: description of the ring.
            limits: of the stage.
            limit: contradiction, in standard deviations, that is not borne.
            timing: standard uncertainty of the stamps of two heads against one another, s.
        """
        self._heads = dict(heads)
        self._radius, self._count = encoder.disc_radius, encoder.resolution
        self._limits, self._limit, self._timing = limits, limit, timing
        # of a reading by the centre of heads in any usual places, of which each would come of a single sample
        self._noisiest = 2.0 * math.hypot(encoder.noise, encoder.resolution / math.sqrt(12.0))
        self._described = HeadLayout(tuple(heads.values())).redundancy if heads else 0
        self.doubted: dict[str, str] = {}
        self.contradiction = ""
        self.scale = self.contradicted = self._tolerance = 1.0
        self.redundant = self._described > 0
        self.reach = EVERYWHERE
        self.contradicting = False
        self._agreeing = 0.0
        self._contradictions = LastingContradiction()
        self._lasting = 1.0
        self._believed: tuple[str, ...] = ()
        self._layouts: dict[tuple[str, ...], HeadLayout] = {}
        self._redundancy = 0
        self._untried = TRIES
        self._size = 0.0
        self._since = self._unusual = 0  # windows since one was beyond anything, and beyond what is usual
        self._steps = RingSteps(tuple(heads), limits, encoder.disc_radius, timing)
        self._own, self.rotation = HeadsOwn(limits, timing), 0.0
        self._history = HeadHistory()
        self._by_stamps = StampsScatter()
        self._last: tuple[int, float] | None = None
        self.uneven = False
        self._bends: deque[float] = deque(maxlen=SHORT)  # four samples around a tick, as far apart as any that count
        self._forget()

    def reset(self) -> None:
        """Believe all heads again."""
        self.doubted.clear()
        self.contradiction = ""
        self.scale = self.contradicted = self._tolerance = 1.0
        self._agreeing = 0.0
        self._steps.reset()
        self._own.reset()
        self._history.forget_turns()
        self._by_stamps = StampsScatter()
        self._settle()
        self._forget()

    def forget_turn(self) -> None:
        """Forget where the ring was at which angle: the heads may count from another zero."""
        self._own.forget_turn()
        self._history.forget_turns()

    @property
    def most(self) -> float:
        """Contradiction that is borne, in standard deviations of noise: beside noise the stamps are uncertain."""
        return self._borne(self._tolerance)

    def _borne(self, tolerance: float) -> float:
        if tolerance == 1.0:
            return self._limit
        return math.hypot(self._limit, WEAK * math.sqrt(tolerance**2 - 1.0))

    @property
    def unsettled(self) -> bool:
        """Whether heads without redundancy are used of which one may have lost counts."""
        return not self.redundant and not self._steps.are_settled

    @property
    def settled(self) -> frozenset[str]:
        """Heads that were never silent, or are where they were before."""
        return self._steps.settled

    @property
    def tells_rotation(self) -> bool:
        """Whether the heads in use tell the rotation free of the ring's displacement."""
        return self.tell_rotation(self._believed)

    def tell_rotation(self, available: Sequence[str]) -> bool:
        """The same of those that are believed of the heads `available`; also where none is."""
        believed = tuple(name for name in available if name not in self.doubted)
        return not believed or self._layout(believed).tells_rotation

    @property
    def lost(self) -> bool:
        """Whether redundancy that the stage is described with is not there any more."""
        return self._described > 0 and not self.redundant

    def judge(self, window: EvidenceWindow, available: Sequence[str]) -> None:
        """Take in a window in which the heads `available` were there all the time, whether believed or not."""
        self.reach, self.contradicting, self.rotation = EVERYWHERE, False, 0.0
        self._steps.note_missing(available)
        if not window.has("heads") or not window.steady:
            self._agreeing = 0.0
            return
        believed = tuple(name for name in available if name not in self.doubted) if self.doubted else tuple(available)
        if believed != self._believed:
            self._believed = believed
            self._forget()
        self._redundancy = self._layout(believed).redundancy
        self.redundant = self._redundancy > 0
        seen = window.mean
        rate = self._allow(window.number, window.duration, seen.theta, seen.radial_variance, seen.head_bend)
        self._restore(window, available)
        mean, there = window.mean, window.has("command")
        shown = mean.theta, mean.ecc if there else math.nan, mean.surplus_x, mean.surplus_y
        if self.redundant:
            self._judge_redundant(window, shown, rate)
        else:
            self._history.add(window.number, shown, [], sure=False)
            self._judge_steps(window, shown, rate)

    def are_calm(self, windows: Windows, available: Sequence[str]) -> bool:
        """Whether the same heads agree in windows that all have them, as they did before: nothing is to be judged."""
        last, least = self._last, min(WEAK, self._limit) ** 2
        return (
            self.redundant
            and not (self.doubted or self.contradiction)
            and self._since >= SHORT
            and self._believed == available
            and self.settled == frozenset(available)
            and last is not None
            and last[0] == windows.first - 1
            and all(found < least for found in windows.mean.believed_agreement)
        )

    def take_in(self, windows: Windows) -> list[tuple[float, float, float]]:
        """Take in windows that are calm, as `judge` does; give `scale`, `most` and `rotation` after each."""
        self._unusual = 0
        mean, duration, tolerances, rates = windows.mean, windows.duration, list[float](), list[float]()
        for row in zip(windows.numbers, mean.theta, mean.radial_variance, mean.head_bend, strict=True):
            number, theta, variance, bend = row
            rates.append(self._allow(number, duration, theta, variance, bend))
            tolerances.append(self._tolerance)
        shown = zip(mean.theta, mean.ecc, mean.surplus_x, mean.surplus_y, strict=True)
        parity = windows.parity[:, : self._redundancy].tolist()
        for each in zip(windows.numbers, shown, parity, strict=True):
            self._history.add(*each, sure=True)
        weighed = self._weigh(mean.believed_agreement, mean.head_samples, tolerances, windows.ticks)
        if self._is_bent(duration):
            return [(*each, 0.0) for each in weighed]
        places, found = windows.pairs("surplus"), list[tuple[float, float, float]]()
        self._steps.follow_turn(windows.last.has("radial"), windows.first, mean.theta, places)
        rows = zip(windows.numbers, mean.theta, places, mean.radial_variance, mean.head_samples, strict=True)
        for seen, ecc, (scale, most), rate in zip(rows, mean.ecc, weighed, rates, strict=True):
            number, theta, place, variance, samples = seen
            self._own.note_place(number, duration, place, variance / max(1.0, samples * windows.ticks), rate)
            rotation = self._own.rotation(number, theta, ecc)
            own = self._own.raised(scale, number, theta, place, variance)
            found.append((own if self._own.counts else scale, most, rotation))
        self.scale, _, self.rotation = found[-1]
        return found

    def _allow(self, number: int, duration: float, theta: float, variance: float, bend: float) -> float:
        """Bear what stamps and interpolation make; give the speed of the readings over their noise, 1/s.

        Args:
            number: of the window.
            duration: of it, s.
            theta: rotation in it, rad.
            variance: of what is seen of the ring's centre, m².
            bend: mean third difference of the heads, rad: within some samples it may be none where these miss most.
        """
        self._bends.append(abs(bend) if self.uneven else 0.0)
        missed = KINK * max(self._bends)
        # noise of a head's: stamps show as speed over noise, beside which no more counts of what interpolation misses
        reading = min(math.sqrt(2.0 * variance) / self._radius, self._noisiest)
        last, self._last = self._last, (number, theta)
        if last is None or number == last[0] or reading == 0.0:
            speed, reading, missed = 0.0, 1.0, 0.0
        else:
            speed = (theta - last[1]) / ((number - last[0]) * duration)
        self._tolerance = math.hypot(1.0, self._timing * speed / reading, missed / reading)
        return abs(speed) / reading

    def _weigh(
        self, agreements: Sequence[float], samples: Sequence[float], tolerances: Sequence[float], ticks: int
    ) -> list[tuple[float, float]]:
        """Take in contradictions that were found, as chi-square over degrees of freedom; give `scale` and `most`.

        Each of a window with so many `ticks` and independent `samples` behind one, and the tolerance in it.
        """
        borne = [self._borne(each) for each in tolerances]
        # what is borne changes with the speed: each window has its own
        largest = [most**2 for most in borne]
        counted = [min(each, most) for each, most in zip(agreements, largest, strict=True)]
        freedoms = [max(1.0, ticks * each) * self._redundancy for each in samples]
        weighed = []
        for place, end in enumerate(self._contradictions.add(counted)):
            of_last, of_some, of_all = self._contradictions.excesses(freedoms[place], end)
            self.contradicted = math.sqrt(max(1.0, of_last, of_some, of_all))
            self._lasting = math.sqrt(max(1.0, of_all))
            found, tolerance = agreements[place], tolerances[place]
            self.scale = max(self.contradicted, tolerance)
            self.contradicting = found >= largest[place]
            weakly = found >= (WEAK * tolerance) ** 2
            if not weakly and not self.doubted:
                self._by_stamps.add(found, tolerance)
            self._beyond.append((self.contradicting, weakly, found))
            self._since = 0 if self.contradicting or weakly else self._since + 1
            weighed.append((self.scale, borne[place]))
        return weighed

    def _judge_redundant(self, window: EvidenceWindow, shown: Shown, rate: float) -> None:
        found = window.mean.believed_agreement
        self._note_unusual(found)
        self._weigh([found], [window.mean.head_samples], [self._tolerance], window.ticks)
        sure = not self.contradicting and not self.contradiction
        self._history.add(window.number, shown, window.parity[: self._redundancy].tolist(), sure=sure)
        if not self.contradicting and not self.contradiction:
            self._steps.settle()
            # where heads show the ring that can be believed
            if not self._is_bent(window.duration):
                theta, place, mean = window.mean.theta, window.pair("surplus"), window.mean
                variance = mean.radial_variance / max(1.0, mean.head_samples * window.ticks)
                self._own.note_place(window.number, window.duration, place, variance, rate)
                self._steps.follow_turn(window.has("radial"), window.number, [theta], [place])
                self.rotation = self._own.rotation(window.number, theta, shown[1])
                own = self._own.raised(self.scale, window.number, theta, place, window.mean.radial_variance)
                self.scale = own if self._own.counts else self.scale
        if self._since >= SHORT and not self.contradiction:  # none of the last ones is beyond anything
            return
        persistent = sum([beyond for beyond, _, _ in self._beyond]) >= PERSISTENT
        lasting = sum([beyond for _, beyond, _ in self._beyond]) >= PERSISTENT
        if not (self.contradiction or persistent or lasting):
            return
        self._untried += 1
        if self._untried >= TRIES:
            self._untried = 0
            if self._leave_out_the_wrong(slow=persistent or bool(self.contradiction)):
                self.contradiction, self._size = "", found
                return
        if persistent and not self.contradiction:
            self._size, self._own.counts = found, True
            largest = math.sqrt(max(each for _, _, each in self._beyond))
            self.contradiction = (
                f"the heads contradict one another by {largest:.3g} standard deviations, and nothing tells "
                "which is wrong; a head's place, zero or direction, the graduation or the described noise may be wrong"
            )

    def _note_unusual(self, found: float) -> None:
        """A contradiction that stamps may make, but did not at such a speed before, may be a head's that was wrong.

        `found` is its chi-square over degrees of freedom.
        """
        usual = self._by_stamps.at(self._tolerance)
        self._unusual = self._unusual + 1 if usual > 0.0 and found > WEAK**2 * max(1.0, usual) else 0
        if self._unusual >= PERSISTENT:
            self._own.counts = True

    def _leave_out_the_wrong(self, *, slow: bool) -> bool:
        """Leave out the head that causes the contradiction; give whether its course tells which that is.

        A `slow` course is asked where otherwise none would be believed: what is borne may go as slowly, as stamps do.
        """
        found = wrong_head(self._layout(self._believed), self._history, self._limits, self._radius, slow=slow)
        if found is None:
            return False
        self._own.counts = True
        self.doubted[self._believed[found.head]] = fault_in_words(found.fault, self._count)
        self._agreeing = 0.0
        self._settle()
        return True

    def _judge_steps(self, window: EvidenceWindow, shown: Shown, rate: float) -> None:
        """Without redundancy nothing but a step that no bearing makes tells a fault.

        What lasted of a contradiction that heads showed which are gone may be in those that are left; and what is not
        as in the first turn may be a head's.
        """
        self.contradicted = self._lasting
        place, variance = window.pair("surplus"), window.mean.radial_variance
        scale = max(self.contradicted, self._tolerance)
        self.scale = self._own.raised(scale, window.number, window.mean.theta, place, variance)
        self.rotation = self._own.rotation(window.number, window.mean.theta, shown[1])
        self.contradiction = self._steps.judge(window, shown, self._history.before(), rate, self.contradiction)
        self.reach = self._steps.reach

    def _is_bent(self, duration: float) -> bool:
        """Whether interpolation misses more than the ring moves in a window, s, so that it shows none of its place."""
        return KINK * max(self._bends) * self._radius > self._limits.radial_rate * duration

    def _restore(self, window: EvidenceWindow, available: Sequence[str]) -> None:
        """Believe all heads again once all of them have agreed long enough."""
        if not (self.doubted or (self.contradiction and self.redundant)):
            return
        whole = self._layout(tuple(available))
        back = all(name in available for name in self.doubted) and whole.redundancy > 0
        freedom = max(1.0, window.ticks * window.mean.head_samples) * max(whole.redundancy, 1)
        bound = chi_square_bound(freedom)
        # what the uncertainty of stamps explains at a speed is no return of a head that was off before, but for as much
        # as stamps made there before: what is left of a fault is within the uncertainty that they give at such a speed
        usual = self._by_stamps.at(self._tolerance)
        most = bound * min(self._tolerance**2, max(1.0, RETURNED * self._size / bound, usual))
        fine = back and window.mean.agreement <= most
        self._agreeing = self._agreeing + window.duration if fine else 0.0
        if self._agreeing >= AGREEMENT:
            self.doubted.clear()
            self.contradiction = ""

    def _settle(self) -> None:
        """What the heads contradicted one another by so far is accounted for."""
        self._contradictions.clear()
        self._lasting = 1.0

    def _forget(self) -> None:
        """What was remembered of other heads tells nothing about these, but for how far they contradict one another."""
        self._steps.begin(self._believed)
        self._own.begin()
        self._beyond: deque[tuple[bool, bool, float]] = deque(maxlen=SHORT)
        self._since = 0
        self._history.begin(self._believed)
        self._untried = TRIES

    def forget_time(self) -> None:
        """The clock was set back: how much time has passed since the last window is not known; doubts stay."""
        for each in (self._contradictions, self._beyond):
            each.clear()
        self._history.forget_last()
        self._agreeing = 0.0
        self._steps.forget_time()
        self._own.begin()
        self._last = None

    def _layout(self, names: tuple[str, ...]) -> HeadLayout:
        if names not in self._layouts:
            self._layouts[names] = HeadLayout(tuple(self._heads[name] for name in names))
        return self._layouts[names]
