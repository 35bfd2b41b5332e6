"""What commissioning says of a stage of the independent world, held against how the stage was built."""

from __future__ import annotations

import cmath
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from described_stages import stage_of
from world.newly_built import NewlyBuilt
from world.recording import AUTOCOLLIMATOR, COMMAND, Recording, head_topic

from rotary_error_monitor.commissioning.commission import Commissioning, commission
from rotary_error_monitor.commissioning.found import StatedReadings, UncertainValue
from rotary_error_monitor.commissioning.streams import CommissioningRecording, join_blocks

LOUD = "is noisier than described"
LAGS = "the rotation follows its command"
TURN = 2 * np.pi


@dataclass(frozen=True)
class Judged:
    """One stage.

    Attributes:
        result: of commissioning.
        expected: what is wrong with the stage beside its noise, as it should be said.
        named: what was said beside noise.
        told: whether the layout was told; it need not be where it is symmetric.
        listed: whether the true layout is the likeliest, or among those that are not told from it.
        off: of each parameter how far it is off the truth, in standard uncertainties.
        falsely_loud: streams that are called noisy and are not.
    """

    result: Commissioning
    expected: frozenset[str]
    named: frozenset[str]
    told: bool
    listed: bool
    off: dict[str, float]
    falsely_loud: tuple[str, ...]


def judge(
    built: NewlyBuilt,
    change: Callable[[Recording], Recording] | None = None,
    expected: frozenset[str] = frozenset(),
    mirrored: bool = False,
) -> Judged:
    """Commission a stage whose recording went through `change`, by which `expected` is said beside what is built."""
    stage = stage_of(built.nominal)
    recording = built.recording if change is None else change(built.recording)
    streams = {
        topic.split("/")[2]: join_blocks(blocks, blocks[0].names[1:]) for topic, blocks in recording.blocks.items()
    }
    stated = StatedReadings(frozenset({"command"} if "sign" in built.nominal.get("command", {}) else ()))
    result = commission(stage, stated, CommissioningRecording(streams))
    named = [finding.text for finding in result.findings]
    heads = built.true["encoder"]["heads"]
    letters = list(heads)
    truly = _layout(built), heads[letters[0]]["sign"], mirrored
    possible = [
        (each.layout.places, each.layout.sense, each.layout.mirrored) for each in (result.likeliest, *result.others)
    ]
    right = truly == possible[0]
    return Judged(
        result,
        expected | _built_wrong(built),
        frozenset(
            text
            for text in named
            if LOUD not in text and not text.startswith(("not told apart", LAGS if _lags(built) else "not told apart"))
        ),
        not result.others,
        truly in possible,
        _off(built, result) if right else {},
        tuple(text for text in named if LOUD in text and not _is_loud(built, text)),
    )


def _lags(built: NewlyBuilt) -> bool:
    """Whether all heads are stamped later than the command by more than is described."""
    late = [head["latency"] for head in built.true["encoder"]["heads"].values()]
    return bool(min(late) - built.true["command"]["latency"] > 2.9e-4)


def _layout(built: NewlyBuilt) -> tuple[int, ...]:
    letters = list(built.true["encoder"]["heads"])
    places = list(range(len(letters)))
    if built.swapped:
        i, j = (letters.index(each) for each in built.swapped)
        places[i], places[j] = places[j], places[i]
    return tuple(places)


def _built_wrong(built: NewlyBuilt) -> frozenset[str]:
    said = {
        f"head {letter} counts the other way"
        for letter, head in built.true["encoder"]["heads"].items()
        if head["sign"] != 1
    }
    if built.swapped:
        said.add(f"heads {built.swapped[0]} and {built.swapped[1]} are swapped")
    if built.true["command"]["sign"] != built.nominal.get("command", {}).get("sign", 1):
        said.add("command counts the other way")
    return frozenset(said)


def _is_loud(built: NewlyBuilt, text: str) -> bool:
    """Whether the instrument has 1.15 times the noise that is described, by its own; noise has any shape."""
    return built.noise > 1.15 or ("autocollimator" in text and built.true["autocollimator"]["gain"] > 1.3)


