"""Pictures of a verification: monitor and reference over angle and over time (Lou et al. 2019, Figures 13 to 15)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from matplotlib.axes import Axes

from rotary_error_monitor.analysis.verification_result import ReferenceComparison, TurningComparison, Verification
from rotary_error_monitor.arrays import Array
from rotary_error_monitor.report.drawing import WIDE, Sketch, drawn, go_round, in_rows, label, new_axes, tiled
from rotary_error_monitor.report.drawn import Drawn
from rotary_error_monitor.report.palette import BLACK, GREY, ORANGE, colour
from rotary_error_monitor.units import MICRO

_HEIGHT = 2.7
"""Of a picture, inches."""

_COLUMNS = 2
"""Pictures side by side in the one PNG of all: x and y of the same."""

_MOST_POINTS = 4000
"""Of a line over time: more are drawn over one another. Of each stretch its smallest and largest stay."""

_DEGREES = 180 / np.pi
_BOUND, _MOST = "95 % bound of one difference", "limit of the mean, RMS"

_GAP = 1.0
"""Time without a difference over which no line is drawn, s."""

_BEYOND = 2.0
"""Times the largest difference from which a bound is not shown to its end: it would press the line together."""


def draw(found: Verification) -> list[list[Drawn]]:
    """Pictures of each comparison: of each kind, one for each direction of the reference."""
    begin = found.span_ns[0]
    return [
        [drawn(*sketch) for kind in (_over_angle, _angle_differences) for sketch in kind(each)]
        + [drawn(*sketch) for sketch in (*_over_time(each, begin), *_time_differences(each, begin))]
        for each in found.comparisons
    ]


def joined(pictures: Sequence[Sequence[Drawn]]) -> bytes:
    """One PNG of all."""
    return tiled([row for each in pictures for row in in_rows(each, _COLUMNS)])


def _over_angle(each: ReferenceComparison) -> Iterator[Sketch]:
    """Radial error motion over the angle, the mean over the turns: reference and monitor, a pair for each direction."""
    shown = _longest(each)
    for axis, name in enumerate(each.axes):
        names = [f"{who}, {_way(turning)}" for turning in shown for who in ("reference", "monitor")]
        figure, ax = new_axes(WIDE, _HEIGHT, names)
        for place, turning in enumerate(shown):
            estimate, reference = (turning.profiles[:, k] * MICRO for k in (axis, len(each.axes) + axis))
            angles = _closed(turning.angles * _DEGREES, 360.0)
            told = colour(place)
            ax.plot(angles, _closed(reference), color=told, lw=2.6, alpha=0.35, label=f"reference, {_way(turning)}")
            ax.plot(angles, _closed(estimate), color=told, lw=1.0, label=f"monitor, {_way(turning)}")
        go_round(ax)
        title = f"{_title(each, name)}: radial error motion"
        label(figure, ax, title, "angle, °", "mean over turns, µm")
        ranges = ", ".join(f"{np.ptp(turning.profiles[:, axis]) * MICRO:.3g} µm {_way(turning)}" for turning in shown)
        yield Sketch(figure, f"{title} over the angle, reference and monitor; range of the monitor {ranges}")


def _angle_differences(each: ReferenceComparison) -> Iterator[Sketch]:
    """Their difference over the angle, of every direction and speed."""
    for axis, name in enumerate(each.axes):
        figure, ax = new_axes(WIDE, _HEIGHT, [*(turning.name for turning in each.turnings), _MOST])
        most = max(turning.axes[axis].judgement.most for turning in each.turnings) * MICRO
        for place, turning in enumerate(each.turnings):
            difference = (turning.profiles[:, len(each.axes) + axis] - turning.profiles[:, axis]) * MICRO
            angles = _closed(turning.angles * _DEGREES, 360.0)
            ax.plot(angles, _closed(difference), color=colour(place), lw=1.0, label=turning.name)
        _draw_bound(ax, most, _MOST)
        go_round(ax)
        title = f"{_title(each, name)}: reference less monitor"
        label(figure, ax, title, "angle, °", "mean over turns, µm")
        ranges = ", ".join(
            f"{turning.axes[axis].judgement.mean * MICRO:.2g} µm {turning.name}" for turning in each.turnings
        )
        yield Sketch(figure, f"{title} over the angle; root mean square {ranges}; limit of it {most:.2g} µm")


def _over_time(each: ReferenceComparison, begin_ns: int) -> Iterator[Sketch]:
    """Radial error motion over time."""
    for axis, name in enumerate(each.axes):
        figure, ax = new_axes(WIDE, _HEIGHT, ("reference", "monitor"))
        for number, turning in enumerate(each.turnings):
            named = number == 0
            for who, values, width, alpha in (
                ("reference", turning.samples.reference, 1.8, 0.4),
                ("monitor", turning.samples.estimate, 0.7, 1.0),
            ):
                time, line = _thinned(turning, values[:, axis], begin_ns)
                told = ORANGE if who == "reference" else BLACK
                ax.plot(time, line * MICRO, color=told, lw=width, alpha=alpha, label=who if named else None)
        ax.grid(alpha=0.3)
        title = f"{_title(each, name)}: radial error motion"
        label(figure, ax, title, "time after the first estimate, s", "radial error motion, µm")
        yield Sketch(figure, f"{title} over time, reference and monitor, while it turned at a constant speed")


def _time_differences(each: ReferenceComparison, begin_ns: int) -> Iterator[Sketch]:
    """Their difference over time."""
    for axis, name in enumerate(each.axes):
        figure, ax = new_axes(WIDE, _HEIGHT, [*(turning.name for turning in each.turnings), _BOUND])
        bound = max(float(turning.bound[axis]) for turning in each.turnings) * MICRO
        for place, turning in enumerate(each.turnings):
            samples = turning.samples
            time, line = _thinned(turning, samples.reference[:, axis] - samples.estimate[:, axis], begin_ns)
            ax.plot(time, line * MICRO, color=colour(place), lw=0.6, label=turning.name)
        _draw_bound(ax, bound, _BOUND)
        title = f"{_title(each, name)}: reference less monitor"
        label(figure, ax, title, "time after the first estimate, s", "difference, µm")
        largest = max(turning.axes[axis].largest for turning in each.turnings) * MICRO
        yield Sketch(figure, f"{title} over time; largest {largest:.2g} µm, bound of one difference ±{bound:.2g} µm")


def _draw_bound(ax: Axes, bound: float, name: str) -> None:
    """A band on either side of zero; as much of it as leaves what is drawn already to be seen."""
    largest = max(float(np.nanmax(np.abs(line.get_ydata()))) for line in ax.get_lines())
    ax.axhspan(-bound, bound, color=GREY, alpha=0.12, lw=0, label=name)
    shown = max(1.1 * largest, min(1.1 * bound, _BEYOND * largest))
    ax.set_ylim(-shown, shown)
    ax.grid(alpha=0.3)


def _longest(each: ReferenceComparison) -> list[TurningComparison]:
    """Of each direction of turning the speed with the most turns."""
    ways = dict.fromkeys(_way(turning) for turning in each.turnings)
    own = ([turning for turning in each.turnings if _way(turning) == way] for way in ways)
    return [max(turnings, key=lambda turning: turning.whole) for turnings in own]


def _way(turning: TurningComparison) -> str:
    return "forward" if turning.speed > 0 else "backward"


def _title(each: ReferenceComparison, axis: str) -> str:
    return f"{each.reference} {axis} at {each.height * 1e3:.4g} mm"


def _closed(values: Array, last: float | None = None) -> Array:
    return np.append(values, values[0] if last is None else last)


def _thinned(turning: TurningComparison, values: Array, begin_ns: int) -> tuple[Array, Array]:
    """Time (s) and values of a line that looks the same with fewer points; broken where samples are missing."""
    stamps = turning.samples.stamp_ns
    time = (stamps - begin_ns) * 1e-9
    step = max(1, 2 * len(values) // _MOST_POINTS)
    if step > 1:
        whole = len(values) // step * step
        parts = values[:whole].reshape(-1, step)
        first = np.arange(0, whole, step)
        chosen = np.sort(np.stack([first + parts.argmin(axis=1), first + parts.argmax(axis=1)], axis=1), axis=1).ravel()
        time, values = time[chosen], values[chosen]
    gaps = np.flatnonzero(np.diff(time) > _GAP) + 1
    return np.insert(time, gaps, np.nan), np.insert(values, gaps, np.nan)
