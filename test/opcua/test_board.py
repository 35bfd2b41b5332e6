"""Quality of values: by age, by who judges them, by what they are; never good where stale, whatever clocks do."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from rotary_error_monitor.opcua.board import Board, Quality, Status
from rotary_error_monitor.opcua.model import Variable, health_variables

JUDGE = "error_estimator: estimate"
VALUE = Variable("error_motion/exc", "", stale_after=1.0, judge=JUDGE)
FREE = replace(VALUE, judge="")
SECOND = 1_000_000_000


class Clocks:
    """The node's clock, which may halt or jump, and a steady one."""

    def __init__(self, start_ns=1_000 * SECOND):
        self.now_ns, self.steady = start_ns, 50.0

    def board(self):
        return Board(lambda: self.now_ns, lambda: self.steady)

    def pass_by(self, seconds, *, halted=False):
        self.steady += seconds
        self.now_ns += 0 if halted else round(seconds * SECOND)


def status(level, name=JUDGE, **figures):
    return Status(name, level, "as it is", {key: str(value) for key, value in figures.items()})


@pytest.mark.parametrize(
    ("level", "quality"),
    [
        (0, Quality.GOOD),
        (1, Quality.SUBNORMAL),
        (2, Quality.FAULTY),
        (3, Quality.OUT_OF_SERVICE),
        (200, Quality.OUT_OF_SERVICE),
    ],
)
def test_quality_follows_the_level_of_the_judge(level, quality):
    clocks = Clocks()
    board = clocks.board()
    board.note(VALUE.path, 0.25, clocks.now_ns)
    board.note_status(status(level), clocks.now_ns)
    point = board.read(VALUE)
    assert point.quality is quality
    assert point.value == (None if quality.is_bad else 0.25)
    assert point.stamp_ns == clocks.now_ns


def test_without_a_word_of_its_judge_a_value_is_uncertain_and_one_without_judge_good():
    clocks = Clocks()
    board = clocks.board()
    board.note(VALUE.path, 0.25, clocks.now_ns)
    assert board.read(VALUE).quality is Quality.SUBNORMAL
    assert board.read(FREE).quality is Quality.GOOD
    board.note_status(status(0), clocks.now_ns)
    assert board.read(VALUE).quality is Quality.GOOD
    clocks.pass_by(5.1)
    board.note(VALUE.path, 0.5, clocks.now_ns)
    assert board.read(VALUE).quality is Quality.SUBNORMAL


def test_what_has_not_come_is_awaited_and_what_no_sensor_tells_says_so():
    clocks = Clocks()
    board = clocks.board()
    assert board.read(FREE).quality is Quality.AWAITED
    assert board.read(replace(FREE, sensed=False)).quality is Quality.NO_SENSOR
    board.note(FREE.path, math.nan, clocks.now_ns)
    assert board.read(FREE).quality is Quality.NOT_OBSERVED
    assert board.read(FREE).value is None


@pytest.mark.parametrize("seed", range(20))
def test_nothing_stale_is_good_whatever_stamps_and_clocks_do(seed):
    """Of drawn courses of two clocks: quality is that of the true age, or worse."""
    rng = np.random.default_rng(seed)
    clocks = Clocks()
    board = clocks.board()
    seen = {"fresh": 0, "stale": 0}
    for _ in range(200):
        if rng.random() < 0.3:
            stamp = clocks.now_ns + round(rng.normal(0.0, 2.0) * SECOND)
            board.note(FREE.path, 1.0, stamp)
            noted, stamped_late = clocks.steady, (clocks.now_ns - stamp) > 0
            assert (board.read(FREE).quality is Quality.GOOD) == (clocks.now_ns - stamp <= SECOND or not stamped_late)
            continue
        clocks.pass_by(rng.exponential(0.4), halted=rng.random() < 0.3)
        if rng.random() < 0.1:
            clocks.now_ns += round(rng.normal(0.0, 5.0) * SECOND)
        quality = board.read(FREE).quality
        if quality is not Quality.AWAITED and clocks.steady - noted > 1.0:
            seen["stale"] += 1
            assert quality is Quality.SILENT
        seen["fresh"] += quality is Quality.GOOD
    assert min(seen.values()) > 0


@pytest.mark.parametrize(
    ("figure", "text", "kind", "value"),
    [
        ("age_s", "1.5", float, 1.5),
        ("age_s", "none", float, None),
        ("latched", "True", bool, True),
        ("latched", "false", bool, False),
        ("latched", "1", bool, None),
        ("verdict", "explained", str, "explained"),
        ("absent", "x", str, None),
    ],
)
def test_figures_of_a_status_are_read_by_their_type(figure, text, kind, value):
    clocks = Clocks()
    board = clocks.board()
    key = figure if figure != "absent" else "other"
    board.note_status(status(1, **{key: text}), clocks.now_ns)
    point = board.read(Variable("gap/x", "", kind, stale_after=5.0, status=JUDGE, figure=figure))
    assert point.value == value
    assert point.quality is (Quality.AWAITED if value is None else Quality.GOOD)


def test_a_report_of_an_error_is_a_good_report_but_what_it_speaks_of_is_not():
    clocks = Clocks()
    board = clocks.board()
    level, message, usable, rate = health_variables("a: /x/y", ("rate_hz", "unknown_figure"))
    assert level.path == "health/a: .x.y/level"
    board.note_status(status(2, "a: /x/y", rate_hz=12.5), clocks.now_ns)
    assert (board.read(level).value, board.read(message).value) == (2.0, "as it is")
    assert board.read(level).quality is Quality.GOOD
    assert board.read(usable).quality is board.read(rate).quality is Quality.FAULTY
    board.note_status(status(1, "a: /x/y", rate_hz=12.5), clocks.now_ns)
    assert (board.read(usable).value, board.read(rate).value) == (True, 12.5)
    assert board.read(usable).quality is board.read(rate).quality is Quality.SUBNORMAL
    clocks.pass_by(5.1, halted=True)
    assert {board.read(each).quality for each in (level, message, usable, rate)} == {Quality.SILENT}
