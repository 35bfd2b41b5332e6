"""Steps of the distance of rotation and command: told from what the drive, a delay and interpolation make."""

from __future__ import annotations

from typing import NamedTuple

from rotary_error_monitor.pipeline.distance_noise import missed_in
from rotary_error_monitor.pipeline.distance_places import DistancePlaces, WindowDistance
from rotary_error_monitor.pipeline.distance_reach import STEADY
from rotary_error_monitor.pipeline.distance_words import why_stepped
from rotary_error_monitor.pipeline.evidence import SIGMAS, EvidenceWindow
from rotary_error_monitor.pipeline.held_step import HeldStep
from rotary_error_monitor.pipeline.speed_slope import SpeedSlope


class Compared(NamedTuple):
    """A window that is held against those before it.

    Attributes:
        window, last: it and the one before it.
        speed: in it, rad/s.
        scatter: standard deviation of the distance, rad.
        delay: of the heads against the command, as it is known, s.
        late: delay that the distance leaves possible where it shows one, s.
        hidden: by how much the delay may be another than is seen, s.
    """

    window: EvidenceWindow
    last: EvidenceWindow
    speed: float
    scatter: float
    delay: float
    late: float
    hidden: float

    @property
    def distance(self) -> float:
        """Of rotation and command, rad."""
        return self.window.mean.ecc

    def change(self, before: WindowDistance) -> float:
        """Of the distance since a place, beside what the delay makes, rad."""
        return abs(self.distance - before.distance + self.delay * (self.speed - before.speed))


class DistanceStep(NamedTuple):
    """A step: its size (rad), windows from what was before it, and that."""

    size: float
    passed: int
    before: WindowDistance

    def told(self, duration: float) -> tuple[WindowDistance, str, float]:
        """What was before it, the same in words by the duration of a window, s, and its size."""
        return self.before, why_stepped(self.size, self.passed * duration), self.size


class DistanceSteps:
    """Finds steps, and holds what may be one as uncertainty until it is told.

    What changes within the time that a step takes may be one. Where interpolation misses more for longer than that, as
    of a slow command in a long ramp, none can be told: the distance is held against what it was before that, and the
    change counts as uncertainty until it is over.

    Attributes:
        places: where the distance was.
    """

    def __init__(self, following_error: float, noise: float) -> None:
        """Of a drive with a largest `following_error`, and a reading with a `noise`, rad."""
        self._farthest, self._noise = following_error, noise
        self.places = DistancePlaces()
        self._held, self._elsewhere = HeldStep(following_error), HeldStep(following_error)

    def clear(self) -> None:
        """Forget all: what comes does not follow upon it."""
        self.places.clear()
        self.let_go()

    def let_go(self) -> None:
        """Hold nothing."""
        self._held.clear()
        self._elsewhere.clear()

    @property
    def is_held(self) -> bool:
        """Whether what may be a step is held: of it neither noise nor a delay can be learnt."""
        return self._held.before is not None

    @property
    def is_elsewhere(self) -> bool:
        """Whether the distance is held against what it was before a time in which nothing could be told."""
        return self._elsewhere.before is not None

    @property
    def size(self) -> float:
        """Of what is held, rad."""
        return max(self._held.size, self._elsewhere.size)

    def before(self, window: EvidenceWindow, last: EvidenceWindow, speed: float) -> WindowDistance:
        """What a window is held against, with the `speed` (rad/s) of the one before it."""
        return self._held.before or self.places.before(window.number, WindowDistance(last.number, last.mean.ecc, speed))

    def missed(self, window: EvidenceWindow, last: EvidenceWindow, before: WindowDistance) -> float:
        """What interpolation may miss of a change, rad: a third difference that changes its sign tells less."""
        return missed_in(window) + self.places.most_missed(max(missed_in(last), before.missed))

    def seen(self, what: Compared, before: WindowDistance) -> DistanceStep | None:
        """A step that neither the drive nor a change of speed makes."""
        moved, unknown = self.moved(what, before)
        if abs(moved) <= STEADY * self._farthest + unknown:
            return None
        return DistanceStep(abs(moved), what.window.number - before.number, before)

    def moved(self, what: Compared, before: WindowDistance) -> tuple[float, float]:
        """By how much the distance is another than before, and how much of that may be no step, rad."""
        accelerated = what.late * abs(what.speed - before.speed)
        unknown = accelerated + self.missed(what.window, what.last, before) + SIGMAS * what.scatter
        return what.distance - before.distance, unknown

    def far(self, what: Compared) -> WindowDistance | None:
        """Where the distance was told last, where that is too long ago to tell a step and it is another now."""
        before = self.places.plain
        if before is None or self.is_elsewhere or not self.places.is_old(what.window.number):
            return None
        return before if what.change(before) > STEADY * self._farthest + SIGMAS * what.scatter else None

    def judge(
        self, what: Compared, seen: DistanceStep | None, far: WindowDistance | None, slope: SpeedSlope
    ) -> DistanceStep | None:
        """A step of what is held, or has to be: until it is told from what the drive makes as it accelerates.

        Held from this window on are a step that is `seen`, and a distance that is `far` from what it was.

        The `slope` knows the course of rotation and distance for longer than the places do, but not while one is held.
        """
        if far is not None:
            self._hold(self._elsewhere, far, what, slope)
        if seen is not None and not self.is_held:
            self._hold(self._held, seen.before, what, slope)
        known = STEADY * self._farthest
        # in a time in which no step could be told the drive may go from one end of its following error to the other
        for held, sure in ((self._held, known), (self._elsewhere, 2.0 * self._farthest)):
            if held.before is not None and (step := self._told(held, held.before, what, (known, sure))):
                return step
        return None

    def _hold(self, held: HeldStep, before: WindowDistance, what: Compared, slope: SpeedSlope) -> None:
        earlier = max(slope.course(), self.places.course, key=lambda each: len(each[0]))
        held.hold(before, what.last.number, earlier, what.scatter or self._noise)

    def _told(
        self, held: HeldStep, before: WindowDistance, what: Compared, limits: tuple[float, float]
    ) -> DistanceStep | None:
        """A change that is held is none within the first of some limits, and is one beyond the other, rad."""
        change, mean = what.change(before), what.window.mean
        held.add(mean.theta, mean.ecc, change)
        unknown = self.missed(what.window, what.last, before) + held.explained
        none, sure = (each + SIGMAS * held.scatter for each in limits)
        if change > sure + unknown + what.hidden * abs(what.speed - before.speed):
            outcome = "step"
        else:
            outcome = "over" if max(change, unknown) <= none else "open"
        if not held.lasts(outcome) or outcome == "open":
            return None
        if outcome == "step":
            return DistanceStep(change, held.passed, before)
        held.clear()
        return None
