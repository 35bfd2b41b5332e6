"""Whether a field of a listed sensor is believed: held against what the rotor does by all that is known of it."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from itertools import islice

from rotary_error_monitor.description.listed_sensors import ListedSensor
from rotary_error_monitor.metrology.agreement import chi_square_bound
from rotary_error_monitor.metrology.repeated_readings import run_by_chance
from rotary_error_monitor.pipeline.evidence import AGREEMENT, LONG, SHORT, SIGMAS
from rotary_error_monitor.pipeline.first_turn import OWN, FirstTurn
from rotary_error_monitor.pipeline.tilt_belief import STANDING, STAYED
from rotary_error_monitor.pipeline.turn_memory import ANGLES, TurnMemory

FEWEST_EQUAL = 3
"""Windows whose mean is the same before a sensor without steps counts as stuck: two are so by chance now and then."""

SAME = 1e-5
"""Part of noise or step by which two means may differ and be the same: rounding of what was averaged."""


@dataclass(frozen=True)
class SensorWindow:
    """What one field of a sensor says over one window, in its unit, m or rad.

    Attributes:
        number: of the window on its grid.
        duration: s.
        ticks: in it.
        samples: independent ones in it.
        theta: mean rotation, rad.
        reading: mean of what the sensor says.
        surplus: mean of what is not predicted of the displacement.
        undescribed: mean of what the description alone does not predict of it.
        scatter: variance of the ticks' surplus about a straight line; 0 where they are too few to tell.
        own_scatter: the same of what the description alone does not predict: other sensors' noise is not in it.
        own: variance of a tick by noise of the sensor.
        variance: of a tick's surplus by noise, of the sensor and of what is predicted.
        systematic: variance of what the sensor shows beside that, which stays.
        others: variance of what other sensors have wrong beside their noise; it may turn with the rotor.
        stamps: standard deviation of that part of it which stamps make, and goes with the speed, or the air.
        unknown: largest displacement by components of error motion that nothing else shows.
        rate: fastest change of that, per s.
        shared: variance of the mean surplus by noise of another sensor that has fewer independent samples there.
    """

    number: int
    duration: float
    ticks: int
    samples: float
    theta: float
    reading: float
    surplus: float
    undescribed: float
    scatter: float
    own_scatter: float
    own: float
    variance: float
    systematic: float
    others: float
    stamps: float
    unknown: float
    rate: float
    shared: float

    @property
    def deviation(self) -> float:
        """Standard deviation of the mean surplus by noise."""
        return math.sqrt(self.variance / max(1.0, self.samples) + self.shared)


class Excess:
    """How many times what is stated the scatter of windows is, as far as that is no chance.

    Attributes:
        factor: of the variance, 1 or more.
    """

    def __init__(self) -> None:
        """Nothing was seen."""
        self.factor = 1.0
        self._ratios: deque[tuple[float, float]] = deque(maxlen=LONG)

    def add(self, scatter: float, variance: float, freedom: float) -> None:
        """Take in a window: variance seen and stated, with the degrees of freedom of what was seen."""
        if freedom > 0.0 and scatter > 0.0:
            self._ratios.append((min(scatter / variance, 1e6), freedom))
        found = [1.0]
        for count in (SHORT, len(self._ratios)):
            latest = list(self._ratios)[-count:]
            free = sum(each for _, each in latest)
            if len(latest) < SHORT:
                break
            mean = sum(ratio * each for ratio, each in latest) / free
            if mean > chi_square_bound(max(1, round(free))):
                found.append(mean)
        self.factor = max(found)


class SensorBelief:
    """Judges one field of a sensor, window by window.

    What is looked for: a value that stands still where noise or what is predicted must move it, a step that no bearing
    makes, a displacement beyond what the stage can do or what the other sensors allow, and noise beyond what is
    stated. What others see as well must be where it was a turn ago; once no other would contradict it any more, what is
    not as in the first turn, in which they did not, may be its own, and counts as uncertain. What is doubted is
    believed again once it has agreed for `AGREEMENT` with what it was before.

    Attributes:
        doubt: why the sensor is not believed; empty while it is.
        since: number of the window from which on it is doubted.
        scale: by which its stated standard deviation is to be multiplied.
        middle, reach: where the surplus can be at the next ticks, in the unit of the field.
    """

    def __init__(self, sensor: ListedSensor) -> None:
        """Judge of a sensor."""
        self._sensor = sensor
        self._unit = f"µ{sensor.unit}"
        noise, step = sensor.noise, sensor.resolution
        self._equal_run = run_by_chance(noise, step)
        self._same = SAME * max(noise, step)
        self.reset()

    def reset(self) -> None:
        """Believe the sensor again."""
        self.doubt, self.since = "", 0
        self.scale = 1.0
        self._excess, self._own_excess = Excess(), Excess()
        self.middle, self.reach = 0.0, math.inf
        self._recent: deque[float] = deque(maxlen=SHORT)
        self._course: deque[tuple[float, float, float, float]] = deque(maxlen=LONG)
        self._turn, self._stamps, self._first = TurnMemory(), TurnMemory(), FirstTurn()
        self._own = 0.0  # largest of what may be its own since no other would contradict it
        self._gone_since: deque[tuple[float, float, float]] = deque(maxlen=SHORT)
        self._before = 0.0
        self._agreeing = self._near = 0.0
        self.pause()

    def pause(self) -> None:
        """Nothing was heard, or it cannot be told what it means: no step is told from what was before."""
        self._last: SensorWindow | None = None
        self._still: SensorWindow | None = None
        self._calm: SensorWindow | None = None
        self._gone = self._farthest = self._shifted = self._agreeing = 0.0
        self._course.clear()
        self._gone_since.clear()
        self.middle, self.reach = 0.0, math.inf

    def retract(self) -> None:
        """Believe it: what it was held against was wrong, and so is by how much it scattered about that."""
        self.doubt = ""
        self._excess, self._own_excess = Excess(), Excess()
        self.pause()

    def change(self, window: SensorWindow) -> tuple[float, float] | None:
        """By how much the surplus is not what it was at this angle a turn ago, else in the last window; None where
        neither is known. With its standard deviation, as far as what is not stated may have changed it.
        """
        turned, last = self._turned(window), self._last
        before = self._turn.get(window.theta, turned)
        if last is None or window.unknown != last.unknown:
            return None
        if before is None or window.unknown > 0.0:
            noise = self._noise_scale() * math.hypot(window.deviation, last.deviation)
            return window.surplus - last.surplus, noise + window.rate * window.duration / SIGMAS
        noise = self._noise_scale() * math.hypot(window.deviation, before[1])
        return window.surplus - before[0], math.hypot(noise, window.stamps) + self._blurred(window, turned) / SIGMAS

    def judge(self, window: SensorWindow, *, checked: bool = True) -> None:
        """Take in a window; whether what all others show has `checked` what the sensor does."""
        stuck = self._is_stuck(window) or self._stands(window)
        step = self._step(window)
        if step:
            self._course.clear()
        lasting = window.systematic + window.others
        self._course.append((window.surplus, window.deviation**2, lasting, window.unknown))
        wrong = stuck or step or self._beyond() or self._elsewhere(window)
        freedom = window.samples * (1.0 - 2.0 / window.ticks)
        self._excess.add(window.scatter, window.variance, freedom)
        self._own_excess.add(window.own_scatter, window.own, freedom)
        if wrong and not self.doubt:
            self.since = window.number
            self._before = sum(self._recent) / len(self._recent) if self._recent else 0.0
            self._near = STAYED * (abs(window.surplus - self._before) if step else window.unknown)
            self._recent.clear()
        if wrong:
            self.doubt = self.doubt if self.doubt and step else wrong
            self._agreeing = 0.0
        elif self.doubt:
            back = abs(window.surplus - self._before) <= self._near + SIGMAS * window.deviation
            self._agreeing = self._agreeing + window.duration if back else 0.0
            if self._agreeing >= AGREEMENT:
                self.doubt = ""
        if not self.doubt:
            self._recent.append(window.surplus)
            self._first.follow(window.number, window.theta, (window.undescribed, 0.0), sure=checked)
            # until all that others see of it is there, as of an autocollimator that begins late, it is another surplus
            if self._shifted == 0.0 and window.unknown == 0.0:
                turned = self._turned(window)
                self._turn.put(window.theta, turned, (window.surplus, window.deviation))
                self._stamps.put(window.theta, turned, (window.stamps, 0.0))
        self._last = window
        # it is no surer because the rotor goes the other way for a while
        self._own = 0.0 if checked else max(self._own, self._own_of(window))
        unseen = max(self._gone, self._moved(window), self._shifted, self._own)
        self.scale = math.sqrt(self._own_excess.factor + unseen**2 / window.own)
        # one tick is less sure than the mean of a window, and may be a window and a half away
        noise = window.deviation * math.sqrt(1.0 + window.samples) * self._noise_scale()
        digit = self._sensor.resolution / abs(self._sensor.gain)
        self.middle, self.reach = window.surplus, 1.5 * window.rate * window.duration + digit + SIGMAS * noise

    def _is_stuck(self, window: SensorWindow) -> str:
        """Equal readings for longer than chance allows, or while what is predicted must have moved them."""
        if self._last is None or self._still is None or abs(window.reading - self._last.reading) > self._same:
            self._still = window
            return ""
        run = window.number - self._still.number + 1
        noise = math.sqrt(2.0 * window.deviation**2 + window.others)
        floor = self._sensor.resolution + SIGMAS * math.hypot(self._sensor.noise, noise)
        long = run >= FEWEST_EQUAL and run * window.samples > self._equal_run
        if long or self._moved(window) > floor:
            return f"stuck: the same reading for {run * window.duration * 1e3:.0f} ms"
        return ""

    def _stands(self, window: SensorWindow) -> str:
        """A reading that stays within its noise for a turn while what is predicted of it goes on: its digits stick.

        For less than a turn it may stand at a turning point while a motion that is not described goes on; that counts
        as uncertain.
        """
        near = self._sensor.resolution + SIGMAS * math.sqrt(2.0) * window.deviation
        if self._calm is None or abs(window.reading - self._calm.reading) > near:
            self._calm, self._gone, self._farthest = window, 0.0, 0.0
            return ""
        gone = abs(window.surplus - self._calm.surplus)
        self._gone = gone if gone > 0.5 * near else 0.0  # less is noise
        self._farthest = max(self._farthest, self._gone)
        far = STANDING * near + SIGMAS * math.sqrt(window.others)
        if self._farthest <= far or abs(window.theta - self._calm.theta) < 2 * math.pi:
            return ""
        return f"stuck: it stays where it is while what is predicted of it goes {self._farthest * 1e6:.3g} {self._unit}"

    def _moved(self, window: SensorWindow) -> float:
        """How far the reading should have moved since it has been the same; 0 where it is not.

        Nor where others show another part of it than then: that it moved is what they see, or what is described.
        """
        if self._still is None or self._still is window or self._still.unknown != window.unknown:
            return 0.0
        return abs(window.surplus - self._still.surplus)

    def _step(self, window: SensorWindow) -> str:
        if self._last is None or window.unknown != self._last.unknown:  # what others show of it is another part now
            return ""
        passed = (window.number - self._last.number) * window.duration
        step = abs(window.surplus - self._last.surplus)
        noise = self._noise_scale() * math.hypot(window.deviation, self._last.deviation)
        noise = math.hypot(noise, math.sqrt(window.others))
        digit = self._sensor.resolution / abs(self._sensor.gain)
        if step <= max(window.rate, self._last.rate) * passed + digit + SIGMAS * noise:
            return ""
        return f"a step of {step * 1e6:.3g} {self._unit} within {passed * 1e3:.3g} ms that no bearing makes"

    def _beyond(self) -> str:
        """Surplus, of the latest window or of many together, that neither noise nor what is not known explains."""
        for count in (1, SHORT, LONG):
            if count > len(self._course):
                break
            surplus, noise, systematic, unknown = zip(*islice(reversed(self._course), count), strict=True)
            mean = abs(sum(surplus)) / count
            most = max(unknown) + SIGMAS * math.sqrt(sum(noise) / count**2 + max(systematic))
            if mean > most:
                return (
                    f"{mean * 1e6:.3g} {self._unit} from what description and other sensors say; "
                    f"{most * 1e6:.3g} {self._unit} at most could be so"
                )
        return ""

    def _elsewhere(self, window: SensorWindow) -> str:
        """What other sensors see as well, and did not a turn ago: an error of theirs turns with the rotor.

        As long as it is no contradiction it counts as uncertain, and what was seen a turn ago stays what it is held
        against: a slow drift adds up.
        """
        turned = self._turned(window)
        before, stamps = self._turn.get(window.theta, turned), self._stamps.get(window.theta, turned)
        self._shifted = 0.0
        if before is None or stamps is None or self._last is None or window.unknown > 0.0:
            self._gone_since.clear()
            return ""
        blurred = self._blurred(window, turned)
        noise = self._noise_scale() * math.hypot(window.deviation, before[1])
        self._gone_since.append((window.surplus - before[0], noise, blurred))
        for count in (1, SHORT):
            latest = list(self._gone_since)[-count:]
            gone = abs(sum(each for each, _, _ in latest)) / count
            near = SIGMAS * math.sqrt(sum(each**2 for _, each, _ in latest)) / count
            near += sum(each for _, _, each in latest) / count
            # stamps of the others may have wandered since, and what they make goes with the speed of either time
            if len(latest) == count and gone > near + SIGMAS * math.hypot(window.stamps, stamps[0]):
                size = f"{gone * 1e6:.3g} {self._unit}"
                return f"{size} from where it was at this angle a turn ago; other sensors did not see that"
            self._shifted = gone if gone > 0.5 * near else 0.0  # less is noise
        return ""

    def _own_of(self, window: SensorWindow) -> float:
        """Standard deviation of what is not as in the first turn: of the rotor, or of a sensor that is off."""
        off, noise = self._first.unrepeated, self._noise_scale() * math.sqrt(2.0) * window.deviation
        return off / OWN if off > 0.5 * SIGMAS * noise else 0.0  # less is noise

    def _blurred(self, window: SensorWindow, turned: float) -> float:
        """What the surplus may change by within the angle to which an angle of a turn ago is found again."""
        step = 0.0 if self._last is None else abs(window.surplus - self._last.surplus)
        return step * min(1.0, 2 * math.pi / ANGLES / max(abs(turned), 1e-9))

    def _noise_scale(self) -> float:
        """By which the standard deviation of the surplus is to be multiplied."""
        return math.sqrt(self._excess.factor)

    def _turned(self, window: SensorWindow) -> float:
        """Rotation since the last window, rad; of a window behind a gap nothing but its middle is known."""
        last = self._last
        return window.theta - last.theta if last is not None and last.number == window.number - 1 else 0.0
