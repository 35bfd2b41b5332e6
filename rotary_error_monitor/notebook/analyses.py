"""How good a stage is, as a notebook has it: what the command `analyse` gives, to the last bit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from rotary_error_monitor.analysis.changes import Change
from rotary_error_monitor.analysis.result import AnalysisResult, figures_of
from rotary_error_monitor.analysis.verdict import Conformity, limited
from rotary_error_monitor.description.error_motion_limits import limits_of
from rotary_error_monitor.errors import InputError, excerpt
from rotary_error_monitor.metrology.turns import MOST_WAVES
from rotary_error_monitor.notebook.pictures import Figures
from rotary_error_monitor.notebook.read_only import sealed
from rotary_error_monitor.notebook.recording import Recording, Topics, bag_of
from rotary_error_monitor.notebook.tables import Units, scaled, table_of_rows
from rotary_error_monitor.pipeline.estimator_settings import MAX_GAP, max_gap_of
from rotary_error_monitor.pipeline.radial_heights import HIGHEST, check_height
from rotary_error_monitor.recordings.analysis import FileAnalysis, Question, check_waves
from rotary_error_monitor.recordings.formats import outputs_of
from rotary_error_monitor.report.analysis import changes_sentence, verdict_box, verdict_sentence
from rotary_error_monitor.signals.blocks import NANOSECONDS

if TYPE_CHECKING:
    from pandas import DataFrame

Limits = Mapping[str, float] | Path | str
"""Limits by name and unit, such as `{"radial_synchronous_um": 2}`, or a YAML file with a section of them."""


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class Analysis:
    """Error motion values of a recording; arrays are read-only.

    Attributes:
        files: what was analysed, and how.
        result: all that was found, as the package has it.
        changes: since another recording; None where there is none.
    """

    files: FileAnalysis
    result: AnalysisResult
    changes: tuple[Change, ...] | None

    @property
    def outcome(self) -> Conformity:
        """Whether the stage keeps its limits."""
        return self.result.outcome

    @property
    def verdict(self) -> str:
        """The same in a sentence, as the command prints it."""
        return verdict_sentence(self.result)

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a reader should know, that of each segment with its name."""
        of_segments = [f"{each.name}: {remark}" for each in self.result.segments for remark in each.remarks]
        return (*of_segments, *self.result.remarks)

    def to_dataframe(self, units: Units = "SI") -> DataFrame:
        """Table with a row for each value; what does not apply is missing.

        Columns: `quantity` (such as `radial_rotating_at_16mm.synchronous`), `segment` (direction and speed; empty for
        the whole recording), `value`, `U95` (expanded uncertainty, k = 2), `unit`, `measured` (the value by its
        definition, with what noise adds), `turns`, `cut_off` (waves a turn), `bandwidth` (Hz), `limit` and `verdict`.

        Args:
            units: `SI` for m and rad, `um` for µm and µrad.

        Raises:
            InputError: there are no such units.
            MissingPackageError: pandas is not installed.
        """
        figures = list(figures_of(self.result))
        limits = limited(self.result.segments, self.result.judged)
        judged = [limits.get((each.segment, each.name)) for each in figures]
        told = scaled(
            units,
            [each.unit for each in figures],
            {
                "value": [each.value for each in figures],
                "U95": [each.expanded_uncertainty for each in figures],
                "measured": [each.measured for each in figures],
                "limit": [None if each is None else each[0] for each in judged],
            },
        )
        columns = {
            "quantity": [each.name for each in figures],
            "segment": [each.segment for each in figures],
            "value": told["value"],
            "U95": told["U95"],
            "unit": told["unit"],
            "measured": told["measured"],
            "turns": [each.turns for each in figures],
            "cut_off": [each.cut_off for each in figures],
            "bandwidth": [each.bandwidth for each in figures],
            "limit": told["limit"],
            "verdict": [None if each is None else each[1].value for each in judged],
        }
        return table_of_rows(columns, {"bandwidth": "Hz"})

    def figures(self, shown: str = "") -> Figures:
        """Pictures of the page: `polar`, `orders` or `course`; by default the first that there are.

        Raises:
            InputError: there are no such pictures; the message says which there are.
        """
        from rotary_error_monitor.report.analysis_figure import COLUMNS, COURSE, ORDERS, POLAR, sketches
        from rotary_error_monitor.report.drawing import in_rows

        names = {"polar": POLAR, "orders": ORDERS, "course": COURSE}
        there = [name for name, what in names.items() if next(sketches(self.result, what), None) is not None]
        if not there:
            raise InputError(
                f"{self.files.recording}: no picture: no whole turn at a constant speed, and no force or temperature"
            )
        if shown and shown not in there:
            raise InputError(f"shown is '{excerpt(shown)}'; this analysis has {', '.join(there)}")
        what = names[shown or there[0]]
        return Figures(in_rows(list(sketches(self.result, what)), COLUMNS[what]))

    def save(self, path: Path | str) -> None:
        """Write what the command writes to such a file: a page (.html), .json, .csv or pictures (.png).

        Raises:
            InputError: it cannot be written, ends otherwise, or is a file of the recording.
        """
        replace(self.files, outputs=outputs_of(Path(path))).write(self.result, self.changes)

    def __repr__(self) -> str:
        changed = () if self.changes is None else (changes_sentence(self.changes),)
        return "\n  ".join([f"Analysis of {self.files.recording}", self.verdict, *changed, *self.remarks])

    def _repr_html_(self) -> str:
        changed = [] if self.changes is None else [changes_sentence(self.changes)]
        return verdict_box(self.result, [*changed, *self.remarks])


