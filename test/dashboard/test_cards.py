"""The parts of the page as text: units, limits, what is old, and nothing that somebody else wrote as markup."""

from __future__ import annotations

import re
from html.parser import HTMLParser

import numpy as np
import pytest

from rotary_error_monitor.dashboard import cards
from rotary_error_monitor.dashboard.board import PageBoard
from rotary_error_monitor.dashboard.cards import PARTS, CardDrawer, ShownMoment
from rotary_error_monitor.dashboard.health import NodeStatus, Severity, verdict_of
from rotary_error_monitor.dashboard.model import CellModel
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.error_motion import ErrorMotion

NOW_NS = 1_700_000_000_000_000_000
LIMITS = {
    "linear_warning_um": "100",
    "linear_error_um": "500",
    "rotary_warning_urad": "500",
    "rotary_error_urad": "2000",
    "latched": "False",
}
EVIL = "<script>alert(1)</script><img src=x onerror=y>&'\""


class Words(HTMLParser):
    """What a browser makes of a part: its words, its elements, whether each is closed."""

    VOID = ("img", "br")

    def __init__(self, text):
        super().__init__()
        self.words, self.tags, self.open = [], set(), []
        self.feed(text)
        assert not self.open, f"never closed: {self.open}"

    def handle_starttag(self, tag, attributes):
        self.tags.add(tag)
        self.open.append(tag)

    def handle_startendtag(self, tag, attributes):
        self.tags.add(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)

    @property
    def text(self):
        return " ".join(self.words)


def model_with(statuses=(), theta=0.3, components=(1e-6, -2e-6, 0, 3e-6, 0, -4e-6)):
    model = CellModel(0.1, rotary=["A", "C"])
    covariance = np.diag([1e-16, 4e-16, 0, 9e-16, 0, 0])[None]
    observable = np.array([[1, 1, 0, 1, 1, 1]], bool)
    model.take_motion(ErrorMotion.of(np.array([theta]), np.array([components]), observable, covariance), 0.0, NOW_NS)
    model.take_statuses(statuses, 0.0)
    return model


def words(model, part, now=0.1):
    return Words(CardDrawer(model, {"a": 0.0}, "stage").parts(ShownMoment(now, NOW_NS))[part]).text


def test_every_part_is_drawn_from_the_first_moment_on():
    parts = CardDrawer(CellModel(0.1), {}, "stage").parts(ShownMoment(0.0, NOW_NS))
    assert set(parts) == set(PARTS)
    for text in parts.values():
        Words(text)
    assert "FAULT" in parts["verdict"]


def test_figures_in_micrometres_and_microradians_with_their_uncertainty():
    text = words(model_with(), "figures")
    assert re.search(r"exc\s+1\.000\s+± 0\.010\s+µm", text)
    assert re.search(r"eyc\s+−2\.000\s+± 0\.020\s+µm", text)
    assert re.search(r"ezc\s+–\s+µm", text), "what is not observable is no number"
    assert re.search(r"eac\s+3\.000\s+± 0\.030\s+µrad", text)
    assert re.search(r"ecc\s+−4\.000\s+± 0\.000\s+µrad", text)


def test_what_is_old_is_greyed_and_says_so():
    model = model_with([NodeStatus("error_estimator", "estimate", 0, "complete")])
    parts = CardDrawer(model, {}, "stage").parts(ShownMoment(1.7, NOW_NS))
    assert "old" in parts["figures"] and "2 s old" in parts["figures"]
    assert "class='drawing old'" in parts["polar"]
    assert "no error motion has come for 1.7 s" in Words(parts["verdict"]).text
    assert verdict_of(model.rows(0.5)).severity == Severity.OK
    assert verdict_of(model.rows(1.7)).severity == Severity.FAULT


def test_tool_offset_before_and_after():
    model = model_with()
    model.take_offset("before", np.array([3.0, 4.0, 0, 1.0, 0, 0]), 0.0, NOW_NS)
    model.take_offset("after", np.array([0, 0, 0.6, 1.0, 0, 0]), 0.0, NOW_NS)
    text = words(model, "offset")
    assert re.search(r"shift\s+5\.000\s+0\.600\s+µm", text)
    assert re.search(r"a\s+1\.000\s+1\.000\s+µrad", text)
    assert model.trend.series("tool offset, uncorrected", NOW_NS)[-1] == pytest.approx(5.0)
    assert model.trend.series("tool offset, corrected", NOW_NS)[-1] == pytest.approx(0.6)


