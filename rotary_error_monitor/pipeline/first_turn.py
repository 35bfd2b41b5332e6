"""How far something is from where it was at the same angle when the rotor was there first.

One instrument alone cannot tell whether it changed or what it looks at: a step, a drift, or another level behind a gap
may be either. So a part of what does not repeat counts as uncertain for as long as it lasts.
"""

from __future__ import annotations

from rotary_error_monitor.pipeline.turn_memory import TurnMemory, distance

OWN = 3.0
"""Standard deviations within which all that is not as in the first turn may be the instrument's own: the limit of what
is taken for chance."""

Place = tuple[float, float]


class FirstTurn:
    """What was seen at each angle when the rotor was there first.

    Attributes:
        unrepeated: how far the last place is from it; as before where the rotor has not been.
    """

    def __init__(self) -> None:
        """Nothing was seen."""
        self.forget()

    def forget(self) -> None:
        """Begin anew: the angles are others."""
        self._turn = TurnMemory()
        self._last: tuple[int, float] | None = None
        self.unrepeated = 0.0

    def follow(self, number: int, theta: float, place: Place, *, sure: bool = True) -> None:
        """Take in a window that is believed.

        Args:
            number: of the window.
            theta: rotation in it, rad.
            place: what is seen in it.
            sure: whether it may be what is seen there first.
        """
        last, self._last = self._last, (number, theta)
        moved = theta - last[1] if last is not None and last[0] == number - 1 else 0.0
        first = self._turn.get(theta, moved)
        if first is None and sure:
            self._turn.complete(theta, moved, place)
        elif first is not None:
            self.unrepeated = distance(place, first)
