"""The diagnosis of all bags below a folder: each by itself, then which stages have which cause."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import closing
from dataclasses import dataclass, replace

from rotary_error_monitor.bags.naming import Naming
from rotary_error_monitor.bags.search import find_bags
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.files import check_outputs, check_places, exists, make_folder, write_all
from rotary_error_monitor.gap.loading import load_twin
from rotary_error_monitor.gap.sentences import verdict_sentence
from rotary_error_monitor.recordings.bag_figures import rows_of_cells
from rotary_error_monitor.recordings.diagnosis import FileDiagnosis
from rotary_error_monitor.recordings.stage_names import StageNames, label_of
from rotary_error_monitor.recordings.workers import Lost, run_all
from rotary_error_monitor.report.folder_diagnosis import DiagnosedBag, FolderVerdict, page
from rotary_error_monitor.report.page import made_by
from rotary_error_monitor.report.result_files import json_of


@dataclass(frozen=True)
class DiagnosisTask:
    """A bag, what it is called in results, and how it is diagnosed."""

    name: str
    how: FileDiagnosis


Answer = tuple[DiagnosisTask, tuple[DiagnosedBag, ...] | Lost]
Progress = Callable[[Iterable[Answer], int], Iterable[Answer]]


def diagnose_bag(task: DiagnosisTask) -> tuple[DiagnosedBag, ...]:
    """Diagnose every cell of a bag that is meant; what goes wrong with one is a reason."""
    label = label_of(task.how.recording)

    def read(known: DiagnosedBag, naming: Naming) -> DiagnosedBag:
        *_, diagnosis = replace(task.how, naming=naming).diagnose(lambda step: None)
        return replace(known, told=verdict_sentence(diagnosis), content=diagnosis.as_mapping())

    known = DiagnosedBag(task.name, label.stage, "", label.started_ns)
    return tuple(rows_of_cells(task.how.recording, task.how.naming, known, read))


@dataclass(frozen=True)
class FolderDiagnosis:
    """What is diagnosed, and where the results go.

    Attributes:
        how: of each bag, with the folder for a recording; `output` is the folder for the results.
        jobs: processes; None for one a processor.
        scheduler: address of a Dask scheduler that has other processes; None for none.
        by_folder: whether folders name the stages.
        has_page: whether a page is written beside the JSON file.
    """

    how: FileDiagnosis
    jobs: int | None
    scheduler: str | None
    by_folder: bool
    has_page: bool

    def run(self, progress: Progress) -> FolderVerdict:
        """Diagnose, and write the results.

        Raises:
            InputError: the twin cannot be used, no bag can be diagnosed, or a result cannot be written.
        """
        folder, output = self.how.recording, self.how.output
        bags = find_bags(folder)
        results = [output / f"diagnosis.{suffix}" for suffix in ("json", "html")]
        check_outputs(results, [*bags, self.how.twin, *self.how.effects])
        check_places(results if exists(output) else [])
        load_twin(self.how.twin, self.how.effects)  # wrong for one bag, wrong for all
        hows = ((bag.relative_to(folder).as_posix(), replace(self.how, recording=bag.absolute())) for bag in bags)
        tasks = [DiagnosisTask(*row) for row in hows]
        names = StageNames(self.how.twin.stem, self.by_folder)
        found: list[DiagnosedBag] = []
        with closing(run_all(diagnose_bag, tasks, self.jobs, self.scheduler)) as answers:
            for task, answer in progress(answers, len(tasks)):
                rows = (DiagnosedBag(task.name, reason=answer.why),) if isinstance(answer, Lost) else answer
                found += [replace(row, stage=names.of(row.bag, row.stage)) for row in rows]
        found.sort(key=lambda row: (row.stage, row.cell, row.started_ns or 0, row.bag))
        verdict = FolderVerdict(tuple(found))
        if not verdict.diagnosed:
            first = verdict.bags[0]
            raise InputError(f"{folder}: none of {len(bags)} bags can be diagnosed; {first.bag}: {first.reason}")
        about = self._about()
        contents = {results[0]: json_of(verdict.as_mapping(about))}
        if self.has_page:
            contents[results[1]] = page(verdict, folder.resolve().name, about).encode()
        make_folder(output)
        write_all(contents)
        return verdict

    def _about(self) -> dict[str, str]:
        return {
            "folder": str(self.how.recording),
            "twin": str(self.how.twin),
            "false alarms": f"{self.how.false_alarms:.2%} of recordings without a gap, at most",
            "made by": made_by(),
        }
