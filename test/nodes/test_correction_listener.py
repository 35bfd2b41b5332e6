"""Corrections on their way into a node: what is believed, held and said, on a mock controller."""

from __future__ import annotations

import itertools
import math
import os
import re
import subprocess
import sys
import time
from array import array
from pathlib import Path

import pytest
from nodes.node_log import Log
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import JointState

from rotary_error_monitor.nodes import messages
from rotary_error_monitor.nodes.mock_controller import MockController

NAMES = tuple("XYZAC")
CORRECTION = (10e-6, -20e-6, 7e-6, 1e-4, -2e-4)
STATUS = "mock_controller: corrections"
MS, HOUR, DAY = 10**6, 3600 * 10**9, 86400 * 10**9
PROGRAM = str(Path(__file__).with_name("correction_publisher.py"))


def message(names=NAMES, positions=CORRECTION, age_ns=0, stamp_ns=None, frame="base"):
    stamp_ns = time.time_ns() - age_ns if stamp_ns is None else stamp_ns
    filled = messages.joint_state_message(max(stamp_ns, 0), frame, names, [0.0] * len(names))
    filled.position = array("d", positions)
    filled.velocity, filled.effort = array("d", bytes(8 * len(positions))), array("d", bytes(8 * len(positions)))
    return filled


class CorrectionMaker:
    """One publisher of corrections."""

    def __init__(self, cell, name="axis_corrections"):
        self.cell, self.topic = cell, cell.wire.topic(name)
        self.publisher = cell.node.create_publisher(JointState, self.topic.name, 10)

    def send(self, *args, **kwargs):
        self.publisher.publish(message(*args, **kwargs))

    def until(self, condition, what, *args, **kwargs):
        """Send a message at each turn of the cell, some twenty or more a second, until the condition holds."""

        def step():
            self.send(*args, **kwargs)
            return condition()

        self.cell.wait_until(step, what)

    def end(self):
        self.cell.node.destroy_publisher(self.publisher)


@pytest.fixture
def mock(cell):
    cell.run(MockController, "mock_controller", machine="xyzac_trt")
    return cell


@pytest.fixture
def applied(mock):
    return mock.collect(mock.wire.topic("applied_corrections"))


def is_applied(applied, values=CORRECTION):
    return bool(applied) and list(applied[-1].position) == pytest.approx(values, abs=1e-12)


