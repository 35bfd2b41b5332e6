"""What a recording says of a newly built stage, in words, degrees, µm, arcsec and ms."""

from __future__ import annotations

import math
from collections.abc import Iterator

from rotary_error_monitor.commissioning.commission import Commissioning
from rotary_error_monitor.commissioning.findings import described_noise, spoken
from rotary_error_monitor.commissioning.found import FoundTilt, UncertainValue
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.units import ARCSEC


def commissioning_text(stage: StageDescription, result: Commissioning) -> str:
    """Everything: what is there, what is wrong, what was found, what the recording cannot tell."""
    lines = ["what is there:", *(f"  {each}" for each in stream_lines(stage, result))]
    lines += [f"note: {remark}" for remark in result.remarks]
    if result.findings:
        lines.append("what is wrong:")
        for finding in result.findings:
            lines.append(f"  {finding.text}" + (" (put right in the stage file)" if finding.settled else ""))
            if finding.advice:
                lines.append(f"    {finding.advice}")
    else:
        lines.append("nothing is wrong")
    lines += ["what was found (± standard uncertainty):", *(f"  {each}" for each in found_lines(result))]
    lines += ["what this recording cannot tell:", *(f"  {each}" for each in untold(stage, result))]
    return "\n".join(lines)


def stream_lines(stage: StageDescription, result: Commissioning) -> Iterator[str]:
    """What each stream is like."""
    for name, each in result.figures.items():
        line = f"{spoken(name)}: {each.samples} samples, {each.rate:.1f} Hz"
        described = described_noise(stage, name)
        if each.noise and described > 0:
            line += f", noise {max(each.noise) * ARCSEC:.3f} arcsec (described {described * ARCSEC:.3f})"
        line += f", stamps scatter by {each.jitter * 1e6:.1f} µs"
        line += f", {each.lost} samples lost" if each.lost else ", none lost"
        if each.disordered:
            line += f", {each.disordered} out of order or not finite"
        yield line


def stream_rows(stage: StageDescription, result: Commissioning) -> tuple[list[str], list[list[str]]]:
    """What each stream is like, as a table: its head with units, and a row each."""
    head = [
        "stream",
        "samples",
        "rate, Hz",
        "noise, arcsec",
        "described noise, arcsec",
        "scatter of stamps, µs",
        "lost",
    ]
    rows = []
    for name, each in result.figures.items():
        described = described_noise(stage, name)
        is_told = bool(each.noise) and described > 0
        noise = [f"{max(each.noise) * ARCSEC:.3f}", f"{described * ARCSEC:.3f}"] if is_told else ["–", "–"]
        row = [spoken(name), str(each.samples), f"{each.rate:.1f}", *noise, f"{each.jitter * 1e6:.1f}", str(each.lost)]
        rows.append([*row, str(each.disordered)])
    return [*head, "out of order or not finite"], rows


def head_rows(result: Commissioning) -> tuple[list[str], list[list[str]]]:
    """What was found of each head, as a table: its head with units, and a row each."""
    rows = [
        [
            letter,
            _shown(head.azimuth, math.degrees(1), ""),
            _shown(head.zero, math.degrees(1), ""),
            f"{head.sign:+d}",
            _shown(head.latency, 1e3, ""),
        ]
        for letter, head in result.found.heads.items()
    ]
    return ["head", "azimuth, °", "zero, °", "sign", "latency, ms"], rows


def found_lines(result: Commissioning, heads: bool = True) -> Iterator[str]:
    """What was found, each with its standard uncertainty; `heads`: of each head too."""
    found = result.found
    yield f"rotation counted from {spoken(found.datum)}"
    for letter, head in found.heads.items() if heads else ():
        yield (
            f"head {letter}: azimuth {_shown(head.azimuth, math.degrees(1), '°')}, zero "
            f"{_shown(head.zero, math.degrees(1), '°')}, sign {head.sign:+d}, latency "
            f"{_shown(head.latency, 1e3, ' ms')}"
        )
    if found.command is not None:
        command = found.command
        yield (
            f"command: zero {_shown(command.zero, math.degrees(1), '°')}, sign {command.sign:+d}, later than the "
            f"rotation by {_shown(command.latency, 1e3, ' ms')}"
        )
    x, y = found.eccentricity
    yield f"eccentricity of the ring: x {_shown(x, 1e6, ' µm')}, y {_shown(y, 1e6, ' µm')}"
    for row, std in found.graduation:
        size = UncertainValue(math.hypot(row.cos, row.sin), std)
        yield f"graduation order {row.order}: {_shown(size, ARCSEC, ' arcsec')}"
    if found.tilt is not None:
        yield from _tilt(found.tilt)


def _tilt(tilt: FoundTilt) -> Iterator[str]:
    x, y = tilt.zero
    yield (
        f"autocollimator: zero x {_shown(x, ARCSEC, ' arcsec')}, y {_shown(y, ARCSEC, ' arcsec')}, latency "
        f"{_shown(tilt.latency, 1e3, ' ms')}"
    )
    if tilt.axes is not None:
        yield (
            f"its gain {_shown(UncertainValue(tilt.gain, tilt.axes.std), 1, '')}, roll "
            f"{_shown(UncertainValue(tilt.roll, tilt.axes.std), math.degrees(1), '°')}"
            + ("" if tilt.axes_told else ", not sure enough to be written")
        )
    mirror = [UncertainValue(each, tilt.tilt_std) for each in tilt.tilt]
    yield f"tilt of the mirror: x {_shown(mirror[0], ARCSEC, ' arcsec')}, y {_shown(mirror[1], ARCSEC, ' arcsec')}"


def _shown(value: UncertainValue, scale: float, unit: str) -> str:
    std = value.std * scale
    places = max(0, 1 - math.floor(math.log10(std))) if 0 < std < math.inf else 6
    # + 0.0: no negative zero
    return f"{round(value.value * scale, places) + 0.0:.{places}f} ± {std:.{places}f}{unit}"


def untold(stage: StageDescription, result: Commissioning) -> Iterator[str]:
    """What stays as the file has it, or is a convention, because nothing in such a recording shows it."""
    found = result.found
    yield f"a zero common to all angles: the rotation is counted from {spoken(found.datum)}"
    if stage.ring.graduation_table is None:
        yield "a turn common to all azimuths: the direction of x is that of the described azimuths on average"
    else:
        yield "what the ring's measured curve is off by, which counts as described: azimuths are counted by it"
    yield "a delay common to all: the earliest of heads and autocollimator counts as in time"
    yield "eccentricity of the ring from what the rotor's own order 1 goes round with it, and both but over disc_radius"
    if found.hidden_orders:
        orders = ", ".join(map(str, found.hidden_orders))
        yield f"graduation of the orders {orders}: these heads see it as rotation or as error motion"
    if found.command is not None:
        yield "a lag of the drive from a delay of the command, and a constant following error from its zero"
    if found.tilt is not None:
        yield "tilt of the mirror from what the rotor's own order 1 goes round with it"
        if not found.tilt.axes_told:
            yield (
                "roll and gain of the autocollimator: a turn of it looks like another direction of the mirror's tilt, "
                "a gain like another size. State spindle.tilt with its uncertainty, or push at the shaft and state "
                "spindle.tilt_compliance with its uncertainty"
            )
