"""A diagnosis from files to files: recording and twin in, verdict, page and improved twin out."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import yaml

from rotary_error_monitor.bags.marks import SUFFIXES
from rotary_error_monitor.bags.metadata import recorded_span
from rotary_error_monitor.bags.naming import THE_ONLY_CELL, Naming
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.files import check_outputs, check_places, exists, make_folder, write_all
from rotary_error_monitor.gap.diagnosis import DiagnosisResult, FoundCause, diagnose
from rotary_error_monitor.gap.loading import AnyTwinFile, improved_twin, load_problem, load_twin
from rotary_error_monitor.gap.options import FALSE_ALARMS, MOST_CAUSES
from rotary_error_monitor.gap.problem import DiagnosableProblem
from rotary_error_monitor.report.diagnosis import report_files
from rotary_error_monitor.report.page import made_by
from rotary_error_monitor.report.painter import Painter
from rotary_error_monitor.report.result_files import json_of
from rotary_error_monitor.twin.rates import MOST_RATE


@dataclass(frozen=True)
class FileDiagnosis:
    """What is diagnosed, how, and where the results go.

    Attributes:
        recording: bag or file of what is diagnosed, as its kind reads it.
        twin: YAML that is held against it.
        output: folder for the results; made where it does not exist.
        effects: files with effects of the user's own.
        false_alarms: largest chance that anything is found where there is no gap.
        most_causes: effects combined at most.
        most_rate: samples a second (Hz) that are used of one sensor, for kinds that sample in time.
        improved: file for the twin with the causes added; None writes none.
        naming: which cell of a bag it is, and how the bag calls its topics.
    """

    recording: Path
    twin: Path
    output: Path
    effects: Sequence[Path] = ()
    false_alarms: float = FALSE_ALARMS
    most_causes: int = MOST_CAUSES
    most_rate: float = MOST_RATE
    improved: Path | None = None
    naming: Naming = THE_ONLY_CELL

    def run(self, painter: Painter | None, progress: Callable[[str], None]) -> DiagnosisResult:
        """Diagnose, and write the results.

        Args:
            painter: draws the figure of the page; without one there is neither page nor figure.
            progress: called with a few words at the beginning of each step.

        Raises:
            InputError: recording or twin cannot be used, or a result cannot be written.
        """
        progress("reading")
        results = [self.output / f"diagnosis.{suffix}" for suffix in ("json", "html", "png")]
        check_outputs([*results, self.improved], self.read)
        check_places(results if exists(self.output) else [])
        if self.improved is not None and self.output not in self.improved.parents:  # that folder may be made later
            check_places([self.improved])
        twin, problem, diagnosis = self.diagnose(progress)
        progress("writing")
        make_folder(self.output)
        write_all(self._contents(twin, problem, diagnosis, painter))
        return diagnosis

    @property
    def read(self) -> list[Path]:
        """Files and bags that are read."""
        return [self.recording, self.twin, *self.effects]

    def diagnose(self, progress: Callable[[str], None]) -> tuple[AnyTwinFile, DiagnosableProblem, DiagnosisResult]:
        """Diagnose alone: the twin, it beside the recording, and what was found.

        Raises:
            InputError: recording or twin cannot be used.
        """
        if self.naming.is_given and self.recording.is_file() and not self.recording.name.endswith(SUFFIXES):
            raise InputError(
                f"{self.recording}: no bag, so that it has no cells or topics; leave --cell and --topics out"
            )
        twin = replace(load_twin(self.twin, self.effects), naming=self.naming)
        problem = load_problem(self.recording, twin, self.most_rate)
        return twin, problem, diagnose(problem, self.false_alarms, self.most_causes, progress)

    def _contents(
        self, twin: AnyTwinFile, problem: DiagnosableProblem, diagnosis: DiagnosisResult, painter: Painter | None
    ) -> dict[Path, bytes]:
        """What is written where."""
        found = {self.output / "diagnosis.json": json_of(diagnosis.as_mapping())}
        if painter is not None:
            files = report_files(problem, diagnosis, self.title, painter, self.about())
            found |= {self.output / name: each for name, each in files.items()}
        if self.improved is not None and diagnosis.causes:
            found[self.improved] = _improved(twin, diagnosis.causes).encode()
        return found

    @property
    def title(self) -> str:
        """Of the page."""
        return " beside ".join("/".join(path.resolve().parts[-2:]) for path in (self.recording, self.twin))

    def about(self) -> dict[str, str]:
        """What was diagnosed, beside what, when it was recorded, and by what this was made."""
        recorded = recorded_span(self.recording)
        return {
            "recording": str(self.recording),
            **({"recorded": recorded} if recorded else {}),
            "twin": str(self.twin),
            "false alarms": f"{self.false_alarms:.2%} of recordings without a gap, at most",
            "made by": made_by(),
        }


def _improved(twin: AnyTwinFile, causes: Sequence[FoundCause]) -> str:
    """The twin with the causes and those of their departures that it can hold; the others stand in comments."""
    content = improved_twin(twin, [cause for found in causes for cause in (found.cause, *found.beside)])
    lacking = [
        f"# not in this twin: {' at '.join(filter(None, found.cause.key))} {row.pattern} ({row.share:.1%} of it)\n"
        for found in causes
        for row in found.departures
        if not row.held
    ]
    return "".join(lacking) + yaml.safe_dump(content, sort_keys=False)
