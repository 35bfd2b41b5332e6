"""Whether the autocollimator is believed: one signal without redundancy, held against what turns with the rotor."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from itertools import pairwise

from rotary_error_monitor.description.stage import Autocollimator, StageDescription
from rotary_error_monitor.metrology.agreement import chi_square_bound
from rotary_error_monitor.metrology.description_check import DARK, MIRRORED, Claim, FigureCheck, departure
from rotary_error_monitor.metrology.repeated_readings import run_by_chance
from rotary_error_monitor.pipeline.evidence import LONG, SHORT, Reach, Window
from rotary_error_monitor.pipeline.head_belief import AGREEMENT
from rotary_error_monitor.pipeline.trailing import Trailing

SIGMAS = 6.0
"""Standard deviations that noise does not reach in years."""

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
        claim = None if stated is None else Claim(stated, departure(stage.spindle.tilt))
        mirror = "tilt of the mirror on the rotor, rad,"
        self.figure = FigureCheck({**MIRRORED, **DARK}, noise, 0.5 * stage.limits.tilt, mirror, claim=claim)
        self.reset()

    def reset(self) -> None:
        """Believe the tilt again."""
        self.doubt = ""
        self.scale = self._noise_scale = 1.0
        # of the window that is judged: what is read, what of it is not described, what noise and turbulence make of it
        self._reading = self._surplus = self._last_reading = self._last_surplus = 0.0, 0.0
        self._stated, self._drifted, self._samples = self._noise, 0.0, 1.0
        self._excursion: tuple[int, float] | None = None
        self.reach = self._anywhere
        self.figure.forget()
        self._agreeing = self._size = self._near = self._farthest = 0.0
        self._squares, self._within = Trailing(SHORT, LONG), Trailing(2 * SHORT, LONG)
        self._bounds_of: tuple[tuple[int, ...], float] | None = None  # counts of squares that `_bounds` hold for
        self._bounds: list[float] = []
        self._recent: deque[tuple[float, float]] = deque(maxlen=SHORT)
        self._before: tuple[float, float] | None = None
        self._last: Window | None = None
        self._still: Window | None = None
        self._repeated: tuple[float, float] | None = None
        self._calm: Window | None = None
        self._gone = self._most_gone = 0.0

    def retract(self, *, doubt: bool) -> None:
        """Forget the last windows, which came of a wrong head; with `doubt`, what was doubted by them as well."""
        if doubt:
            self.doubt, self._before = "", None
        self._agreeing = 0.0
        self._recent.clear()
        self._last = self._still = self._repeated = self._calm = None
        self._gone = 0.0

    def judge(self, window: Window) -> None:
        """Take in a window; the tilt counts only where the rotation is known."""
        self.reach = self._anywhere
        self.scale = self._noise_scale
        if not (window.has("tilt") and window.tells_rotation):
            self._still = self._repeated = self._calm = None
            self._agreeing = self._gone = 0.0
            return
        self._look_at(window)
        stuck = self._is_stuck(window) or self._stands(window)
        step = self._step(window)
        wrong = stuck or step or self._beyond() or self._misread(window)
        self._measure_noise(window)
        if wrong or self.doubt:
            self._conclude(window, wrong, step)
        self._settle(window)

    def are_calm(self, windows: Sequence[Window]) -> bool:
        """Whether the tilt moves and fits in windows that have it and the rotation, none a multiple of `SHORT`."""
        last, calm = self._last, self._calm
        if last is None or last.number != windows[0].number - 1 or self.doubt:
            return False
        thetas = [window.mean.theta for window in windows]
        since = thetas if calm is None else [calm.mean.theta, *thetas]
        if not self.figure.covers(thetas) or not max(since) - min(since) < 2 * math.pi:
            return False
        readings = [self._last_reading, *[window.pair("tilt") for window in windows]]
        surplus = [self._last_surplus, *[window.pair("tilt_surplus") for window in windows]]
        most = max([window.mean.tilt_samples for window in windows])
        least = self._noise / math.sqrt(max(1.0, last.ticks * most))
        allowed = self._step_allowed(last.duration, math.hypot(least, self._drift(last.duration)))
        return (
            all(one != other for one, other in pairwise(readings))
            and all(_distance(one, other) <= allowed for one, other in pairwise(surplus))
            and all(math.hypot(x, y) <= 2.0 * self._limits.tilt for x, y in surplus)
        )

    def take_in(self, window: Window) -> None:
        """Take in one of windows that are calm, as `judge` does."""
        self._look_at(window)
        self._still, self._repeated = window, None
        self._stands(window)
        self._add(window)
        self._measure_noise(window)
        self._settle(window)

    def _look_at(self, window: Window) -> None:
        self._reading, self._surplus = window.pair("tilt"), window.pair("tilt_surplus")
        self._samples = samples = max(1.0, window.ticks * window.mean.tilt_samples)
        self._stated, self._drifted = self._noise / math.sqrt(samples), self._drift(window.duration)

    def _settle(self, window: Window) -> None:
        """How sure the tilt is, and where it can be next."""
        if not self.doubt:
            self._recent.append(self._surplus)
        self._last, self._last_reading, self._last_surplus = window, self._reading, self._surplus
        deviation = math.sqrt(window.mean.tilt_variance or math.inf)
        self.scale = math.hypot(self._noise_scale, self._unseen(window) / deviation)
        # one tick is less sure than the mean of a window, and may be a window and a half away
        noise = math.hypot(self._deviation * math.sqrt(1.0 + self._samples), self._drifted)
        reach = 1.5 * self._limits.tilt_rate * window.duration + SIGMAS * noise
        self.reach = Reach(*self._surplus, reach)

    def _conclude(self, window: Window, wrong: str, step: str) -> None:
        """Doubt by what is wrong, or believe again what has agreed for long enough."""
        if wrong and not self.doubt:
            self._before = self._mean_before()
            self._recent.clear()
            self._near = STAYED * self._size if step else STAYED * self._limits.tilt
            self._farthest = 0.0
        if wrong:
            # a step back is no new fault, but a reason to wait
            self.doubt = self.doubt if self.doubt and step else wrong
            self._agreeing = 0.0
        if self._before is not None:
            self._farthest = max(self._farthest, _distance(self._surplus, self._before))
        if not wrong:
            self._agreeing = self._agreeing + window.duration if self._is_back() else 0.0
            if self._agreeing >= AGREEMENT:
                self.doubt = ""
                self._excursion = (window.number, self._farthest)

    def _is_stuck(self, window: Window) -> str:
        """Equal readings for longer than chance allows, or while the mirror must have moved them."""
        if self._last is None or self._still is None or self._reading != self._last_reading:
            self._still, self._repeated = window, None
            return ""
        if self._repeated is None:  # the first windows of a run may hold some of what came before
            earlier = list(self._recent)[: SHORT // 2] or [self._still.pair("tilt_surplus")]
            self._repeated = _mean(earlier)
        run = window.number - self._still.number + 1
        readings = run * window.ticks * window.mean.tilt_samples
        moved = self._moved()
        floor = self._instrument.resolution + SIGMAS * self._instrument.noise
        if readings > self._equal_run or moved > floor:
            return f"stuck: the same reading for {run * window.duration * 1e3:.0f} ms"
        return ""

    def _stands(self, window: Window) -> str:
        """A reading that stays within its noise for a turn while what is described of it goes on: its digits stick.

        For less than a turn it may stand at a turning point while a motion that is not described goes on; that counts
        as uncertain.
        """
        near = self._instrument.resolution + SIGMAS * _ROOT * self._deviation
        if self._calm is None or _distance(self._reading, self._calm.pair("tilt")) > near:
            self._calm, self._gone, self._most_gone = window, 0.0, 0.0
            return ""
        gone = _distance(self._surplus, self._calm.pair("tilt_surplus"))
        self._gone = gone if gone > 0.5 * near else 0.0  # less is noise
        self._most_gone = max(self._most_gone, self._gone)
        passed = (window.number - self._calm.number) * window.duration
        far = STANDING * near + SIGMAS * _ROOT * self._drift(passed)
        if self._most_gone <= far or abs(window.mean.theta - self._calm.mean.theta) < 2 * math.pi:
            return ""
        return f"stuck: it stays where it is while what is described of it goes {self._most_gone * 1e6:.3g} µrad"

    def _moved(self) -> float:
        """How far the reading should have moved since it has been the same, rad; 0 where it is not."""
        return 0.0 if self._still is None else _distance(self._surplus, self._still.pair("tilt_surplus"))

    def _unseen(self, window: Window) -> float:
        """Standard deviation of what the tilt can be off by beyond its noise without being doubted, rad.

        A reading that repeats may be stuck, and have been off from the first: it is where it was before the run, and it
        should have moved since. An instrument that stepped and came back may do so again, which shows only
        once it is beyond `SIGMAS`.
        """
        again = 0.0
        if self._excursion is not None and (window.number - self._excursion[0]) * window.duration < REMEMBERED:
            again = self._excursion[1] / SIGMAS
        off = 0.0 if self._repeated is None else max(self._moved(), _distance(self._surplus, self._repeated))
        return math.hypot(max(off, self._gone), again)

    def _step(self, window: Window) -> str:
        last = self._last
        if last is None:
            return ""
        passed = (window.number - last.number) * window.duration
        step = _distance(self._surplus, self._last_surplus)
        if step <= self._step_allowed(passed, math.hypot(self._deviation, self._drifted)):
            return ""
        self._size = step
        return f"a step of {step * 1e6:.3g} µrad within {passed * 1e3:.3g} ms that no bearing makes"

    def _step_allowed(self, passed: float, noise: float) -> float:
        """Largest step of the tilt within a time (s) that bearing and noise of a standard deviation make, rad."""
        return self._limits.tilt_rate * passed + SIGMAS * _ROOT * noise

    def _beyond(self) -> str:
        surplus = math.hypot(*self._surplus)
        if surplus <= 2.0 * self._limits.tilt:  # what is left where the description is the opposite of the truth
            return ""
        most = self._limits.tilt * 1e6
        return f"{surplus * 1e6:.3g} µrad from the described tilt; the stage tilts by {most:.3g} at most"

    def _misread(self, window: Window) -> str:
        if not self._add(window) and window.number % SHORT:
            return self.doubt if self.doubt.startswith(_MISREAD) else ""
        found = self.figure.judge(math.sqrt(window.mean.tilt_variance))
        if found is None:
            return ""
        return f"{_MISREAD}: {found.mistake} ({found.explained:.0%} of {found.left * 1e6:.3g} µrad that is unexplained)"

    def _add(self, window: Window) -> bool:
        """Add to the figure what is read; give whether its angle is new."""
        (x, y), (off_x, off_y) = self._reading, self._surplus
        return self.figure.add(window.mean.theta, (x, y), (x - off_x, y - off_y))

    def _measure_noise(self, window: Window) -> None:
        """Scatter of a window about its neighbours against what the stated noise explains."""
        recent = self._recent
        if len(recent) >= 2 and self._last is not None and window.number == self._last.number + 1 and not self.doubt:
            variance = 1.5 * self._stated**2 + self._drifted**2
            three = zip(recent[-2], recent[-1], self._surplus, strict=True)
            self._squares.extend(
                [min((middle - 0.5 * (first + last)) ** 2 / variance, 1e6) for first, middle, last in three]
            )
            variance = window.mean.tilt_variance or math.inf
            _, x, y = window.scatter
            self._within.extend((min(x**2 / variance, 1e6), min(y**2 / variance, 1e6)))
        if len(self._squares) >= SHORT:
            among, within = self._squares, self._within
            counts = 2, len(among.few), len(among.many), len(within.few), len(within.many)
            each = (window.ticks - 2) * window.mean.tilt_samples
            if (counts, each) != self._bounds_of:
                self._bounds_of, self._bounds = (counts, each), _bounds(counts, each)
            last, few, many, few_within, many_within = self._bounds
            most = max(
                1.0,
                (among.many[-2] + among.many[-1]) / 2 / last,
                sum(among.few) / counts[1] / few,
                sum(among.many) / counts[2] / many,
                sum(within.few) / counts[3] / few_within,
                sum(within.many) / counts[4] / many_within,
            )
            self._noise_scale = math.sqrt(most)

    @property
    def _deviation(self) -> float:
        """Standard deviation of the mean of the window that is judged, rad."""
        return self._stated * self._noise_scale

    def _drift(self, passed: float) -> float:
        """Standard deviation of what turbulence changes within a time (s), over the root of two, rad."""
        turbulence = self._instrument.turbulence
        if turbulence is None:
            return 0.0
        return turbulence.std * math.sqrt(min(1.0, passed / turbulence.correlation_time))

    def _mean_before(self) -> tuple[float, float] | None:
        return _mean(list(self._recent)) if self._recent else self._before

    def _is_back(self) -> bool:
        """Whether the tilt is near where it was before it was doubted; the description where nothing was before."""
        near = self._near + SIGMAS * math.hypot(self._deviation, self._drifted)
        return _distance(self._surplus, self._before or (0.0, 0.0)) <= near


def _bounds(counts: Sequence[int], each: float) -> list[float]:
    """Bounds on the mean of so many squares: three times among windows, then within them, with `each` independent."""
    # neighbours share windows, which leaves about half of them independent
    among = [0.5 * count for count in counts[:3]]
    # as many independent ones as there are samples, of which a straight line takes two
    return [chi_square_bound(freedom) for freedom in (*among, *(max(1, round(each * count)) for count in counts[3:]))]


def _mean(pairs: list[tuple[float, float]]) -> tuple[float, float]:
    return sum(x for x, _ in pairs) / len(pairs), sum(y for _, y in pairs) / len(pairs)


def _distance(one: tuple[float, float], other: tuple[float, float]) -> float:
    """The larger of the two components."""
    return max(abs(one[0] - other[0]), abs(one[1] - other[1]))


_MISREAD = "it does not fit its description"
