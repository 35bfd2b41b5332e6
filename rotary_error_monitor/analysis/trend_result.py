"""The trend of a folder of recordings: stages over time, what could not be read, and all of it as plain data."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from rotary_error_monitor.analysis.history import LimitStanding, StageHistory
from rotary_error_monitor.analysis.trend import Trend
from rotary_error_monitor.analysis.verdict import Conformity
from rotary_error_monitor.metrology.spindle_figures import COVERAGE


@dataclass(frozen=True)
class Unread:
    """A bag, or a cell of it, that is not in the trend, and why."""

    bag: str
    cell: str
    reason: str


@dataclass(frozen=True)
class FolderTrend:
    """All that was found below a folder.

    Attributes:
        stages: their recordings.
        unread: bags that cannot be analysed; they are tried again when they change.
        undone: bags that could be read another time, such as those of a worker that was ended; the next run tries.
        gone: bags that the index knew and that are no longer there.
        read: how many bags were read now.
        known: how many were known from the index.
    """

    stages: tuple[StageHistory, ...]
    unread: tuple[Unread, ...]
    undone: tuple[Unread, ...]
    gone: tuple[str, ...]
    read: int
    known: int

    @property
    def outcome(self) -> Conformity:
        """The worst of the stages, each by its latest recording."""
        return Conformity.worst(stage.outcome for stage in self.stages)


def date_of(stamp_ns: int) -> str:
    """Date and time, such as `2026-03-01 08:00:00` (UTC)."""
    return f"{datetime.fromtimestamp(stamp_ns // 1_000_000_000, UTC):%Y-%m-%d %H:%M:%S}"


def as_mapping(trend: FolderTrend, about: Mapping[str, str]) -> dict[str, Any]:
    """Content of the JSON file."""
    return {
        "about": dict(about),
        "verdict": trend.outcome.value,
        "coverage_factor": COVERAGE,
        "read": trend.read,
        "known": trend.known,
        "stages": [_stage(stage) for stage in trend.stages],
        "unread": [vars(each) for each in trend.unread],
        "undone": [vars(each) for each in trend.undone],
        "gone": list(trend.gone),
    }


def _stage(stage: StageHistory) -> dict[str, Any]:
    return {
        "stage": stage.stage,
        "cell": stage.cell,
        "verdict": stage.outcome.value,
        "recordings": [
            {
                "bag": row.bag,
                "started": date_of(row.started_ns),
                "started_ns": row.started_ns,
                "remarks": [*row.remarks],
            }
            for row in stage.recordings
        ],
        "copies": list(stage.copies),
        "limits": [_limit(stage, standing) for standing in stage.standings],
        "figures": [_figure(stage, trend) for trend in stage.trends],
    }


def _limit(stage: StageHistory, standing: LimitStanding) -> dict[str, Any]:
    reaching = standing.reaching
    return {
        **standing.now.as_mapping(),
        "first_beyond": None if standing.first_beyond is None else stage.recordings[standing.first_beyond].bag,
        "margin": None if standing.margin is None else standing.margin[0],
        "margin_uncertainty": None if standing.margin is None else standing.margin[1],
        "margin_of": None if standing.closest is None else [*_key(standing.closest)],
        "reached": None if reaching is None else date_of(reaching[1].at_ns),
        "reached_earliest": None if reaching is None else date_of(reaching[1].earliest_ns),
        "reached_latest": None if reaching is None or reaching[1].latest_ns is None else date_of(reaching[1].latest_ns),
        "reached_by": None if reaching is None else [*_key(reaching[0])],
    }


def _key(trend: Trend) -> Iterator[str]:
    yield from (trend.series.name, trend.series.segment)


def _figure(stage: StageHistory, trend: Trend) -> dict[str, Any]:
    series = trend.series
    rows = zip(series.places, series.values.tolist(), series.uncertainties.tolist(), strict=True)
    return {
        "name": series.name,
        "segment": series.segment,
        "unit": series.unit,
        "now": trend.now,
        "now_uncertainty": trend.now_uncertainty,
        "slope_per_day": trend.slope,
        "slope_uncertainty": trend.slope_uncertainty if math.isfinite(trend.slope_uncertainty) else None,
        "has_slope": trend.has_slope,
        "scatter": trend.scatter if math.isfinite(trend.scatter) else None,
        "scatters": trend.scatters,
        "steps": [
            {
                "after": stage.recordings[step.previous].bag,
                "from": stage.recordings[step.place].bag,
                "date": date_of(stage.recordings[step.place].started_ns),
                "before": step.before,
                "now": step.after,
                "expanded_uncertainty": step.expanded_uncertainty,
            }
            for step in trend.steps
        ],
        "values": [
            {"bag": stage.recordings[place].bag, "value": value, "expanded_uncertainty": COVERAGE * own}
            for place, value, own in rows
        ],
    }
