"""Why a recording differs from its twin, as a notebook has it: what the command `diagnose` gives, to the last bit."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.files import check_outputs, check_places, write_whole
from rotary_error_monitor.gap.diagnosis import DiagnosisResult, FoundCause
from rotary_error_monitor.gap.options import FALSE_ALARMS, MOST_CAUSES, check_false_alarms, check_most_causes
from rotary_error_monitor.gap.sentences import verdict_sentence
from rotary_error_monitor.gap.verdict import Verdict
from rotary_error_monitor.notebook.pictures import Figures
from rotary_error_monitor.notebook.read_only import sealed
from rotary_error_monitor.notebook.recording import Recording, Topics, bag_of
from rotary_error_monitor.notebook.tables import Units, scaled, table_of_rows
from rotary_error_monitor.recordings.diagnosis import FileDiagnosis
from rotary_error_monitor.report.diagnosis import page, verdict_box
from rotary_error_monitor.report.page import bullets
from rotary_error_monitor.report.picture import Picture, picture_of
from rotary_error_monitor.report.result_files import json_of
from rotary_error_monitor.twin.rates import MOST_RATE, check_most_rate

if TYPE_CHECKING:
    from pandas import DataFrame


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Diagnosis:
    """What the gap between a recording and its twin comes from; arrays are read-only.

    Attributes:
        files: what was diagnosed, and how.
        result: all that was found, as the package has it.
        picture: what its figure shows.
    """

    files: FileDiagnosis
    result: DiagnosisResult
    picture: Picture

    @property
    def outcome(self) -> Verdict:
        """Whether there is a gap, and whether it is explained."""
        return self.result.verdict

    @property
    def verdict(self) -> str:
        """The same with the causes and their sizes in a sentence, as the command prints it."""
        return verdict_sentence(self.result)

    @property
    def causes(self) -> tuple[FoundCause, ...]:
        """Effects added to the model, each with probability and size."""
        return self.result.causes

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a reader should know."""
        return self.result.remarks

    def to_dataframe(self, units: Units = "SI") -> DataFrame:
        """Table with a row for each parameter of each cause, of a vector one for each component.

        Columns: `effect`, `location`, `probability` (of the cause), `parameter`, `component` (missing of what is no
        vector), `value`, `sigma` (standard uncertainty), `unit`. Without causes there is no row.

        Args:
            units: `SI` for m and rad, `um` for µm and µrad, where these are the whole unit.

        Raises:
            InputError: there are no such units.
            MissingPackageError: pandas is not installed.
        """
        rows = [row for found in self.causes for row in _rows_of(found)]
        names = ("effect", "location", "probability", "parameter", "component", "value", "sigma", "unit")
        columns = {name: [row[i] for row in rows] for i, name in enumerate(names)}
        sizes = {name: columns[name] for name in ("value", "sigma")}
        return table_of_rows(columns | scaled(units, columns["unit"], sizes))

    def figures(self) -> Figures:
        """Pictures of the page: gap, where it lies, ranking, residuals of the channels that matter."""
        from rotary_error_monitor.report.diagnosis_figure import sketches

        return Figures(sketches(self.picture))

    def save(self, path: Path | str) -> None:
        """Write what the command writes as `diagnosis.json`, `diagnosis.html` or `diagnosis.png`, by the file's ending.

        Raises:
            InputError: it cannot be written, ends otherwise, or is a file of the recording.
        """
        file = Path(path)
        check_outputs([file], self.files.read)
        check_places([file])
        write_whole(file, self._content(file))

    def _content(self, file: Path) -> bytes:
        if file.suffix == ".json":
            return json_of(self.result.as_mapping())
        if file.suffix not in (".html", ".png"):
            raise InputError(f"{file}: ends in none of html, json, png; name such a file")
        from rotary_error_monitor.report.diagnosis_figure import draw

        sheet = draw(self.picture)
        if file.suffix == ".png":
            return sheet.whole
        return page(self.result, sheet.rows, self.files.title, self.files.about()).encode()

    def __repr__(self) -> str:
        title = f"Diagnosis of {self.files.recording} beside {self.files.twin}"
        return "\n  ".join([title, self.verdict, *self.remarks])

    def _repr_html_(self) -> str:
        return verdict_box(self.result) + (bullets(self.remarks) if self.remarks else "")


def _rows_of(found: FoundCause) -> Iterator[tuple[Any, ...]]:
    """Rows of the table, SI units."""
    effect, location = found.cause.effect, found.cause.location
    units = effect.units(location)
    for name, estimate in found.parameters.items():
        is_vector = isinstance(estimate.value, tuple)
        values = estimate.value if isinstance(estimate.value, tuple) else (estimate.value,)
        spreads = estimate.std if isinstance(estimate.std, tuple) else (estimate.std,)
        for i, (value, spread) in enumerate(zip(values, spreads, strict=True)):
            component = i if is_vector else None
            yield effect.name, location, found.probability, name, component, value, spread, units.get(name, "1")


def diagnose(
    recording: Recording | Path | str,
    twin: Path | str,
    *,
    effects: Sequence[Path | str] = (),
    false_alarms: float = FALSE_ALARMS,
    most_causes: int = MOST_CAUSES,
    most_rate: float = MOST_RATE,
    progress: Callable[[str], None] = lambda step: None,
    cell: str = "",
    topics: Topics = None,
) -> Diagnosis:
    """Where a recording differs from its twin, why, and how far that is mended: the numbers of the command `diagnose`.

    Args:
        recording: a bag or a file of what is diagnosed, as its kind reads it, or what `read_bag` gave.
        twin: YAML with the section of its kind, such as `stage` or `machine`.
        effects: files with effects of your own; they run as code.
        false_alarms: largest chance that anything is found where there is no gap.
        most_causes: effects combined at most.
        most_rate: samples a second (Hz) of one sensor of a stage that are used.
        progress: called with a few words at the beginning of each step, such as `print`.
        cell: of a bag that holds several, as for `read_bag`.
        topics: how the bag calls its topics, as for `read_bag`.

    Raises:
        InputError: recording or twin cannot be used, or a value is out of range; the message says which and what would
            be right.

    Example:
        >>> from rotary_error_monitor import diagnose
        >>> found = diagnose(bag, stage)
        >>> found.outcome.value in ("no_gap", "explained", "partly_explained", "unknown")
        True
    """
    path, naming = bag_of(recording, cell, topics)
    check_false_alarms(false_alarms, f"false_alarms is {false_alarms}")
    check_most_causes(most_causes, f"most_causes is {most_causes}")
    check_most_rate(most_rate, f"most_rate is {most_rate}")
    own = [Path(effect) for effect in effects]
    nowhere = Path()  # only `run` writes there
    files = FileDiagnosis(path, Path(twin), nowhere, own, false_alarms, most_causes, most_rate, naming=naming)
    _, problem, result = files.diagnose(progress)
    picture = sealed(picture_of(problem, result))
    # what was tried on the way holds the whole problem in memory
    return Diagnosis(files, result, picture)
