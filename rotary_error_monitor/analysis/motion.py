"""Error motion values of a recording by direction, speed and height."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.analysis.runs import Segment, find_segments
from rotary_error_monitor.analysis.signals import RADIAL, ROTATING, Estimates, Signal, signals_of
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.metrology.circles import CENTRES, Centre, find_centre
from rotary_error_monitor.metrology.encoder_heads import HeadLayout
from rotary_error_monitor.metrology.order_spectrum import OrderSpectrum, estimate_orders, orders_like_radial
from rotary_error_monitor.metrology.spindle_figures import Value, estimate_values
from rotary_error_monitor.metrology.turns import MOST_WAVES, SAMPLES_A_WAVE, TURN, TurnProfiles, cut_turns

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SignalFigures:
    """What one signal of a segment shows.

    Attributes:
        signal: its key, such as `radial_rotating_at_16mm`.
        quantity: `radial`, `tilt` or `axial`.
        direction: `rotating`, `x`, `y` or `z`.
        height: above the ring, m; None where it does not matter.
        unit: of all its figures, `m` or `rad`.
        turns: whole turns that count.
        values: error motion values by name.
        centres: of the polar profile of its synchronous error motion, by `CENTRES`; radial motion alone.
        spectrum: of orders; None in a rotating direction, which mixes the orders.
        angles: (k,) rad, of the profiles.
        synchronous, lowest, highest: (k,) mean over the turns, smallest and largest of them.
        means: (n,) of each turn.
        middle_ns: (n,) timestamp (ns) of the middle of each turn.
        mean_uncertainty: standard uncertainty of such a mean by the estimate's random part.
    """

    signal: str
    quantity: str
    direction: str
    height: float | None
    unit: str
    turns: int
    values: Mapping[str, Value]
    centres: Mapping[str, Centre]
    spectrum: OrderSpectrum | None
    angles: Array
    synchronous: Array
    lowest: Array
    highest: Array
    means: Array
    middle_ns: NDArray[np.int64]
    mean_uncertainty: float


@dataclass(frozen=True)
class SegmentFigures:
    """One direction at one speed.

    Attributes:
        name: such as `forward 1.571 rad/s`.
        speed: with its sign, rad/s.
        steady: whether it is constant.
        turned: how many turns were made, parts of a turn too.
        samples: estimates a turn.
        cut_off: of the filter over the angle, waves a turn; 0 where there is no profile.
        begin_ns: timestamp (ns) of its first sample.
        signals: figures of each.
        remarks: what is not told, and why.
    """

    name: str
    speed: float
    steady: bool
    turned: float
    samples: float
    cut_off: int
    begin_ns: int
    signals: tuple[SignalFigures, ...]
    remarks: tuple[str, ...]

    @property
    def bandwidth(self) -> float:
        """Frequency at which half of the amplitude is left, Hz."""
        return self.cut_off * abs(self.speed) / TURN


def analyse_motion(
    estimates: Estimates,
    stage: StageDescription,
    heights: Sequence[float],
    most_waves: int = MOST_WAVES,
    rate: float = math.inf,
) -> tuple[SegmentFigures, ...]:
    """Figures of each direction and speed, in the order in which they began.

    Args:
        estimates: error motion over the recording.
        stage: as described.
        heights: above the ring at which radial error motion is told, m.
        most_waves: cut-off of the filter over the angle, waves a turn, at most.
        rate: samples a second (Hz) of the slowest sensor: what it does not resolve the estimates only interpolate.
    """
    segments = find_segments(estimates.stamp_ns, estimates.theta)
    waves = [min(most_waves, rate * TURN / abs(segment.speed) / SAMPLES_A_WAVE) for segment in segments]
    return tuple(_segment(each, estimates, stage, heights, int(w)) for each, w in zip(segments, waves, strict=True))


def _segment(
    segment: Segment, estimates: Estimates, stage: StageDescription, heights: Sequence[float], most_waves: int
) -> SegmentFigures:
    rows = np.concatenate([np.arange(first, last) for first, last in segment.runs])
    ends = np.cumsum([last - first for first, last in segment.runs]).tolist()
    runs = list(zip([0, *ends[:-1]], ends, strict=True))
    theta, stamps = estimates.theta[rows], estimates.stamp_ns[rows]
    turned = sum(abs(float(theta[last - 1] - theta[first])) for first, last in runs) / TURN
    figures: list[SignalFigures] = []
    remarks: list[str] = []
    shown = TurnProfiles.none()
    signals = signals_of(estimates, stage, heights, rows)
    # what is observable at the same times has the same turns
    for quantity, same in groupby(signals, key=lambda signal: (signal.quantity, bool(signal.height))):
        group = list(same)
        turns = cut_turns(theta, np.stack([signal.values for signal in group], axis=1), runs, most_waves)
        remarks += [f"{quantity[0]}: {text}" for text in _lacking(turns)]
        if turns is None or not len(turns.profiles):
            continue
        shown = turns
        proven = estimates.proven[rows]
        hidden = _hidden(stage, turns.cut_off)
        for number, signal in enumerate(group):
            figures.append(_figures(signal, turns, number, hidden if signal.quantity == RADIAL else (), proven, stamps))
        if not proven.any():
            remarks.append(f"{quantity[0]}: {_UNPROVEN}")
    return SegmentFigures(
        segment.name,
        segment.speed,
        segment.steady,
        turned,
        shown.samples,
        shown.cut_off,
        int(stamps[0]),
        tuple(figures),
        tuple(dict.fromkeys(remarks)),
    )


_UNPROVEN = (
    "until its end no whole turn had shown that the description fits the stage, so that uncertainties are as large as "
    "the stage's limits"
)


def _lacking(turns: TurnProfiles | None) -> Iterator[str]:
    """What of the figures is not told, and why."""
    if turns is None:
        yield "too few samples a turn: no error motion value is told"
        return
    count = len(turns.profiles)
    if count == 0:
        more = f", and {turns.incomplete} in which samples are missing" if turns.incomplete else ""
        yield f"{turns.whole:.2g} turns{more}: no whole one, so no error motion value is told"
    elif count == 1:
        yield "one whole turn: what comes again in each turn is not told from what does not, no asynchronous value"
    if count and turns.incomplete:
        yield f"{turns.incomplete} whole turns in which samples are missing are left out"


def _hidden(stage: StageDescription, highest: int) -> tuple[int, ...]:
    azimuths = tuple(stage.azimuths.values())
    return orders_like_radial(HeadLayout(azimuths), highest) if azimuths else ()


def _figures(
    signal: Signal,
    turns: TurnProfiles,
    number: int,
    hidden: Sequence[int],
    proven: NDArray[np.bool_],
    stamps: NDArray[np.int64],
) -> SignalFigures:
    inside = np.zeros(len(stamps), np.bool_)
    for first, last in turns.rows:
        inside[first : last + 1] = True
    inside &= np.isfinite(signal.values)
    noise = signal.noise(inside & proven if (inside & proven).any() else inside)
    profiles = turns.profiles[:, :, number]
    mean = profiles.mean(axis=0)
    rotating = signal.direction == ROTATING
    return SignalFigures(
        signal.key,
        signal.quantity,
        signal.direction,
        signal.height,
        signal.unit,
        len(profiles),
        estimate_values(turns, number, noise, keeps_fundamental=signal.keeps_fundamental),
        {name: find_centre(turns.angles, mean, name) for name in CENTRES} if signal.quantity == RADIAL else {},
        None if rotating else estimate_orders(turns, number, noise, hidden),
        turns.angles,
        mean,
        profiles.min(axis=0),
        profiles.max(axis=0),
        profiles.mean(axis=1),
        stamps[turns.rows].mean(axis=1).astype(np.int64),
        noise.random / math.sqrt(turns.samples),
    )
