"""What is wrong with a stage as it is described and plugged, said as a person would say it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rotary_error_monitor.commissioning.found import Found, FoundTilt, Shown
from rotary_error_monitor.commissioning.layouts import Layout, Weighed
from rotary_error_monitor.commissioning.streams import CommissioningRecording, StreamFigures
from rotary_error_monitor.commissioning.units import RADIAN, AngleUnit
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.streams import COMMAND, OWN_REFERENCE, REFERENCE_TITLE
from rotary_error_monitor.metrology.distributions import chi_square_tail
from rotary_error_monitor.units import ANGLE_UNITS

SIGMAS = 4.0
"""Standard uncertainties from which a parameter differs from what is described."""

LEAST_TURN = math.radians(1.0)
"""Turn of an instrument, rad, from which it is said: less is what one sets up by eye."""

LEAST_GAIN = 0.005
"""Departure of a gain from what is described from which it is said: a linear instrument's accuracy class."""

UNSURE = 1e-3
"""Standard uncertainty of a head's zero, rad, from which the heads do not agree: as much as an eccentricity of 0.1 mm
makes of a reading at a radius of 0.1 m, and a thousand times what a turn each way leaves of it."""

MISFIT = 1e-6
"""Probability below which the heads do not fit a ring: it costs a file, and chance must not."""

LOUD = 1.3
"""Times the described noise from which an instrument is louder than described: as far as noise of one make scatters."""

LOSS = 0.02
"""Part of a stream's samples that may be lost; more is a network or a computer that is too slow."""

DRIFT = 1e-6
"""Relative drift of a stream's clock from which it is said: 1 ppm is what a disciplined clock keeps."""

VERY_LATE = 0.02
"""Delay of an instrument, s, from which it is said: samples as far apart are not joined either, by default."""


@dataclass(frozen=True)
class CommissioningFinding:
    """Something that is wrong.

    Attributes:
        text: what, in a sentence without a full stop.
        settled: whether the stage file that is written is right all the same.
        advice: what to do where it is not.
    """

    text: str
    settled: bool
    advice: str = ""


def findings_of(
    stage: StageDescription,
    recorded: CommissioningRecording,
    figures: Mapping[str, StreamFigures],
    shown: Shown,
    found: Found,
    likeliest: Weighed,
    others: Sequence[Weighed],
    azimuth_std: float,
    tilt_unit: AngleUnit | None,
) -> Iterator[CommissioningFinding]:
    """All that is wrong, in the order in which one would put it right."""
    for name in recorded.missing:
        yield CommissioningFinding(
            f"{spoken(name)}: no samples",
            settled=False,
            advice=f"start its node and record again, or take '{name}' out of the stage file",
        )
    yield from _units(shown, tilt_unit)
    yield from _streams(stage, figures)
    letters = list(stage.azimuths)
    if others:
        yield _undecided(letters, likeliest, others)
    else:
        yield from _layout(letters, likeliest.layout)
        yield from _signs(stage, found)
    yield from _agreement(found)
    square, count = likeliest.fit.chi_square
    if chi_square_tail(square, count) < MISFIT:
        yield CommissioningFinding(
            f"the heads do not fit a ring at these azimuths: what is left is {math.sqrt(square / count):.1f} times "
            "the noise",
            settled=False,
            advice="check azimuths and disc_radius, and that all heads look at the same ring",
        )
    yield from _azimuths(stage, found, likeliest.layout, azimuth_std)
    yield from _clocks(stage, found)
    yield from _latencies(found)
    # where the hand is among what is not told apart it has been said
    if found.tilt is not None and all(each.layout.mirrored == found.tilt.mirrored for each in others):
        yield from _tilt(stage, found.tilt)


def spoken(stream: str) -> str:
    """A stream's name as one says it."""
    kind, _, letter = stream.partition("_")
    title = REFERENCE_TITLE if stream == OWN_REFERENCE else stream.replace("_", " ")
    return f"head {letter}" if kind == "head" else title


def listed(names: Sequence[str]) -> str:
    """Names with commas and an `and`."""
    return " and ".join([*filter(None, [", ".join(names[:-1])]), names[-1]]) if names else ""


def _units(shown: Shown, tilt_unit: AngleUnit | None) -> Iterator[CommissioningFinding]:
    for name, unit in shown.angles.unit.items():
        if unit == RADIAN:
            continue
        words = unit.words if unit is not None else f"{shown.angles.factor[name]:.4g} times the angle"
        text = f"command is in {words}" if name == COMMAND and unit is not None else f"{spoken(name)} reads {words}"
        yield CommissioningFinding(text, settled=False, advice=_unit_advice(name, unit))
    if tilt_unit is not None:
        advice = _unit_advice("autocollimator", tilt_unit)
        yield CommissioningFinding(f"autocollimator reads {tilt_unit.words}", settled=False, advice=advice)


