"""Whether the ring fits its description: the radial error motion over a turn, and what of it goes with the speed."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from itertools import pairwise
from operator import sub

from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.stage_section import Encoder
from rotary_error_monitor.metrology.description_check import MIRRORED, Claim, FigureCheck, departure
from rotary_error_monitor.metrology.error_motion import KINK
from rotary_error_monitor.pipeline.evidence import AGREEMENT, LONG, SHORT, SIGMAS, EvidenceWindow, Windows
from rotary_error_monitor.pipeline.speed_slope import SpeedSlope

CONFIDENT = 0.2
"""Stated noise over what is seen, the other way round: a stage whose heads scatter by less than a fifth of it is not
the one that is described."""

MORE = 1.0 + 1e-9
"""By which a sum over some windows must be beyond a limit if that over all is to be for sure: both are rounded."""

TURN_ORDERS = 3
"""Orders of the rotation beside which the ring's way over the speed is seen: eccentricity, and what a rotor that swings
to and fro over the same angles makes alike with its speed. Higher ones are small in a bearing."""


ABSENT = Encoder(disc_radius=1.0, lines_per_revolution=1, counts_per_line=1, noise=1.0, azimuths={})
"""Stands for that of a stage which has none: no reading comes that it would be held against."""


class RingBelief:
    """Judges whether the radial error motion can be that of the described stage, window by window.

    Attributes:
        doubt: why the description is not believed; empty while it is.
        figure: of the ring's centre over the rotation.
        late: displacement that goes with the speed, at the present one, m: no bearing makes it, but stamps of heads
            that are apart by the same time do, where these are too many for the others to contradict them.
        vague: what interpolation of a spike may make of a displacement that is none, m; 0 of readings as any others.
        uneven: whether some heads have many more samples per s than others; whoever knows sets it.
    """

    def __init__(self, stage: StageDescription) -> None:
        """Judge of the ring of a stage."""
        encoder = stage.encoder or ABSENT
        self._limit, self._radius = stage.limits.radial, encoder.disc_radius
        self.uneven = False
        self._fastest, self._timing = stage.limits.speed, stage.timing("encoder")
        noise = math.hypot(encoder.noise, encoder.resolution / math.sqrt(12.0)) * encoder.disc_radius
        self._noise = noise
        stated = stage.uncertainty.get("encoder.eccentricity")
        claim = None if stated is None else Claim(stated, departure(stage.spindle.radial))
        self.figure = FigureCheck(MIRRORED, noise, 0.5 * self._limit, "eccentricity of the ring, m,", claim=claim)
        self.reset()

    @property
    def beyond(self) -> bool:
        """Whether it is doubted for a motion that the stage cannot make."""
        return self.doubt.startswith(_BEYOND)

    def reset(self) -> None:
        """Believe the description again, until it is contradicted anew."""
        self.doubt = ""
        self.figure.forget()
        self.late = self.vague = 0.0
        self._last: tuple[int, float] | None = None  # number and rotation of the last window
        self._bent: deque[float] = deque([0.0], maxlen=SHORT)  # four samples around a tick, as far apart as any may be
        self._speed = self._fastest
        self._slope = SpeedSlope(10 * LONG, 2, TURN_ORDERS)
        self._agreeing = 0.0
        self._agreement: deque[float] = deque(maxlen=LONG)
        self._turned: deque[float] = deque(maxlen=LONG)

    @property
    def _apart_by_stamps(self) -> float:
        """What stamps of heads that are apart make at the present speed of a displacement that is none, m, at most."""
        return SIGMAS * self._timing * self._speed * self._radius

    @property
    def apart(self) -> float:
        """Time by which stamps of heads are apart, s, where the displacement goes with the speed; else zero."""
        return self._slope.length / self._radius

    @property
    def late_stands_out(self) -> bool:
        """Whether what goes with the speed is more than the noise of a reading now."""
        return self.late > self._noise

    def retract(self, *, doubt: bool) -> None:
        """Forget the last windows, which came of a wrong head; with `doubt`, what was doubted by them as well."""
        self.doubt = "" if doubt else self.doubt
        self._agreeing = 0.0
        self._agreement.clear()
        self._turned.clear()
        self._slope.forget()

    def judge(self, window: EvidenceWindow) -> None:
        """Take in a window of believed heads."""
        if not window.has("heads"):
            self._agreeing = 0.0
            return
        missed = self._missed(window.mean.head_bend)
        self._measure(window.number, window.duration, window.mean.theta, window.pair("surplus"), missed)
        self.vague = self._vague(window)
        wrong = self._beyond(window)
        if not wrong and not self.vague and window.has("radial"):
            place = [window.mean.theta], [window.vector("centre")], [window.vector("surplus")]
            new = self._add(*place, [self._apart_by_stamps])
            wrong = self._misread(window, new) or self._too_quiet(window)
        if wrong:
            self.doubt, self._agreeing = wrong, 0.0
        elif self.doubt:
            self._agreeing += window.duration
            if self._agreeing >= AGREEMENT:
                self.doubt = ""

    def foresee(self, windows: Windows) -> None:
        """Make ready for windows that are to be judged."""
        mean = windows.mean
        missed = list(map(self._missed, mean.head_bend))
        self._slope.foresee(windows.first, SHORT, mean.theta, mean.surplus_x, mean.surplus_y, missed=missed)

    def are_calm(self, windows: Windows) -> bool:
        """Whether windows of heads that see the radial error motion and agree fit, but for what the last measures."""
        mean = windows.mean
        if self.doubt or not self.figure.covers(mean.theta):
            return False
        if self._last is None or self._last[0] != windows.first - 1:
            return False
        moved = (theta - before for before, theta in pairwise([self._last[1], *mean.theta]))
        if any(map(self._is_bent, mean.head_bend, (abs(each) / windows.duration for each in moved))):
            return False
        motions = map(_motion, mean.surplus_x, mean.surplus_y, mean.described_x, mean.described_y)
        if not (all(each > 0.0 for each in mean.believed_agreement) and all(each <= self._limit for each in motions)):
            return False
        if len(self._agreement) + len(windows) < LONG:
            return True
        lasting = sum(list(self._agreement)[len(windows) - LONG :])  # of those that all of the windows come behind
        return math.sqrt(lasting / LONG) > MORE * CONFIDENT

    def take_in(self, windows: Windows) -> list[float]:
        """Take in windows that are calm, as `judge` does; give `late` after each."""
        mean, duration, late, apart = windows.mean, windows.duration, list[float](), list[float]()
        shown = mean.theta, windows.pairs("surplus"), map(self._missed, mean.head_bend)
        for number, theta, surplus, missed in zip(windows.numbers, *shown, strict=True):
            self._measure(number, duration, theta, surplus, missed)
            late.append(self.late)
            apart.append(self._apart_by_stamps)
        self._add(mean.theta, windows.vectors("centre"), windows.vectors("surplus"), apart)
        wrong = self._misread(windows.last, new=False)
        if wrong:
            self.doubt, self._agreeing = wrong, 0.0
        told = len(windows) - bool(wrong)
        self._agreement.extend(mean.believed_agreement[:told])
        self._turned.extend(mean.theta[:told])
        return late

    def _vague(self, window: EvidenceWindow) -> float:
        deviation = math.sqrt(window.mean.radial_variance)
        usual = self._noise + self._timing * self._speed * self._radius
        return SIGMAS * deviation if deviation > SIGMAS * usual else 0.0

    def _beyond(self, window: EvidenceWindow) -> str:
        mean = window.mean
        motion = _motion(mean.surplus_x, mean.surplus_y, mean.described_x, mean.described_y)
        # within some samples the third difference may be none where interpolation misses most
        missed = max(self._bent) if self.uneven else self._missed(mean.head_bend)
        most = self._limit + self._apart_by_stamps + missed + self.vague
        if motion <= most:
            return ""
        return (
            f"{_BEYOND} of {motion * 1e6:.3g} µm; the stage's is {most * 1e6:.3g} at most. "
            "Eccentricity, radius of the ring or places of the heads are not as described"
        )

    def _missed(self, bend: float) -> float:
        """What interpolation of heads whose stamps are not the same may make of a displacement that is none, m."""
        return KINK * abs(bend) * self._radius

    def _is_bent(self, bend: float, speed: float) -> bool:
        """Whether interpolation misses more than samples and their stamps scatter by, which bends them as well."""
        missed = self._missed(bend)
        return missed > self._noise and missed > self._timing * speed * self._radius

    def _measure(self, number: int, duration: float, theta: float, surplus: tuple[float, float], missed: float) -> None:
        """The part of the displacement that goes with the speed."""
        last, self._last = self._last, (number, theta)
        self._bent.append(missed)
        if last is None or last[0] != number - 1:
            self._speed = self._fastest
            return
        self._speed = abs(theta - last[1]) / duration
        self._slope.add(number, theta, *surplus, missed=missed)
        if number % SHORT == 0 and len(self._slope) >= SHORT:
            self._slope.measure(duration)
        self.late = self._speed * self._slope.length

    def _misread(self, window: EvidenceWindow, new: bool) -> str:
        """What the figure shows where its angle is new, and now and then."""
        if not new and window.number % SHORT:
            return self.doubt if self.doubt.startswith(_MISREAD) else ""
        found = self.figure.judge(math.sqrt(window.mean.radial_variance))
        if found is None:
            return ""
        return f"{_MISREAD}: {found.mistake} ({found.explained:.0%} of {found.left * 1e6:.3g} µm that is unexplained)"

    def _add(
        self,
        thetas: Sequence[float],
        centres: Sequence[complex],
        surplus: Sequence[complex],
        apart: Sequence[float],
    ) -> bool:
        """Add to the figure where the centre is seen; give whether an angle is new."""
        return self.figure.extend(thetas, centres, map(sub, centres, surplus), apart)

    def _too_quiet(self, window: EvidenceWindow) -> str:
        """Heads that move and yet scatter far less than the described noise."""
        agreement, theta = window.mean.believed_agreement, window.mean.theta
        if agreement == 0.0 or self._is_bent(window.mean.head_bend, self._speed):
            # no redundancy to see it by, or what is stated is more than their noise
            self._agreement.clear()
            self._turned.clear()
            return ""
        self._agreement.append(agreement)
        self._turned.append(theta)
        if len(self._agreement) < LONG or abs(theta - self._turned[0]) < math.pi / 8:
            return ""
        seen = math.sqrt(sum(self._agreement) / LONG)
        if seen > CONFIDENT:
            return ""
        return f"the heads scatter by {seen:.2g} times their described noise: that is stated far too large"


def _motion(surplus_x: float, surplus_y: float, described_x: float, described_y: float) -> float:
    """Radial error motion, described or not, m."""
    return math.hypot(surplus_x + described_x, surplus_y + described_y)


_BEYOND = "a radial error motion"
_MISREAD = "the ring does not fit its description"
