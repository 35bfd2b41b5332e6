"""Whether a stage keeps its limits, as far as the uncertainty lets it be said (ISO 14253-1)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import Enum

from rotary_error_monitor.analysis.motion import SegmentFigures
from rotary_error_monitor.description.error_motion_limits import ErrorMotionLimits
from rotary_error_monitor.metrology.spindle_figures import Value


class Outcome(Enum):
    """What is said of a stage, or of one limit."""

    WITHIN = "within"
    BEYOND = "beyond"
    OPEN = "open"
    NO_LIMITS = "no_limits"

    @property
    def exit_code(self) -> int:
        """Of the command: 0 fine or not asked, 10 beyond, 11 neither is proven."""
        return {Outcome.BEYOND: 10, Outcome.OPEN: 11}.get(self, 0)


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
    outcome: Outcome
    value: Value | None
    where: tuple[str, str]
    unit: str


def judge(segments: Sequence[SegmentFigures], limits: ErrorMotionLimits) -> tuple[Outcome, tuple[Judged, ...]]:
    """Outcome of all, and of each limit in the order of their names."""
    rows = tuple(_judged(name, limit, segments) for name, limit in limits.stated.items())
    found = {row.outcome for row in rows}
    worst = next((o for o in (Outcome.BEYOND, Outcome.OPEN, Outcome.WITHIN) if o in found), Outcome.NO_LIMITS)
    return worst, rows


def _judged(name: str, limit: float, segments: Sequence[SegmentFigures]) -> Judged:
    quantity, _, figure = name.partition("_")
    values = list(_values(quantity, figure, segments))
    unit = "rad" if quantity == "tilt" else "m"
    if not values:
        return Judged(name, limit, Outcome.OPEN, None, ("", ""), unit)
    beyond = [row for row in values if outcome_of(row[0], limit) is Outcome.BEYOND]
    if beyond:
        value, *where = max(beyond, key=lambda row: row[0].value - row[0].expanded)
    else:
        value, *where = max(values, key=lambda row: row[0].value + row[0].expanded)
    return Judged(name, limit, outcome_of(value, limit), value, (where[0], where[1]), unit)


def outcome_of(value: Value, limit: float) -> Outcome:
    """Of one value: within where it is with its expanded uncertainty, beyond where it is without it, else open."""
    if value.value - value.expanded > limit:
        return Outcome.BEYOND
    return Outcome.WITHIN if value.value + value.expanded <= limit else Outcome.OPEN


def limited(
    segments: Sequence[SegmentFigures], judged: Sequence[Judged]
) -> dict[tuple[str, str], tuple[float, Outcome]]:
    """Limit (m or rad) and outcome of each value that has one, by its segment and its name as `Figure` has it."""
    found = {}
    for row in judged:
        quantity, _, figure = row.name.partition("_")
        for value, segment, signal in _values(quantity, figure, segments):
            found[segment, f"{signal}.{figure}"] = row.limit, outcome_of(value, row.limit)
    return found


def _values(quantity: str, figure: str, segments: Sequence[SegmentFigures]) -> Iterator[tuple[Value, str, str]]:
    for segment in segments:
        for signal in segment.signals:
            if signal.quantity == quantity and figure in signal.values:
                yield signal.values[figure], segment.name, signal.signal
