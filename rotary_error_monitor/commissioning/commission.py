"""From the streams of a recording to what a stage is like: what is there, what is wrong, what was found."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from rotary_error_monitor.commissioning.command import fit_command
from rotary_error_monitor.commissioning.findings import CommissioningFinding, findings_of, noise_and_step
from rotary_error_monitor.commissioning.found import Found, Shown, StatedReadings, known_hand, origin_of, parameters
from rotary_error_monitor.commissioning.heads import HeadAngles, angles_of, head_response
from rotary_error_monitor.commissioning.layouts import Signs, Weighed, alternatives, weigh_layouts
from rotary_error_monitor.commissioning.ring_model import RingPrior
from rotary_error_monitor.commissioning.stated_curves import (
    check_counted,
    check_mirror_curve,
    check_ring_curve,
    ring_curve,
)
from rotary_error_monitor.commissioning.streams import CommissioningRecording, RawStream, StreamFigures, describe_stream
from rotary_error_monitor.commissioning.tilt import fit_tilt, log_hand
from rotary_error_monitor.commissioning.units import AngleUnit, tilt_units
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.streams import AUTOCOLLIMATOR, COMMAND, FORCE
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.encoder_heads import LEAST_SEEN, seen_part

AZIMUTH = math.radians(2.0) / math.sqrt(3)
"""Standard uncertainty of azimuths of which the file states none, rad: heads are screwed on to within 2°."""

ECCENTRICITY = 1e-4
"""Prior standard deviation of a ring's eccentricity in each direction, m: rings are aligned by a dial gauge, or not."""

GRADUATION = 1e-5
"""Prior standard deviation of order 1 of the graduation, rad, of higher ones as much less: 2 arcsec of a good ring."""

APART = 0.05
"""Least angle, rad, between two heads that are told from one another: 3°, beyond how well azimuths are known."""


@dataclass(frozen=True)
class Commissioning:
    """What a recording says of a stage.

    Attributes:
        figures: what each stream is like, by its name.
        found: the parameters.
        findings: what is wrong.
        likeliest: where the heads stand, with the ring.
        others: what the recording does not tell from that.
        shown: what the instruments showed.
        remarks: what of the recording could not be read.
    """

    figures: Mapping[str, StreamFigures]
    found: Found
    findings: tuple[CommissioningFinding, ...]
    likeliest: Weighed
    others: tuple[Weighed, ...]
    shown: Shown
    remarks: tuple[str, ...]

    @property
    def settled(self) -> bool:
        """Whether all that is wrong is put right by the parameters."""
        return all(finding.settled for finding in self.findings)


def commission(stage: StageDescription, stated: StatedReadings, recorded: CommissioningRecording) -> Commissioning:
    """What a recording of a stage that turns both ways says of it, beyond what its data sheets say.

    Args:
        stage: as described; its heads are at least two, their azimuths apart.
        stated: what of it the file itself states.
        recorded: the raw streams.

    Raises:
        InputError: the stage stands still, moves less than a turn or one way only; streams do not overlap; a measured
            curve of ring or mirror is not what the instruments see.
    """
    check_azimuths(stage)
    check_counted(stage, COMMAND in recorded.streams or bool({*stated.zeros} - {COMMAND}))
    angular = [f"head_{letter}" for letter in stage.azimuths] + ([COMMAND] if COMMAND in recorded.streams else [])
    angles = angles_of(stage, {name: recorded.streams[name] for name in angular})
    figures = _figures(stage, recorded, angles)
    heads = head_response(stage, angles)
    command = fit_command(stage, angles, heads) if COMMAND in recorded.streams else None
    tilt, tilt_unit = None, None
    if stage.autocollimator is not None and AUTOCOLLIMATOR in recorded.streams:
        stream, tilt_unit = _in_radians(stage, recorded.streams[AUTOCOLLIMATOR], figures[AUTOCOLLIMATOR])
        if tilt_unit is not None:
            figures[AUTOCOLLIMATOR] = _figures_of(stage, AUTOCOLLIMATOR, stream, is_angle=False)
        plain = replace(stage, responses={})
        # that is calibrated by itself: no rotation tells it from what the rotor does
        stream = replace(stream, values=stage.response(AUTOCOLLIMATOR).undistorted(stream.values))
        tilt = fit_tilt(plain, angles, heads, stream, recorded.streams.get(FORCE))
    shown = Shown(angles, heads, command, tilt)
    azimuth = stage.uncertainty.get("encoder.azimuth", AZIMUTH)
    limits = stage.limits
    prior = RingPrior(stage.ring.disc_radius, ECCENTRICITY, limits.radial / 2, GRADUATION, azimuth)
    signs = Signs(
        tuple(angles.relative[name] for name in angular),
        tuple(int(np.sign(stage.response(name).gain)) for name in angular),
        tuple(name in stated.signs for name in angular),
    )
    known = known_hand(stage, stated, shown)
    hand = {} if tilt is None else log_hand(tilt, limits.tilt)
    handed = {way: each + known.get(way, 0.0) for way, each in hand.items()} or None
    described = np.array(list(stage.azimuths.values()))
    priors = _with_curve(stage, stated, shown, prior)
    weighed = weigh_layouts(heads.response, described, priors, signs, handed)
    others = alternatives(weighed)
    check_ring_curve((weighed[0], *others), heads.response, described, priors)
    found = parameters(stage, stated, shown, weighed[0].layout, weighed[0].fit, priors[weighed[0].layout.sense])
    if found.tilt is not None and found.tilt.axes is not None and not found.tilt.mirrored:
        check_mirror_curve(stage, found.tilt.axes.chi_square)
    findings = findings_of(stage, recorded, figures, shown, found, weighed[0], others, azimuth, tilt_unit)
    return Commissioning(figures, found, tuple(findings), weighed[0], others, shown, recorded.remarks)


