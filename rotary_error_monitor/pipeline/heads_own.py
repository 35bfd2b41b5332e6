"""How far what heads show is their own: what differs from their first turn, once one of them was wrong."""

from __future__ import annotations

import math

from rotary_error_monitor.description.stage_limits import StageLimits
from rotary_error_monitor.pipeline.evidence import SIGMAS
from rotary_error_monitor.pipeline.first_turn import OWN, FirstTurn, StepSize
from rotary_error_monitor.pipeline.ring_scatter import RingScatter
from rotary_error_monitor.pipeline.turn_memory import distance


class HeadsOwn:
    """What of the ring's place and of the rotation against its command is not as in the first turn, at the same angle.

    Heads that agree prove nothing any more once one of them was wrong.

    Attributes:
        counts: whether one was, so that it counts as uncertain.
    """

    def __init__(self, limits: StageLimits, timing: float) -> None:
        """Of heads with stamps of a standard uncertainty `timing`, s."""
        self._limits, self._scatter = limits, RingScatter(timing)
        self._first_turn, self._first_rotation = FirstTurn(), FirstTurn()
        self.reset()

    def reset(self) -> None:
        """None was wrong, and nothing was seen."""
        self.counts = False
        self._scatter.reset()
        self.forget_turn()
        self.begin()

    def forget_turn(self) -> None:
        """Forget what was seen at which angle."""
        self._first_turn.forget()
        self._first_rotation.forget()

    def begin(self) -> None:
        """What comes next does not follow upon what was."""
        self._scatter.forget_last()
        self._place: tuple[int, tuple[float, float], float] | None = None
        self._steps, self._rotation_steps = StepSize(), StepSize()
        self._stepped = -1  # number of the window of the last step

    def note_place(
        self, number: int, duration: float, place: tuple[float, float], variance: float, rate: float
    ) -> None:
        """Take in where the ring is; a step that no bearing makes counts: two heads went off together, or the ring.

        Args:
            number: of the window.
            duration: of it, s.
            place: of the ring's centre beside what is described, m.
            variance: of that by noise, m².
            rate: speed of a head's reading over the noise of it, 1/s.
        """
        noise = math.sqrt(variance) * self._scatter.scale(rate)
        last, self._place = self._place, (number, place, noise)
        if last is not None:
            way = self._limits.radial_rate * duration * (number - last[0])
            most = min(way, 2.0 * self._limits.radial) + SIGMAS * math.hypot(noise, last[2])
            if distance(place, last[1]) > most:
                self.counts, self._stepped = True, number
        stepped = self._stepped == number
        self._first_turn.step(self._steps.grown(number, place, stepped=stepped))
        if not stepped:
            self._scatter.add(number, place, variance, rate)

    def raised(self, scale: float, number: int, theta: float, place: tuple[float, float], variance: float) -> float:
        """Scale of standard deviations, with what may be a head's: all that is not as in the first turn.

        It counts where no other head would contradict, and once one was wrong: two that are off alike agree as well.
        """
        self._first_turn.follow(number, theta, place)
        return math.hypot(scale, self._first_turn.unrepeated / (OWN * math.sqrt(variance)))

    def rotation(self, number: int, theta: float, ecc: float) -> float:
        """Standard deviation of `ecc` by what may be the heads': heads that lose as much one by one agree again.

        As `raised`, but of the rotation alone, which also goes with the load of the drive.
        """
        if not math.isnan(ecc):
            grown = self._rotation_steps.grown(number, (ecc, 0.0), stepped=self._stepped == number)
            self._first_rotation.step(grown)
            self._first_rotation.follow(number, theta, (ecc, 0.0))
        return self._first_rotation.unrepeated / OWN if self.counts else 0.0
