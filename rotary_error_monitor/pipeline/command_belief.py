"""Whether the command fits the rotation that the heads tell: their distance, its steps, its slope over the speed."""

from __future__ import annotations

import math
import operator
from collections.abc import Sequence
from itertools import pairwise

from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.pipeline.distance_noise import (
    DistanceNoise,
    Variances,
    deviation,
    missed_in,
    missed_of,
    scatter_in,
)
from rotary_error_monitor.pipeline.distance_places import WindowDistance
from rotary_error_monitor.pipeline.distance_reach import STEADY, DistanceReach
from rotary_error_monitor.pipeline.distance_steps import Compared, DistanceStep, DistanceSteps
from rotary_error_monitor.pipeline.distance_words import tells_distance, why_far, why_late, why_moved
from rotary_error_monitor.pipeline.evidence import AGREEMENT, LONG, SHORT, SIGMAS, EvidenceWindow, Reach, Windows
from rotary_error_monitor.pipeline.far_distance import FarDistance
from rotary_error_monitor.pipeline.mixed_rotation import limits_of_distance
from rotary_error_monitor.pipeline.ring_belief import ABSENT
from rotary_error_monitor.pipeline.speed_slope import SpeedSlope
from rotary_error_monitor.pipeline.standing_command import StandingCommand
from rotary_error_monitor.pipeline.told_speed import ToldSpeed
from rotary_error_monitor.pipeline.usual_distance import UsualDistance
from rotary_error_monitor.pipeline.zero_keeping import ZeroKeeping

RETURNED = 0.3
"""Part of a step, or of what a delay makes, within which the distance counts as back where it was."""


