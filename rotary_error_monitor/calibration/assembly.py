"""Assembly errors of a stage's ring and mirror, from a recording of the shaft between centres into the stage file."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import date
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.calibration.yaml_document import (
    Provenance,
    YamlDocument,
    hash_source,
    in_one_line,
    note_provenance,
    number,
    section_of,
)
from rotary_error_monitor.description.stage import StageDescription, load_stage
from rotary_error_monitor.description.wire import load_wire
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.assembly import (
    MirrorAssembly,
    RingAssembly,
    ShaftRecording,
    estimate_mirror_assembly,
    estimate_ring_assembly,
)
from rotary_error_monitor.signals.blocks import SampleBlock
from rotary_error_monitor.signals.resampling import resample_all, tick_times

Array = NDArray[np.float64]

PERIOD_NS = 10_000_000
MAX_GAP_NS = 30_000_000
FEWEST_TICKS = 100
ARCSEC = 648000 / np.pi


@dataclass(frozen=True)
class AssemblyResult:
    """What a recording between centres says; the mirror is None where no autocollimator was recorded."""

    ring: RingAssembly
    mirror: MirrorAssembly | None
    ticks: int


def read_shaft_recording(path: Path | str, stage: StageDescription) -> ShaftRecording:
    """Heads and autocollimator of a bag, brought to common times 10 ms apart.

    Raises:
        InputError: the bag cannot be read, holds fewer than two heads, or its streams hardly overlap.
    """
    wire = load_wire(tuple(stage.encoder.azimuths))
    reader = BagReader(path)
    topics = {letter: wire.topic("head_samples", letter).name for letter in stage.encoder.azimuths}
    heads = tuple(letter for letter, name in topics.items() if name in reader.topics and reader.topics[name].count)
    if len(heads) < 2:
        reader.check_topics(topics.values())
    collimator = wire.topic("autocollimator_samples").name
    names = [topics[letter] for letter in heads]
    if collimator in reader.topics and reader.topics[collimator].count:
        names.append(collimator)
    blocks = reader.read_blocks(names)
    streams = [_joined(blocks[name]) for name in names]
    first = max(int(times[0]) for times, _ in streams) // PERIOD_NS + 1
    last = min(int(times[-1]) for times, _ in streams) // PERIOD_NS - 1
    if last - first < FEWEST_TICKS:
        raise InputError(f"{path}: the streams {', '.join(names)} overlap for {max(0, last - first) * 10} ms only")
    sampled = resample_all(streams, tick_times(first, last - first, PERIOD_NS), PERIOD_NS, MAX_GAP_NS)
    readings = np.concatenate([one.values for one in sampled[: len(heads)]], axis=1)
    # The speed at a tick needs its neighbours as well.
    valid = np.all([one.valid for one in sampled], axis=0)
    valid &= np.roll(valid, 1) & np.roll(valid, -1)
    valid[[0, -1]] = False
    speed = np.gradient(readings.mean(axis=1)) / (PERIOD_NS * 1e-9)
    head_variance = stage.encoder.noise**2 + stage.encoder.resolution**2 / 12
    tilt_variance = stage.autocollimator.noise**2 + stage.autocollimator.resolution**2 / 12
    tilt = sampled[len(heads)] if len(names) > len(heads) else None
    return ShaftRecording(
        heads=heads,
        readings=readings[valid],
        reading_variances=np.stack([one.gain[valid] for one in sampled[: len(heads)]], axis=1) * head_variance,
        speed=speed[valid],
        tilt=None if tilt is None else tilt.values[valid],
        tilt_variances=None if tilt is None else np.repeat(tilt.gain[valid, None] * tilt_variance, 2, axis=1),
    )


def calibrate_assembly(source: Path, stage_file: Path, output: Path, day: date) -> AssemblyResult:
    """Eccentricity and graduation of the ring, tilt and flatness of the mirror, into the stage file.

    Raises:
        InputError: the bag or the stage file cannot be read, or the recording does not determine the assembly.
    """
    stage = load_stage(stage_file)
    recording = read_shaft_recording(source, stage)
    try:
        ring = estimate_ring_assembly(stage, recording)
        mirror = None if recording.tilt is None else estimate_mirror_assembly(recording)
    except InputError as error:
        raise InputError(f"{source}: {error}") from error
    document = YamlDocument(stage_file)
    section = document.content["stage"]
    provenance = {"encoder": max(ring.eccentricity_std)}
    encoder = section["encoder"]
    encoder["eccentricity"] = in_one_line([number(value) for value in ring.eccentricity])
    encoder["graduation"] = [
        in_one_line({"order": row.order, "cos": number(row.cos), "sin": number(row.sin)}) for row in ring.graduation
    ]
    if mirror is not None:
        entry = section_of(section, "mirror")
        entry["tilt"] = in_one_line([number(value) for value in mirror.tilt])
        entry["flatness"] = [
            in_one_line({"order": row.order, "x": [*map(number, row.x)], "y": [*map(number, row.y)]})
            for row in mirror.flatness
        ]
        provenance["mirror"] = max(mirror.tilt_std)
    digest = hash_source(source)
    for name, uncertainty in provenance.items():
        note_provenance(section, [name], Provenance(day, source.name, digest, uncertainty))
    document.save(output, load_stage)
    return AssemblyResult(ring, mirror, len(recording.readings))


def assembly_text(result: AssemblyResult, output: Path) -> str:
    """What was found, in µm and arcsec."""
    ring, mirror = result.ring, result.mirror
    (x, y), (std_x, std_y) = ring.eccentricity, ring.eccentricity_std
    lines = [
        f"ring: eccentricity ({x * 1e6:.3f}, {y * 1e6:.3f}) µm, standard uncertainty ({std_x * 1e6:.4f}, "
        f"{std_y * 1e6:.4f}) µm, from {result.ticks} times; residual {ring.noise_ratio:.2f} times the noise"
    ]
    for row, std in zip(ring.graduation, ring.graduation_std, strict=True):
        lines.append(
            f"  graduation order {row.order}: {np.hypot(row.cos, row.sin) * ARCSEC:.3f} arcsec, standard uncertainty "
            f"{max(std) * ARCSEC:.4f}"
        )
    if ring.hidden_orders:
        lines.append(f"  orders that these heads cannot see: {', '.join(map(str, ring.hidden_orders))}")
    if mirror is None:
        lines.append("mirror: no autocollimator in the recording, left as it was")
    else:
        tilt_x, tilt_y = (value * ARCSEC for value in mirror.tilt)
        lines.append(
            f"mirror: tilt ({tilt_x:.3f}, {tilt_y:.3f}) arcsec, standard uncertainty "
            f"{max(mirror.tilt_std) * ARCSEC:.4f}; autocollimator {mirror.delay * 1e3:.3f} ms old; residual "
            f"{mirror.noise_ratio:.2f} times the noise"
        )
        for wave, deviation in zip(mirror.flatness, mirror.flatness_std, strict=True):
            size = np.sqrt(np.sum(np.square([*wave.x, *wave.y])) / 2)
            lines.append(
                f"  flatness order {wave.order}: {size * ARCSEC:.3f} arcsec, standard uncertainty "
                f"{deviation * ARCSEC:.4f}"
            )
    return "\n".join([*lines, f"written to {output}"])


def _joined(blocks: list[SampleBlock]) -> tuple[NDArray[np.int64], Array]:
    """Times and values of a stream; samples that are not after the one before are left out."""
    times = np.concatenate([block.times_ns for block in blocks])
    values = np.concatenate([block.rows[:, 1:] for block in blocks])
    newest = np.maximum.accumulate(times)
    fresh = np.concatenate([[True], times[1:] > newest[:-1]])
    return times[fresh], values[fresh]
