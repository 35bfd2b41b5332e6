"""What the files of a result hold, by their formats: JSON, CSV, page and pictures."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import TypeVar

Pictures = TypeVar("Pictures")


def contents_of(
    outputs: Mapping[str, Path],
    mapping: Callable[[], Mapping[str, object]],
    table: Callable[[], bytes],
    draw: Callable[[], tuple[Pictures, Callable[[Pictures], bytes]]],
    page: Callable[[Pictures], str],
) -> Iterator[tuple[Path, bytes]]:
    """File and content, one after another; nothing is drawn where neither page nor pictures are asked for.

    Args:
        outputs: files of some of the formats `json`, `csv`, `html` and `png`.
        mapping: gives what JSON holds.
        table: gives the CSV.
        draw: gives the pictures, and what makes one PNG of them.
        page: gives the page of the pictures.
    """
    if "json" in outputs:
        yield outputs["json"], json_of(mapping())
    if "csv" in outputs:
        yield outputs["csv"], table()
    if {"html", "png"} & set(outputs):
        pictures, joined = draw()
        if "html" in outputs:
            yield outputs["html"], page(pictures).encode()
        if "png" in outputs:
            yield outputs["png"], joined(pictures)


def json_of(content: Mapping[str, object]) -> bytes:
    """A mapping as JSON, an entry a line; numbers are finite."""
    return f"{json.dumps(content, indent=1, allow_nan=False)}\n".encode()


def csv_of(head: Iterable[str], rows: Iterable[Iterable[object]]) -> bytes:
    """A table as CSV, its columns' names first."""
    buffer = io.StringIO()
    writer = csv.writer(buffer, lineterminator="\n")
    writer.writerow(head)
    writer.writerows(rows)
    return buffer.getvalue().encode()
