"""The monitor held against the references of a recording, from files to files."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from rotary_error_monitor.analysis.comparison import DESCRIBED, Stand, stands_at, stands_of_reference
from rotary_error_monitor.analysis.verification import compare_reference
from rotary_error_monitor.analysis.verification_result import Verification, as_mapping, figures_of
from rotary_error_monitor.arrays import Array, Times
from rotary_error_monitor.bags.naming import THE_ONLY_CELL, Naming
from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.description.stage import StageDescription, load_stage
from rotary_error_monitor.description.streams import OWN_REFERENCE, REFERENCE_TITLE
from rotary_error_monitor.description.wire import wire_of
from rotary_error_monitor.errors import InputError, told_of
from rotary_error_monitor.files import check_outputs, check_places, write_all
from rotary_error_monitor.pipeline.estimator_settings import EstimatorSettings
from rotary_error_monitor.pipeline.reference_readings import (
    Reference,
    reference_names,
    reference_of,
    without_references,
)
from rotary_error_monitor.recordings.long_estimates import estimates_of
from rotary_error_monitor.recordings.replay import check_estimated, replay_bag
from rotary_error_monitor.recordings.replayed import Replay
from rotary_error_monitor.recordings.result_contents import about_of, figures_table, title_of
from rotary_error_monitor.recordings.stream_health import read_streams
from rotary_error_monitor.report.drawn import Drawn
from rotary_error_monitor.report.result_files import contents_of
from rotary_error_monitor.report.verification import page
from rotary_error_monitor.resources import config
from rotary_error_monitor.signals.rows import RowsInMemory


@dataclass(frozen=True)
class FileVerification:
    """What is compared, and where the results go.

    Attributes:
        recording: bag.
        stage_file: YAML with a section `stage`; None for the embedded one.
        heights: above the ring, m; none, and they are those at which references were recorded.
        references: names of references; none, and it is the stage's own, or where none was recorded all radial probes.
        naming: which cell of a bag it is, and how the bag calls its topics.
        outputs: file of each format (`html`, `json`, `csv`, `png`).
        settings: how the monitor samples.
    """

    recording: Path
    stage_file: Path | None
    heights: Sequence[float]
    references: Sequence[str]
    naming: Naming
    outputs: Mapping[str, Path]
    settings: EstimatorSettings = field(default_factory=EstimatorSettings)

    def run(self) -> Verification:
        """Compare, and write the results: all of them, or what stood there stays.

        Raises:
            InputError: as `verify_bag`, or a result cannot be written.
        """
        check_outputs(self.outputs.values(), [self.recording, self._stage_file])
        check_places(self.outputs.values())
        stage = load_stage(self.stage_file)
        found = verify_bag(self.recording, stage, self.heights, self.references, self.naming, self.settings)
        write_all(dict(self._contents(found)))
        return found

    @property
    def _stage_file(self) -> Path:
        return self.stage_file or config("stage.yaml")

    def _contents(self, found: Verification) -> Iterator[tuple[Path, bytes]]:
        about = about_of(self.recording, self.stage_file)

        def drawn() -> tuple[list[list[Drawn]], Callable[[Sequence[Sequence[Drawn]]], bytes]]:
            # what draws takes long to load
            from rotary_error_monitor.report.verification_figure import draw, joined

            return draw(found), joined

        return contents_of(
            self.outputs,
            lambda: as_mapping(found, about),
            lambda: figures_table(figures_of(found)),
            drawn,
            lambda pictures: page(found, pictures, title_of(self.recording), about),
        )


def verify_bag(
    bag: Path | str,
    stage: StageDescription,
    heights: Sequence[float] = (),
    names: Sequence[str] = (),
    naming: Naming = THE_ONLY_CELL,
    settings: EstimatorSettings | None = None,
) -> Verification:
    """Hold the radial error motion of a replay against the references that were recorded beside it.

    A listed probe is an input of the live estimate. As a reference it is held out: the replay does without it, and so
    does not repeat what the live run decided.

    Args:
        bag: recording.
        stage: as described.
        heights: above the ring, m; none, and they are those at which references were recorded.
        names: of references: the stage's own by its stream, or radial probes as the section `sensors` calls them.
        naming: which cell of a bag it is, and how the bag calls its topics.
        settings: how the monitor samples.

    Raises:
        InputError: there is no such bag, reference, or height with one, or not a whole turn of what is compared.
    """
    reader, wire = BagReader(bag, naming), wire_of(stage)
    kept = read_streams(reader, wire, stage, RowsInMemory, kept=(OWN_REFERENCE, *stage.sensors)).kept
    samples = {name: samples.all() for name, samples in kept.items()}
    references = _references(stage, names, samples, reader)
    monitor = without_references(stage, tuple(references))
    replay = replay_bag(bag, monitor, None, settings, naming, repeat=monitor is stage)
    check_estimated(replay, bag, monitor, least=2)
    stands = {name: _stands(each, stage, replay) for name, each in references.items()}
    chosen = [(name, stand) for name, own in stands.items() for stand in own]
    if heights:
        chosen = [pair for height in heights for pair in _at(stands, height, str(bag))]
    estimates = estimates_of(replay)
    try:
        compared = [compare_reference(estimates, monitor, references[name], stand, str(bag)) for name, stand in chosen]
    except InputError as error:  # it may be for what was not believed
        said = [remark for remark in replay.remarks if not remark.startswith(f"{bag}: ")]
        raise InputError("; ".join([str(error), *said])) from error
    return Verification(tuple(compared), replay.span_ns, replay.remarks)


def _references(
    stage: StageDescription, names: Sequence[str], samples: Mapping[str, tuple[Times, Array]], reader: BagReader
) -> dict[str, Reference]:
    """Those that are asked for, or the stage's own, or else the radial probes.

    Raises:
        InputError: one that is asked for was not recorded, or none was.
    """
    known = reference_names(stage)
    asked = names or [name for name in known if name == OWN_REFERENCE] or known
    found = {name: reference_of(stage, name, samples) for name in asked}
    if not names and not any(found.values()):
        found = {name: reference_of(stage, name, samples) for name in known}
    there = {name: each for name, each in found.items() if each is not None}
    lacking = [name for name, each in found.items() if each is None]
    if not there or (names and lacking):
        have = f"the stage has {', '.join(known) or f'neither {REFERENCE_TITLE} nor radial probe'}"
        what = f"no samples of the reference {', '.join(lacking)}" if lacking else "no reference"
        damage = f"; {reader.damage}" if reader.damage else ""
        raise InputError(f"{reader.path}: {what}; {have}: record one beside heads and autocollimator{damage}")
    return there


def _stands(reference: Reference, stage: StageDescription, replay: Replay) -> tuple[Stand, ...]:
    """Where a reference stood; a listed probe stays where it is described."""
    if reference.name == OWN_REFERENCE and stage.reference is not None:
        seen = reference.times_ns, reference.readings
        return stands_of_reference(replay.stamp_ns, replay.motion, stage.reference, *seen)
    begin, end = int(replay.stamp_ns[0]), int(replay.stamp_ns[-1]) + 1
    return (Stand(reference.height, DESCRIBED, (reference.height,), begin, end),)


def _at(stands: Mapping[str, Sequence[Stand]], height: float, bag: str) -> list[tuple[str, Stand]]:
    with told_of(f"{bag}: --height is {height * 1e3:g} (mm)"):
        return stands_at(stands, height)
