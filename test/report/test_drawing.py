"""Pictures that are drawn quickly against the drawing library's own slow way, dot by dot."""

from __future__ import annotations

import io

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from PIL import Image

from rotary_error_monitor.report.drawing import WIDE, draw_bars, drawn, label, new_axes, scale_by_powers, tiled
from rotary_error_monitor.report.drawn import Drawn
from rotary_error_monitor.report.palette import colour
from rotary_error_monitor.report.plot import Plot
from rotary_error_monitor.report.wording import power_of_ten

HEIGHT = 2.5
FAST = Image.Quantize.FASTOCTREE


def dots(figure):
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba()).copy()


def bars(draw, places, heights, *, hatched):
    figure, ax = new_axes(WIDE, HEIGHT, ("a name",))
    style = {"facecolor": "white", "edgecolor": "#0072b2", "hatch": "////", "lw": 0.8} if hatched else {}
    draw(ax, places, heights, style)
    scale_by_powers(ax)
    ax.set_ylim(bottom=0.3 * heights.min())
    label(figure, ax, "title", "order", "amplitude, µm")
    return dots(figure)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("hatched", [False, True])
def test_bars_are_those_of_the_library(seed, hatched):
    generator = np.random.default_rng(seed)
    places, heights = np.arange(1, 31) + 0.2, 10.0 ** generator.uniform(-3, 2, 30)

    def slow(ax, places, heights, style):
        ax.bar(places, heights, 0.4, **(style or {"color": "#d55e00"}), label="a name")

    def quick(ax, places, heights, style):
        draw_bars(ax, places, heights, 0.4, **(style or {"facecolor": "#d55e00", "lw": 0}), label="a name")

    one, other = (bars(draw, places, heights, hatched=hatched) for draw in (slow, quick))
    off = np.abs(one.astype(int) - other).max(axis=2)
    assert (off > 8).mean() < 1e-3, f"{(off > 8).sum()} dots differ"
    assert (one < 200).any(axis=2).sum() > 10_000, "there is something to be seen"


def test_names_of_axes_are_whole_and_beyond_those_of_their_ticks():
    for low, high in ((-500, 500), (0.0, 1e-3), (-1.0, 1.0)):
        figure, ax = new_axes(WIDE, HEIGHT)
        ax.plot([0, 1], [low, high])
        label(figure, ax, "title", "time, s", "mean, µm")
        FigureCanvasAgg(figure).draw()
        below, beside = (axis.label.get_window_extent() for axis in (ax.xaxis, ax.yaxis))
        assert min(below.x0, below.y0, beside.x0, beside.y0) > 0.0
        assert below.y1 < min(text.get_window_extent().y0 for text in ax.get_xticklabels())
        seen = [tick for tick in ax.yaxis.get_major_ticks() if low <= tick.get_loc() <= high]
        assert beside.x1 < min(tick.label1.get_window_extent().x0 for tick in seen)


def opened(picture):
    return np.asarray(Image.open(io.BytesIO(picture.png)).convert("RGB")).astype(int)


def scribble(generator, lines):
    figure, ax = new_axes(WIDE, HEIGHT)
    for number in range(lines):
        ax.plot(generator.normal(size=100).cumsum(), color=colour(number), alpha=generator.uniform(0.3, 1.0))
    label(figure, ax, "title", "time, s", "mean, µm")
    return figure


@pytest.mark.parametrize("seed", range(4))
def test_a_picture_in_few_colours_is_as_near_as_one_that_the_imaging_library_makes(seed):
    """Which chooses as many colours for all dots; white ones are white."""
    figure = scribble(np.random.default_rng(seed), 1 + 2 * seed)
    whole = dots(figure)[..., :3].astype(int)
    ours, few = opened(drawn(figure, "lines")), Image.fromarray(whole.astype(np.uint8)).quantize(64, method=FAST)
    off, its = (np.sqrt(((each - whole) ** 2).mean()) for each in (ours, np.asarray(few.convert("RGB")).astype(int)))
    assert off < 1.1 * its + 0.1
    white = (whole == 255).all(axis=2)
    assert 0.7 < white.mean() < 1.0
    assert (ours[white] == 255).all()
    assert np.abs(ours - whole).max() < 64, "no dot has another colour"


def test_pictures_do_not_show_what_was_drawn_before_them():
    first, other = (scribble(np.random.default_rng(seed), 3) for seed in range(2))
    alone = drawn(other, "other").png
    assert drawn(first, "first").png != alone
    assert drawn(other, "other").png == alone


def test_a_picture_of_nothing_is_white():
    assert (opened(drawn(Plot(figsize=(1, 1), dpi=100), "nothing")) == 255).all()
    assert opened(Drawn(tiled([]), "nothing")).shape == (1, 1, 3)


def test_a_picture_without_white_keeps_its_colour():
    blue = Plot(figsize=(1, 1), dpi=100, facecolor="#0072b2")
    assert np.abs(opened(drawn(blue, "blue")) - [0x00, 0x72, 0xB2]).max() < 8


@pytest.mark.parametrize(("exponent", "told"), [(-12, "10⁻¹²"), (0, "10⁰"), (3, "10³")])
def test_powers_of_ten_are_told_as_by_hand(exponent, told):
    assert power_of_ten(exponent) == told
