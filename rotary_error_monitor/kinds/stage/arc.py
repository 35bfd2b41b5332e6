"""What a recording within an arc tells of waves over the rotation: fewer are independent than on whole turns."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from rotary_error_monitor.description.streams import COMMAND
from rotary_error_monitor.effects.effect import Cause, Searched, order_of
from rotary_error_monitor.effects.rotor import StageEffect, is_among
from rotary_error_monitor.gap.verdict import names_of
from rotary_error_monitor.sensors.library import kind_of
from rotary_error_monitor.twin.recording import StageRecording


@dataclass(frozen=True)
class Arc:
    """The arc within which a rotor turned.

    Waves of orders up to K have 2 K directions beside a constant on whole turns, and `2 K turns` of these are
    independent within an arc (Landau and Pollak 1962): what fits there with more waves than that fits anything smooth.

    Attributes:
        turns: how many.
    """

    turns: float

    @classmethod
    def of(cls, recording: StageRecording) -> Arc:
        """That of the command of a recording."""
        return cls(float(np.ptp(recording.streams[COMMAND].values[:, 0])) / (2 * np.pi))

    def independent(self, cause: Cause) -> float:
        """Part of the directions of a cause's form that are independent within the arc; one if it is no wave."""
        order = _order(cause)
        return 1.0 if order is None else min(order * self.turns, 1.0)

    def tells_apart(self, orders: Iterable[float]) -> bool:
        """Whether waves of these orders are no more than are independent up to the highest of any two and more."""
        ascending = sorted(orders)
        return all(count <= order * self.turns for count, order in enumerate(ascending, 1) if count > 1)

    def neighbours(self, cause: Cause, found: Sequence[Cause]) -> list[Cause]:
        """Those orders beside that of a cause which the arc tells from it: others would make it anything smooth."""
        return [other for other in found if self.tells_apart((order_of(cause.location), order_of(other.location)))]

    def goes_around(self, cause: Cause) -> bool:
        """Whether what a cause does may be told to differ around the turn: of a wave that takes a whole one."""
        return self.turns >= 1 or _order(cause) is None

    def tells_form(self, cause: Cause) -> bool:
        """Whether the form of a cause is told from one that goes with its size, or comes and goes on the arc.

        The square of a wave is one of twice its order, and a course over each swing is a function of the rotation.
        """
        order = _order(cause)
        return order is None or self.tells_apart((order, 2 * order))

    def doubt(self, causes: Sequence[Cause], channels: Iterable[str]) -> str:
        """Why causes would fit whatever is at work in the channels; empty where they would not."""
        for kind in dict.fromkeys(map(kind_of, channels)):
            waves = [cause for cause in causes if _order(cause) is not None and _shows_in(cause, kind)]
            if not self.tells_apart(order for order in map(_order, waves) if order is not None):
                return (
                    f"{names_of(waves)} fit, but sums of as many orders fit anything smooth within {self.turns:.2g} of "
                    "a turn: record whole turns"
                )
        return ""


def _order(cause: Cause) -> float | None:
    """Order of a wave over the rotation; None where the effect is none."""
    effect = cause.effect
    if effect.orders:
        return float(order_of(cause.location))
    if effect.searched is Searched.WAVE:
        return float(cause.values[effect.slices()["order"]][0])
    return None


def _shows_in(cause: Cause, kind: str) -> bool:
    return isinstance(cause.effect, StageEffect) and is_among(kind, cause.effect.stands_out_in)
