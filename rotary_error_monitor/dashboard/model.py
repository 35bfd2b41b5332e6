"""What the page knows of a cell: fed by what comes on the topics, asked by what draws; one for all browsers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.dashboard.health import Health, HealthRow, NodeStatus, Severity
from rotary_error_monitor.dashboard.trend import DayTrend
from rotary_error_monitor.dashboard.turns import LastTurns
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.error_motion import ErrorMotion
from rotary_error_monitor.units import MICRO

OLD_AFTER = 1.0
"""s after which a value is greyed: it tells nothing of now."""

RADIAL, BEFORE, AFTER = "radial error motion", "tool offset, uncorrected", "tool offset, corrected"
TREND = (RADIAL, BEFORE, AFTER)


_MOST_AXES = 32
"""Axes of a machine that are shown: whoever publishes a thousand names shall not fill the page."""

_ROTARY = "ABC"
"""Axes that turn, by ISO 841, for a machine whose file is not given."""


@dataclass(frozen=True)
class ShownValue:
    """A number with its unit, µm or µrad.

    Attributes:
        name: what it is.
        value: NaN where it is not observable.
        unit: µm or µrad.
        deviation: standard uncertainty; NaN where it is not stated.
    """

    name: str
    value: float
    unit: str
    deviation: float = np.nan


@dataclass(frozen=True)
class ValueGroup:
    """Values that came together, and how long ago (s); None before the first."""

    values: tuple[ShownValue, ...]
    age: float | None

    @property
    def is_old(self) -> bool:
        """Whether they tell nothing of now."""
        return self.age is None or self.age > OLD_AFTER


class _Timed:
    """The latest values of a kind."""

    def __init__(self) -> None:
        self._values: tuple[ShownValue, ...] = ()
        self._heard: float | None = None

    def put(self, values: Sequence[ShownValue], now: float) -> None:
        self._values, self._heard = tuple(values), now

    def at(self, now: float) -> ValueGroup:
        return ValueGroup(self._values, None if self._heard is None else now - self._heard)


class CellModel:
    """All that is shown. Times `now` are s of a clock that never steps; `now_ns` are timestamps (ns) for the trend."""

    def __init__(
        self, radius: float, namespace: str = "", labels: Mapping[str, str] | None = None, rotary: Sequence[str] = ()
    ) -> None:
        """Nothing is known yet.

        Args:
            radius: of the drawn ring, m.
            namespace: of the cell, dotted.
            labels: as for `Health`.
            rotary: axes of the machine that turn; none where its file is not given.
        """
        self.turns = LastTurns(radius)
        self.health = Health(namespace, labels or {})
        self.trend = DayTrend(TREND)
        self._rotary = tuple(rotary) or tuple(_ROTARY)
        self._groups = {name: _Timed() for name in ("motion", "before", "after", "applied")}

    def take_motion(self, motion: ErrorMotion, now: float, now_ns: int) -> None:
        """Take in error motion at some more times."""
        self.turns.add(motion)
        seen = motion.observable[:, :2].all(axis=1)
        if seen.any():
            largest = float(np.hypot(*motion.components[seen, :2].T).max())
            self.trend.note(RADIAL, largest * MICRO, now_ns)
        deviation = np.sqrt(np.maximum(np.diagonal(motion.covariance[-1]), 0.0))
        shown = np.where(motion.observable[-1], [motion.components[-1], deviation], np.nan) * MICRO
        self._put_six("motion", ("exc", "eyc", "ezc", "eac", "ebc", "ecc"), shown, now)

    def take_offset(self, which: str, offset: NDArray[np.float64], now: float, now_ns: int) -> None:
        """Take in a tool offset, `before` or `after` correction: (6,) x y z (µm) a b c (µrad)."""
        self.trend.note({"before": BEFORE, "after": AFTER}[which], float(np.linalg.norm(offset[:3])), now_ns)
        self._put_six(which, ("x", "y", "z", "a", "b", "c"), np.array([offset, np.full(6, np.nan)]), now)

    def take_corrections(self, positions: Mapping[str, float], now: float) -> None:
        """Take in the corrections that the controller has in effect, m or rad by axis.

        Raises:
            InputError: there are more axes than any machine has.
        """
        if len(positions) > _MOST_AXES:
            raise InputError(f"{len(positions)} axes with corrections; expected at most {_MOST_AXES}")
        units = {axis: "µrad" if axis in self._rotary else "µm" for axis in positions}
        values = [ShownValue(axis, position * MICRO, units[axis]) for axis, position in positions.items()]
        self._groups["applied"].put(values, now)

    def take_statuses(self, statuses: Sequence[NodeStatus], now: float) -> None:
        """Take in what nodes say on `/diagnostics`."""
        self.health.note(statuses, now)

    def group(self, name: str, now: float) -> ValueGroup:
        """Values by their kind: `motion`, `before`, `after`, `applied`."""
        return self._groups[name].at(now)

    def rows(self, now: float) -> tuple[HealthRow, ...]:
        """The nodes and streams, worst first, and what is missing here although its node speaks."""
        rows = self.health.rows(now)
        motion = self.group("motion", now)
        if self.health.find("error_estimator", "estimate", now) is None or not motion.is_old:
            return rows
        since = "has come yet" if motion.age is None else f"has come for {motion.age:.1f} s"
        text = f"no error motion {since}"
        row = HealthRow(Severity.FAULT, "error motion", text, motion.age or 0.0, True, text)
        at = next((place for place, each in enumerate(rows) if each.severity < Severity.FAULT), len(rows))
        return (*rows[:at], row, *rows[at:])

    def _put_six(self, name: str, names: Sequence[str], shown: NDArray[np.float64], now: float) -> None:
        units = ("µm",) * 3 + ("µrad",) * 3
        rows = zip(names, shown[0], units, shown[1], strict=True)
        self._groups[name].put([ShownValue(key, float(v), unit, float(u)) for key, v, unit, u in rows], now)
