"""Assembly errors of a stage's ring and mirror, from a recording of the shaft between centres into the stage file."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.calibration.assembly_doubts import Centres, doubt_assembly
from rotary_error_monitor.calibration.assembly_tables import MeasuredCurve, mirror_curve, ring_curve, written_names
from rotary_error_monitor.calibration.head_comparison import AssemblyComparison, compare_assembly
from rotary_error_monitor.calibration.yaml_document import YamlDocument, hash_source, number
from rotary_error_monitor.calibration.yaml_text import YamlRows
from rotary_error_monitor.description.provenance import Calibrated
from rotary_error_monitor.description.stage import StageDescription, load_stage
from rotary_error_monitor.description.table_files import FLATNESS, GRADUATION
from rotary_error_monitor.description.wire import Wire, wire_of
from rotary_error_monitor.errors import InputError, told_of
from rotary_error_monitor.files import write_all
from rotary_error_monitor.metrology.mirror_assembly import (
    DELAY_STD,
    MirrorAssembly,
    doubt_mirror,
    estimate_mirror_assembly,
)
from rotary_error_monitor.metrology.periodic_curves import stage_by_orders
from rotary_error_monitor.metrology.responses import correct_block
from rotary_error_monitor.metrology.ring_assembly import RingAssembly, estimate_ring_assembly
from rotary_error_monitor.metrology.rotation_fit import HIGHEST
from rotary_error_monitor.metrology.shaft_recording import ShaftRecording, record_shaft
from rotary_error_monitor.signals.blocks import SampleBlock
from rotary_error_monitor.units import ARCSEC

NOTHING = 0.01
"""Part of a reading's noise below which an order of a curve that the file has is none: no calculation notices it."""


@dataclass(frozen=True)
class AssemblyResult:
    """What a recording between centres says.

    Attributes:
        mirror: None where no autocollimator was recorded, or where it does not tell.
        radius: of the ring, m.
        remark: why there is no mirror.
        remarks: what of the recording could not be used, and what changed within what the centres explain.
        ticks: times that were used.
        written: False where the recording does not fit and was not forced into the file.
        contradictions: what speaks against ring or mirror though the recording fits them, in words.
        centres: what the shaft may have moved between them, which counts into the uncertainties.
        comparison: the heads against one another, and what the autocollimator sees, before and after.
        curves: graduation and flatness as measured curves, where these are written in place of their orders.
    """

    ring: RingAssembly
    mirror: MirrorAssembly | None
    radius: float
    remark: str
    ticks: int
    written: bool
    remarks: tuple[str, ...] = ()
    contradictions: tuple[str, ...] = ()
    centres: Centres = field(default_factory=Centres)
    comparison: AssemblyComparison | None = None
    curves: tuple[MeasuredCurve, ...] = ()

    @property
    def fits(self) -> bool:
        """Whether the recording fits ring and mirror, and these what is known of them."""
        return self.ring.fit.fits and (self.mirror is None or self.mirror.fit.fits) and not self.contradictions


def read_shaft_recording(path: Path | str, stage: StageDescription, remarks: list[str] | None = None) -> ShaftRecording:
    """Heads and autocollimator of a bag, brought to common times.

    What of the bag cannot be read, or lies outside of the recording by its time, is added to `remarks`.

    Raises:
        InputError: the bag cannot be read, holds fewer than two heads, or its streams hardly overlap.
    """
    wire = wire_of(stage)
    reader = BagReader(path)
    topics = {letter: wire.topic("head_samples", letter).name for letter in stage.azimuths}
    heads = tuple(letter for letter, name in topics.items() if name in reader.topics and reader.topics[name].count)
    if len(heads) < 2:
        reader.check_topics(topics.values())
    collimator = wire.topic("autocollimator_samples").name
    names = [topics[letter] for letter in heads]
    if stage.autocollimator and collimator in reader.topics and reader.topics[collimator].count:
        names.append(collimator)
    window = reader.window(names)
    blocks = reader.read_blocks(names, window)
    if remarks is not None:
        remarks += [remark for remark in (*reader.remarks, window and window.remark) if remark]
    streams = {name: _joined(_corrected(blocks[name], wire, name, stage)) for name in names}
    with told_of(path):
        return record_shaft(stage, {letter: streams[topics[letter]] for letter in heads}, streams.get(collimator))