def analyse(
    recording: Recording | Path | str,
    stage: Path | str | None = None,
    machine: Path | str | None = None,
    *,
    heights: Sequence[float] = (),
    limits: Limits | None = None,
    waves: int = MOST_WAVES,
    max_gap: float = MAX_GAP,
    against: Path | str | None = None,
    cell: str = "",
    topics: Topics = None,
) -> Analysis:
    """Error motion values (ISO 230-7) of a recording: the numbers of the command `analyse`.

    Args:
        recording: a bag, or what `read_bag` gave.
        stage: YAML with a section `stage`; None for the stage that the package ships.
        machine: YAML, or name of a machine that ships; None for the stage alone.
        heights: above the ring, m, at which radial error motion is told; none, and they are ring, reference and probes.
        limits: that the stage is to keep; None, and they are those of the stage's file, if it states some.
        waves: cut-off of the filter over the angle, waves a turn, at most.
        max_gap: samples further apart are not joined, s, but for what the bag's live run joined.
        against: another bag of the same stage: what changed since.
        cell: of a bag that holds several, as for `read_bag`.
        topics: how the bag calls its topics, as for `read_bag`.

    Raises:
        InputError: there is no such bag or description, or a value is out of range; the message says which and what
            would be right.

    Example:
        >>> from rotary_error_monitor import analyse
        >>> found = analyse(bag, stage, limits={"radial_total_um": 100})
        >>> found.outcome.value
        'within'
        >>> table = found.to_dataframe()
        >>> set(table["unit"]) >= {"m", "rad"}
        True
    """
    path, naming = bag_of(recording, cell, topics)
    file, other = (None if each is None else Path(each) for each in (stage, against))
    for height in heights:
        check_height(height, HIGHEST, "m", f"heights has {height}")
    check_waves(waves, f"waves is {waves}")
    joined_ns = max_gap_of(max_gap, NANOSECONDS, f"max_gap is {max_gap} s")
    question = Question(limits_of(_words(limits), file, "limits"), sorted(set(heights)), waves, naming, joined_ns)
    files = FileAnalysis(path, file, None if machine is None else str(machine), question, {}, other)
    result, changes = files.analyse()
    return Analysis(files, sealed(result), changes)


def _words(limits: Limits | None) -> list[str]:
    """Limits as on the command line."""
    if limits is None:
        return []
    return [f"{name}={value!r}" for name, value in limits.items()] if isinstance(limits, Mapping) else [str(limits)]