class CommandBelief:
    """Judges whether rotation and command can belong together.

    Attributes:
        doubt: why the command is not believed; empty while it is.
        delay: age of the heads against the command that the distance of both shows, s; zero while it shows none.
        reach: where the distance can be at the next ticks.
        lag: standard uncertainty of the distance at the present speed, for the stamps of both are not surer, rad.
        shift: by how much the distance is another since the heads were silent, rad: all of them may have lost counts
            meanwhile, or the drive has moved. Zero where that is no more than their noise.
    """

    def __init__(self, stage: StageDescription) -> None:
        """Judge of the command of a stage."""
        self._limits, self._timing = limits_of_distance(stage), stage.timing("command")
        encoder = stage.encoder or ABSENT
        self._noise = math.hypot(encoder.noise, encoder.resolution)
        farthest = self._limits.following_error + self._limits.latency * self._limits.speed
        self._anywhere = Reach(0.0, 0.0, farthest)
        self.reset()

    def reset(self) -> None:
        """Believe the command again."""
        self.doubt = ""
        self.delay = self.shift = 0.0
        self._told = ToldSpeed(self._limits.speed)
        # until both have been compared at a speed that is known, the distance is anywhere
        self._met = False
        self.lag = math.hypot(self._limits.speed * self._timing, self._anywhere.reach / SIGMAS)
        self.reach = self._anywhere
        self._agreeing = 0.0
        self._size = 0.0
        self._before: tuple[float, float] | None = None  # distance and speed just before a step, rad and rad/s
        self._far = FarDistance(self._limits.following_error, steady=True)
        self._scattering = DistanceNoise()
        self._steps = DistanceSteps(self._limits.following_error, self._noise)
        self._last: EvidenceWindow | None = None
        self._compared: int | None = None
        self._was_vague = False  # whether the last window was
        self._since = 0  # number of the window since which it is doubted
        self._standing = StandingCommand(self._limits.following_error, self._noise)
        self._speed = 0.0
        self._zero = ZeroKeeping()
        self._slope = SpeedSlope(10 * LONG)
        self._usual = UsualDistance()
        self._farther = DistanceReach(self._limits)
        self._hidden = self._limits.latency  # by how much the delay may be another than is seen, s

    def retract(self, *, doubt: bool) -> None:
        """Forget the last windows, which came of a wrong head; with `doubt`, what was doubted by them as well."""
        if doubt:
            self.doubt, self._before = "", None
            self._far.clear()
        self._agreeing = 0.0
        self._last = self._compared = None
        self._steps.clear()
        self._scattering.clear()
        self._slope.forget()
        if self._zero.open:
            self._zero.begin(sound=False)

    def note_silence(self, number: int) -> None:
        """The heads were silent up to the window of that number: what comes is held against what was before."""
        self._zero.begin(sound=True)
        if self._last is not None:
            self._note_hidden(self._last.duration)
        self._slope.forget()  # a step of the zero in between would pass for a delay
        self.lag = max(self.lag, self._told.largest(number) * math.hypot(self.delay, self._timing))

    @property
    def untold(self) -> float:
        """What counts as uncertainty of the positioning since the heads were silent, rad; 0 where that is told.

        At another speed than before, lost counts of all heads and a delay that no change of speed has shown are alike.
        """
        untold = self._zero.untold / SIGMAS
        return untold if untold > self._noise else 0.0

    @property
    def distance(self) -> float:
        """Rotation by the heads less the command in the last window that has both, rad."""
        return 0.0 if self._last is None else self._last.mean.ecc

    def _note_hidden(self, duration: float) -> None:
        self._hidden = min(self._hidden, self._slope.unseen(duration))

    def agrees(self, window: EvidenceWindow) -> bool:
        """Whether the window that was judged last has shown that rotation and command belong together."""
        return not self.doubt and self._compared == window.number

    def judge(self, window: EvidenceWindow, vague: float = 0.0) -> None:
        """Take in a window in which the heads tell the rotation, but for what is `vague` of it, rad."""
        last, self._last = self._last, window
        self.reach = self._anywhere
        if not tells_distance(window) or last is None or window.number != last.number + 1:
            self._interrupt(window, last)
            return
        self._compared = window.number
        speed, scatter = self._told.of(window, last), scatter_in(window, self._scattering.earlier)
        before, whole = self._steps.before(window, last, self._speed), tells_distance(last) and not self._was_vague
        self._was_vague = False
        wrong = self._beyond(window, speed, vague) or (self._standing.judge(window, last) if whole else "")
        what = Compared(window, last, speed, scatter, self.delay, self._farther.late(self.delay), self._hidden)
        found = self._steps.seen(what, before) if whole else None
        if not (wrong or self.doubt or self._zero.open):
            found = self._sure(what, found)
        before, step, self._size = (before, "", self._size) if found is None else found.told(window.duration)
        if step and self.doubt:
            moved, unknown = self._steps.moved(what, before)
            self._far.step(moved, before.distance, unknown)
        if self._zero.open or not step:  # a step just behind a silence as well: what was before is before both
            step = self._moved_in_silence(window, last, speed, scatter) or step
        wrong = wrong or step
        late, missed = "", missed_in(window)
        if not wrong and not self._steps.is_held:
            bent = self._is_bent(missed, speed)
            self._measure(window.number, [window.mean.theta], [window.mean.ecc], [window.scatter.ecc], [missed], bent)
            late = self._late() if self._steps.is_elsewhere else self._measure_delay(window)
        usual = bool(self.doubt) and self._is_usual(window.mean.ecc, speed)
        wrong = wrong or ("" if usual else late)
        if wrong and not self.doubt:
            self._before, self._since = None, window.number
            self._size = self._size if step else 0.0
            self._note_hidden(window.duration)
        if step and self._before is None and before.number < self._since:  # also where a part of it was told as another
            kept = window.mean.ecc - self._zero.latest, speed
            self._before = kept if self._zero.open else (before.distance, before.speed)
        if wrong:
            self._steps.let_go()
            if step:  # of what is before and behind it the slope would make a delay
                self._slope.forget()
            self.doubt, self._agreeing = self.doubt if self.doubt and step else wrong, 0.0
        elif self.doubt:
            # after a step only the return to what was before it tells that it is over
            back = usual or self._is_back(window.mean.ecc, speed)
            self._agreeing = self._agreeing + window.duration if back else 0.0
            if self._agreeing >= AGREEMENT:
                self._believe_again(usual, late)
        elif last.tells_rotation and not (self._zero.open or self._steps.size):
            self._usual.add(window.mean.ecc, speed, self.delay)
        self._keep(window, last, speed, scatter)

    def judge_vaguely(self, window: EvidenceWindow, vague: float) -> None:
        """Take in a window in which a displacement of the ring may be as much as is `vague` of the rotation, rad.

        It tells whether the command is beyond that, and is otherwise as one of a silence.
        """
        last, self._last = self._last, window
        self.reach, self._was_vague, agreeing = self._anywhere, True, self._agreeing
        self._interrupt(window, last)
        if not tells_distance(window):
            return
        speed = self._told.of(window, last)
        if wrong := self._beyond(window, speed, vague):
            self.doubt, self._since, self._before = self.doubt or wrong, window.number, None
        elif self.doubt and self._far.is_told and self._is_back(window.mean.ecc, speed):
            self._agreeing = agreeing + window.duration
            if self._agreeing >= AGREEMENT:
                self._believe_again(usual=False, late="")

    def _interrupt(self, window: EvidenceWindow, last: EvidenceWindow | None) -> None:
        """Of a window that is not told against the one before."""
        self._agreeing = 0.0
        self._steps.clear()
        self._scattering.interrupt()
        if self._met:
            self.lag = self._lag_at(self._told.of(window, last), scatter_in(window, self._scattering.variances))
        if not self._zero.open:  # a window that lacks some ticks tells nothing against those before it
            self._zero.begin(sound=last is not None and window.number == last.number + 1)

    def _sure(self, what: Compared, found: DistanceStep | None) -> DistanceStep | None:
        """A step that was found, or is held, once it is told."""
        far = self._steps.far(what)
        if far is not None or (found is not None and not self._steps.is_held):
            self._note_hidden(what.window.duration)
            self._scattering.interrupt()
        return self._steps.judge(what._replace(hidden=self._hidden), found, far, self._slope)

    def _keep(self, window: EvidenceWindow, last: EvidenceWindow, speed: float, scatter: float) -> None:
        """What a window that was judged tells of the next ones."""
        missed, noise = missed_in(window), scatter_in(window, self._scattering.variances)
        self._settle(speed, noise, window.mean.ecc, window.duration, missed if missed > self._noise else 0.0)
        plain = self._is_plain(self._steps.places.most_missed(missed), window.scatter.ecc, speed)
        if not (plain or self.doubt or self._steps.size):
            self._keep_reach(window, last, scatter)
        self._steps.places.add(WindowDistance(window.number, window.mean.ecc, speed, missed), plain=plain)
        self._steps.places.follow([window.mean.theta], [window.mean.ecc])

    def _keep_reach(self, window: EvidenceWindow, last: EvidenceWindow, scatter: float) -> None:
        """Of a window in which a step may have begun, where the distance can be next is told by what was before."""
        before = self._steps.before(window, last, self._speed)
        reach = self._farther.within(window.duration, self.delay, self._lag_at(self._speed, scatter))
        faster = self._farther.late(self.delay) * abs(self._speed - before.speed)
        self.reach = Reach(before.distance, 0.0, reach + faster + self._steps.missed(window, last, before))

    def _is_back(self, distance: float, speed: float) -> bool:
        """Whether a distance is what it was before a step, as far as a delay leaves that to be told at this speed."""
        if self._before is None:
            return self._far.has_changed(distance, speed, self.delay, self._farther.late(0.0))
        faster, near = speed - self._before[1], RETURNED * self._size
        back = abs(distance - self._before[0] + self.delay * faster) <= near
        return back and self._hidden * abs(faster) <= near

    def _believe_again(self, usual: bool, late: str) -> None:
        self.doubt = ""
        self._far.clear()
        if usual:  # what was kept of each angle may hold the fault, which was not seen as it began
            self._zero = ZeroKeeping()
        self._zero.begin(sound=False)
        if late:  # by windows of the fault, which the slope still holds
            self.delay = self._usual.delay
            self._slope.restore(-self.delay)

    def _is_usual(self, distance: float, speed: float) -> bool:
        """Whether a distance is what it was most of the time, at the delay that was seen then.

        So the end of a fault is told from its begin where that was not seen: it crept in, or was small. It is near to
        what was usual against the step that ended it, or against what a delay would make if it were real.
        """
        near = RETURNED * max(self._size, abs((self.delay - self._usual.delay) * speed))
        near = min(near, STEADY * self._limits.following_error)
        if not self._far.has_changed(distance, speed, self.delay, self._farther.late(0.0)):
            return False
        return self._usual.is_at(distance, speed, near, self._hidden)

    def foresee(self, windows: Windows) -> None:
        """Make ready for windows that are to be judged."""
        thetas, distances = windows.mean.theta, windows.mean.ecc
        missed = list(map(missed_of, windows.mean.head_bend, windows.mean.command_bend))
        self._slope.foresee(windows.first, SHORT, list(map(operator.sub, thetas, distances)), distances, missed=missed)

    def are_calm(self, windows: Windows) -> bool:
        """Whether rotation and command belong together in windows that have both, but for what the last measures."""
        last, farthest = self._last, self._limits.following_error
        if last is None or last.number != windows.first - 1 or self.doubt or self._zero.open or self._late():
            return False
        plain = self._steps.places.plain
        if plain is None or plain.number != last.number or self._steps.size:
            return False
        if not all(abs(ecc) <= farthest for ecc in windows.mean.ecc):
            return False
        places = [(last.mean.theta, last.mean.ecc), *zip(windows.mean.theta, windows.mean.ecc, strict=True)]
        speeds = [(place[0] - before[0]) / windows.duration for before, place in pairwise(places)]
        missed = map(missed_of, windows.mean.head_bend, windows.mean.command_bend)
        if not all(map(self._is_plain, missed, windows.scatter.ecc, speeds)):
            return False
        most = STEADY * farthest
        return all(
            abs(place[1] - before[1]) <= most and self._standing.goes_along(place, before)
            for before, place in pairwise(places)
        )

    def take_in(self, windows: Windows) -> list[tuple[float, Reach]]:
        """Take in windows that are calm, as `judge` does; give `lag` and `reach` after each."""
        last, self._last = self._last, windows.last
        assert last is not None
        self._compared = windows.last.number
        self._standing.clear()
        thetas, distances, duration = windows.mean.theta, windows.mean.ecc, windows.duration
        moved = [theta - before for before, theta in pairwise([last.mean.theta, *thetas])]
        speeds = [self._told.of(windows[0], last), *[each / duration for each in moved[1:]]]
        if len(windows) > 1:
            self._told.tell(windows.last, speeds[-1])
        missed = list(map(missed_of, windows.mean.head_bend, windows.mean.command_bend))
        for theta, turned, distance, speed, miss in zip(thetas, moved, distances, speeds, missed, strict=True):
            self.shift = self._shift((theta, turned, (distance, speed)), miss)
        measured = self._measure(windows.first, thetas, distances, windows.scatter.ecc, missed)
        samples = [max(1.0, windows.ticks * each) for each in windows.mean.head_samples]
        scatters = list(map(deviation, measured, samples))
        found = []
        for place, (speed, scatter, distance) in enumerate(zip(speeds, scatters, distances, strict=True), start=1):
            if place == len(windows):
                self.doubt = self._measure_delay(windows.last)
                if self.doubt:
                    self._before, self._agreeing, self._size = None, 0.0, 0.0
            if not self.doubt:
                self._usual.add(distance, speed, self.delay)
            self._settle(speed, scatter, distance, duration)
            found.append((self.lag, self.reach))
        self._steps.places.add(WindowDistance(windows.last.number, distances[-1], speeds[-1]), plain=True)
        self._steps.places.follow(thetas, distances)
        return found

    def _settle(self, speed: float, scatter: float, distance: float, duration: float, missed: float = 0.0) -> None:
        """How sure the distance is at a speed (rad/s) with what scatters and is missed (rad), and where it is next."""
        self._speed = speed
        self._met = self._met or (self._compared is not None and self._told.number == self._compared)
        self.lag = self._lag_at(speed, scatter, missed) if self._met else self.lag
        self.reach = Reach(distance, 0.0, self._farther.within(duration, self.delay, self.lag))

    def _lag_at(self, speed: float, scatter: float, missed: float = 0.0) -> float:
        untold = self._zero.untold / SIGMAS
        held, missed = self._steps.size / SIGMAS, self._steps.places.most_missed(missed) / SIGMAS
        return math.hypot(speed * math.hypot(self.delay, self._timing), scatter, self.shift, untold, held, missed)

    def _beyond(self, window: EvidenceWindow, speed: float, vague: float) -> str:
        late, missed = self._farther.late(self.delay), vague + self._steps.places.most_missed(missed_in(window))
        far = self._far.is_far(window.mean.ecc, speed, late, missed)
        return why_far(window.mean.ecc, speed, self._far.allowed(speed, late)) if far else ""

    def _is_bent(self, missed: float, speed: float) -> bool:
        """Whether interpolation misses more than samples and their stamps scatter by, which bends them as well."""
        return missed > self._noise and missed > self._timing * abs(speed)

    def _is_plain(self, missed: float, scatter: float, speed: float) -> bool:
        """Whether a window's distance is one from begin to end: not interpolated wrong, and without a step."""
        return not self._is_bent(missed, speed) and scatter <= self._farther.rippled

    def _moved_in_silence(self, window: EvidenceWindow, last: EvidenceWindow, speed: float, scatter: float) -> str:
        """The same over a silence of the heads: what is less than a step counts as uncertainty."""
        self.shift = self._shift_in_silence(window, last, speed) if not self.doubt else 0.0
        if self.shift <= STEADY * self._limits.following_error + 6.0 * scatter:
            return ""
        self._size = max(self.shift, abs(self._zero.latest))
        return why_moved(self.shift)

    def _shift_in_silence(self, window: EvidenceWindow, last: EvidenceWindow, speed: float) -> float:
        theta, distance = window.mean.theta, window.mean.ecc
        missed = self._steps.places.most_missed(missed_in(window))
        if not (window.tells_rotation and last.tells_rotation):  # the speed is anything up to this one
            return self._shift((theta, 0.0, (distance, 0.0)), missed, (abs(self.delay) + self._hidden) * abs(speed))
        return self._shift((theta, theta - last.mean.theta, (distance, speed)), missed)

    def _shift(self, place: tuple[float, float, tuple[float, float]], missed: float, unknown: float = 0.0) -> float:
        """As `ZeroKeeping.judge`; what interpolation may miss is unknown as well where it is more than noise."""
        unknown += missed if missed > self._noise else 0.0
        return self._zero.judge(*place, self.delay, self._noise, self._hidden, unknown)

    def _measure(
        self,
        first: int,
        thetas: Sequence[float],
        distances: Sequence[float],
        scatters: Sequence[float],
        missed: Sequence[float],
        bent: bool = False,
    ) -> list[Variances | None]:
        """Take in rotation, distance, scatter and what is missed of windows from the `first` on; give variances.

        Of `bent` windows none are learnt.
        """
        for number, (theta, distance, miss) in enumerate(zip(thetas, distances, missed, strict=True), start=first):
            # the command's speed: at its rest a drive that settles goes as its distance does, late or not
            self._slope.add(number, theta - distance, distance, missed=miss)
        if bent:  # what is missed is no noise, and counts by itself
            self._scattering.interrupt()
            return [self._scattering.variances]
        return self._scattering.add(distances, scatters)

    def _measure_delay(self, window: EvidenceWindow) -> str:
        """Renew the delay now and then, behind a window that was taken in; give why it is too much."""
        if window.number % SHORT == 0 and len(self._slope) >= SHORT:
            self._slope.measure(window.duration)
            if self._zero.open:
                self._note_hidden(window.duration)
            self.delay = -float(self._slope.value[0])
            if not self.doubt:
                self._usual.add_delay(self.delay)
            self._farther.learn(self._slope, window.number, window.duration, self.delay, self.lag)
        return self._late()

    def _late(self) -> str:
        return "" if abs(self.delay) <= self._limits.latency else why_late(self.delay, self._limits.latency)