def calibrate_assembly(
    source: Path,
    stage_file: Path,
    output: Path,
    day: date,
    *,
    delay: tuple[float, float] = (0.0, DELAY_STD),
    centres: Centres | None = None,
    as_table: bool = False,
    force: bool = False,
) -> AssemblyResult:
    """Eccentricity and graduation of the ring, tilt and flatness of the mirror, into the stage file.

    What the recording cannot tell stays in the file. A recording that does not fit, or that contradicts what the file
    has with an uncertainty, is written only by `force`, with an uncertainty that covers what is left. What was there
    before goes to the history of each section.

    Args:
        source: bag of the shaft between centres.
        stage_file: the stage as described so far.
        output: where to write.
        day: of the calibration.
        delay: age of the autocollimator's values beyond its described latency, and its standard uncertainty, as known
            before, s.
        centres: how well the centres hold the shaft; by default as `Centres` has it.
        as_table: write graduation and flatness as measured curves of all orders that the recording tells, in CSV files
            beside the output, in place of orders that stand out.
        force: write what does not fit.

    Raises:
        InputError: the bag or the stage file cannot be read, or the recording does not determine the ring.
    """
    described = load_stage(stage_file)
    if described.encoder is None:
        raise InputError(f"{stage_file}: the stage has no section 'encoder', which this calibrates")
    stage = stage_by_orders(described, HIGHEST, _least(described))
    result = _measured(source, stage, delay, centres or Centres(), as_table)
    if not (result.fits or force):
        return result
    document, digest = YamlDocument(stage_file, "stage"), hash_source(source)
    files = written_names(result.curves, output)
    doubt = "" if result.fits else "; ".join(misfit_lines(result))
    notes = _set_ring(document, result.ring, files), _set_mirror(document, result.mirror, files)
    for name, (uncertainty, figures) in notes:
        if name:
            document.note(name, Calibrated(day.isoformat(), source.name, digest, uncertainty, figures, doubt or None))
    contents = {files[curve.name]: curve.content(source.name, digest, day) for curve in result.curves}
    with _written_beside(contents):
        document.save(output, load_stage, source)
    return replace(result, written=True)


def _measured(
    source: Path, stage: StageDescription, delay: tuple[float, float], centres: Centres, as_table: bool
) -> AssemblyResult:
    """What the recording says of ring and mirror; arguments and errors as `calibrate_assembly`."""
    remarks: list[str] = []
    recording = read_shaft_recording(source, stage, remarks)
    with told_of(source):
        ring = estimate_ring_assembly(stage, recording, every=as_table)
    where = "in the recording" if stage.autocollimator is not None else "by the stage file"
    mirror, remark = None, f"no autocollimator {where}"
    if recording.tilt is not None:
        try:
            mirror = doubt_mirror(estimate_mirror_assembly(stage, recording, delay, every=as_table), ring)
        except InputError as error:
            remark = str(error)
    doubts = doubt_assembly(stage, ring, mirror, centres)
    return AssemblyResult(
        doubts.ring,
        doubts.mirror,
        stage.ring.disc_radius,
        remark,
        len(recording.readings),
        written=False,
        remarks=(*remarks, *doubts.remarks),
        contradictions=doubts.misfits,
        centres=centres,
        comparison=compare_assembly(stage, recording, doubts.ring, doubts.mirror),
        curves=_curves(doubts.ring, doubts.mirror) if as_table else (),
    )


@contextmanager
def _written_beside(contents: Mapping[Path, bytes]) -> Iterator[None]:
    """Files that a stage file names, written before it, and taken away again where it could not be written."""
    new = [path for path in contents if not path.exists()]
    write_all(contents)
    try:
        yield
    except BaseException:  # also what Ctrl-C ends
        for path in new:
            path.unlink(missing_ok=True)
        raise


def _least(stage: StageDescription) -> tuple[float, float]:
    """Amplitudes of orders of a measured curve, ring and mirror, rad, below which a calibration does without them."""
    ring, mirror = stage.ring, stage.autocollimator
    heads = np.hypot(ring.noise, ring.resolution / np.sqrt(12))
    tilt = heads if mirror is None else np.hypot(mirror.noise, mirror.resolution / np.sqrt(12))
    return NOTHING * float(heads), NOTHING * float(tilt)


