"""What the files of an analysis or comparison tell alike: the recording, and a table of figures."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields
from pathlib import Path

from rotary_error_monitor.analysis.result import Figure
from rotary_error_monitor.bags.metadata import recorded_span
from rotary_error_monitor.report.page import made_by
from rotary_error_monitor.report.result_files import csv_of
from rotary_error_monitor.resources import config


def about_of(recording: Path, stage_file: Path | None, **beside: str) -> dict[str, str]:
    """What a recording and its stage are, when it was recorded, what is `beside`, and by what this was made."""
    return {
        "recording": str(recording),
        "recorded": recorded_span(recording),
        "stage": str(stage_file or config("stage.yaml")),
        **beside,
        "made by": made_by(),
    }


def title_of(recording: Path) -> str:
    """Name of a recording and of the folder in which it lies."""
    return "/".join(recording.resolve().parts[-2:])


def figures_table(figures: Iterable[Figure]) -> bytes:
    """Figures as CSV, a row each."""
    return csv_of((each.name for each in fields(Figure)), (vars(figure).values() for figure in figures))
