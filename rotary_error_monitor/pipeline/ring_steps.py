"""Steps of the ring that no bearing makes: what tells a fault of heads of which none could contradict the others."""

from __future__ import annotations

import math
from collections.abc import Sequence

from rotary_error_monitor.description.stage_limits import StageLimits
from rotary_error_monitor.pipeline.evidence import AGREEMENT, EVERYWHERE, EvidenceWindow, Reach
from rotary_error_monitor.pipeline.head_history import Shown
from rotary_error_monitor.pipeline.ring_jumps import Change, RingJumps, change_between
from rotary_error_monitor.pipeline.ring_scatter import RingScatter
from rotary_error_monitor.pipeline.turn_memory import CentreCourse, Held, distance

RETURNED_STEP = 0.5
"""Part of a step within which the ring counts as back where it was: nearer to that than to where it stepped to."""


class RingSteps:
    """Where the ring's centre was, and whether it went from there by more than a bearing does.

    A step of a head lasts, so it is over only where the ring is again where it was at this angle before. So is one that
    a head may have made while it was silent, in which time the ring may have gone further as well.

    Attributes:
        settled: heads that were never silent, or are where they were before: others would have to show that they lost
            counts meanwhile.
        reach: where the part of the radial error motion that is not described can be at the next ticks.
    """

    def __init__(self, heads: Sequence[str], limits: StageLimits, radius: float, timing: float) -> None:
        """Of a ring of a radius, m, whose heads have stamps of a standard uncertainty `timing`, s."""
        self._heads, self._limits, self._radius = frozenset(heads), limits, radius
        self._scatter = RingScatter(timing)
        self.reset()

    def reset(self) -> None:
        """Nothing was seen; all heads are where they were."""
        self.settled = self._heads
        self.reach = EVERYWHERE
        self._courses: dict[tuple[str, ...], CentreCourse] = {}
        self._scatter.reset()
        self.begin(())

    def begin(self, believed: tuple[str, ...]) -> None:
        """What comes next is seen by these heads: where the ring was is the same, but not what of it they see."""
        self._believed = believed
        self._scatter.forget_last()
        for course in self._courses.values():
            course.held = None
        self._jumps = RingJumps()
        self._step = self._returning = 0.0

    def forget_time(self) -> None:
        """The clock was set back: how much time has passed since the last window is not known."""
        self._scatter.forget_last()
        for course in self._courses.values():
            course.forget_last()

    def note_missing(self, available: Sequence[str]) -> None:
        """Heads that are not among these may come back with counts lost."""
        if self._believed and len(self.settled.intersection(available)) < len(self.settled):  # before, none has begun
            self.settled &= frozenset(available)

    def settle(self) -> None:
        """The heads in use are where they were: others contradict none of them."""
        if not self.are_settled:
            self.settled |= frozenset(self._believed)

    @property
    def are_settled(self) -> bool:
        """Whether none of the heads in use may have lost counts."""
        return self.settled.issuperset(self._believed)

    def follow_turn(
        self, shows_all: bool, first: int, thetas: Sequence[float], places: Sequence[tuple[float, float]]
    ) -> None:
        """Take in where the ring is for sure, in windows one behind another from the `first` on."""
        self._course(shows_all).follow_turn(first, thetas, places)

    def judge(self, window: EvidenceWindow, shown: Shown, before: Shown | None, rate: float, contradiction: str) -> str:
        """Take in a window of heads without redundancy; give why none of them is believed, nothing if they are.

        Args:
            window: what they say.
            shown: the same, as a history keeps it, and what was shown in the window `before`.
            before: None where that was not of the same heads.
            rate: speed of a head's reading over the noise of it, 1/s: noise and stamps make no more at such a speed.
            contradiction: why none was believed until now.
        """
        self.reach = EVERYWHERE
        course, place, theta = self._course(window.has("radial")), window.pair("surplus"), window.mean.theta
        moved = course.moved(window.number, theta)
        passed = math.inf if course.number is None else (window.number - course.number) * window.duration
        variance = window.mean.radial_variance / max(1.0, window.ticks * window.mean.head_samples)
        noise = math.sqrt(variance) * self._scatter.scale(rate)
        allowed = self._limits.radial_rate * window.duration + 6.0 * math.sqrt(2.0) * noise
        earlier, last, sure = course.turn.get(theta, moved), course.place, course.sure
        change = None if before is None else change_between(before, shown, self._radius)
        gap = course.number != window.number - 1
        course.follow(window.number, theta, place, sure=False)
        slow = course.hold(Held(window.number, shown, noise), self._limits.radial_rate * window.duration)
        if contradiction:
            # a jump within a gap may be less than what the bearing had the time for
            self._jumps.follow(change, jump=gap or (change is not None and max(map(abs, change[:2])) > allowed))
            if self._step == 0.0:  # it is not the step of one component that would show here when it is over
                return contradiction
            off = math.inf if earlier is None else distance(place, earlier)
            return "" if self._is_back(window.duration, off, 2.0 * allowed) else contradiction
        settled = self.are_settled
        steps = [distance(place, each) for each in (last, None if settled else earlier) if each is not None]
        most = allowed + min(self._limits.radial_rate * (passed - window.duration), self._limits.radial)
        if steps and min(steps) > most:
            return self._contradict(change, min(steps), most, passed)
        if slow is not None and settled:
            self._jumps.forget_last()  # what was before is in it
            change = change_between(slow.before, shown, self._radius)
            return self._contradict(change, slow.size, slow.most, slow.windows * window.duration)
        self._jumps.follow(change, jump=False)
        self._scatter.add(window.number, place, variance, rate)
        told = [distance(place, each) for each in (last if sure else None, earlier) if each is not None]
        self._note(bool(steps) and min(steps) > allowed, min(told) <= allowed if told else course.turn.empty)
        course.sure = self.are_settled
        if course.sure and course.holds(window.number):  # what is interpolated may be a part of a step
            course.turn.put(theta, moved, place)
        self.reach = Reach(*place, 1.5 * allowed)
        return ""

    def _note(self, stepped: bool, near: bool) -> None:
        """Keep whether the heads in use may have lost counts: not if they are near to where they were."""
        if stepped:  # in windows that tell nothing a bearing has the time for as much
            self.settled = self.settled - frozenset(self._believed)
        if near:
            self.settle()

    def _contradict(self, change: Change | None, step: float, most: float, passed: float) -> str:
        """Why no head is believed: a step (m) within a time (s) that is more than the most that is explained."""
        self._step, self._returning = step, 0.0
        self._jumps.begin(change)
        return (
            f"a step of {step * 1e6:.3g} µm within {passed * 1e3:g} ms that no bearing makes (at most {most * 1e6:.3g} "
            "µm), and too few heads to tell which is wrong; a reset accepts it"
        )

    def _is_back(self, duration: float, off: float, near: float) -> bool:
        """Whether the ring has long enough been as near to where it was at this angle, or its jumps are taken back.

        What is nearer than `near`, m, is within the uncertainty that is stated without redundancy.
        """
        back = off <= min(RETURNED_STEP * self._step, near) or self._jumps.are_taken_back(RETURNED_STEP, near)
        self._returning = self._returning + duration if back else 0.0
        if self._returning < AGREEMENT:
            return False
        self._step = 0.0
        return True

    def _course(self, shows_all: bool) -> CentreCourse:
        """Where the ring was: heads that show all of its displacement show the same, whichever they are."""
        return self._courses.setdefault(() if shows_all else self._believed, CentreCourse())
