"""Whether the autocollimator is believed: one signal without redundancy, held against what turns with the rotor."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from itertools import pairwise
from operator import sub

from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.two_axis_section import Autocollimator
from rotary_error_monitor.metrology.description_check import DARK, MIRRORED, Claim, FigureCheck, Mistake, departure
from rotary_error_monitor.metrology.repeated_readings import run_by_chance
from rotary_error_monitor.pipeline.evidence import AGREEMENT, SHORT, SIGMAS, EvidenceWindow, Reach, Windows
from rotary_error_monitor.pipeline.first_turn import OWN, FirstTurn, own_part
from rotary_error_monitor.pipeline.tilt_look import Look, StillParts, mean_of
from rotary_error_monitor.pipeline.tilt_scatter import TiltScatter
from rotary_error_monitor.pipeline.turn_memory import distance
from rotary_error_monitor.pipeline.usual_level import UsualLevel

_ROOT = math.sqrt(2.0)

STAYED = 0.3
"""Part of a step, or else of the largest tilt, within which a signal that was doubted counts as back where it was."""

STANDING = 3.0
"""How many times what noise moves a reading by, at most, its description must go while it stays as near: so far no
motion that is not described follows the described one backwards."""

REMEMBERED = 10.0
"""How long a step that came back counts as what the instrument may do again, s. What goes out before it shows, two
windows, is less than a fivehundredth of that."""


ABSENT = Autocollimator(range=1.0, resolution=1.0, noise=1.0)
"""Stands for that of a stage which has none: no tilt comes that it would be held against."""


class TiltBelief:
    """Judges the tilt, window by window.

    What is looked for: a value that stands still where noise or the turning mirror must move it, a step that no bearing
    makes, tilt beyond what the stage can do, and a figure over the rotation that a mistake in the connection explains
    better than the description. What is doubted is believed again once it has agreed for `AGREEMENT` with what it was
    before, or with the description where nothing was before.

    Attributes:
        doubt: why the tilt is not believed; empty while it is.
        scale: by which stated standard deviations are to be multiplied: noise is measured, not taken on trust, and a
            reading that repeats is off by what it should have moved, if it is stuck.
        reach: where the part of the tilt that is not described can be at the next ticks.
        figure: of the tilt over the rotation.
    """

    def __init__(self, stage: StageDescription) -> None:
        """Judge of the autocollimator of a stage."""
        self._instrument, self._limits = stage.autocollimator or ABSENT, stage.limits
        self._anywhere = Reach(0.0, 0.0, 2.0 * stage.limits.tilt)
        self._equal_run = run_by_chance(self._instrument.noise, self._instrument.resolution, components=2)
        self._noise = noise = math.hypot(self._instrument.noise, self._instrument.resolution / math.sqrt(12.0))
        stated = stage.uncertainty.get("mirror.tilt")
        late = stage.timing("autocollimator") * stage.limits.speed * math.hypot(*stage.mirror.tilt)
        claim = None if stated is None else Claim(stated, math.hypot(departure(stage.spindle.tilt), late))
        mirror = "tilt of the mirror on the rotor, rad,"
        self._first_turn, self._ring = FirstTurn(), FirstTurn()
        spindle = stage.spindle
        # a push that moves the ring by a metre tilts the rotor by so many rad
        self._yields = spindle.tilt_compliance / spindle.radial_compliance if spindle.radial_compliance else 0.0
        self.figure = FigureCheck({**MIRRORED, **DARK}, noise, 0.5 * stage.limits.tilt, mirror, claim=claim)
        self.reset()

    def reset(self) -> None:
        """Believe the tilt again."""
        self.doubt = ""
        self.scale = self._noise_scale = 1.0
        # of the window that is judged: what it shows, and what turbulence makes of its mean, rad
        self._here, self._drifted = Look(0, 0.0, (0.0, 0.0), (0.0, 0.0), 1.0, 1, self._noise, math.inf), 0.0
        self._excursion: tuple[int, float] | None = None
        self.reach = self._anywhere
        self.forget_turn()
        self._agreeing = self._size = self._near = self._farthest = 0.0
        self._scatter = TiltScatter()
        self._recent: deque[tuple[float, float]] = deque(maxlen=SHORT)
        self._before: tuple[float, float] | None = None
        self._last: Look | None = None
        self._still: Look | None = None
        self._still_parts = StillParts(self._instrument)
        self._repeated: tuple[float, float] | None = None
        self._calm: Look | None = None
        self._gone = self._most_gone = 0.0
        self._finding: Mistake | None = None
        self._usual, self._sound = UsualLevel(), self.figure.copy()

    def forget_turn(self) -> None:
        """Forget what turned with the rotor: its angle is another, or is not known."""
        self.figure.forget()
        self._first_turn.forget()
        self._ring.forget()

    def retract(self, *, doubt: bool) -> None:
        """Forget the last windows, which came of a wrong head; with `doubt`, what was doubted by them as well."""
        if doubt:
            self.doubt, self._before = "", None
        self._agreeing = 0.0
        self._recent.clear()
        self._last = self._still = self._repeated = self._calm = None
        self._still_parts.clear()
        self._gone = 0.0

    def judge(self, window: EvidenceWindow) -> None:
        """Take in a window; the tilt counts only where the rotation is known."""
        self.reach = self._anywhere
        self.scale = self._noise_scale
        if not (window.has("tilt") and window.tells_rotation):
            self._still = self._repeated = self._calm = None
            self._still_parts.clear()
            self._agreeing = self._gone = 0.0
            return
        mean, duration = window.mean, window.duration
        self._drifted = self._drift(duration)
        samples = window.ticks * mean.tilt_samples
        pairs = window.pair("tilt"), window.pair("tilt_surplus")
        self._here = here = self._look(
            window.number, mean.theta, *pairs, samples, mean.tilt_variance, window.pair("surplus")
        )
        stuck = self._is_stuck(samples, duration) or self._still_parts.judge(here, duration) or self._stands(duration)
        step = self._step(duration)
        wrong = stuck or step or self._beyond()
        if not wrong:
            new = self._add([mean.theta], [window.vector("tilt")], [window.vector("tilt_surplus")])
            wrong = self._misread(window.number, math.sqrt(mean.tilt_variance), new)
        inner = (window.ticks - 2) * mean.tilt_samples
        (self._noise_scale,) = self._scatter.measure(
            self._earlier(here), [here], [window.scatter[1:]], [inner], self._drifted
        )
        if wrong or self.doubt:
            self._conclude(duration, wrong, step)
        else:
            self._usual.add(self._here.surplus)
        self._settle(duration)

    def are_calm(self, windows: Windows) -> bool:
        """Whether the tilt moves and fits in windows that have it and the rotation, but for what the last measures."""
        last, calm = self._last, self._calm
        if last is None or last.number != windows.first - 1 or self.doubt:
            return False
        thetas, duration = windows.mean.theta, windows.duration
        since = thetas if calm is None else [calm.theta, *thetas]
        if not self.figure.covers(thetas) or not max(since) - min(since) < 2 * math.pi:
            return False
        readings = [last.reading, *windows.pairs("tilt")]
        surplus = [last.surplus, *windows.pairs("tilt_surplus")]
        least = self._noise / math.sqrt(max(1.0, windows.ticks * max(windows.mean.tilt_samples)))
        allowed = self._step_allowed(duration, math.hypot(least, self._drift(duration)))
        return (
            all(one[0] != other[0] and one[1] != other[1] for one, other in pairwise(readings))
            and all(distance(one, other) <= allowed for one, other in pairwise(surplus))
            and all(math.hypot(x, y) <= 2.0 * self._limits.tilt for x, y in surplus)
        )

    def take_in(self, windows: Windows) -> list[tuple[float, Reach]]:
        """Take in windows that are calm, as `judge` does; give `scale` and `reach` after each."""
        mean, scatter, ticks, duration = windows.mean, windows.scatter, windows.ticks, windows.duration
        self._drifted, self._repeated = self._drift(duration), None
        samples = [ticks * each for each in mean.tilt_samples]
        vectors, ring = (windows.pairs("tilt"), windows.pairs("tilt_surplus")), windows.pairs("surplus")
        looks = list(map(self._look, windows.numbers, mean.theta, *vectors, samples, mean.tilt_variance, ring))
        self._add(mean.theta, windows.vectors("tilt"), windows.vectors("tilt_surplus"))
        scatters = list(zip(scatter.tilt_surplus_x, scatter.tilt_surplus_y, strict=True))
        inner = [(ticks - 2) * each for each in mean.tilt_samples]
        scales = self._scatter.measure(self._earlier(looks[0]), looks, scatters, inner, self._drifted)
        found = []
        wrong = self._misread(windows.last.number, math.sqrt(mean.tilt_variance[-1]), new=False)
        for look, scale in zip(looks, scales, strict=True):
            self._here = self._still = look
            self._still_parts.moved(look)
            self._stands(duration)
            self._noise_scale = scale
            if wrong and look is looks[-1]:
                self._conclude(duration, wrong, "")
            else:
                self._usual.add(look.surplus)
            self._settle(duration)
            found.append((self.scale, self.reach))
        return found

    def _look(
        self,
        number: int,
        theta: float,
        reading: tuple[float, float],
        surplus: tuple[float, float],
        samples: float,
        variance: float,
        ring: tuple[float, float],
    ) -> Look:
        apart = 1 if samples >= 1.0 else min(math.ceil(1.0 / max(samples, 1e-9)), SHORT // 2)
        stated = self._noise / math.sqrt(max(1.0, samples))
        return Look(number, theta, reading, surplus, samples, apart, stated, variance or math.inf, ring)

    def _earlier(self, look: Look) -> list[tuple[float, float]]:
        """What the last windows showed before one, where it comes right behind them and the tilt is believed."""
        follows = self._last is not None and look.number == self._last.number + 1
        return list(self._recent) if follows and not self.doubt else []

    def _settle(self, duration: float) -> None:
        """How sure the tilt is, and where it can be next."""
        here = self._last = self._here
        if not self.doubt:
            self._recent.append(here.surplus)
        self._first_turn.follow(here.number, here.theta, here.surplus, sure=not self.doubt)
        self._ring.follow(here.number, here.theta, here.ring)
        self.scale = math.hypot(self._noise_scale, self._unseen(duration) / math.sqrt(here.variance))
        # one tick is less sure than the mean of a window, and may be a window and a half away
        noise = math.hypot(self._deviation * math.sqrt(1.0 + max(1.0, here.samples)), self._drifted)
        reach = 1.5 * self._limits.tilt_rate * duration + SIGMAS * noise
        self.reach = Reach(*here.surplus, reach)

    def _conclude(self, duration: float, wrong: str, step: str) -> None:
        """Doubt by what is wrong, or believe again what has agreed for long enough."""
        if wrong and not self.doubt:
            self._before = self._repeated or self._mean_before()  # the last windows of a run of equals are the run
            self._recent.clear()
            self._size = self._size if step else 0.0
            self._near = STAYED * (self._size or self._limits.tilt)
            self._farthest, self._sound = 0.0, self.figure.copy()
        fits = self._fits_again() if wrong.startswith(_MISREAD) and self.doubt else False
        if wrong and fits is False:
            # a step back is no new fault, but a reason to wait
            self.doubt = self.doubt if self.doubt and step else wrong
            self._agreeing = 0.0
        if self._before is not None:
            self._farthest = max(self._farthest, distance(self._here.surplus, self._before))
        if fits or not wrong:
            self._agreeing = self._agreeing + duration if fits or self._is_back() else 0.0
            if self._agreeing >= AGREEMENT:
                self.doubt = ""
                if fits and self._finding is not None:
                    self.figure.mend(self._finding, self._sound)
                self._excursion = (self._here.number, self._farthest)

    def _is_stuck(self, samples: float, duration: float) -> str:
        """Equal readings for longer than chance allows, or while the mirror must have moved them."""
        here = self._here
        if self._last is None or self._still is None or here.reading != self._last.reading:
            self._still, self._repeated = here, None
            return ""
        if self._repeated is None:  # the first windows of a run may hold some of what came before
            self._repeated = mean_of(list(self._recent)[: SHORT // 2] or [self._still.surplus])
        run = here.number - self._still.number + 1
        readings = run * samples
        moved = self._moved()
        floor = self._instrument.resolution + SIGMAS * self._instrument.noise
        if readings > self._equal_run or moved > floor:
            return f"stuck: the same reading for {run * duration * 1e3:.0f} ms"
        return ""

    def _stands(self, duration: float) -> str:
        """A reading that stays within its noise for a turn while what is described of it goes on: its digits stick.

        For less than a turn it may stand at a turning point while a motion that is not described goes on; that counts
        as uncertain.
        """
        here, calm = self._here, self._calm
        near = self._instrument.resolution + SIGMAS * _ROOT * self._deviation
        if calm is None or distance(here.reading, calm.reading) > near:
            self._calm, self._gone, self._most_gone = here, 0.0, 0.0
            return ""
        gone = distance(here.surplus, calm.surplus)
        self._gone = gone if gone > 0.5 * near else 0.0  # less is noise
        self._most_gone = max(self._most_gone, self._gone)
        if abs(here.theta - calm.theta) < 2 * math.pi:
            return ""
        far = STANDING * near + SIGMAS * _ROOT * self._drift((here.number - calm.number) * duration)
        if self._most_gone <= far:
            return ""
        return f"stuck: it stays where it is while what is described of it goes {self._most_gone * 1e6:.3g} µrad"

    def _moved(self) -> float:
        """How far the reading should have moved since it has been the same, rad; 0 where it is not."""
        return 0.0 if self._still is None else distance(self._here.surplus, self._still.surplus)

    def _unseen(self, duration: float) -> float:
        """Standard deviation of what the tilt can be off by beyond its noise without being doubted, rad.

        A reading that repeats may be stuck, and have been off from the first: it is where it was before the run, and it
        should have moved since. An instrument that stepped and came back may do so again, which shows only
        once it is beyond `SIGMAS`. What it shows that is not as in the first turn may be its own, however it came.
        """
        ring = self._ring.moved
        yielded = -self._yields * ring[1], self._yields * ring[0]
        own = own_part(self._first_turn.moved, yielded) / OWN
        if self._excursion is not None and (self._here.number - self._excursion[0]) * duration < REMEMBERED:
            own = max(own, self._excursion[1] / SIGMAS)
        off = 0.0 if self._repeated is None else max(self._moved(), distance(self._here.surplus, self._repeated))
        return math.hypot(max(off, self._gone), own)

    def _step(self, duration: float) -> str:
        last = self._last
        if last is None:
            return ""
        passed = (self._here.number - last.number) * duration
        step = distance(self._here.surplus, last.surplus)
        if step <= self._step_allowed(passed, math.hypot(self._deviation, self._drifted)):
            return ""
        self._size = step
        return f"a step of {step * 1e6:.3g} µrad within {passed * 1e3:.3g} ms that no bearing makes"

    def _step_allowed(self, passed: float, noise: float) -> float:
        """Largest step of the tilt within a time (s) that bearing and noise of a standard deviation make, rad."""
        return self._limits.tilt_rate * passed + SIGMAS * _ROOT * noise

    def _beyond(self) -> str:
        surplus = math.hypot(*self._here.surplus)
        if surplus <= 2.0 * self._limits.tilt:  # what is left where the description is the opposite of the truth
            return ""
        most = self._limits.tilt * 1e6
        return f"{surplus * 1e6:.3g} µrad from the described tilt; the stage tilts by {most:.3g} at most"

    def _misread(self, number: int, deviation: float, new: bool) -> str:
        """What the figure shows where its angle is new, and now and then; in between what it showed last."""
        if not new and number % SHORT:
            return self.doubt if self._finding is not None and self.doubt.startswith(_MISREAD) else ""
        found = self._finding = self.figure.judge(deviation)
        if found is None:
            return ""
        return f"{_MISREAD}: {found.mistake} ({found.explained:.0%} of {found.left * 1e6:.3g} µrad that is unexplained)"

    def _add(self, thetas: Sequence[float], readings: Sequence[complex], surplus: Sequence[complex]) -> bool:
        """Add to the figure what is read; give whether an angle is new."""
        return self.figure.extend(thetas, readings, map(sub, readings, surplus))

    @property
    def _deviation(self) -> float:
        """Standard deviation of the mean of the window that is judged, rad."""
        return self._here.stated * self._noise_scale

    def _drift(self, passed: float) -> float:
        """Standard deviation of what turbulence changes within a time (s), over the root of two, rad."""
        turbulence = self._instrument.turbulence
        if turbulence is None:
            return 0.0
        return turbulence.std * math.sqrt(min(1.0, passed / turbulence.correlation_time))

    def _mean_before(self) -> tuple[float, float] | None:
        return mean_of(list(self._recent)) if self._recent else self._before

    def _is_back(self) -> bool:
        """Whether the tilt is near where it was before it was doubted; the description where nothing was before.

        Or where it was most of the time: a fault may have begun unseen, so that it was there already just before.
        """
        surplus, noise = self._here.surplus, SIGMAS * math.hypot(self._deviation, self._drifted)
        if distance(surplus, self._before or (0.0, 0.0)) <= self._near + noise:
            return True
        near = STAYED * (self._size or self._limits.tilt) + noise
        return self._usual.is_at(surplus, (near, near))

    def _fits_again(self) -> bool | None:
        """Whether the description explains this window, and what was found does not; None where nothing tells."""
        if self._finding is None:
            return False
        left, seen = complex(*self._here.surplus), complex(*self._here.reading)
        off, mistaken = abs(left), abs(seen - self._finding.shows(self._here.theta, seen - left))
        if max(off, mistaken) > SIGMAS * math.hypot(self._deviation, self._drifted):
            if off <= STAYED * mistaken:
                return True
            if mistaken <= STAYED * off:
                return False
        return None


_MISREAD = "it does not fit its description"