def _unit_advice(name: str, unit: AngleUnit | None) -> str:
    """No setting of the stage file changes a unit: it is the driver's, or the device's."""
    source = "vector3" if name == "autocollimator" else "joint_state"
    node = {COMMAND: "stage_command"}.get(name, name.replace("head_", "encoder_head_"))
    here = ""
    if unit is not None and unit.name in ANGLE_UNITS:
        here = f", or {node} (of source {source}) to `{source}: {{unit: {unit.name}}}`"
    if name == "autocollimator":
        return f"set its driver to rad{here} (of source iio: iio.sensitivity), or convert in the device's class"
    counts = "" if name == COMMAND else " (of source counter: lines_per_revolution and counts_per_line)"
    return f"set its driver to rad{here}{counts}, or convert in the device's class (doc/devices.md)"


def _streams(stage: StageDescription, figures: Mapping[str, StreamFigures]) -> Iterator[CommissioningFinding]:
    for name, each in figures.items():
        part = each.lost / max(1, each.samples + each.lost)
        if part > LOSS:
            yield CommissioningFinding(
                f"{spoken(name)} lost {part:.1%} of its samples",
                settled=False,
                advice="look at network and load of the computer, and record again",
            )
        if is_louder(stage, name, each):
            found, described = (f"{1e6 * size:.3g}" for size in (max(each.noise), described_noise(stage, name)))
            sizes = f"{found} µrad against {described} µrad"
            yield CommissioningFinding(f"{spoken(name)} is noisier than described: {sizes}", True)


def is_louder(stage: StageDescription, stream: str, figures: StreamFigures) -> bool:
    """Whether an instrument is noisier than described, by more than those of one make scatter and than chance."""
    described = described_noise(stage, stream)
    if described <= 0.0 or not figures.noise:
        return False
    more = max(figures.noise) - described
    return more > (LOUD - 1.0) * described and more > SIGMAS * max(figures.noise_std)


def described_noise(stage: StageDescription, stream: str) -> float:
    """Standard deviation of a reading with its rounding, rad, as described; 0 where nothing is."""
    noise, step = noise_and_step(stage, stream)
    return math.hypot(noise, step / math.sqrt(12))


def noise_and_step(stage: StageDescription, stream: str) -> tuple[float, float]:
    """Standard deviation of a reading before rounding, and step to which it is rounded, rad, as described; else 0."""
    if stream.startswith("head_"):
        return stage.ring.noise, stage.ring.resolution
    if stream == "autocollimator" and stage.autocollimator is not None:
        size = abs(stage.response(stream).gain)
        return size * stage.autocollimator.noise, size * stage.autocollimator.resolution
    return 0.0, 0.0


def _agreement(found: Found) -> Iterator[CommissioningFinding]:
    unsure = [letter for letter, head in found.heads.items() if not head.zero.std < UNSURE]
    if unsure:
        worst = max(math.degrees(found.heads[letter].zero.std) for letter in unsure)
        heads = f"head {unsure[0]}" if len(unsure) == 1 else f"heads {listed(unsure)}"
        yield CommissioningFinding(
            f"{heads} jump against the others: zero uncertain to {worst:.2g}°",
            settled=False,
            advice="samples are lost while the stage moves, or a driver starts again at something else than a turn, as "
            "in degrees: look at units and losses, turn more slowly, and record again",
        )


def _layout(letters: Sequence[str], layout: Layout) -> Iterator[CommissioningFinding]:
    said: set[int] = set()
    for i in layout.moved:
        if i in said:
            continue
        cycle = [i]
        while layout.places[cycle[-1]] != i:
            cycle.append(layout.places[cycle[-1]])
        said |= set(cycle)
        names = listed(sorted(letters[k] for k in cycle))
        if len(cycle) == 2:
            yield CommissioningFinding(f"heads {names} are swapped", True)
        else:
            places = ", ".join(f"{letters[k]} where {letters[layout.places[k]]} is described" for k in cycle)
            yield CommissioningFinding(f"heads {names} stand at one another's places: {places}", True)


def _signs(stage: StageDescription, found: Found) -> Iterator[CommissioningFinding]:
    for letter, head in found.heads.items():
        if head.sign != _sign(stage, f"head_{letter}"):
            yield CommissioningFinding(f"head {letter} counts the other way", True)
    if found.command is not None and found.command.sign != _sign(stage, COMMAND):
        yield CommissioningFinding("command counts the other way", True)


def _sign(stage: StageDescription, stream: str) -> int:
    return 1 if stage.response(stream).gain > 0 else -1


def _undecided(letters: Sequence[str], likeliest: Weighed, others: Sequence[Weighed]) -> CommissioningFinding:
    ways = dict.fromkeys(_said(letters, each.layout, likeliest.layout) for each in (likeliest, *others))
    return CommissioningFinding(
        "not told apart: " + "; or ".join(ways),
        settled=False,
        advice="these differ by nothing that was recorded. State `command: {sign: …}` if you know which way the "
        "controller counts about +z; where heads are swapped, put the azimuths right in the stage file and run again",
    )


def _said(letters: Sequence[str], layout: Layout, likeliest: Layout) -> str:
    parts = [finding.text for finding in _layout(letters, layout)] or ["no heads are swapped"]
    if layout.sense != likeliest.sense:
        parts.append("all heads and the command count the other way than in the first case")
    if layout.mirrored:
        parts.append("the autocollimator's axes are of the wrong hand")
    return " and ".join(parts)