def test_corrections_stand_against_their_limits_and_the_latch_is_said():
    model = model_with([NodeStatus("compensation", "correction", 0, "correcting", LIMITS)])
    model.take_corrections({"X": 250e-6, "C": -100e-6}, 0.0)
    part = CardDrawer(model, {}, "stage").parts(ShownMoment(0.1, NOW_NS))["correction"]
    text = Words(part).text
    assert re.search(r"X\s+250\.0\s+µm\s+of 100 / 500", text)
    assert re.search(r"C\s+−100\.0\s+µrad\s+of 500 / 2000", text)
    assert re.findall(r'width="([\d.]+)" height="10" fill="#0|width="([\d.]+)" height="10" fill="#d5', part) == [
        ("", "50.0"),
        ("5.0", ""),
    ]
    assert "latch open" in text
    latched = [NodeStatus("compensation", "correction", 2, "held: error limit latched", LIMITS | {"latched": "True"})]
    model.take_statuses(latched, 0.1)
    assert "LATCHED" in words(model, "correction")


def test_recording():
    assert "nothing is recorded" in words(model_with(), "recording")
    figures = {"bag": "/data/bag", "size_mb": "12.5", "free_mb": "250000", "messages": "1234567"}
    statuses = [
        NodeStatus("recorder", "recording", 0, "recording", figures),
        NodeStatus("recorder", "state", 0, "active"),
    ]
    text = words(model_with(statuses), "recording")
    for expected in ("recording", "/data/bag", "12.5 MB", "250.00 GB", "1,234,567"):
        assert expected in text
    paused = [statuses[0], NodeStatus("recorder", "state", 1, "inactive")]
    assert "paused: nothing is recorded" in words(model_with(paused), "recording")


def test_the_gap_monitors_last_verdict():
    figures = {"causes": "head eccentricity b (97%)", "age_s": "240", "turns": "25"}
    text = words(model_with([NodeStatus("gap_monitor", "verdict", 1, "a gap", figures)]), "gap")
    for expected in ("a gap", "head eccentricity b (97%)", "of 25 turns that ended 4 min ago"):
        assert expected in text


def test_a_simulation_is_called_one():
    assert "SIMULATED" not in words(model_with([NodeStatus("encoder_head_a", "state", 0, "")]), "verdict")
    simulated = NodeStatus("encoder_head_a", "state", 0, "", {"simulated": "true"})
    assert "SIMULATED" in words(model_with([simulated]), "verdict")


def test_nothing_that_comes_on_a_topic_is_markup():
    figures = {**LIMITS, "bag": EVIL, "causes": EVIL, "age_s": EVIL, "messages": EVIL, "size_mb": EVIL, "turns": EVIL}
    model = model_with(
        [
            NodeStatus("compensation", "correction", 2, EVIL, figures),
            NodeStatus("recorder", "recording", 2, EVIL, figures),
            NodeStatus("gap_monitor", "verdict", 2, EVIL, figures),
            NodeStatus(EVIL, EVIL, 2, EVIL, figures),
        ]
    )
    model.take_corrections({EVIL: 1.0}, 0.0)
    for name, text in CardDrawer(model, {EVIL: 0.0}, EVIL).parts(ShownMoment(0.1, NOW_NS)).items():
        assert not Words(text).tags & {"script", "img"}, name


def test_a_thousand_axes_are_refused():
    with pytest.raises(InputError, match="1000 axes"):
        model_with().take_corrections({f"X{n}": 0.0 for n in range(1000)}, 0.0)


def test_a_part_that_is_as_before_stays_the_same_object_and_is_not_sent():
    board = PageBoard()
    board.show({"a": "".join(["x", "1"]), "b": "y"})
    before = board.look()
    board.show({"a": "".join(["x", "1"]), "b": "z"})
    assert board.look()["a"] is before["a"]
    assert board.look()["b"] == "z"
    assert board.is_watched


def test_the_day_is_not_drawn_anew_at_each_moment():
    drawn, model = CardDrawer(model := model_with(), {}, "stage"), model
    first = drawn.parts(ShownMoment(0.0, NOW_NS))["trend_radial"]
    model.trend.note("radial error motion", 50.0, NOW_NS)
    assert drawn.parts(ShownMoment(4.9, NOW_NS))["trend_radial"] == first
    assert drawn.parts(ShownMoment(5.1, NOW_NS))["trend_radial"] != first


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0.000"),
        (-0.1234, "−0.123"),
        (-1e-5, "0.000"),
        (9.9996, "10.00"),
        (123.45, "123.5"),
        (np.nan, "–"),
        (12345.6, "12,345.6"),
    ],
)
def test_numbers(value, text):
    assert cards._number(value) == text
