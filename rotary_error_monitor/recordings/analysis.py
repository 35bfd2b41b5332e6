"""How good a stage is, from files to files: a bag in, its error motion values and page out."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

from rotary_error_monitor.analysis.changes import Change, changes_between
from rotary_error_monitor.analysis.comparison import Stay, stays_of
from rotary_error_monitor.analysis.course import estimate_drifts
from rotary_error_monitor.analysis.motion import SegmentFigures, analyse_motion
from rotary_error_monitor.analysis.positions import positioning_of
from rotary_error_monitor.analysis.result import AnalysisResult, as_mapping, figures_of
from rotary_error_monitor.analysis.signals import default_heights
from rotary_error_monitor.analysis.verdict import judge
from rotary_error_monitor.bags.kept_rows import kept_beside, kept_in
from rotary_error_monitor.bags.naming import THE_ONLY_CELL, Naming
from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.description.error_motion_limits import ErrorMotionLimits
from rotary_error_monitor.description.machine import MachineDescription, load_machine, machine_path
from rotary_error_monitor.description.stage import StageDescription, load_stage
from rotary_error_monitor.description.streams import AUTOCOLLIMATOR, OWN_REFERENCE
from rotary_error_monitor.description.wire import wire_of
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.files import check_outputs, check_places, write_all
from rotary_error_monitor.metrology.turns import LEAST_WAVES, MOST_WAVES
from rotary_error_monitor.pipeline.estimator_settings import EstimatorSettings
from rotary_error_monitor.recordings.long_estimates import ReplayedEstimates
from rotary_error_monitor.recordings.progress import Progress, silent
from rotary_error_monitor.recordings.replay import check_estimated, replay_long
from rotary_error_monitor.recordings.result_contents import about_of, figures_table, title_of
from rotary_error_monitor.recordings.stream_health import RecordedStreams, read_streams
from rotary_error_monitor.report.analysis import page
from rotary_error_monitor.report.drawn import Drawn
from rotary_error_monitor.report.result_files import contents_of
from rotary_error_monitor.resources import config
from rotary_error_monitor.signals.rows import Keep
from rotary_error_monitor.units import TURN

PUSHED = 1.0
"""Force on the shaft from which it is said that values hold what it does, N."""


@dataclass(frozen=True)
class Question:
    """What is asked of a recording.

    Attributes:
        limits: of the error motion values; none, and there is no verdict.
        heights: above the ring, m; none, and they are those of ring, reference and probes.
        most_waves: cut-off of the filter over the angle, waves a turn, at most.
        naming: which cell of a bag it is, and how the bag calls its topics.
        max_gap_ns: samples further apart than this are not joined, ns.
    """

    limits: ErrorMotionLimits = field(default_factory=ErrorMotionLimits)
    heights: Sequence[float] = ()
    most_waves: int = MOST_WAVES
    naming: Naming = THE_ONLY_CELL
    max_gap_ns: int = EstimatorSettings.max_gap_ns


def check_waves(waves: float, told: str) -> None:
    """Refuse a cut-off that leaves nothing; `told` as for a height.

    Raises:
        InputError: it is too low.
    """
    if not waves >= LEAST_WAVES:
        raise InputError(f"{told}; it must be at least {LEAST_WAVES}")


@dataclass(frozen=True)
class FileAnalysis:
    """What is analysed, and where the results go.

    Attributes:
        recording: bag.
        stage_file: YAML with a section `stage`; None for the embedded one.
        machine: YAML, or name of a machine that ships; None for the stage alone.
        question: what is asked.
        outputs: file of each format (`html`, `json`, `csv`, `png`).
        against: another bag of the same stage, with which it is compared; None for none.
    """

    recording: Path
    stage_file: Path | None
    machine: str | None
    question: Question
    outputs: Mapping[str, Path]
    against: Path | None = None

    def run(self, progress: Progress = silent) -> tuple[AnalysisResult, tuple[Change, ...] | None]:
        """Analyse, and write the results: all of them, or what stood there stays. Changes where there is another bag.

        Args:
            progress: is told how far it is.

        Raises:
            InputError: as `analyse_bag`, or a result cannot be written.
        """
        self._check_outputs()
        analysis, changes = self.analyse(progress)
        self._write(analysis, changes)
        return analysis, changes

    def analyse(self, progress: Progress = silent) -> tuple[AnalysisResult, tuple[Change, ...] | None]:
        """Analyse alone; arguments and results as `run`.

        Raises:
            InputError: as `analyse_bag`.
        """
        machine = load_machine(self.machine) if self.machine else None
        stage = load_stage(self.stage_file)
        keep = next(map(kept_beside, self.outputs.values()), None)
        analysis = analyse_bag(self.recording, stage, machine, self.question, keep, progress)
        changes = None
        if self.against is not None:
            other = analyse_bag(self.against, stage, machine, self.question, keep, progress)
            changes = tuple(changes_between(list(figures_of(other)), list(figures_of(analysis))))
        return analysis, changes

    def write(self, analysis: AnalysisResult, changes: tuple[Change, ...] | None) -> None:
        """Write what `analyse` gave: all of the files, or what stood there stays.

        Raises:
            InputError: a result cannot be written.
        """
        self._check_outputs()
        self._write(analysis, changes)

    def _check_outputs(self) -> None:
        read = [self.recording, self.against, self.stage_file or config("stage.yaml")]
        check_outputs(self.outputs.values(), [*read, machine_path(self.machine) if self.machine else None])
        check_places(self.outputs.values())

    def _write(self, analysis: AnalysisResult, changes: tuple[Change, ...] | None) -> None:
        write_all(dict(self._contents(analysis, changes)))

    def _contents(self, analysis: AnalysisResult, changes: tuple[Change, ...] | None) -> Iterator[tuple[Path, bytes]]:
        beside = {"machine": self.machine} if self.machine else {}
        beside |= {"compared with": str(self.against)} if self.against else {}
        about = about_of(self.recording, self.stage_file, **beside)
        since = {} if changes is None else {"changes": [asdict(each) | {"told": each.is_told} for each in changes]}

        def drawn() -> tuple[dict[str, list[Drawn]], Callable[[Mapping[str, Sequence[Drawn]]], bytes]]:
            # what draws takes long to load
            from rotary_error_monitor.report.analysis_figure import draw, joined

            return draw(analysis), joined

        return contents_of(
            self.outputs,
            lambda: as_mapping(analysis, about) | since,
            lambda: figures_table(figures_of(analysis)),
            drawn,
            lambda pictures: page(analysis, pictures, title_of(self.recording), about, changes),
        )


def analyse_bag(
    bag: Path | str,
    stage: StageDescription,
    machine: MachineDescription | None = None,
    question: Question | None = None,
    keep: Keep | None = None,
    progress: Progress = silent,
) -> AnalysisResult:
    """Analyse the recording of a stage; its error motion is that of a replay, which is that of the live run.

    Args:
        bag: of any length: of a long one no more than a part is in memory.
        stage: as described.
        machine: that carries it; None for the stage alone.
        question: what is asked.
        keep: where what is larger than memory is kept; by default files without a name, where the system has its own.
        progress: is told how far it is.

    Raises:
        InputError: there is no such bag, it lacks what tells the rotation, or the machine does not have this stage.
    """
    question, keep = question or Question(), keep or kept_in()
    check_machine(machine)
    settings = EstimatorSettings(max_gap_ns=question.max_gap_ns)
    replay = replay_long(bag, stage, machine, settings, question.naming, keep, progress)
    check_estimated(replay, bag, stage, least=2)
    estimates = ReplayedEstimates(replay)
    wire = wire_of(stage)
    streams = read_streams(BagReader(bag, question.naming), wire, stage, keep, progress)
    heights, rate = question.heights or default_heights(stage), _least_rate(streams, stage)
    with progress("figures") as step:
        segments = analyse_motion(estimates, stage, heights, question.most_waves, rate, keep, lambda x: step(x, 0))
    acting = streams.acting(stage)
    temperatures = {name.partition(",")[0]: each for name, each in acting.items() if name.endswith("°C")}
    outcome, judged = judge(segments, question.limits)
    return AnalysisResult(
        outcome,
        judged,
        segments,
        estimate_drifts(segments, temperatures),
        positioning_of(estimates),
        _stays(estimates, streams, stage),
        estimates.tool_offset,
        tuple(streams.health),
        estimates.fall_outs({name: wire.used_streams.mask([name]) for name in wire.used_streams.bits}),
        acting,
        replay.span_ns,
        estimates.period_ns * 1e-9,
        (*_remarks(streams, stage), *_too_short(estimates, segments), *replay.remarks),
    )


def _least_rate(streams: RecordedStreams, stage: StageDescription) -> float:
    """Samples a second, Hz, of the slowest of the sensors that are recorded."""
    names = [*(f"head_{letter}" for letter in stage.azimuths), AUTOCOLLIMATOR, *stage.sensors]
    return min((streams.rates[name] for name in names if name in streams.rates), default=math.inf)


def _stays(estimates: ReplayedEstimates, streams: RecordedStreams, stage: StageDescription) -> tuple[Stay, ...]:
    """The monitor against the stage's own reference, where one was recorded."""
    samples = streams.kept.get(OWN_REFERENCE)
    if stage.reference is None or samples is None:
        return ()
    return stays_of(estimates, estimates.period_ns, stage.reference, samples)


def check_machine(machine: MachineDescription | None) -> MachineDescription | None:
    """The machine, or none.

    Raises:
        InputError: it has no axis that the stage could be.
    """
    if machine is not None and machine.monitored is None:
        raise InputError("the machine has no monitored axis; give one that the stage is part of, or none")
    return machine


def _too_short(estimates: ReplayedEstimates, segments: Sequence[SegmentFigures]) -> list[str]:
    turned = estimates.turned / TURN
    return [] if segments else [f"the rotor turned {turned:.2g} turns: no whole one, so no error motion value is told"]


def _remarks(streams: RecordedStreams, stage: StageDescription) -> list[str]:
    most = streams.most_force(stage)
    if most < PUSHED:
        return []
    return [
        f"a force of up to {most:.3g} N acted on the shaft: what it did is part of the error motion, and "
        "of its total and asynchronous values most of all; record without it to judge the stage alone"
    ]
