"""Orders at which a form error of what the sensors look at passes for error motion, signal by signal."""

from __future__ import annotations

from dataclasses import replace

from rotary_error_monitor.analysis.signals import AXIAL, RADIAL, ROTATING, TILT, SignalName
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.pipeline.surfaces import Surface, surfaces

_ALONG = {
    (RADIAL, "x"): ("exc", "ebc"),
    (RADIAL, "y"): ("eyc", "eac"),
    (TILT, "x"): ("eac",),
    (TILT, "y"): ("ebc",),
    (AXIAL, "z"): ("ezc",),
}
"""Components of a signal; the tilt of a radial one counts by its lever, which is none at height 0."""


class HiddenOrders:
    """Finds orders that no sensor of a stage contradicts.

    Heads alone tell what of their ring passes for radial error motion, also beside probes: these contradict it in part.
    Where an autocollimator tells the tilt, no order is taken for one of its mirror: all of them pass for tilt.
    """

    def __init__(self, stage: StageDescription) -> None:
        """Of a stage as described."""
        self._stage, self._has_heads = stage, len(stage.azimuths) > 1
        self._heads_alone = replace(stage, autocollimator=None, sensors={})
        self._known: dict[bool, tuple[int, tuple[Surface, ...]]] = {}

    def of(self, signal: SignalName, highest: int) -> tuple[int, ...]:
        """Those from 1 to `highest` of a signal; none in a rotating direction, which mixes the orders."""
        if signal.direction == ROTATING:
            return ()
        by_heads = signal.quantity == RADIAL and self._has_heads
        if signal.quantity == TILT and self._stage.autocollimator is not None:
            return ()
        if not (by_heads or self._stage.sensors):
            return ()
        along, *lever = _ALONG[signal.quantity, signal.direction]
        components = {along, *lever} if signal.height else {along}
        if by_heads:  # of the ring, at every height, and either direction by the amplitude of both
            components = {"exc", "eyc"}
        views = (view for surface in self._surfaces(by_heads, highest) for view in surface.orders)
        found = {view.order for view in views if view.is_hidden and components & set(view.components)}
        return tuple(sorted(order for order in found if order <= highest))

    def _surfaces(self, by_heads: bool, highest: int) -> tuple[Surface, ...]:
        """How orders up to `highest` or more appear to the heads alone, or to all sensors."""
        known, found = self._known.get(by_heads, (0, ()))
        if known < highest:
            found = surfaces(self._heads_alone if by_heads else self._stage, highest)
            self._known[by_heads] = highest, found
        return found
