"""The page of a folder's diagnosis: which causes which stages have, and what each recording says."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from rotary_error_monitor.analysis.trend_result import date_of
from rotary_error_monitor.gap.verdict import Verdict
from rotary_error_monitor.report.diagnosis import BADGES
from rotary_error_monitor.report.page import about, section, table, verdict, whole_page
from rotary_error_monitor.report.wording import counted

SCHEMA = 1


@dataclass(frozen=True)
class DiagnosedBag:
    """The diagnosis of one cell of a bag, or why there is none.

    Attributes:
        bag, stage, cell: which it is.
        started_ns: when it began, ns; None where nobody knows.
        told: the verdict in a sentence.
        content: as `diagnosis.json` of a single bag; None where there is none.
        reason: why it cannot be diagnosed; empty where it can.
    """

    bag: str
    stage: str = ""
    cell: str = ""
    started_ns: int | None = None
    told: str = ""
    content: Mapping[str, Any] | None = None
    reason: str = ""

    @property
    def of(self) -> str:
        """Stage and, where it is in a namespace, cell."""
        return self.stage if self.cell in ("", "/") else f"{self.stage} in {self.cell}"

    @property
    def causes(self) -> tuple[str, ...]:
        """Effects with their places."""
        rows = self.content["causes"] if self.content else ()
        return tuple(" at ".join(filter(None, (row["effect"], row["location"]))) for row in rows)


@dataclass(frozen=True)
class FolderVerdict:
    """All bags, ordered by stage and time."""

    bags: tuple[DiagnosedBag, ...] = field(default=())

    @property
    def diagnosed(self) -> tuple[DiagnosedBag, ...]:
        """Those that could be."""
        return tuple(row for row in self.bags if row.content is not None)

    @property
    def worst(self) -> Verdict:
        """The verdict that leaves most open: what the exit code tells."""
        found = [Verdict(row.content["verdict"]) for row in self.diagnosed if row.content is not None]
        return max(found, key=lambda each: each.exit_code)

    @property
    def stages_by_cause(self) -> Mapping[str, Mapping[str, int]]:
        """Recordings that each stage has of a cause, those first that most stages share."""
        found: dict[str, Counter[str]] = defaultdict(Counter)
        for row in self.diagnosed:
            for cause in row.causes:
                found[cause][row.of] += 1
        return dict(sorted(found.items(), key=lambda pair: (-len(pair[1]), pair[0])))

    def as_mapping(self, about: Mapping[str, str]) -> dict[str, Any]:
        """Content of the JSON file."""
        return {
            "schema": SCHEMA,
            "about": dict(about),
            "verdict": self.worst.value,
            "causes": [
                {"cause": cause, "stages": dict(stages), "shared": len(stages) > 1}
                for cause, stages in self.stages_by_cause.items()
            ],
            "bags": [
                {"bag": row.bag, "stage": row.stage, "cell": row.cell, "reason": row.reason, "diagnosis": row.content}
                for row in self.bags
            ],
        }


def folder_sentence(found: FolderVerdict) -> str:
    """What is said first."""
    counts = Counter(str(row.content["verdict"]) for row in found.diagnosed if row.content is not None)
    told = ", ".join(f"{counts[each.value]} {each.value.replace('_', ' ')}" for each in Verdict if counts[each.value])
    stages = counted(len({row.of for row in found.diagnosed}), "stage")
    shared = [cause for cause, rows in found.stages_by_cause.items() if len(rows) > 1]
    left = len(found.bags) - len(found.diagnosed)
    return (
        f"{counted(len(found.diagnosed), 'recording')} of {stages}: {told}. "
        + (f"Stages share: {', '.join(shared)}." if shared else "No cause is shared by stages.")
        + (f" {left} could not be diagnosed." if left else "")
    )


def page(found: FolderVerdict, title: str, facts: Mapping[str, str]) -> str:
    """The whole page; `rotary_error_monitor diagnose BAG` has all of one recording.

    Args:
        found: what is shown.
        title: of the page.
        facts: what was diagnosed, how, and by what this was made.
    """
    causes = [
        [cause, "yes" if len(rows) > 1 else "no", ", ".join(f"{stage} ({count})" for stage, count in rows.items())]
        for cause, rows in found.stages_by_cause.items()
    ]
    rows = [
        [row.of, "–" if row.started_ns is None else date_of(row.started_ns), row.bag, row.told]
        for row in found.diagnosed
    ]
    left = [[row.bag, row.cell or "–", row.reason] for row in found.bags if row.content is None]
    sections = [
        verdict(*BADGES[found.worst], folder_sentence(found)),
        section("Causes", table(["cause", "shared by stages", "stages (recordings)"], causes)),
        section("Recordings", table(["stage", "began (UTC)", "bag", "diagnosis"], rows)),
        section("Bags that cannot be diagnosed", table(["bag", "cell", "why"], left)),
        about(facts),
    ]
    return whole_page("Diagnosis", title, sections)
