"""The page of a trend, of histories that are made here: slopes, dates of limits, and names that somebody else chose."""

from __future__ import annotations

import re

import numpy as np
import pytest

from rotary_error_monitor.analysis.history import Recorded, StageHistory, histories
from rotary_error_monitor.analysis.result import Figure
from rotary_error_monitor.analysis.trend import DAY_NS
from rotary_error_monitor.analysis.trend_result import FolderTrend
from rotary_error_monitor.description.error_motion_limits import ErrorMotionLimits
from rotary_error_monitor.report.trend import page, trend_sentence
from rotary_error_monitor.report.trend_figure import MOST_PANELS, draw, joined

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
        rows.append(Recorded(f"day {day}", stage, "/", BEGIN_NS + day * DAY_NS, figures, {"forward 4 rad/s": 4.0}))
    return histories(rows, ErrorMotionLimits(tilt_total=5e-6), 0.01)


def page_of(trend: FolderTrend) -> str:
    return page(trend, draw(trend), "bags", {"folder": "bags"})


@pytest.mark.parametrize("seed", range(5))
def test_wear_is_told_with_its_slope_and_the_date_of_its_limit(seed: int) -> None:
    """100 nrad a day from 1 µrad meet 5 µrad on the fortieth day after the first, 2025-12-31."""
    trend = FolderTrend(wearing("A7", 1e-7, seed), (), (), (), 12, 0)
    shown = page_of(trend)
    said = trend_sentence(trend)
    assert "12 recordings of 1 stage; something changed or drifts in 1 stage." in said
    (event,) = re.findall(r"<li>(a slope of [^<]*)</li>", shown)
    (told, wide) = re.findall(r"of 1 figure, most clearly of tilt x: total, ([\d.]+)\s±\s([\d.]+)\snrad/day", event)[0]
    assert abs(float(told) - 100) <= 2 * float(wide) < 5
    (reached,) = re.findall(r"<td[^>]*>(\d{4}-\d\d-\d\d), between (\S+) and (\S+) \(tilt x: total\)</td>", shown)
    assert "2025-12-25" <= reached[1] <= reached[0] <= reached[2] <= "2026-01-06"
    assert "<th>slope ± U, nrad/day</th>" in shown and "<th>now ± U, µrad</th>" in shown


def test_names_of_stages_are_drawn_and_written_whatever_they_are() -> None:
    """Nothing in them is markup or a formula; letters that no font has bring no warning."""
    trend = FolderTrend((*wearing(HOSTILE, 1e-7, 1), *wearing("A7", 0.0, 2)), (), (), (), 24, 0)
    shown = page_of(trend)
    assert "<b>" not in shown and "&lt;b&gt;" in shown
    alts = re.findall(r"alt='([^']*)'", shown)
    assert len(alts) == len(set(alts)) == 4
    assert joined(draw(trend)).startswith(b"\x89PNG")


def test_a_single_recording_has_no_pictures_and_says_why() -> None:
    trend = FolderTrend(wearing("A7", 1e-7, 1, count=1), (), (), (), 1, 0)
    shown = page_of(trend)
    assert draw(trend) == {} and "<img" not in shown
    assert "Two recordings with a figure in common are needed" in shown
    assert "1 recording of 1 stage; something changed or drifts in none." in trend_sentence(trend)


def test_no_more_is_drawn_than_fits_on_a_page() -> None:
    names = [f"radial_x_at_{height}mm.total" for height in range(2 * MOST_PANELS)]
    rows = [
        Recorded(f"{k}", "A", "/", BEGIN_NS + k, tuple(Figure(name, "", 1e-6, 1e-7, "m") for name in names), {})
        for k in range(2)
    ]
    trend = FolderTrend(histories(rows, ErrorMotionLimits(), 0.01), (), (), (), 2, 0)
    assert [len(each) for each in draw(trend).values()] == [MOST_PANELS]
    shown = page_of(trend).replace("\u00a0", " ")
    assert all(name.replace("_", " ").replace("mm.", " mm: ") in shown for name in names)
