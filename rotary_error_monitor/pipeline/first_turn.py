"""How far something is from where it was at the same angle when the rotor was there first.

One instrument alone cannot tell whether it changed or what it looks at: a step, a drift, or another level behind a gap
may be either. So a part of what does not repeat counts as uncertain for as long as it lasts.
"""

from __future__ import annotations

from collections import deque

from rotary_error_monitor.pipeline.turn_memory import TurnMemory, distance

OWN = 3.0
"""Standard deviations within which all that is not as in the first turn may be the instrument's own: the limit of what
is taken for chance."""

YIELDED = 0.4
"""Part of what the rotor may have yielded to a push that counts nevertheless: the other instrument may show warmth."""

Place = tuple[float, float]


class FirstTurn:
    """What was seen at each angle when the rotor was there first.

    Attributes:
        moved: where the last place is from it; as before where the rotor has not been.
    """

    def __init__(self) -> None:
        """Nothing was seen."""
        self.forget()

    def forget(self) -> None:
        """Begin anew: the angles are others."""
        self._turn = TurnMemory()
        self._last: tuple[int, float] | None = None
        self._stepped = self.moved = 0.0, 0.0

    def step(self, by: Place) -> None:
        """What is seen went by so much at once and stays there: so it is off where the rotor has not been before."""
        self._stepped = self._stepped[0] + by[0], self._stepped[1] + by[1]
        self.moved = self.moved[0] + by[0], self.moved[1] + by[1]

    @property
    def unrepeated(self) -> float:
        """How far the last place is from it, the larger of both components; no less than what it stepped by."""
        return max(distance(self.moved, (0.0, 0.0)), distance(self._stepped, (0.0, 0.0)))

    def follow(self, number: int, theta: float, place: Place, *, sure: bool = True) -> None:
        """Take in a window that is believed.

        Args:
            number: of the window.
            theta: rotation in it, rad.
            place: what is seen in it.
            sure: whether it may be what is seen there first.
        """
        last, self._last = self._last, (number, theta)
        turned = theta - last[1] if last is not None and last[0] == number - 1 else 0.0
        first = self._turn.get(theta, turned)
        if first is None and sure:
            self._turn.complete(theta, turned, (place[0] - self._stepped[0], place[1] - self._stepped[1]))
        elif first is not None:
            self.moved = place[0] - first[0], place[1] - first[1]


class StepSize:
    """By how much something went at a step, of which one window may show a part and the next one the rest."""

    def __init__(self) -> None:
        """Nothing was seen."""
        self._before: deque[Place] = deque(maxlen=2)
        self._number, self._reference, self._counted = -2, (0.0, 0.0), (0.0, 0.0)

    def grown(self, number: int, place: Place, *, stepped: bool) -> Place:
        """By how much more it went by the window of that number, in which it `stepped` or not."""
        goes_on = number - self._number == 1
        if stepped and not goes_on:
            self._reference, self._counted = self._before[0] if self._before else place, (0.0, 0.0)
        self._before.append(place)
        if not (stepped or goes_on):
            return 0.0, 0.0
        self._number = number if stepped else -2
        counted, self._counted = self._counted, (place[0] - self._reference[0], place[1] - self._reference[1])
        return self._counted[0] - counted[0], self._counted[1] - counted[1]


def own_part(moved: Place, yielded: Place) -> float:
    """How much of what moved may be the instrument's own: all, or what is left where the rotor yielded by as much.

    Args:
        moved: what one instrument shows beyond the first turn.
        yielded: what the rotor moves by if it yielded to a push as another instrument shows.
    """
    whole = distance(moved, (0.0, 0.0))
    return max(min(whole, distance(moved, yielded)), YIELDED * whole)
