"""What stands in the files of an analysis or comparison: JSON, CSV, page and pictures."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import asdict, fields
from pathlib import Path
from typing import TypeVar

from rotary_error_monitor.analysis.result import Figure
from rotary_error_monitor.bags.metadata import recorded_span
from rotary_error_monitor.report.page import made_by
from rotary_error_monitor.resources import config

Pictures = TypeVar("Pictures")


def contents_of(
    formats: Collection[str],
    mapping: Callable[[], Mapping[str, object]],
    figures: Iterable[Figure],
    draw: Callable[[], tuple[Pictures, Callable[[Pictures], bytes]]],
    page: Callable[[Pictures], str],
) -> Iterator[tuple[str, bytes]]:
    """Content by format, one after another; nothing is drawn where neither page nor pictures are asked for.

    Args:
        formats: some of `json`, `csv`, `html` and `png`.
        mapping: gives what JSON holds.
        figures: rows of the table.
        draw: gives the pictures, and what makes one PNG of them.
        page: gives the page of the pictures.
    """
    if "json" in formats:
        yield "json", f"{json.dumps(mapping(), indent=1, allow_nan=False)}\n".encode()
    if "csv" in formats:
        yield "csv", figures_table(figures).encode()
    if {"html", "png"} & set(formats):
        pictures, joined = draw()
        if "html" in formats:
            yield "html", page(pictures).encode()
        if "png" in formats:
            yield "png", joined(pictures)


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


def figures_table(figures: Iterable[Figure]) -> str:
    """Figures as CSV, a row each."""
    buffer = io.StringIO()
    writer = csv.DictWriter(buffer, [each.name for each in fields(Figure)], lineterminator="\n")
    writer.writeheader()
    writer.writerows(asdict(figure) for figure in figures)
    return buffer.getvalue()