def _off(built: NewlyBuilt, result: Commissioning) -> dict[str, float]:
    heads, found = built.true["encoder"]["heads"], result.found
    letters = list(heads)
    clock = built.recording.drawn["streams"]
    late = np.array([heads[letter]["latency"] + clock[head_topic(letter)]["offset"] for letter in letters])
    own = built.true["autocollimator"]
    tilt_late = own["latency"] + clock[AUTOCOLLIMATOR]["offset"]
    # what all are late by is convention
    first = late.mean() - np.mean([found.heads[letter].latency.value for letter in letters])
    off: dict[str, float] = {}
    spread = np.array([found.heads[letter].zero.value * found.heads[letter].sign for letter in letters])
    true = np.array([heads[letter]["zero"] * heads[letter]["sign"] for letter in letters])
    apart = np.angle(np.exp(1j * ((spread - spread[0]) - (true - true[0]))))
    azimuths = np.array([found.heads[letter].azimuth.value for letter in letters])
    at = azimuths - np.array([heads[letter]["azimuth"] for letter in letters])
    at = at - TURN * np.rint(at / TURN)
    for i, letter in enumerate(letters):
        head = found.heads[letter]
        off[f"{letter} zero"] = float(apart[i] - apart.mean()) / head.zero.std
        off[f"{letter} latency"] = _sigmas(head.latency, float(late[i] - first))
        off[f"{letter} azimuth"] = float(at[i] - at.mean()) / head.azimuth.std
    if found.command is not None:
        true_late = built.true["command"]["latency"] + clock[COMMAND]["offset"]
        off["command latency"] = _sigmas(found.command.latency, float(true_late - first))
    counted = built.true["command"]["sign"] * (
        built.true["command"]["zero"] - built.nominal.get("command", {}).get("zero", 0.0)
    )
    seen = complex(*built.true["encoder"]["eccentricity"]) + _first(built, "radial")
    seen *= cmath.exp(1j * (at.mean() - counted))
    for value, part, name in zip(found.eccentricity, (seen.real, seen.imag), "xy", strict=True):
        off[f"eccentricity {name}"] = (value.value - part) / value.std
    if found.tilt is not None and not found.tilt.mirrored:
        gain = own["gain"] * cmath.exp(1j * own["roll"])
        off["tilt latency"] = _sigmas(found.tilt.latency, float(tilt_late - first))
        for value, zero, name in zip(found.tilt.zero, own["zero"], "xy", strict=True):
            off[f"tilt zero {name}"] = _sigmas(value, zero)
        # what the mirror shows is surer than how it is shared between instrument, mirror and a curve that is stated
        curve = sum(_turning(row) for row in built.true["mirror"].get("flatness", ()) if row["order"] == 1)
        tilt = complex(*built.true["mirror"]["tilt"]) + _first(built, "tilt")
        shown = gain * (tilt + curve) * cmath.exp(-1j * counted)
        stated = curve if "flatness_table" in built.nominal.get("mirror", {}) else 0.0
        read = complex(*found.tilt.tilt) + stated * cmath.exp(-1j * counted)
        read *= found.tilt.gain * cmath.exp(1j * found.tilt.roll)
        std = np.hypot(found.tilt.tilt_std, found.tilt.latency.std * 2.0 * abs(shown))
        off["mirror"] = abs(read - shown) / std / np.sqrt(2)
        if found.tilt.axes_told and found.tilt.axes is not None:
            apart_by = found.tilt.axes.response / gain - 1
            off["gain"], off["roll"] = (each / found.tilt.axes.std for each in (apart_by.real, apart_by.imag))
    return off


def _first(built: NewlyBuilt, kind: str) -> complex:
    """What of the rotor's order 1 goes round with it, and so with what is mounted on it."""
    row = built.true["spindle"][kind][0]
    assert row["order"] == 1
    return _turning(row)


def _turning(row: Mapping[str, Any]) -> complex:
    """What of a row of order 1 turns with the rotor."""
    return 0.5 * complex(row["x"][0] + row["y"][1], row["y"][0] - row["x"][1])


def _sigmas(value: UncertainValue, truth: float) -> float:
    return (value.value - truth) / value.std
