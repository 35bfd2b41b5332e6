"""What was found, into the stage file: in the form that a description has, with all else left as it is."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from datetime import date
from pathlib import Path
from typing import Any

import numpy as np

from rotary_error_monitor.bags.naming import THE_ONLY_CELL, Naming
from rotary_error_monitor.calibration.stage_document import in_file, kept_figures, set_value
from rotary_error_monitor.calibration.yaml_document import YamlDocument, hash_source, number
from rotary_error_monitor.calibration.yaml_text import YamlRows
from rotary_error_monitor.commissioning.bag_streams import read_streams
from rotary_error_monitor.commissioning.commission import Commissioning, commission
from rotary_error_monitor.commissioning.findings import is_louder
from rotary_error_monitor.commissioning.found import StatedReadings, UncertainValue
from rotary_error_monitor.description.provenance import Calibrated
from rotary_error_monitor.description.sections import locate
from rotary_error_monitor.description.stage import StageDescription, load_stage
from rotary_error_monitor.description.streams import AUTOCOLLIMATOR
from rotary_error_monitor.description.table_files import FLATNESS, GRADUATION
from rotary_error_monitor.description.two_axis_section import DISTORTIONS
from rotary_error_monitor.errors import InputError

MOVED = 2.0
"""Standard uncertainties by which a delay differs from what the file has before it is written."""

DIGITS = 2
"""Digits of a standard uncertainty that a value is written to."""


def commission_stage(
    bag: Path, stage_file: Path, naming: Naming = THE_ONLY_CELL
) -> tuple[StageDescription, Commissioning]:
    """The stage as a file describes it, and what a bag says of it.

    Raises:
        InputError: bag or file cannot be read, the stage has no heads, or the recording does not tell; it names the
            bag, or the file with its line.
    """
    stage = load_stage(stage_file)
    if stage.encoder is None:
        raise InputError(f"{stage_file}: the stage has no section 'encoder'; expected read heads to be commissioned")
    check_commissionable(stage, stage_file)
    recorded = read_streams(bag, stage, naming)
    try:
        return stage, commission(stage, stated_in(stage_file, stage.azimuths), recorded)
    except InputError as error:
        for place in (("encoder", "heads"), GRADUATION, FLATNESS):
            begin, _, what = str(error).partition(": ")
            if begin == ".".join(place):
                raise InputError(f"{locate(stage_file, ('stage', *place))}: {what}") from error
        raise InputError(f"{bag}: {error}") from error


def check_commissionable(stage: StageDescription, stage_file: Path) -> None:
    """Refuse what commissioning does not take into account.

    That is a gain of the command.

    Raises:
        InputError: the stage has one; the message names file and line.
    """
    if abs(stage.response("command").gain) != 1.0:
        gain = in_file(YamlDocument(stage_file, "stage"), ("command", "gain"))
        raise InputError(
            f"{locate(stage_file, ('stage', *gain))}: a gain of the command, which commissioning does not take into "
            "account; expected a command in rad of the stage: have its node turn it into that, and leave the gain out"
        )


def stated_in(stage_file: Path, letters: Iterable[str]) -> StatedReadings:
    """What a stage file states of signs and zeros, of the heads of these letters and of the command."""
    document = YamlDocument(stage_file, "stage")
    places = {f"head_{letter}": in_file(document, ("encoder", "heads", letter)) for letter in letters}
    rows = {name: document.get(*place) for name, place in places.items()}
    rows["command"] = document.get(*in_file(document, ("command",))) or {}
    return StatedReadings(
        frozenset(name for name, row in rows.items() if "sign" in row),
        frozenset(name for name, row in rows.items() if "zero" in row),
    )


def write_stage(
    stage: StageDescription, result: Commissioning, bag: Path, stage_file: Path, output: Path, day: date
) -> None:
    """The stage file with what was found; comments, and all that was not found, stay.

    Raises:
        InputError: the file cannot be changed or written, or what was found is beyond what a stage file may say.
    """
    document = YamlDocument(stage_file, "stage")
    digest = hash_source(bag)
    remark = "; ".join(finding.text for finding in result.findings if not finding.settled)
    parts = {
        "encoder": dict(_set_ring(document, stage, result)),
        "command": dict(_set_command(document, stage, result)),
        "autocollimator": dict(_set_autocollimator(document, stage, result)),
        "mirror": dict(_set_mirror(document, result)),
    }
    for part, figures in parts.items():
        if figures:
            # no uncertainty of the section: that would claim that eccentricity and the rotor's own motion were told
            document.note(part, Calibrated(day.isoformat(), bag.name, digest, None, figures, remark or None))
    document.save(output, load_stage, bag)


def rounded(value: UncertainValue) -> float:
    """The value to the digits that its uncertainty leaves."""
    if not 0 < value.std < math.inf:
        return number(value.value)
    places = DIGITS - 1 - math.floor(math.log10(value.std))
    return float(round(value.value, places))


Figures = Iterator[tuple[str, float]]


def _set_ring(document: YamlDocument, stage: StageDescription, result: Commissioning) -> Figures:
    found = result.found
    for letter, head in found.heads.items():
        before = stage.response(f"head_{letter}")
        place = ("encoder", "heads", letter)
        # with more digits than they are sure of: eccentricity and azimuths belong together
        set_value(document, "encoder", (*place, "azimuth"), number(_within_a_turn(head.azimuth.value)))
        yield f"{letter}.azimuth_uncertainty", head.azimuth.std
        set_value(document, "encoder", (*place, "zero"), rounded(head.zero))
        yield f"{letter}.zero_uncertainty", head.zero.std
        if head.sign != 1 or document.get(*in_file(document, (*place, "sign"))) is not None:
            set_value(document, "encoder", (*place, "sign"), head.sign)
        _set_latency(document, "encoder", (*place, "latency"), head.latency, before.latency)
        yield f"{letter}.latency_uncertainty", head.latency.std
    set_value(document, "encoder", ("encoder", "eccentricity"), [number(each.value) for each in found.eccentricity])
    yield "eccentricity_uncertainty", max(each.std for each in found.eccentricity)
    if found.graduation:
        told = {row.order for row, _ in found.graduation}
        kept = [{"order": r.order, "cos": r.cos, "sin": r.sin} for r in stage.ring.graduation if r.order not in told]
        rows = [
            {
                "order": row.order,
                "cos": rounded(UncertainValue(row.cos, std)),
                "sin": rounded(UncertainValue(row.sin, std)),
            }
            for row, std in found.graduation
        ]
        set_value(document, "encoder", ("encoder", "graduation"), YamlRows(sorted([*kept, *rows], key=_order)))
        yield "largest_graduation_uncertainty", max(std for _, std in found.graduation)
    noise = louder(stage, result, (f"head_{letter}" for letter in stage.azimuths))
    if noise is not None:
        set_value(document, "encoder", ("encoder", "noise"), number(noise))
    azimuth = max(head.azimuth.std for head in found.heads.values())
    set_value(document, "encoder", ("uncertainty", "encoder.azimuth"), number(azimuth))


def _within_a_turn(azimuth: float) -> float:
    """The azimuth where a stage file may state it: of a head that is described at 360° it may be found beyond."""
    return azimuth if abs(azimuth) < 2 * math.pi else math.remainder(azimuth, 2 * math.pi)


def _order(row: dict[str, Any]) -> int:
    return int(row["order"])


def louder(stage: StageDescription, result: Commissioning, streams: Iterable[str], gain: float = 1.0) -> float | None:
    """Largest noise, rad, before rounding of the streams that are noisier than described; None where none of them is.

    Noise is only raised: the few samples within which it shows do not see what is slow in it.

    Args:
        stage: as described.
        result: what the recording says.
        streams: of instruments that the file describes as one.
        gain: size of a reading per shown value, over which the file has their noise.
    """
    figures = {name: result.figures[name] for name in streams if name in result.figures}
    noisy = [max(each.noise) / gain for name, each in figures.items() if is_louder(stage, name, each)]
    if not noisy:
        return None
    instrument = stage.tilt_instrument if AUTOCOLLIMATOR in figures else stage.ring
    return float(np.sqrt(max(max(noisy) ** 2 - instrument.resolution**2 / 12, instrument.noise**2)))


def _set_command(document: YamlDocument, stage: StageDescription, result: Commissioning) -> Figures:
    command = result.found.command
    if command is None:
        return
    before = stage.response("command")
    if result.found.datum != "command":
        set_value(document, "command", ("command", "zero"), rounded(command.zero))
    if command.sign != 1 or document.get("command", "sign") is not None:
        set_value(document, "command", ("command", "sign"), command.sign)
    yield "zero_uncertainty", command.zero.std
    _set_latency(document, "command", ("command", "latency"), command.latency, before.latency)
    yield "latency_uncertainty", command.latency.std


def _set_autocollimator(document: YamlDocument, stage: StageDescription, result: Commissioning) -> Figures:
    tilt = result.found.tilt
    if tilt is None or tilt.mirrored:
        return
    before = stage.response(AUTOCOLLIMATOR)
    noise = louder(stage, result, [AUTOCOLLIMATOR], abs(tilt.gain if tilt.axes_told else before.gain))
    if noise is not None:
        set_value(document, "autocollimator", ("autocollimator", "noise"), number(noise))
    set_value(document, "autocollimator", ("autocollimator", "zero"), [rounded(each) for each in tilt.zero])
    yield "zero_uncertainty", max(each.std for each in tilt.zero)
    if tilt.axes_told and tilt.axes is not None:
        set_value(
            document, "autocollimator", ("autocollimator", "gain"), rounded(UncertainValue(tilt.gain, tilt.axes.std))
        )
        set_value(
            document, "autocollimator", ("autocollimator", "roll"), rounded(UncertainValue(tilt.roll, tilt.axes.std))
        )
        yield "gain_uncertainty", tilt.axes.std * abs(tilt.gain)
        yield "roll_uncertainty", tilt.axes.std
    _set_latency(document, "autocollimator", ("autocollimator", "latency"), tilt.latency, before.latency)
    yield "latency_uncertainty", tilt.latency.std
    yield from kept_figures(document, DISTORTIONS if tilt.axes_told else ("gain", "roll", *DISTORTIONS))


def _set_mirror(document: YamlDocument, result: Commissioning) -> Figures:
    tilt = result.found.tilt
    if tilt is None or tilt.mirrored:
        return
    values = [rounded(UncertainValue(each, tilt.tilt_std)) for each in tilt.tilt]
    set_value(document, "mirror", ("mirror", "tilt"), values)
    yield "tilt_uncertainty", tilt.tilt_std


def _set_latency(
    document: YamlDocument, part: str, place: tuple[str, ...], found: UncertainValue, before: float
) -> None:
    """A delay that differs from what the file has; none is negative."""
    value = max(0.0, rounded(found))
    if abs(found.value - before) > MOVED * found.std and value != before:
        set_value(document, part, place, value)
