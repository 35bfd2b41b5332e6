"""Ticks that are drawn quickly against the drawing library's own slow way, dot by dot: no dot may differ."""

from __future__ import annotations

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.dates import AutoDateLocator, ConciseDateFormatter

from rotary_error_monitor.report.drawing import NARROW, WIDE, drawn, label, new_axes, scale_by_powers
from rotary_error_monitor.report.polar import draw_base, scale_radius
from rotary_error_monitor.report.quick_ticks import quick_ticks

HEIGHT = 2.5


def dots(figure):
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba()).copy()


def with_grid(ax, generator):
    low = generator.normal() * 10.0 ** generator.integers(-3, 5)
    ax.plot(generator.normal(size=50).cumsum() + low)
    ax.grid(alpha=0.3)


def of_a_fixed_range(ax, generator):
    """Ends that are ticks, or just not."""
    ends = np.sort(generator.integers(-5, 6, 2) + generator.choice([0.0, 1e-12, -1e-12, 0.3], 2))
    ax.plot([0, 360], ends)
    ax.set_xlim(0, 360)
    ax.set_xticks(range(0, 361, 60))
    ax.set_ylim(ends[0], ends[1] + 1.0)
    ax.grid(alpha=0.3)


def of_powers(ax, generator):
    ax.plot(10.0 ** generator.uniform(-6, 3, 30))
    scale_by_powers(ax)


def with_minor_ticks(ax, generator):
    ax.plot(10.0 ** generator.uniform(-2, 2, 30))
    ax.set_yscale("log")
    ax.grid(which="both")


def about_a_large_number(ax, generator):
    """Names share what stands beside the axis."""
    ax.plot(1e7 + generator.normal(size=30), 1e-9 * generator.normal(size=30))


def over_dates(ax, generator):
    begin = np.datetime64("2026-01-01", "s") + generator.integers(0, 10**8)
    ax.plot(begin + np.cumsum(generator.integers(1, 10**6, 20)), generator.normal(size=20))
    locator = AutoDateLocator(minticks=3, maxticks=6)
    ax.xaxis.set_major_locator(locator)
    ax.xaxis.set_major_formatter(ConciseDateFormatter(locator))


def with_named_places(ax, generator):
    names = [f"place {number}" for number in range(generator.integers(2, 6))]
    ax.barh(np.arange(len(names)), generator.uniform(size=len(names)))
    ax.set_yticks(np.arange(len(names)), names, fontsize=8, color="#d55e00")
    ax.set_xticks([0.0, 0.5, 1.0], ["0 %", "50 %", "100 %"])
    ax.invert_yaxis()


def of_kinds(ax, generator):
    ax.bar(["before", "noise\nfloor"], generator.uniform(size=2))


def on_the_other_side(ax, generator):
    ax.plot(generator.normal(size=20))
    ax.yaxis.tick_right()
    ax.grid()


def without_ticks(ax, generator):
    ax.plot(generator.normal(size=20))
    ax.set(xticks=[], yticks=[])


def without_an_axis(ax, generator):
    ax.plot(generator.normal(size=20))
    ax.yaxis.set_visible(False)


STRAIGHT = (
    with_grid,
    of_a_fixed_range,
    of_powers,
    with_minor_ticks,
    about_a_large_number,
    over_dates,
    with_named_places,
    of_kinds,
    on_the_other_side,
    without_ticks,
    without_an_axis,
)


def check(figure, told=""):
    before = dots(figure)
    with quick_ticks(figure):
        quick = dots(figure)
    after = dots(figure)
    assert (before < 128).any(axis=2).sum() > 1000, "there is something to be seen"
    np.testing.assert_array_equal(quick, before, f"as it is drawn quickly {told}")
    np.testing.assert_array_equal(after, before, f"afterwards {told}")


@pytest.mark.parametrize("draw", STRAIGHT)
def test_ticks_are_those_of_the_library(draw):
    for seed in range(4):
        figure, ax = new_axes(WIDE, HEIGHT)
        draw(ax, np.random.default_rng(seed))
        label(figure, ax, "title", "time, s", "mean, µm")
        check(figure, f"(seed {seed})")


def test_ticks_of_polar_plots_are_those_of_the_library():
    for seed in range(4):
        generator = np.random.default_rng(seed)
        figure, ax = new_axes(NARROW, 3.9, polar=True, left=0.4)
        angles, span = np.linspace(0, 2 * np.pi, 181), 10.0 ** generator.uniform(-3, 3)
        base = draw_base(ax, angles, span)
        ax.plot(angles, base + span * 0.5 * np.sin(3 * angles))
        scale_radius(ax, base, 0.5 * span)
        label(figure, ax, "title")
        check(figure, f"(seed {seed})")


def test_an_axis_has_one_tick():
    """This is what makes it quick."""
    figure, ax = new_axes(WIDE, HEIGHT)
    ax.plot([0, 1], [0, 1])
    ax.grid(alpha=0.3)
    label(figure, ax, "title")
    drawn(figure, "a line")
    assert [len(axis.majorTicks) for axis in (ax.xaxis, ax.yaxis)] == [1, 1]
    assert len(ax.get_xticks()) > 3


def test_axes_are_given_back_whatever_happens():
    figure, ax = new_axes(WIDE, HEIGHT)
    children = ax.get_children()
    with pytest.raises(ZeroDivisionError), quick_ticks(figure):
        assert not ax.xaxis.get_visible()
        1 / 0  # noqa: B018 (what fails)
    assert ax.get_children() == children and ax.xaxis.get_visible() and ax.yaxis.get_visible()