def _curves(ring: RingAssembly, mirror: MirrorAssembly | None) -> tuple[MeasuredCurve, ...]:
    """Curves of what was told: none where not even order 2 was."""
    found = [ring_curve(ring)] if ring.graduation else []
    if mirror is not None and mirror.flatness:
        found.append(mirror_curve(mirror))
    return tuple(found)


def misfit_lines(result: AssemblyResult) -> list[str]:
    """By how much a recording does not fit, and what is left looks like."""
    ring, mirror = result.ring, result.mirror
    lines = [] if ring.fit.fits else [ring.fit.sentence("heads", result.radius * 1e6, "µm at the ring")]
    if mirror is not None and not mirror.fit.fits:
        lines.append(mirror.fit.sentence("autocollimator", ARCSEC, "arcsec"))
    return [*lines, *result.contradictions]


Note = tuple[str, tuple[float, dict[str, float]]]


def _set_ring(document: YamlDocument, ring: RingAssembly, files: Mapping[str, Path]) -> Note:
    place = ("encoder", "eccentricity")
    document.set("encoder", ".".join(place), place, [number(value) for value in ring.eccentricity])
    found = () if "graduation" in files else ring.graduation
    rows = [{"order": row.order, "cos": number(row.cos), "sin": number(row.sin)} for row in found]
    rows += [{"order": row.order, "cos": row.cos, "sin": row.sin} for row in ring.kept]
    _set_rows(document, "encoder", ("encoder", "graduation"), rows)
    _set_file(document, GRADUATION, files.get("graduation"))
    figures = {"residual_ratio": ring.fit.ratio}
    if ring.graduation_std and found:
        figures["graduation_uncertainty"] = max(max(pair) for pair in ring.graduation_std)
    return "encoder", (max(ring.eccentricity_std), figures)


def _set_mirror(document: YamlDocument, mirror: MirrorAssembly | None, files: Mapping[str, Path]) -> Note:
    if mirror is None:
        return "", (0.0, {})
    place = ("mirror", "tilt")
    document.set("mirror", ".".join(place), place, [number(value) for value in mirror.tilt])
    found = () if "flatness" in files else mirror.flatness
    rows: list[dict[str, Any]] = [
        {"order": row.order, "x": [*map(number, row.x)], "y": [*map(number, row.y)]} for row in found
    ]
    rows += [{"order": row.order, "x": [*row.x], "y": [*row.y]} for row in mirror.kept]
    _set_rows(document, "mirror", ("mirror", "flatness"), rows)
    _set_file(document, FLATNESS, files.get("flatness"))
    figures = {
        "residual_ratio": mirror.fit.ratio,
        "autocollimator_delay": mirror.delay,
        "autocollimator_delay_uncertainty": mirror.delay_std,
    }
    if mirror.flatness_std and found:
        figures["flatness_uncertainty"] = max(mirror.flatness_std)
    return "mirror", (max(mirror.tilt_std), figures)


def _set_rows(document: YamlDocument, part: str, place: tuple[str, str], rows: list[dict[str, Any]]) -> None:
    if rows or document.get(*place):
        document.set(part, ".".join(place), place, YamlRows(sorted(rows, key=lambda row: int(row["order"]))))


def _set_file(document: YamlDocument, place: tuple[str, str], file: Path | None) -> None:
    """Name the file of a measured curve there, or take out what was there."""
    if file is not None:
        document.set(place[0], ".".join(place), place, {"file": file.name})
    elif document.get(*place) is not None:
        document.remove(place[0], ".".join(place), place)


def _corrected(blocks: list[SampleBlock], wire: Wire, topic: str, stage: StageDescription) -> list[SampleBlock]:
    """Blocks of a topic as the package means them."""
    contract = wire.named(topic)
    response = stage.responses.get(contract.frame)
    return [correct_block(block, contract.columns, response) for block in blocks]


def _joined(blocks: list[SampleBlock]) -> tuple[NDArray[np.int64], Array]:
    """Times and values of a stream; samples that are not after the one before are left out."""
    times = np.concatenate([block.times_ns for block in blocks])
    values = np.concatenate([block.rows[:, 1:] for block in blocks])
    newest = np.maximum.accumulate(times)
    fresh = np.concatenate([[True], times[1:] > newest[:-1]])
    return times[fresh], values[fresh]
