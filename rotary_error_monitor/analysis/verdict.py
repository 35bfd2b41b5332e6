"""Whether a stage keeps its limits, as far as the uncertainty lets it be said (ISO 14253-1)."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any, NamedTuple

from rotary_error_monitor.analysis.motion import SegmentFigures
from rotary_error_monitor.description.error_motion_limits import ErrorMotionLimits
from rotary_error_monitor.metrology.spindle_figures import ErrorMotionValue


class Conformity(Enum):
    """What is said of a stage, or of one limit."""

    WITHIN = "within"
    BEYOND = "beyond"
    OPEN = "open"
    NO_LIMITS = "no_limits"

    @property
    def exit_code(self) -> int:
        """Of the command: 0 fine or not asked, 10 beyond, 11 neither is proven."""
        return {Conformity.BEYOND: 10, Conformity.OPEN: 11}.get(self, 0)

    @classmethod
    def worst(cls, of: Iterable[Conformity]) -> Conformity:
        """The worst of some: beyond, open, within; without any, no limits."""
        found = set(of)
        return next((each for each in (cls.BEYOND, cls.OPEN, cls.WITHIN) if each in found), cls.NO_LIMITS)


@dataclass(frozen=True)
class Judged:
    """One limit.

    Attributes:
        name: of the limit, such as `radial_synchronous`.
        limit: m or rad.
        outcome: of this limit: within where every value and its expanded uncertainty is, beyond where one is without
            it, else open.
        value: that decides: the one farthest beyond; None where there is none.
        where: its segment and signal.
        unit: `m` or `rad`.
    """

    name: str
    limit: float
    outcome: Conformity
    value: ErrorMotionValue | None
    where: tuple[str, str]
    unit: str

    def as_mapping(self) -> dict[str, Any]:
        """What JSON files hold of it, apart from where its value is."""
        return {
            "name": self.name,
            "limit": self.limit,
            "unit": self.unit,
            "outcome": self.outcome.value,
            "value": None if self.value is None else self.value.value,
            "expanded_uncertainty": None if self.value is None else self.value.expanded,
        }


class Told(NamedTuple):
    """An error motion value: which it is of what, and the segment and signal that it is of."""

    quantity: str
    figure: str
    value: ErrorMotionValue
    segment: str
    signal: str


def judge(segments: Sequence[SegmentFigures], limits: ErrorMotionLimits) -> tuple[Conformity, tuple[Judged, ...]]:
    """Outcome of all, and of each limit in the order of their names."""
    return judge_values(list(_values(segments)), limits)


def judge_values(values: Sequence[Told], limits: ErrorMotionLimits) -> tuple[Conformity, tuple[Judged, ...]]:
    """The same of values, wherever they come from."""
    rows = tuple(_judged(name, limit, values) for name, limit in limits.stated.items())
    return Conformity.worst(row.outcome for row in rows), rows


def _judged(name: str, limit: float, told: Sequence[Told]) -> Judged:
    quantity, _, figure = name.partition("_")
    values = [(row.value, row.segment, row.signal) for row in told if (row.quantity, row.figure) == (quantity, figure)]
    unit = "rad" if quantity == "tilt" else "m"
    if not values:
        return Judged(name, limit, Conformity.OPEN, None, ("", ""), unit)
    beyond = [row for row in values if outcome_of(row[0], limit) is Conformity.BEYOND]
    if beyond:
        value, *where = max(beyond, key=lambda row: row[0].value - row[0].expanded)
    else:
        value, *where = max(values, key=lambda row: row[0].value + row[0].expanded)
    return Judged(name, limit, outcome_of(value, limit), value, (where[0], where[1]), unit)


def outcome_of(value: ErrorMotionValue, limit: float) -> Conformity:
    """Of one value: within where it is with its expanded uncertainty, beyond where it is without it, else open."""
    if value.value - value.expanded > limit:
        return Conformity.BEYOND
    return Conformity.WITHIN if value.value + value.expanded <= limit else Conformity.OPEN


def limited(
    segments: Sequence[SegmentFigures], judged: Sequence[Judged]
) -> dict[tuple[str, str], tuple[float, Conformity]]:
    """Limit (m or rad) and outcome of each value that has one, by its segment and its name as `Figure` has it."""
    found = {}
    for row in judged:
        quantity, _, figure = row.name.partition("_")
        for told in _values(segments):
            if (told.quantity, told.figure) == (quantity, figure):
                found[told.segment, f"{told.signal}.{figure}"] = row.limit, outcome_of(told.value, row.limit)
    return found


def _values(segments: Sequence[SegmentFigures]) -> Iterator[Told]:
    for segment in segments:
        for signal in segment.signals:
            for figure, value in signal.values.items():
                yield Told(signal.quantity, figure, value, segment.name, signal.signal)
