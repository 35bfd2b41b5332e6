"""What is drawn, read back from the SVG in µm by its own scale, against the motion that was put in."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from rotary_error_monitor.dashboard import drawing
from rotary_error_monitor.dashboard.trend import MINUTES
from rotary_error_monitor.dashboard.turns import LastTurns
from rotary_error_monitor.metrology.error_motion import ErrorMotion

RADIUS = 0.1
SVG = "{*}"


def motion(theta, exc, eyc, observable=True):
    components = np.zeros((len(theta), 6))
    components[:, 0], components[:, 1] = exc, eyc
    return ErrorMotion.of(theta, components, np.full((len(theta), 6), observable), np.zeros((len(theta), 6, 6)))


def lines(svg):
    """Points of each polyline, y upwards."""
    found = ElementTree.fromstring(svg).iter("polyline")
    pairs = [[tuple(map(float, pair.split(","))) for pair in line.get("points").split()] for line in found]
    return [np.array(points) * [1.0, -1.0] for points in pairs]


def ellipse(long, short, turns):
    theta = np.linspace(0.0, turns * 2 * np.pi, turns * 2000, endpoint=False)
    return motion(theta, long * np.cos(theta), short * np.sin(theta))


def drawn(long, short, turns=3):
    last = LastTurns(RADIUS)
    for piece in np.array_split(np.arange(turns * 2000), 37):
        last.add(ellipse(long, short, turns).at(piece))
    return last.pictures()


@pytest.mark.parametrize("seed", range(6))
def test_the_orbit_is_as_large_as_its_grid_says(seed):
    long = 10 ** np.random.default_rng(seed).uniform(-8, -4)
    pictures = drawn(long, 0.4 * long)
    svg = drawing.orbit_svg(pictures, RADIUS)
    shown = {
        float(text.text): float(text.get("x")) for text in ElementTree.fromstring(svg).iter("text") if _number(text)
    }
    division = min(value for value in shown if value > 0.0)
    unit = division * 1e-6 / shown[division]
    assert f"one division {division:g} µm" in drawing.scale_of(pictures, RADIUS, orbit=True)
    size = np.abs(lines(svg)[-1]).max(axis=0) * unit
    np.testing.assert_allclose(size, [long, 0.4 * long], atol=0.1 * unit)
    assert np.abs(lines(svg)[-1]).max() <= 100.5, "it has room"


def _number(text):
    return text.get("text-anchor") == "middle" and re.fullmatch(r"-?[\d.]+(e-?\d+)?", text.text)


def test_the_polar_plot_leaves_its_ring_by_the_radial_error_motion():
    svg = drawing.polar_svg(drawn(1e-6, 0.5e-6), RADIUS, {"a": 0.0, "b": np.pi})
    circles = [float(circle.get("r")) for circle in ElementTree.fromstring(svg).iter("circle")]
    ring, outer, _ = circles
    (label,) = (text.text for text in ElementTree.fromstring(svg).iter("text") if text.text.startswith("+"))
    unit = float(label.split()[0]) * 1e-6 / (outer - ring)
    away = (np.hypot(*lines(svg)[-1].T) - ring) * unit
    np.testing.assert_allclose([away.max(), away.min()], [1e-6, 0.5e-6], atol=0.1 * unit)


def test_turns_are_told_apart_and_the_oldest_goes():
    last = LastTurns(RADIUS, most=3)
    for turn, size in enumerate((1e-6, 2e-6, 3e-6, 4e-6)):
        theta = (turn + np.arange(720) / 720) * 2 * np.pi
        last.add(motion(theta, size * np.cos(theta), size * np.sin(theta)))
    pictures = last.pictures()
    assert len({picture.magnification for picture in pictures}) == 1
    sizes = [np.hypot(*p.orbit[:, :2].T).max() / p.magnification for p in pictures]
    np.testing.assert_allclose(sizes, [2e-6, 3e-6, 4e-6], rtol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_memory_is_bounded_however_the_stage_moves(seed):
    rng, last = np.random.default_rng(seed), LastTurns(RADIUS)
    theta = 0.0
    for _ in range(60):
        path = theta + np.cumsum(rng.normal(0.0, 0.5, 200))
        last.add(motion(path, 1e-6, 0.0))
        theta = path[-1]
        pictures = last.pictures()
        assert 1 <= len(pictures) <= 4
        assert len(drawing.polar_svg(pictures, RADIUS, {})) < 40_000


def test_what_is_not_observable_is_said_and_not_drawn():
    last = LastTurns(RADIUS)
    assert "not observable" in drawing.scale_of(last.pictures(), RADIUS)
    last.add(motion(np.linspace(0, 6, 50), 1.0, 1.0, observable=False))
    pictures = last.pictures()
    assert "not observable" in drawing.scale_of(pictures, RADIUS)
    for svg in (drawing.polar_svg(pictures, RADIUS, {}), drawing.orbit_svg(pictures, RADIUS)):
        assert lines(svg) == []


@pytest.mark.parametrize("largest", [0.37, 1.0, 1.9, 4.2, 9.99, 73.0])
def test_a_trend_is_read_off_its_axis(largest):
    values = np.full(MINUTES, np.nan)
    values[100:700] = np.linspace(0.0, largest, 600)
    values[900:1000] = largest / 2
    svg = drawing.trend_svg([("size", values, drawing.BLUE, "")], "14:05")
    texts = list(ElementTree.fromstring(svg).iter("text"))
    marks = {float(t.text): 4 - float(t.get("y")) for t in texts if t.get("text-anchor") == "end"}
    assert 2 <= len(marks) <= 4
    top = max(marks)
    rising, level = lines(svg)
    unit = top / (marks[top] - marks[0.0])
    np.testing.assert_allclose((rising[-1, 1] - marks[0.0]) * unit, largest, atol=0.1 * unit + 1e-12)
    np.testing.assert_allclose((level[:, 1] - marks[0.0]) * unit, largest / 2, atol=0.1 * unit + 1e-12)
    hours = {t.text: float(t.get("x")) for t in texts if ":" in t.text}
    assert set(hours) == {"00:00", "06:00", "12:00", "18:00"}
    width = rising[-1, 0] - rising[0, 0]
    np.testing.assert_allclose(hours["12:00"] - hours["06:00"], 6 * 60 / 599 * width, rtol=0.01)


def test_an_empty_day_is_drawn_without_lines():
    assert lines(drawing.trend_svg([("size", np.full(MINUTES, np.nan), drawing.BLUE, "")], "00:00")) == []