def _azimuths(
    stage: StageDescription, found: Found, layout: Layout, azimuth_std: float
) -> Iterator[CommissioningFinding]:
    described = list(stage.azimuths.values())
    for (letter, head), place in zip(found.heads.items(), layout.places, strict=True):
        off = head.azimuth.value - described[place]
        if abs(off) > SIGMAS * azimuth_std and abs(off) > SIGMAS * head.azimuth.std:
            yield CommissioningFinding(
                f"head {letter} stands at {math.degrees(head.azimuth.value):.2f}°, not at "
                f"{math.degrees(described[place]):.2f}°",
                True,
            )


def _clocks(stage: StageDescription, found: Found) -> Iterator[CommissioningFinding]:
    streams = [(f"head {letter}", head.scale) for letter, head in found.heads.items()]
    if found.command is not None:
        streams.append(("command", found.command.scale))
    for name, scale in streams:
        if abs(scale.value) > max(SIGMAS * scale.std, DRIFT):
            yield CommissioningFinding(
                f"{name} goes {scale.value * 1e6:+.1f} ppm faster than the other heads: its clock drifts, or its "
                "angle is off by as much",
                settled=False,
                advice="discipline the clocks (PTP), or mend the number of counts of its driver",
            )
    if found.command is not None:
        lag, limit = found.command.latency, stage.limits.latency
        if lag.value < -max(SIGMAS * lag.std, limit):
            yield CommissioningFinding(
                f"the rotation follows its command by {-lag.value * 1e3:.3f} ms, more than limits.latency of "
                f"{limit * 1e3:g} ms: the drive lags, or all heads are stamped late, which is not told",
                settled=False,
                advice="state the lag in limits.latency if it is the drive's, or a latency of all heads",
            )


def _latencies(found: Found) -> Iterator[CommissioningFinding]:
    """Instruments that are very late: what they read is put right, how old every estimate is by them cannot be."""
    streams = [(f"head {letter}", head.latency) for letter, head in found.heads.items()]
    streams += [("command", found.command.latency)] if found.command is not None else []
    streams += [("autocollimator", found.tilt.latency)] if found.tilt is not None else []
    for name, late in streams:
        if late.value > max(SIGMAS * late.std, VERY_LATE):
            yield CommissioningFinding(
                f"{name} is stamped {late.value * 1e3:.3g} ms later than the earliest instrument: every estimate waits "
                "as long for it; does its driver stamp when it hands on instead of when it measures?",
                settled=True,
            )


def _tilt(stage: StageDescription, tilt: FoundTilt) -> Iterator[CommissioningFinding]:
    if tilt.mirrored:
        yield CommissioningFinding(
            _wrong_hand(tilt),
            settled=False,
            advice="no setting of the stage file mirrors: set its driver (of source iio: the order of iio.channels; of "
            "another, the signs of tilt_x and tilt_y)",
        )
        return
    if tilt.axes is not None and chi_square_tail(*tilt.axes.chi_square) < MISFIT:
        yield CommissioningFinding(
            "the tilt that the stage file states is not what the autocollimator shows",
            settled=False,
            advice="is the rotation counted from where spindle.tilt was measured? State the zero of the command, or "
            "leave out uncertainty of spindle.tilt and spindle.tilt_compliance",
        )
        return
    if not tilt.axes_told or tilt.axes is None:
        return
    before = stage.response("autocollimator")
    turn = math.remainder(tilt.roll - before.roll, 2 * math.pi)
    if abs(turn) > max(LEAST_TURN, SIGMAS * tilt.axes.std):
        yield CommissioningFinding(f"the autocollimator is mounted turned by {math.degrees(turn):.1f}°", True)
    if abs(tilt.gain / before.gain - 1) > max(LEAST_GAIN, SIGMAS * tilt.axes.std):
        yield CommissioningFinding(f"the autocollimator's gain is {tilt.gain:.4f}, not {before.gain:g}", True)


_HANDS: Sequence[tuple[float, str]] = (
    (0.0, "the autocollimator's y is reversed"),
    (math.pi, "the autocollimator's x is reversed"),
    (math.pi / 2, "the autocollimator's axes are swapped"),
    (-math.pi / 2, "the autocollimator's axes are swapped and both reversed"),
)


def _wrong_hand(tilt: FoundTilt) -> str:
    """Which axes are wrong, where an independent tilt tells it."""
    if tilt.axes is None or tilt.axes.std > math.radians(10.0):
        return "the autocollimator's axes are of the wrong hand: one of them is reversed, or both are swapped"
    angle = float(np.angle(tilt.axes.response))
    off, text = min(((math.remainder(angle - turn, 2 * math.pi), text) for turn, text in _HANDS), key=_size)
    if abs(off) > max(LEAST_TURN, SIGMAS * tilt.axes.std):
        text += f", and it is mounted turned by {math.degrees(off):.1f}°"
    return text


def _size(pair: tuple[float, str]) -> float:
    return abs(pair[0])
