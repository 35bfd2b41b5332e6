"""The trend of a folder of bags, from files to files: what is new is read, what is known comes from the index."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path

from rotary_error_monitor.analysis.history import RecordingFigures, histories
from rotary_error_monitor.analysis.result import Figure
from rotary_error_monitor.analysis.trend_result import FolderTrend, Unread, as_mapping, date_of
from rotary_error_monitor.bags.search import find_bags, fingerprint_of
from rotary_error_monitor.description.error_motion_limits import ErrorMotionLimits
from rotary_error_monitor.description.machine import load_machine, machine_path
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.files import check_outputs, check_places, write_all
from rotary_error_monitor.recordings.analysis import Question, check_machine
from rotary_error_monitor.recordings.bag_figures import BagResult, BagTask, question_key, read_figures
from rotary_error_monitor.recordings.index import NAME, Index, IndexEntry
from rotary_error_monitor.recordings.stage_names import StageNames
from rotary_error_monitor.recordings.workers import Lost, run_all
from rotary_error_monitor.report.drawn import Drawn
from rotary_error_monitor.report.page import made_by
from rotary_error_monitor.report.result_files import contents_of, csv_of
from rotary_error_monitor.report.trend import page
from rotary_error_monitor.resources import config

Answer = tuple[BagTask, BagResult | Lost]
Progress = Callable[[Iterable[Answer], int], Iterable[Answer]]
"""Passes answers on as they come, and may show how many of how many there are."""


@dataclass(frozen=True)
class FileTrend:
    """What is looked at, and where the results go.

    Attributes:
        folder: with bags below it.
        stage_file: YAML with a section `stage`; None for the embedded one.
        machine: YAML, or name of a machine that ships; None for the stage alone.
        question: what is asked of each bag, and the limits.
        outputs: file of each format (`html`, `json`, `csv`, `png`).
        index: file; None for one within the folder.
        jobs: processes; None for one a processor.
        scheduler: address of a Dask scheduler that has other processes; None for none.
        false_alarms: largest chance that anything is told to change of a stage that does not.
        by_folder: whether folders name the stages.
    """

    folder: Path
    stage_file: Path | None
    machine: str | None
    question: Question
    outputs: Mapping[str, Path]
    index: Path | None
    jobs: int | None
    scheduler: str | None
    false_alarms: float
    by_folder: bool = False

    def run(self, progress: Progress) -> FolderTrend:
        """Read what is new, and write the results: all of them, or what stood there stays.

        Raises:
            InputError: no bag, none that can be analysed, the index cannot be used, or a result cannot be written.
        """
        bags = {path.relative_to(self.folder).as_posix(): path for path in find_bags(self.folder)}
        index_file = self.index or self.folder / NAME
        machine_file = machine_path(self.machine) if self.machine else None
        check_outputs(self.outputs.values(), [*bags.values(), self._stage_file, machine_file, index_file])
        check_places(self.outputs.values())
        stage = load_stage(self.stage_file)
        machine = check_machine(load_machine(self.machine) if self.machine else None)
        question = replace(self.question, limits=ErrorMotionLimits())  # known figures are judged by any limits
        asked = partial(BagTask, stage=stage, machine=machine, question=question)
        with Index(index_file, self.folder) as index:
            found = self._read(index, question_key(stage, machine, question), bags, asked, progress)
        if not found.stages:
            (first, *_), count = (*found.unread, *found.undone), len(bags)
            raise InputError(f"{self.folder}: none of {count} bags can be analysed; {first.bag}: {first.reason}")
        write_all(dict(self._contents(found)))
        return found

    @property
    def _stage_file(self) -> Path:
        return self.stage_file or config("stage.yaml")

    def _read(
        self,
        index: Index,
        key: str,
        bags: Mapping[str, Path],
        ask: Callable[[str, Path], BagTask],
        progress: Progress,
    ) -> FolderTrend:
        """Bring the index up to date, and take from it all that is about these bags."""
        index.note_question(key, self._asked())
        gone = sorted(index.bags() - set(bags))
        index.forget(gone)
        prints = {name: fingerprint_of(path) for name, path in bags.items()}
        known = index.fingerprints(key)
        new = [name for name in bags if known.get(name) != prints[name]]
        tasks = [ask(name, bags[name].absolute()) for name in new]
        undone = []
        with closing(run_all(read_figures, tasks, self.jobs, self.scheduler)) as answers:
            for task, answer in progress(answers, len(tasks)):
                why = _why_not(prints[task.name], answer)
                if isinstance(answer, Lost) or why:
                    undone.append(Unread(task.name, "", why))
                else:
                    index.put(task.name, key, answer.before, answer.entries)
        entries = [row for row in index.entries(key) if row[0] not in {each.bag for each in undone}]
        unread = [Unread(bag, entry.cell, entry.reason) for bag, entry in entries if entry.reason]
        names = StageNames(self._stage_file.stem, self.by_folder)
        recorded = [_recorded(names, bag, entry) for bag, entry in entries if not entry.reason]
        stages = histories(recorded, self.question.limits, self.false_alarms)
        return FolderTrend(stages, tuple(unread), tuple(undone), tuple(gone), len(new), len(bags) - len(new))

    def _asked(self) -> dict[str, object]:
        """The question in words, for people who look into the index."""
        naming = self.question.naming
        return {
            "stage": str(self._stage_file),
            "machine": self.machine,
            "heights": [*self.question.heights],
            "waves": self.question.most_waves,
            "max_gap_ns": self.question.max_gap_ns,
            "cell": naming.cell,
            "topics": {name: given.topic for name, given in naming.topics.items()},
        }

    def _contents(self, trend: FolderTrend) -> Iterator[tuple[Path, bytes]]:
        about = self._about(trend)

        def drawn() -> tuple[dict[str, list[Drawn]], Callable[[Mapping[str, Sequence[Drawn]]], bytes]]:
            # what draws takes long to load
            from rotary_error_monitor.report.trend_figure import draw, joined

            return draw(trend), joined

        return contents_of(
            self.outputs,
            lambda: as_mapping(trend, about),
            lambda: _table(trend),
            drawn,
            lambda pictures: page(trend, pictures, self.folder.resolve().name, about),
        )

    def _about(self, trend: FolderTrend) -> dict[str, str]:
        starts = [row.started_ns for stage in trend.stages for row in stage.recordings]
        return {
            "folder": str(self.folder),
            "recordings": f"{len(starts)}, from {date_of(min(starts))} to {date_of(max(starts))} UTC",
            "stage": str(self._stage_file),
            **({"machine": self.machine} if self.machine else {}),
            "index": f"{self.index or self.folder / NAME}: {trend.read} bags read now, {trend.known} known",
            "false alarms": f"at most {self.false_alarms:.2%} of stages that do not change are told to",
            "made by": made_by(),
        }


def _why_not(expected: str, answer: BagResult | Lost) -> str:
    """Why an answer is not kept; empty for one that is."""
    if isinstance(answer, Lost):
        return answer.why
    if answer.before != answer.after:
        return "it changed while it was read: it is still being recorded or copied"
    if answer.before != expected:
        return "who should read it found another file, or none: workers need the same folder at the same path"
    return ""


def _recorded(names: StageNames, bag: str, entry: IndexEntry) -> RecordingFigures:
    assert entry.started_ns is not None
    stage = names.of(bag, entry.stage)
    return RecordingFigures(bag, stage, entry.cell, entry.started_ns, entry.figures, dict(entry.speeds), entry.remarks)


def _table(trend: FolderTrend) -> bytes:
    """Every figure of every recording as CSV, a row each."""
    return csv_of(
        ["stage", "cell", "bag", "started", *(each.name for each in fields(Figure))],
        (
            [stage.stage, stage.cell, row.bag, date_of(row.started_ns), *vars(figure).values()]
            for stage in trend.stages
            for row in stage.recordings
            for figure in row.figures
        ),
    )
