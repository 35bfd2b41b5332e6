"""Error motion values of a recording by direction, speed and height."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.analysis.hidden_orders import HiddenOrders
from rotary_error_monitor.analysis.runs import Segment, segments_of
from rotary_error_monitor.analysis.segment_turns import SegmentTurns
from rotary_error_monitor.analysis.signals import RADIAL, ROTATING, LongEstimates, SignalName
from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.metrology.circles import CENTRES, Centre, find_centre
from rotary_error_monitor.metrology.order_spectrum import OrderSpectrum, estimate_orders
from rotary_error_monitor.metrology.spindle_figures import ErrorMotionValue, SignalNoise, estimate_values, mean_noise
from rotary_error_monitor.metrology.turns import MOST_WAVES, SAMPLES_A_WAVE, TurnProfiles
from rotary_error_monitor.signals.rows import Keep, RowsInMemory
from rotary_error_monitor.units import TURN


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
        mean_noise: standard deviation of such a mean by the noise of the readings.
    """

    signal: str
    quantity: str
    direction: str
    height: float | None
    unit: str
    turns: int
    values: Mapping[str, ErrorMotionValue]
    centres: Mapping[str, Centre]
    spectrum: OrderSpectrum | None
    angles: Array
    synchronous: Array
    lowest: Array
    highest: Array
    means: Array
    middle_ns: NDArray[np.int64]
    mean_noise: float


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
    estimates: LongEstimates,
    stage: StageDescription,
    heights: Sequence[float],
    most_waves: int = MOST_WAVES,
    rate: float = math.inf,
    keep: Keep = RowsInMemory,
    progress: Callable[[float], None] = lambda share: None,
) -> tuple[SegmentFigures, ...]:
    """Figures of each direction and speed, in the order in which they began.

    Args:
        estimates: error motion over the recording.
        stage: as described.
        heights: above the ring at which radial error motion is told, m.
        most_waves: cut-off of the filter over the angle, waves a turn, at most.
        rate: samples a second (Hz) of the slowest sensor: what it does not resolve the estimates only interpolate.
        keep: where profiles of turns are kept.
        progress: is told which part of all segments is done.
    """
    segments = segments_of(estimates)
    whole = sum(segment.turned for segment in segments)
    found, done, hidden = [], 0.0, HiddenOrders(stage)
    for segment in segments:
        waves = int(min(most_waves, rate * TURN / abs(segment.speed) / SAMPLES_A_WAVE))
        found.append(_figures_of(segment, SegmentTurns(segment, estimates, stage, heights, waves, keep), hidden))
        done += segment.turned
        progress(done / whole)
    return tuple(found)


def _figures_of(segment: Segment, cut: SegmentTurns, hidden: HiddenOrders) -> SegmentFigures:
    figures: list[SignalFigures] = []
    remarks: list[str] = []
    shown: TurnProfiles | None = None
    # what is observable at the same times has the same turns
    for group in cut.groups():
        turns = group.turns
        remarks += [f"{group.quantity}: {text}" for text in _lacking(turns)]
        if turns is None or not turns.count:
            continue
        shown = turns
        for number, signal in enumerate(group.signals):
            figures.append(_figures(signal, turns, number, group.noise[number], hidden.of(signal, turns.cut_off)))
        if not cut.is_proven:
            remarks.append(f"{group.quantity}: {_UNPROVEN}")
    return SegmentFigures(
        segment.name,
        segment.speed,
        segment.steady,
        segment.turned / TURN,
        0.0 if shown is None else shown.samples,
        0 if shown is None else shown.cut_off,
        segment.begin_ns,
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
    count = turns.count
    if count == 0:
        more = f", and {turns.incomplete} in which samples are missing" if turns.incomplete else ""
        yield f"{turns.whole:.2g} turns{more}: no whole one, so no error motion value is told"
    elif count == 1:
        yield "one whole turn: what comes again in each turn is not told from what does not, no asynchronous value"
    if count and turns.incomplete:
        yield f"{turns.incomplete} whole turns in which samples are missing are left out"


def _figures(
    signal: SignalName, turns: TurnProfiles, number: int, noise: SignalNoise, hidden: Sequence[int]
) -> SignalFigures:
    summary = turns.summary(number)
    mean = summary.mean
    rotating = signal.direction == ROTATING
    return SignalFigures(
        signal.key,
        signal.quantity,
        signal.direction,
        signal.height,
        signal.unit,
        turns.count,
        estimate_values(turns, number, noise, keeps_fundamental=signal.keeps_fundamental),
        {name: find_centre(turns.angles, mean, name) for name in CENTRES} if signal.quantity == RADIAL else {},
        None if rotating else estimate_orders(turns, number, noise, hidden),
        turns.angles,
        mean,
        summary.lowest,
        summary.highest,
        np.concatenate([profiles.mean(axis=1) for profiles, _ in turns.parts(number)]),
        turns.labels.mean(axis=1).astype(np.int64),
        mean_noise(turns, number, summary.mean, noise.random),
    )
