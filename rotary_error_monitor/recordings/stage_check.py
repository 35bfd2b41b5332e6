"""Whether a stage's description fits a recording of the stage: what the estimator checks live, told at length."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median

from rotary_error_monitor.bags.naming import THE_ONLY_CELL, Naming
from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.wire import wire_of
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.pipeline.estimation import Estimator
from rotary_error_monitor.pipeline.estimator_settings import EstimatorSettings
from rotary_error_monitor.pipeline.observability import rotation_is_lacking
from rotary_error_monitor.recordings.replay import gap_remarks, input_topics
from rotary_error_monitor.signals.arrival import FUTURE
from rotary_error_monitor.signals.blocks import SampleBlock

BATCH = 32
"""Messages that are reckoned with at once: what is doubted is dated to some hundredths of a second."""

_SCALE_OF_TILT = "uncertainty of the autocollimator, times that of its noise, median"


@dataclass
class Doubt:
    """Something that was not believed.

    Attributes:
        what: stream or part of the description.
        why: the reason, as it was given first.
        begin: from when on, s after the start of the recording.
        duration: how long in all, s.
    """

    what: str
    why: str
    begin: float
    duration: float = 0.0


@dataclass(frozen=True)
class StageCheck:
    """What a recording says of a description.

    Attributes:
        doubts: what was not believed, in the order in which it began.
        refused: samples that were not believed, by stream and reason.
        verified: part of a whole turn against which the description was held, 0 to 1.
        duration: of the recording, s.
        figures: by name, with their units.
        remarks: what of the bag could not be read, or lies outside of its recording.
    """

    doubts: tuple[Doubt, ...]
    refused: Mapping[tuple[str, str], int]
    verified: float
    duration: float
    figures: Mapping[str, float] = field(default_factory=dict)
    remarks: tuple[str, ...] = ()

    @property
    def fits(self) -> bool:
        """Whether nothing contradicts the description."""
        return not self.doubts

    @property
    def is_whole(self) -> bool:
        """Whether the stage made a whole turn, so that a contradiction would have shown."""
        return self.verified >= 1.0


def check_stage(
    bag: Path | str,
    stage: StageDescription,
    naming: Naming = THE_ONLY_CELL,
    settings: EstimatorSettings | None = None,
) -> StageCheck:
    """Hold a recording against the description of its stage.

    Raises:
        InputError: there is no such bag, it lacks what tells the rotation, or nothing can be estimated from it.
    """
    reader = BagReader(bag, naming)
    # Sensors that the stage lists are of use, not needed.
    found = input_topics(reader, wire_of(stage), stage)
    inputs = {topic: name for topic, name in found.items() if name not in stage.sensors or topic in reader.topics}
    settings = settings or EstimatorSettings()
    estimator = Estimator(stage, settings)
    log, ahead = _Log(), Counter[tuple[str, str]]()
    window = reader.window(list(inputs))
    for count, (topic, content, arrival_ns) in enumerate(reader.replay_arrivals(list(inputs), window), start=1):
        if isinstance(content, SampleBlock):
            try:
                estimator.accept(inputs[topic], content, arrival_ns, recorded=True)
            except InputError as error:
                if not str(error).startswith(FUTURE):
                    raise
                ahead[inputs[topic], FUTURE] += len(content.rows)
                continue
            log.note_time(content.stamp_ns)
        if count % BATCH == 0:
            estimator.advance()
            log.note(estimator)
    estimator.finish()
    log.note(estimator)
    status = estimator.status
    if status.estimates + status.withheld == 0:
        raise InputError(f"{bag}: {rotation_is_lacking(stage)}; nothing can be checked")
    refused = Counter(
        {
            (name, reason): number
            for name, stream in status.streams.items()
            for reason, number in stream.admission.refused.items()
        }
    )
    refused.update(ahead)
    said = (*reader.remarks, window and window.remark, *gap_remarks(status, settings))
    remarks = tuple(remark for remark in said if remark)
    figures = _figures(estimator, stage, log)
    verified = estimator.belief.verified
    return StageCheck(tuple(log.doubts.values()), refused, verified, log.duration, figures, remarks)


def _figures(estimator: Estimator, stage: StageDescription, log: _Log) -> dict[str, float]:
    """What the estimator found, by name with unit, as far as the stage has the sensors for it.

    How sure it was is told in the median over the recording: for a moment it is less sure of the best instrument, as
    at a turning point, where one that is stuck would read the same.
    """
    status, belief = estimator.status, estimator.belief
    found = {
        "estimates": float(status.estimates),
        "withheld": float(status.withheld),
        _scale_of_heads(stage): median(log.head_scales or [belief.verdict.head_scale]),
        _SCALE_OF_TILT: median(log.tilt_scales or [belief.verdict.tilt_scale]),
        "delay of the heads against the command, ms": belief.command.delay * 1e3 + 0.0,  # no minus before a zero
        "whole turns taken out": float(status.turns),
        "eccentricity or error motion, not told which, um": belief.verdict.unresolved * 1e6,
        "tilt of the mirror or of the axis, not told which, urad": belief.verdict.unresolved_tilt * 1e6,
    }
    if stage.encoder is not None:
        return found
    own = ("estimates", "withheld", _SCALE_OF_TILT)
    return {name: found[name] for name in own} | {
        "uncertainty of the rotation, which is the command, urad": belief.verdict.lag * 1e6,
        "contradiction among the listed sensors, times what is stated": estimator.sensor_conflict,
    }


def _scale_of_heads(stage: StageDescription) -> str:
    """A ring that turns fast is known less well than its readings: stamps are not of one instant."""
    stamps = f"its stamps known to {stage.timing('encoder') * 1e6:.3g} us (uncertainty.encoder.timing)"
    return f"uncertainty of a head, {stamps}, times that of its noise, median"


def check_text(check: StageCheck) -> Iterator[str]:
    """The result, a line for each thing."""
    if not check.fits:
        yield "The recording contradicts the description of the stage, or one of its instruments is wrong:"
    elif check.is_whole:
        yield "The description fits the recording."
    else:
        yield f"Nothing contradicts the description, but the stage made only {check.verified:.0%} of a whole turn."
    for doubt in check.doubts:
        yield f"  {doubt.what}: {doubt.why} (from {doubt.begin:.2f} s on, {doubt.duration:.2f} s in all)"
    for (name, reason), number in sorted(check.refused.items()):
        yield f"  {name}: {number} samples refused: {reason}"
    for remark in check.remarks:
        yield f"  note: {remark}"
    for name, value in check.figures.items():
        yield f"  {name}: {value:.6g}"


class _Log:
    """What was doubted, and when, and how sure heads and autocollimator were each time."""

    def __init__(self) -> None:
        self.doubts: dict[str, Doubt] = {}
        self.head_scales: list[float] = []
        self.tilt_scales: list[float] = []
        self._first_ns: int | None = None
        self._last_ns = 0
        self._before = 0.0

    @property
    def duration(self) -> float:
        """Time since the first sample, s."""
        return 0.0 if self._first_ns is None else (self._last_ns - self._first_ns) * 1e-9

    def note_time(self, stamp_ns: int) -> None:
        self._first_ns = stamp_ns if self._first_ns is None else self._first_ns
        self._last_ns = max(self._last_ns, stamp_ns)

    def note(self, estimator: Estimator) -> None:
        """What the estimator doubts now lasted since the last time that it was asked."""
        passed, self._before = self.duration - self._before, self.duration
        if estimator.status.estimates:
            self.head_scales.append(estimator.belief.verdict.head_scale)
            self.tilt_scales.append(estimator.belief.verdict.tilt_scale)
        for what, why in estimator.reasons:
            doubt = self.doubts.setdefault(what, Doubt(what, why, self.duration))
            doubt.duration += passed