def _with_curve(
    stage: StageDescription, stated: StatedReadings, shown: Shown, prior: RingPrior
) -> Mapping[int, RingPrior]:
    """What is known of the ring by the sense of the first head, with a graduation that was measured."""
    curves = {sense: ring_curve(stage, origin_of(stage, stated, shown, sense)) for sense in (1, -1)}
    return {
        sense: prior if each is None else replace(prior, curve=each[0], doubt=each[1]) for sense, each in curves.items()
    }


def _figures(stage: StageDescription, recorded: CommissioningRecording, angles: HeadAngles) -> dict[str, StreamFigures]:
    """Figures of all streams, those of angles in rad and without the wraps of a driver."""
    found = {}
    for name, stream in recorded.streams.items():
        if name in angles.streams:
            found[name] = _figures_of(stage, name, replace(stream, values=angles.streams[name][1]), is_angle=True)
        elif len(stream.times_ns) > 1:
            found[name] = _figures_of(stage, name, stream, is_angle=False)
    return found


def _figures_of(stage: StageDescription, name: str, stream: RawStream, *, is_angle: bool) -> StreamFigures:
    noise, step = noise_and_step(stage, name)
    return describe_stream(stream, is_angle=is_angle, noise=noise, step=step)


def check_azimuths(stage: StageDescription) -> None:
    """Hold that the heads can be told from one another.

    Raises:
        InputError: two stand at one azimuth, or all in such a way that no eccentricity shows.
    """
    letters, azimuths = list(stage.azimuths), np.array(list(stage.azimuths.values()))
    for i, first in enumerate(letters):
        for j in range(i):
            between = math.remainder(azimuths[i] - azimuths[j], 2 * math.pi)
            if abs(between) < APART:
                raise InputError(
                    f"encoder.heads: {letters[j]} and {first} stand {math.degrees(abs(between)):.2f}° apart, at one "
                    f"azimuth; expected at least {math.degrees(APART):.1f}°"
                )
    if seen_part(azimuths, 1) < LEAST_SEEN:
        raise InputError(f"encoder.heads: azimuths {azimuths.tolist()} rad show no eccentricity; expected some opposed")


def _in_radians(
    stage: StageDescription, stream: RawStream, figures: StreamFigures
) -> tuple[RawStream, AngleUnit | None]:
    """The autocollimator's stream in rad, and the unit that it seems to be in, None where it is rad.

    Readings beyond the described range are of another unit: of those in which they are within it the one in which the
    noise is most as it is described.
    """
    instrument = stage.tilt_instrument
    largest = float(np.abs(stream.values).max())
    if largest <= instrument.range * (1 + 1e-6):
        return stream, None
    fitting = [unit for unit in tilt_units() if largest / unit.size <= instrument.range * (1 + 1e-6)]
    expected = math.hypot(instrument.noise, instrument.resolution / math.sqrt(12))
    if not fitting or not figures.noise or expected == 0.0 or min(figures.noise) == 0.0:
        raise InputError(
            f"autocollimator: readings reach {largest:.4g}, but autocollimator.range is {instrument.range:g} rad; "
            "expected readings in rad, or the range of this instrument"
        )
    size = float(np.mean(figures.noise)) / expected
    unit = min(fitting, key=lambda each: abs(math.log(size / each.size)))
    return replace(stream, values=stream.values / unit.size), unit