def test_what_is_in_effect_is_published_before_the_first_correction_and_on_the_way_to_it(mock, applied):
    mock.wait_for_status(STATUS, "held: no correction has come yet on /machine/axis_corrections")
    mock.wait_until(lambda: len(applied) > 3, "applied corrections")
    assert all(list(each.position) == [0.0] * 5 == list(each.velocity) == list(each.effort) for each in applied)
    assert tuple(applied[0].name) == NAMES
    assert applied[0].header.frame_id == "base"
    corrector, far = CorrectionMaker(mock), (4e-4, 0.0, 0.0, 0.0, 0.0)
    begin = len(applied)
    corrector.until(lambda: is_applied(applied, far), "the correction to be applied", positions=far)
    corrector.until(lambda: mock.status(STATUS).message == "applied", "the mock to say so", positions=far)
    way = applied[begin - 1 :]
    stamps = [messages.ns_from_stamp(each.header.stamp) for each in way]
    for before, after in itertools.pairwise(way):
        elapsed = (messages.ns_from_stamp(after.header.stamp) - messages.ns_from_stamp(before.header.stamp)) * 1e-9
        moved = after.position[0] - before.position[0]
        assert -1e-15 <= moved <= 2e-3 * elapsed * 1.000001
        assert after.velocity[0] in (0.0, pytest.approx(moved / elapsed))
    assert max(each.velocity[0] for each in way) > 1e-3
    assert len({stamp // (50 * MS) for stamp in stamps}) == len(stamps), "20 a second at most"


WRONG = {
    "of the workpiece": ({"frame": "workpiece"}, "frame", "in the frame 'workpiece'; expected 'base'"),
    "of no frame": ({"frame": ""}, "frame", "in the frame ''; expected 'base'"),
    "X alone": ({"names": "X", "positions": (3e-4,)}, "axes", "missing Y Z A C"),
    "empty": ({"names": (), "positions": ()}, "axes", "missing X Y Z A C"),
    "X twice": ({"names": ("X", *NAMES), "positions": (3e-4, *CORRECTION)}, "axes", "twice X"),
    "no positions": ({"positions": ()}, "numbers", "5 names, 0 positions"),
    "NaN": ({"positions": (math.nan, *CORRECTION[1:])}, "numbers", "correction of X is nan"),
    "infinite": ({"positions": (*CORRECTION[:4], math.inf)}, "numbers", "correction of C is inf"),
    "1e300": ({"positions": (1e300, *CORRECTION[1:])}, "size", "correction of X is 1e+300"),
    "no stamp": ({"stamp_ns": 0}, "stamp", "without a stamp"),
    "an hour old": ({"age_ns": HOUR}, "age", "s old; expected at most 0.1 s"),
    "1 s ahead": ({"age_ns": -1000 * MS}, "ahead", "s ahead of the clock"),
    "365 days ahead": ({"age_ns": -365 * DAY}, "ahead", "s ahead of the clock"),
}


def test_wrong_messages_hold_are_said_and_counted_and_the_next_right_one_ends_it(mock, applied):
    corrector = CorrectionMaker(mock)
    for name, (wrong, doubt, words) in WRONG.items():
        corrector.until(lambda: is_applied(applied), "the correction to be applied")
        corrector.until(lambda: mock.status(STATUS).message.startswith("applied"), "the mock to say so")
        before = int(mock.figures(STATUS)[f"refused_{doubt}"])
        begin = len(applied)
        corrector.until(
            lambda words=words: mock.has_status(STATUS, "held for") and mock.has_status(STATUS, words), name, **wrong
        )
        assert mock.status(STATUS).level == b"\x02", name
        assert int(mock.figures(STATUS)[f"refused_{doubt}"]) > before, name
        for each in applied[begin:]:
            assert list(each.position) == pytest.approx(CORRECTION, abs=1e-12), name


@pytest.mark.parametrize(("names", "later_ns", "words"), [
    ("X", 1, "corrections of the axes X;"),
    (NAMES, 0, "correction is 0 s before the last one believed"),
    (NAMES, -MS, "correction is 0.001 s before the last one believed"),
], ids=["X alone", "repeated stamp", "falling stamp"])  # fmt: skip
def test_a_wrong_message_among_right_ones_is_said_too(mock, applied, names, later_ns, words):
    corrector = CorrectionMaker(mock)
    corrector.until(lambda: is_applied(applied), "the correction to be applied")

    def said():
        stamp_ns = time.time_ns()
        corrector.send(stamp_ns=stamp_ns)
        corrector.send(names, (3e-4,) * len(names), stamp_ns=stamp_ns + later_ns)
        return mock.status(STATUS).message.startswith("applied; ") and mock.has_status(STATUS, words)

    begin = len(applied)
    mock.wait_until(said, "the remark")
    assert mock.status(STATUS).level == b"\x01"
    assert all(list(each.position) == pytest.approx(CORRECTION, abs=1e-12) for each in applied[begin:])


def test_silence_holds_and_says_for_how_long(mock, applied):
    corrector = CorrectionMaker(mock)
    corrector.until(lambda: is_applied(applied), "the correction to be applied")
    status = mock.wait_for_status(STATUS, "no correction comes on /machine/axis_corrections")
    assert status.message.startswith("held for ")
    assert status.level == b"\x01"
    assert mock.figures(STATUS)["publishers"].startswith("/test_harness")
    assert is_applied(applied)
    corrector.until(lambda: mock.status(STATUS).message == "applied", "corrections to be followed again")


def test_two_publishers_that_swing_an_axis_hold_it_until_one_is_left(mock, applied):
    first = CorrectionMaker(mock)
    first.until(lambda: is_applied(applied), "the correction to be applied")
    second, begin = CorrectionMaker(mock), len(applied)

    def swing():
        first.send(positions=(4e-4, *CORRECTION[1:]))
        second.send(positions=(-4e-4, *CORRECTION[1:]))
        return mock.has_status(STATUS, "2 publishers send corrections at once: /test_harness, /test_harness")

    mock.wait_until(swing, "the second publisher to be said")
    assert mock.status(STATUS).level == b"\x02"
    begin = len(applied)

    def rests():
        """For half a second, wherever the first words of the second had it."""
        swing()
        return len(applied) > begin + 10 and len({each.position[0] for each in applied[-10:]}) == 1

    mock.wait_until(rests, "the axis to rest while both speak")
    second.end()
    first.until(lambda: is_applied(applied), "the one that is left to be followed")
    first.until(lambda: mock.status(STATUS).message.startswith("applied"), "the mock to say so")


def test_a_second_publisher_that_says_nothing_yet_is_noticed(mock, applied):
    first = CorrectionMaker(mock)
    first.until(lambda: is_applied(applied), "the correction to be applied")
    second = CorrectionMaker(mock)
    first.until(lambda: mock.has_status(STATUS, "2 publishers of corrections are there"), "it to be said")
    second.end()
    first.until(lambda: mock.status(STATUS).message.startswith("applied"), "corrections to be followed again")


def test_a_restart_in_good_order_goes_on(mock, applied):
    for share in (1.0, 0.5, -1.0):
        corrector, values = CorrectionMaker(mock), tuple(share * value for value in CORRECTION)
        corrector.until(
            lambda values=values: is_applied(applied, values), "corrections to be followed", positions=values
        )
        corrector.end()


def test_a_publisher_that_was_killed_is_not_waited_for_though_it_is_listed_for_20_s(mock, applied):
    environment = {**os.environ, "ROS_DOMAIN_ID": str(mock.node.context.get_domain_id())}
    for micrometres in (5, -5, 10):
        values = (micrometres * 1e-6, 0.0, 0.0, 0.0, 0.0)
        process = subprocess.Popen([sys.executable, PROGRAM, "compensation", str(values[0])], env=environment)
        try:
            mock.wait_until(lambda values=values: is_applied(applied, values), "corrections to be followed")
            mock.wait_until(lambda: mock.status(STATUS).message.startswith("applied"), "the mock to say so")
        finally:
            process.kill()
            process.wait()


def test_a_publisher_that_cannot_be_heard_is_named_with_the_reason(mock):
    quality = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
    mock.node.create_publisher(JointState, "/machine/axis_corrections", quality)
    mock.wait_until(
        lambda: "/test_harness (not heard: ERROR: Best effort" in mock.figures(STATUS)["publishers"], "its name"
    )
    assert mock.status(STATUS).message == "held: no correction has come yet on /machine/axis_corrections"


def test_the_log_ends_with_what_is_so_however_often_it_changes(mock, monkeypatch):
    """Each state is logged once a second at most: the last one of several is logged as soon as it is due."""
    corrector, log = CorrectionMaker(mock), Log(monkeypatch, MockController)

    def logs(word):
        return re.findall("corrections: (applied|held)", "\n".join(log.lines))[-1:] == [word]

    for _ in range(3):
        corrector.until(lambda: mock.has_status(STATUS, "applied"), "corrections that are applied")
        mock.wait_for_status(STATUS, "no correction comes")
    corrector.until(lambda: logs("applied"), "the log to say that corrections are applied")
    mock.wait_until(lambda: logs("held"), "the log to say that they are held")
