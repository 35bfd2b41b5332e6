"""The page of a trend, of histories that are made here: slopes, dates of limits, and names that somebody else chose."""

from __future__ import annotations

import re

import numpy as np
import pytest

from rotary_error_monitor.analysis.history import RecordingFigures, StageHistory, histories
from rotary_error_monitor.analysis.result import Figure
from rotary_error_monitor.analysis.trend import DAY_NS
from rotary_error_monitor.analysis.trend_result import FolderTrend, Unread
from rotary_error_monitor.description.error_motion_limits import ErrorMotionLimits
from rotary_error_monitor.report.trend import page, trend_sentence
from rotary_error_monitor.report.trend_figure import MOST_PANELS, draw, joined, shown

BEGIN_NS = 1_763_700_000_000_000_000
HOSTILE = "<b>$\\frac{</b> $1 軸\n"
"""Markup, a formula that is none, a letter that fonts lack, and a new line."""


def wearing(stage: str, slope: float, seed: int, count: int = 12) -> tuple[StageHistory, ...]:
    """A tilt that rises by `slope` (rad) a day, an axial motion that stays, and a limit of 5 µrad."""
    rng = np.random.default_rng(seed)
    rows = []
    for day in range(count):
        tilt = 1e-6 + slope * day + 5e-9 * rng.standard_normal()
        figures = (
            Figure("tilt_x.total", "forward 4 rad/s", tilt, 1e-8, "rad", tilt, 4, 100, 60.0),
            Figure("axial.total", "forward 4 rad/s", 2e-7, 1e-8, "m", 2e-7, 4, 100, 60.0),
        )
        rows.append(
            RecordingFigures(f"day {day}", stage, "/", BEGIN_NS + day * DAY_NS, figures, {"forward 4 rad/s": 4.0})
        )
    return histories(rows, ErrorMotionLimits(tilt_total=5e-6), 0.01)


def page_of(trend: FolderTrend) -> str:
    return page(trend, draw(trend), "bags", {"folder": "bags"})


@pytest.mark.parametrize("seed", range(5))
def test_wear_is_told_with_its_slope_and_the_date_of_its_limit(seed: int) -> None:
    """100 nrad a day from 1 µrad meet 5 µrad on the fortieth day after the first, 2025-12-31."""
    trend = FolderTrend(wearing("A7", 1e-7, seed), (), (), (), 12, 0)
    text = page_of(trend)
    said = trend_sentence(trend)
    assert "12 recordings of 1 stage; something changed or drifts in 1 stage." in said
    (event,) = re.findall(r"<li>(a slope of [^<]*)</li>", text)
    (told, wide) = re.findall(r"of 1 figure, most clearly of tilt x: total, ([\d.]+)\s±\s([\d.]+)\snrad/day", event)[0]
    assert abs(float(told) - 100) <= 2 * float(wide) < 5
    (reached,) = re.findall(r"<td[^>]*>(\d{4}-\d\d-\d\d), between (\S+) and (\S+) \(tilt x: total\)</td>", text)
    assert "2025-12-25" <= reached[1] <= reached[0] <= reached[2] <= "2026-01-06"
    assert "<th>slope ± U, nrad/day</th>" in text and "<th>now ± U, µrad</th>" in text


def test_names_of_stages_are_drawn_and_written_whatever_they_are() -> None:
    """Nothing in them is markup or a formula; letters that no font has bring no warning."""
    trend = FolderTrend((*wearing(HOSTILE, 1e-7, 1), *wearing("A7", 0.0, 2)), (), (), (), 24, 0)
    text = page_of(trend)
    assert "<b>" not in text and "&lt;b&gt;" in text
    alts = re.findall(r"alt='([^']*)'", text)
    assert len(alts) == len(set(alts)) == 4
    assert joined(draw(trend)).startswith(b"\x89PNG")


def test_a_single_recording_has_no_pictures_and_says_why() -> None:
    trend = FolderTrend(wearing("A7", 1e-7, 1, count=1), (), (), (), 1, 0)
    told = page_of(trend)
    assert draw(trend) == {} and "<img" not in told
    assert "Two recordings with a figure in common are needed" in told
    assert trend_sentence(trend).endswith("1 recording of 1 stage; something changed or drifts in none.")


def test_bags_that_are_not_in_the_trend_are_listed_with_their_reasons() -> None:
    unread, undone = Unread("broken", "/", "no message on /x"), Unread("far", "", "its worker was ended")
    trend = FolderTrend(wearing("A7", 1e-7, 1, count=1), (unread,), (undone,), ("old",), 2, 0)
    told = page(trend, {}, "bags", {})
    for title, *words in (
        ("Bags that cannot be analysed", "broken", "no message on /x"),
        ("Bags that were not read this time", "far", "its worker was ended"),
        ("Bags that are no longer there", "old"),
    ):
        (part,) = re.findall(f"<h2>{title}</h2>(.*?)<h2>", told)
        assert all(f">{word}<" in part for word in words)
    assert trend_sentence(trend).endswith(" 2 bags could not be used.")


def test_no_more_is_drawn_than_fits_on_a_page() -> None:
    names = [f"radial_x_at_{height}mm.total" for height in range(2 * MOST_PANELS)]
    rows = [
        RecordingFigures(f"{k}", "A", "/", BEGIN_NS + k, tuple(Figure(name, "", 1e-6, 1e-7, "m") for name in names), {})
        for k in range(2)
    ]
    trend = FolderTrend(histories(rows, ErrorMotionLimits(), 0.01), (), (), (), 2, 0)
    (stage,) = trend.stages
    assert len(shown(stage)) == MOST_PANELS
    told = page(trend, {}, "bags", {}).replace("\u00a0", " ")
    assert all(name.replace("_", " ").replace("mm.", " mm: ") in told for name in names)
