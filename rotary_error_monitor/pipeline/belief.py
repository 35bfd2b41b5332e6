"""What is believed of a stage's inputs: each kind has a judge, and what they say applies from the next window on."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.metrology.description_check import FigureCheck
from rotary_error_monitor.pipeline.command_belief import CommandBelief
from rotary_error_monitor.pipeline.commanded_rotation import CommandedRotation
from rotary_error_monitor.pipeline.evidence import (
    AGREEMENT,
    LONG,
    Evidence,
    EvidenceWindow,
    WindowGrid,
    Windows,
    are_uneven,
)
from rotary_error_monitor.pipeline.first_turn import OWN
from rotary_error_monitor.pipeline.head_belief import HeadBelief
from rotary_error_monitor.pipeline.mixed_rotation import is_mixed, mixed_in
from rotary_error_monitor.pipeline.ring_belief import ABSENT, RingBelief
from rotary_error_monitor.pipeline.stream_belief import StreamBelief
from rotary_error_monitor.pipeline.tilt_belief import TiltBelief
from rotary_error_monitor.pipeline.turned_part import TurnedPart
from rotary_error_monitor.pipeline.verdict import InputVerdict, Standing, VerdictAssembly
from rotary_error_monitor.signals.streams import SampleStream

FEWEST = 3
"""Windows from which it is faster to ask whether all of them are calm than to judge each."""

_LONG_AGO = -(2**62)
"""Number of a window before all others."""


class Belief:
    """Judges the inputs of an estimator from the evidence of its ticks.

    A verdict follows from whole windows that stand fixed in time and holds for the ticks after them, so that it does
    not depend on how many ticks are handed over at once.

    Attributes:
        verdict: what is believed now.
        turns: whole turns that the heads are ahead of the command, to be taken out of their readings.
        streams, heads, tilt, ring, command: the judges.
    """

    def __init__(
        self,
        stage: StageDescription,
        heads: Mapping[str, float],
        bits: Mapping[str, int],
        streams: Mapping[str, SampleStream],
        period_ns: int,
        disagreement_limit: float,
        check_turns: float,
    ) -> None:
        """Belief in a stage.

        Args:
            stage: its description.
            heads: azimuth of each head by the name of its stream, rad.
            bits: bit of each stream in a mask, by its name; beside the heads `autocollimator` and `command`.
            streams: by their names.
            period_ns: distance of two ticks, ns.
            disagreement_limit: contradiction of the heads, in standard deviations, that is not borne.
            check_turns: part of a turn that must have been seen before the description counts as verified.
        """
        self._bits = dict(bits)
        self._head_names = tuple(heads)
        self._heads_of: dict[int, tuple[str, ...]] = {}  # by the bit mask of streams that are there
        self._mask_of: dict[frozenset[str], int] = {}
        self._grid, self._period_ns = WindowGrid(period_ns), period_ns
        self.streams = StreamBelief(streams, bits)
        self._check_turns = min(check_turns, 1.0)
        encoder, self._commanded = stage.encoder or ABSENT, None if stage.encoder else CommandedRotation(stage)
        self._radius, self._limits = encoder.disc_radius, stage.limits
        self._mixed = TurnedPart() if is_mixed(stage) else None  # seen while rotation and command belonged together
        self._mixed_in = mixed_in(stage) if heads else 0.0
        self._has_tilt = stage.autocollimator is not None
        self.heads = HeadBelief(heads, encoder, stage.limits, disagreement_limit, stage.timing("encoder"))
        self.tilt = TiltBelief(stage)
        self.ring = RingBelief(stage)
        self.command = self._commanded or CommandBelief(stage)
        self._wobble = math.hypot(*stage.mirror.tilt)
        self._assembly = VerdictAssembly(encoder.disc_radius, stage.mirror if self._commanded else None)
        self._pending: Evidence | None = None
        self._explained: set[str] = set()
        self._began: dict[str, int] = {}
        self._heard: int | None = None
        self._zero_open, self._uncommanded = False, 0.0
        self._quiet, self._tilt = False, math.inf
        self.turns = 0
        self.verdict = self._conclude()

    def reset(self) -> None:
        """Believe everything again until it is contradicted anew."""
        for judge in (self.streams, self.heads, self.tilt, self.ring, self.command):
            judge.reset()
        if self._mixed is not None:
            self._mixed.forget()
        self._pending = self._heard = None
        self._zero_open, self._uncommanded = False, 0.0
        self.verdict = self._conclude()

    def forget_time(self) -> None:
        """The clock was set back: no step is told from what was before, for how long ago that was is not known.

        Doubts stay, and so does what a turn has shown: the heads count on while a clock is set.
        """
        self.heads.forget_time()
        for _, judge in self._judges_of_the_rotation():
            judge.retract(doubt=False)
        self._pending = self._heard = None
        self._began = dict.fromkeys(self._began, _LONG_AGO)
        self.verdict = self._conclude()

    @property
    def reasons(self) -> Iterator[tuple[str, str]]:
        """What is doubted, and why."""
        yield from self.streams.doubted.items()
        yield from self.heads.doubted.items()
        for what, why in (
            ("heads", self.heads.contradiction),
            ("ring", self.ring.doubt),
            ("autocollimator", self.tilt.doubt),
            ("command", self.command.doubt),
        ):
            if why:
                yield what, why

    @property
    def left_out(self) -> int:
        """Bit mask of the streams on which no tick may rest: the rest of the evidence is made without them."""
        if not (self.streams.doubted or self.heads.doubted):
            return 0
        return sum(self._bits[name] for name in {*self.streams.doubted, *self.heads.doubted})

    @property
    def unusable(self) -> int:
        """Bit mask of the streams that do not even count as evidence."""
        return sum(self._bits[name] for name in self.streams.doubted)

    @property
    def verified(self) -> float:
        """Part of the turn for the check of the description that has been seen, 0 to 1."""
        if self._mixed is not None:
            return self._part(self._mixed.part)
        return self._part(self._commanded.turned if self._commanded else self.ring.figure.covered)

    def _part(self, covered: float) -> float:
        return min(1.0, covered / self._check_turns) if self._check_turns > 0 else 1.0

    @property
    def unresolved(self) -> Iterator[tuple[str, float]]:
        """What of the description the recording leaves open by more than noise, and how much of it, m or rad."""
        for what, figure in (("eccentricity of the ring", self.ring.figure), ("tilt of the mirror", self.tilt.figure)):
            if figure.stands_out and self._unresolved(figure) > 0.0:
                yield what, figure.unresolved

    def _unresolved(self, figure: FigureCheck) -> float:
        """What a description leaves open that has been held against the stage; before, it counts as unverified."""
        return figure.unresolved if self._check_turns > 0.0 and self._part(figure.covered) == 1.0 else 0.0

    def assess(self, evidence: Evidence) -> tuple[list[tuple[slice, InputVerdict]], int]:
        """Verdicts that hold for the ticks of the evidence, and for how many of them it is valid.

        It ends where the choice of streams changes, or whole turns are to be taken out: what the ticks after that say
        rests on other readings.
        """
        evidence, before = self._joined(evidence)
        self._note_silence(self._grid.number(int(evidence.ticks[0])))
        size, count = self._grid.ticks, len(evidence.ticks)
        skipped = int(-evidence.ticks[0] % size)  # of a window whose begin was not seen
        whole = max(0, (count - skipped) // size)
        parts: list[tuple[slice, InputVerdict]] = []
        begin = 0
        if whole:  # live, most blocks complete no window
            chosen = self.left_out
            for verdict in self._verdicts(self._grid.summarise(evidence.part(slice(skipped, skipped + whole * size)))):
                end = begin + size if begin else skipped + size
                parts.append((slice(max(begin - before, 0), end - before), verdict))
                begin = end
            if self.turns or self.left_out != chosen:
                return parts, begin - before
        if begin < count:
            parts.append((slice(max(begin - before, 0), count - before), self.verdict))
        incomplete = skipped + whole * size
        self._pending = evidence.part(slice(incomplete, count)) if incomplete < count else None
        return parts, count - before

    def _verdicts(self, windows: Windows) -> Iterator[InputVerdict]:
        """What holds for each of some windows, up to that after which whole turns or other streams are to be taken."""
        chosen, self._quiet = self.left_out, self.streams.quiet and not any(windows.broken)
        self.ring.foresee(windows)
        self.command.foresee(windows)
        for some in windows.up_to_measurements():
            if len(some) >= FEWEST and self._are_calm(some):
                yield self.verdict
                yield from self._take_in(some)
                continue
            for place in range(len(some)):
                yield self.verdict
                window = some[place]
                self._judge(window)
                self.turns = int(window.mean.turns) if window.mean.turns.is_integer() else 0
                if self.turns or self.left_out != chosen:
                    return

    def _joined(self, evidence: Evidence) -> tuple[Evidence, int]:
        """Evidence behind that of a window that was not complete, and how many ticks of that there are."""
        pending, self._pending = self._pending, None
        if pending is None or evidence.ticks[0] != pending.ticks[-1] + 1:
            return evidence, 0
        return pending.followed_by(evidence), len(pending.ticks)

    def _note_silence(self, number: int) -> None:
        """The heads count from a zero of their own: after a time in which none was heard, it may be another one."""
        if self._heard is not None and number > self._heard + 1 and not self._zero_open:
            self._zero_open = True
            self.command.note_silence(number)
            self.verdict = self._conclude()

    def _settle_zero(self, window: EvidenceWindow) -> None:
        """The zero of the heads is that of before where the command says so; otherwise a turn has to show it again."""
        if self._head_names and self.streams.refuses_all(self._head_names):
            self._zero_open = True
        if not self._zero_open or not window.has("heads"):
            return
        # Heads are often heard again some windows before the command is.
        self._uncommanded = 0.0 if window.has("command") else self._uncommanded + window.duration
        if self.command.agrees(window):
            self._zero_open = False
        elif self.command.doubt or self._uncommanded > AGREEMENT:
            self._zero_open = False
            self.heads.forget_turn()
            self._forget_ring()
            self.tilt.forget_turn()

    def allow_for_rates(self, rates: Mapping[str, float]) -> None:
        """What interpolation of a head misses contradicts others that have many more samples per s."""
        self.heads.uneven = self.ring.uneven = are_uneven(
            [rates[name] for name in self._head_names if rates[name] > 0.0]
        )

    def _are_calm(self, windows: Windows) -> bool:
        """Whether all that is judged is there and believed in windows, so that their means have to be kept, no more."""
        return (
            self._quiet
            and not (self._commanded or self._zero_open or self._began or self._explained)
            and self._heard == windows.first - 1
            and windows.are_whole
            and self.heads.are_calm(windows, self._heads_there(windows.available[0]))
            and all(judge.are_calm(windows) for judge in (self.ring, self.tilt, self.command))
        )

    def _take_in(self, windows: Windows) -> list[InputVerdict]:
        """Take in windows that are calm, as `_judge` does: verdicts after each but the last."""
        standing = self._standing()  # what stands before them stands in all but the last
        self._heard = windows.numbers[-1]
        judges = (self.heads, self.ring, self.tilt, self.command)
        seen = list(zip(*(judge.take_in(windows) for judge in judges), strict=True))
        self._note_doubts(windows.numbers[-1])
        self.verdict = self._conclude()
        return [
            self._assembly.verdict(standing, heads, late, tilt, command) for heads, late, tilt, command in seen[:-1]
        ]

    def _heads_there(self, available: int) -> tuple[str, ...]:
        if available not in self._heads_of:
            self._heads_of[available] = tuple(name for name in self._head_names if available & self._bits[name])
        return self._heads_of[available]

    def _judge(self, window: EvidenceWindow) -> None:
        self._note_silence(window.number)
        if window.mean.heads > 0.0:
            self._heard = window.number
        before = self._heads_left_out()
        self._tilt = math.hypot(*window.pair("tilt_surplus")) if window.has("tilt") else math.inf
        if not self._quiet:
            self.streams.judge(window, window.number * window.ticks * self._period_ns)
        explained = self.streams.doubted.keys() & {*self._head_names} if self.streams.doubted else set()
        if self.heads.contradiction and self._explained != explained:
            self.heads.reset()  # a stream that is left out for a reason of its own may be the one that is wrong
        self._explained = explained
        self.heads.judge(window, self._heads_there(window.available))
        if self._heads_left_out() - before:
            self._retract(window.number)
        elif self._commanded:
            self._judge_by_command(window)
        elif not (self.heads.contradiction or self.heads.contradicting):
            self._judge_by_heads(window)
        self._note_doubts(window.number)
        self.verdict = self._conclude()

    def _judge_by_heads(self, window: EvidenceWindow) -> None:
        # Those that are left of more; also of a window in which some fell silent.
        if self._mixed is None and not self.heads.tell_rotation(self._heads_there(window.available)):
            self.tilt.judge(window)
            self.command.judge_vaguely(window, self._mixed_in)
            return
        self.ring.judge(window)
        self.tilt.judge(window)
        self.command.judge(window, self.ring.vague / self._radius)
        if self._mixed is not None and self.command.agrees(window):
            self._mixed.add(window.mean.theta)
        self._settle_zero(window)

    def _note_doubts(self, number: int) -> None:
        """Keep since which window what is judged at the rotation is doubted."""
        if self._began or self.ring.doubt or self.tilt.doubt or self.command.doubt:
            doubting = (name for name, judge in self._judges_of_the_rotation() if judge.doubt)
            self._began = {name: self._began.get(name, number) for name in doubting}

    def _heads_left_out(self) -> set[str]:
        if not (self.streams.doubted or self.heads.doubted):
            return set()
        return {*self.streams.doubted, *self.heads.doubted}.intersection(self._head_names)

    def _judge_by_command(self, window: EvidenceWindow) -> None:
        """Without heads the tilt is judged at the command's rotation: not while that is doubted, nor just before."""
        believed = not self.command.doubt
        self.command.judge(window)
        if not self.command.doubt:
            self.tilt.judge(window)
        elif believed:
            self.tilt.retract(doubt=self._began.get("tilt", window.number) >= window.number - LONG)

    def _judges_of_the_rotation(self) -> Iterator[tuple[str, RingBelief | TiltBelief | CommandBelief]]:
        yield from (("ring", self.ring), ("tilt", self.tilt), ("command", self.command))

    def _retract(self, number: int) -> None:
        """A head was wrong, and with it the rotation at which the others were judged of late."""
        for name, judge in self._judges_of_the_rotation():
            judge.retract(doubt=self._began.get(name, number) >= number - LONG)
        if self.verified < 1.0:
            self._forget_ring()
            self.tilt.forget_turn()

    def _forget_ring(self) -> None:
        """What was seen of the ring over the turn tells nothing of what comes."""
        self.ring.figure.forget()
        if self._mixed is not None:
            self._mixed.forget()

    def _conclude(self) -> InputVerdict:
        heads, tilt, command = self.heads, self.tilt, self.command
        return self._assembly.verdict(
            self._standing(),
            (heads.scale, heads.most, heads.rotation),
            self.ring.late,
            (tilt.scale, tilt.reach),
            (command.lag, command.reach),
            heads.reach,
        )

    def _standing(self) -> Standing:
        excluded, heads, ring, tilt, command = self.left_out, self.heads, self.ring, self.tilt, self.command
        # A ring that does not fit and heads that are apart from the command: their zero is wrong, and with it all that
        # is taken off at an angle.
        if tilt.doubt or (ring.doubt and command.doubt):
            excluded |= self._bits["autocollimator"]
        # A motion that the stage cannot make may be a fault of one head: without redundancy it may be in the rotation.
        if command.doubt or (ring.beyond and not heads.redundant):
            excluded |= self._bits["command"]
        unverified = not self._commanded and self.verified < 1.0
        doubts = (  # in the order of `DOUBTS`
            heads.contradiction,
            ring.doubt,
            excluded & self._bits["autocollimator"],
            excluded & self._bits["command"],
            heads.lost,
            self._zero_open or heads.unsettled or unverified,
            self._has_tilt and (self._zero_open or self._part(tilt.figure.covered) < 1.0),
        )
        if heads.settled not in self._mask_of:
            self._mask_of[heads.settled] = sum(self._bits[name] for name in heads.settled)
        return Standing(
            excluded,
            sum([1 << bit for bit, doubted in enumerate(doubts) if doubted]),
            math.hypot(self._unresolved(ring.figure), self._displaced()),
            self._unresolved(tilt.figure),
            self._mask_of[heads.settled],
        )

    def _displaced(self) -> float:
        """What a wrong rotation, or stamps, of the heads make of the radial error motion, m.

        Where the command is not believed the heads may be the ones that are elsewhere on the turn than they say, by as
        much as it is apart, but for where the mirror would show that by more than the tilt that is not expected.
        """
        if not self.command.doubt or self._commanded:
            return 0.0
        turned = min(abs(self.command.distance), math.pi)
        if self._tilt < self._wobble * math.sin(turned / 2.0):  # half of what the mirror would show
            return 0.0
        return self._limits.radial * min(turned, 2.0) / OWN
