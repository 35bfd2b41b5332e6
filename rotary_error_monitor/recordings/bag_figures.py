"""The figures of one bag, for whoever reads many: everything that goes wrong with it is a reason, and stops nobody."""

from __future__ import annotations

import contextlib
import hashlib
import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, TypeVar

from rotary_error_monitor.analysis.result import AnalysisResult, figures_of
from rotary_error_monitor.bags.naming import ROOT, Naming
from rotary_error_monitor.bags.search import cells_of, fingerprint_of
from rotary_error_monitor.description.machine import MachineDescription, machine_mapping
from rotary_error_monitor.description.stage import StageDescription, stage_mapping
from rotary_error_monitor.errors import InputError, one_line
from rotary_error_monitor.pipeline.estimator_settings import EstimatorSettings
from rotary_error_monitor.recordings.analysis import Question, analyse_bag
from rotary_error_monitor.recordings.index import IndexEntry
from rotary_error_monitor.recordings.stage_names import label_of

if TYPE_CHECKING:  # takes long to load
    from rotary_error_monitor.report.folder_diagnosis import DiagnosedBag

Row = TypeVar("Row", IndexEntry, "DiagnosedBag")


@dataclass(frozen=True)
class BagTask:
    """What to read: `name` is what the bag is called in results."""

    name: str
    path: Path
    stage: StageDescription
    machine: MachineDescription | None
    question: Question


@dataclass(frozen=True)
class BagResult:
    """What was found: files as they were before and after reading, and what each cell says."""

    before: str
    after: str
    entries: tuple[IndexEntry, ...]


def read_figures(task: BagTask) -> BagResult:
    """Analyse every cell of a bag that is meant."""
    before = _fingerprint(task.path)
    entries = tuple(_entries(task))
    return BagResult(before, _fingerprint(task.path), entries)


def question_key(stage: StageDescription, machine: MachineDescription | None, question: Question) -> str:
    """What figures depend on beside the bag, hashed: the same for the same question, whatever the limits."""
    asked = {
        "stage": stage_mapping(stage),
        "machine": None if machine is None else machine_mapping(machine),
        "heights": list(question.heights),
        "waves": question.most_waves,
        "cell": question.naming.cell,
        "topics": {name: given.topic for name, given in question.naming.topics.items()},
    }
    if question.max_gap_ns != EstimatorSettings.max_gap_ns:  # else an index of before holds
        asked["max_gap_ns"] = question.max_gap_ns
    return hashlib.sha256(json.dumps(asked, sort_keys=True, default=list).encode()).hexdigest()


def _fingerprint(path: Path) -> str:
    """Nothing where the bag is not there, as on another computer."""
    with contextlib.suppress(InputError):
        return fingerprint_of(path)
    return ""


def rows_of_cells(bag: Path, naming: Naming, known: Row, read: Callable[[Row, Naming], Row]) -> Iterator[Row]:
    """A row for each cell of a bag that is meant; what goes wrong with one, or with all, is its reason.

    Args:
        bag: recording.
        naming: which of its cells are meant.
        known: what is known of the bag before it is read.
        read: gives the row of a cell from what is known of it, and its naming.
    """
    try:
        cells = cells_of(bag, naming) or [ROOT]
    except Exception as error:
        yield replace(known, reason=reason_of(error))
        return
    for cell in cells:
        row = replace(known, cell=cell)
        try:
            yield read(row, replace(naming, cell=cell) if len(cells) > 1 else naming)
        except Exception as error:
            yield replace(row, reason=reason_of(error))


def _entries(task: BagTask) -> Iterator[IndexEntry]:
    label = label_of(task.path)

    def read(known: IndexEntry, naming: Naming) -> IndexEntry:
        question = replace(task.question, naming=naming)
        return _entry(known, analyse_bag(task.path, task.stage, task.machine, question))

    return rows_of_cells(task.path, task.question.naming, IndexEntry("", label.stage, label.started_ns), read)


def _entry(known: IndexEntry, analysis: AnalysisResult) -> IndexEntry:
    figures = tuple(figures_of(analysis))
    if not figures:
        return replace(known, reason=one_line("; ".join(analysis.remarks)) or "it tells no figure")
    begin = analysis.span_ns[0] if known.started_ns is None else known.started_ns
    speeds = tuple((segment.name, segment.speed) for segment in analysis.segments)
    remarks = tuple(map(one_line, analysis.remarks))
    return replace(known, started_ns=begin, figures=figures, speeds=speeds, remarks=remarks)


def reason_of(error: Exception) -> str:
    """Wrong input says what it is; anything else is a fault of the program, and says of which kind."""
    told = one_line(str(error))
    return told if isinstance(error, InputError) else f"unexpected {type(error).__name__}: {told}"
