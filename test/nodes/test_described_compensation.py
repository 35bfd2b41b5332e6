"""The shipped grinder, a machine without monitored axis, on the compensation node: joint states alone correct it."""

from __future__ import annotations

import time

import numpy as np
import pytest
from faults.documenting import Row, shows
from faults.live.other_programs import stated
from nodes.node_log import Log
from received_blocks import block_of
from std_srvs.srv import Trigger

from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.cli import main
from rotary_error_monitor.nodes import messages
from rotary_error_monitor.nodes.compensation import Compensation
from rotary_error_monitor.nodes.mock_controller import MockController
from rotary_error_monitor.nodes.recorder import Recorder

GRINDER = "grinder_zhou2023"
RELAXED = {"age_limit": 1.0}  # the tests share few cores


def test_joint_states_alone_correct_y_and_a_replay_repeats_it(cell, tmp_path, capsys):
    corrections, left = (cell.collect(cell.wire.topic(key)) for key in ("axis_corrections", "corrected_offset_pose"))
    samples = cell.wire.topic("tool_offset_samples")
    offsets = cell.collect(samples)
    bag = tmp_path / "bag"
    recorder = cell.run(Recorder, "recorder", folder=str(bag))
    cell.run(MockController, "mock_controller", machine=GRINDER)
    # what is too old is not sent, and the rate limit counts from what was: a replay knows of no computer that was busy
    compensation = cell.run(Compensation, "compensation", machine=GRINDER, age_limit=10.0)
    cell.wait_until(lambda: len(corrections) > 100 and len(left) > 30, "corrections")
    cell.wait_for_status("compensation: correction", "correcting")
    assert list(corrections[-1].name) == ["X", "Z", "Y"]
    assert abs(corrections[-1].position[2]) > 1e-7
    assert np.abs([message.position[:2] for message in corrections]).max() < 1e-11
    assert abs(left[-1].pose.pose.position.y) < 1e-9
    names = {name for name, _ in cell.node.get_subscriber_names_and_types_by_node("compensation", "/")}
    assert cell.wire.topic("error_motion_samples").name not in names

    cell.remove(compensation)
    last_ns = messages.ns_from_stamp(corrections[-1].header.stamp)
    cell.wait_until(lambda: block_of(offsets[-1]).times_ns[-1] >= last_ns, "the offset of the last correction")
    cell.remove(recorder)
    out = tmp_path / "out.npz"
    assert main(["replay", str(bag), "--machine", GRINDER, "-o", str(out)]) == 0
    assert "joint states over" in capsys.readouterr().out
    (published,) = BagReader(bag).read_blocks([samples.name]).values()
    with np.load(out) as found:
        stamps = np.concatenate([block.times_ns for block in published])
        at = np.searchsorted(found["stamp_ns"], stamps)
        np.testing.assert_array_equal(found["stamp_ns"][at], stamps)
        rows = np.concatenate([block.rows[:, 1:7] for block in published])
        np.testing.assert_array_equal(found["tool_offset"][at], rows)
        assert np.isnan(found["error_motion"]).all()
        sent = {messages.ns_from_stamp(each.header.stamp): list(each.position) for each in corrections}
        again = dict(zip(found["correction_stamp_ns"].tolist(), found["corrections"].tolist(), strict=True))
        # The rate limit counts from the first offset, which the recorder may have come too late for.
        settled = sorted(set(sent) & set(again))[3:]
        assert len(settled) > 50
        assert [sent[stamp] for stamp in settled] == [again[stamp] for stamp in settled]


@shows(
    Row(
        "corrections",
        "Two compensations, also of the same joint states and hence with corrections of the same stamps",
        "by whoever hears a correction that is not its own, or one of its own a second time; by the other in the list "
        "of publishers, as a warning",
        "who hears the other holds; the controller takes none of either",
        "corrections of one at most, which do not move the axes; offsets go on",
        "within 3 s after one of them has ended",
    )
)
def test_of_two_compensations_one_at_most_speaks_and_both_say_so(cell):
    topic, samples = cell.wire.topic("axis_corrections"), cell.wire.topic("tool_offset_samples")
    corrections, offsets = cell.collect(topic), cell.collect(samples)
    cell.run(MockController, "mock_controller", machine=GRINDER)
    cell.run(Compensation, "compensation", machine=GRINDER, **RELAXED)
    cell.wait_until(lambda: len(corrections) > 10, "corrections")
    diagnostics, controller = cell.collect(cell.wire.topic("diagnostics")), "mock_controller: corrections"
    second = cell.run(Compensation, "compensation_b", machine=GRINDER, **RELAXED)
    names = ("compensation", "compensation_b")
    words = f"held: several publishers share {topic.name}", f"may publish {topic.name} too"

    def both_say_so() -> bool:
        return all(any(cell.has_status(f"{name}: correction", each) for each in words) for name in names)

    cell.wait_until(both_say_so, "a word of both")
    cell.wait_until(lambda: any(cell.has_status(f"{name}: correction", words[0]) for name in names), "one to hold")
    said_of_both = "2 publishers of corrections are there", "2 publishers send corrections at once"

    def controller_says_so() -> bool:
        """Also before both had heard each other; from then on no correction comes at all."""
        said = [status.message for each in diagnostics for status in each.status if status.name == controller]
        return any(words in message for words in said_of_both for message in said)

    cell.wait_until(controller_says_so, "the controller's word of two publishers")
    cell.wait_for_status("mock_controller: corrections", "held")
    # what is stamped later was on its way from nobody by then, however long it takes
    held_ns, offsets_before = time.time_ns(), len(offsets)
    cell.spin_for(2.5)
    stamps = [stamp for each in corrections if (stamp := messages.ns_from_stamp(each.header.stamp)) > held_ns]
    assert len(stamps) == len(set(stamps)), "of one at most"
    cell.wait_until(lambda: len(offsets) > offsets_before, "offsets, which go on")
    cell.remove(second)
    before = len(corrections)
    with stated("corrections of the one that is left", 3.0):
        cell.wait_until(lambda: len(corrections) > before + 10, "corrections of the one that is left")
    cell.wait_for_status("mock_controller: corrections", "applied")


@pytest.fixture
def log(monkeypatch):
    return Log(monkeypatch, Compensation)


LATCHED = "corrections are held: error limit latched until ~/reset is called"
LATCHING = {"linear__warning": 1e-7, "linear__error": 2e-7}
"""Limits below what the grinder needs: whatever is computed latches."""


def test_each_reset_and_each_latch_after_it_is_logged(cell, log):
    """Of joint states 10 ms apart the next one latches again, before anybody looks."""
    cell.run(MockController, "mock_controller", machine=GRINDER)
    cell.run(Compensation, "compensation", machine=GRINDER, **RELAXED, **LATCHING)
    for count in range(1, 6):
        cell.wait_until(lambda count=count: log.count(LATCHED) >= count, f"latch {count} in the log")
        cell.spin_for(0.5)  # nothing more is logged of it
        assert cell.call(Trigger, "/compensation/reset").message.startswith("released")
    cell.wait_until(lambda: log.count(LATCHED) >= 6, "the last latch in the log")
    cell.wait_for_status("compensation: correction", LATCHED.removeprefix("corrections are held: "))
    cell.spin_for(0.5)
    assert log.count("reset: released") == 5
    assert log.count(LATCHED) == 6
    assert log.count("later than the age limit") == 0


def test_a_latch_behind_another_hold_is_logged_and_so_is_one_that_comes_back(cell, log):
    silent = "corrections are held: no joint states"
    cell.run(Compensation, "compensation", machine=GRINDER, **RELAXED, **LATCHING)
    cell.wait_until(lambda: log.count(silent) == 1, "a hold")
    controller = cell.run(MockController, "mock_controller", machine=GRINDER)
    cell.wait_until(lambda: log.count(LATCHED) == 1, "the latch behind it")
    controller.trigger_deactivate()
    topic = cell.wire.topic("machine_joint_states").name
    cell.wait_for_status(f"compensation: {topic}", "stale")
    assert cell.call(Trigger, "/compensation/reset").message.startswith("released")
    cell.wait_until(lambda: log.count(silent) == 2, "the hold that the latch had hidden")
    controller.trigger_activate()
    cell.wait_until(lambda: log.count(LATCHED) == 2, "the latch that came back")
    cell.wait_for_status("compensation: correction", LATCHED.removeprefix("corrections are held: "))


def test_when_joint_states_stop_corrections_stop(cell):
    corrections = cell.collect(cell.wire.topic("axis_corrections"))
    controller = cell.run(MockController, "mock_controller", machine=GRINDER)
    cell.run(Compensation, "compensation", machine=GRINDER, **RELAXED)
    cell.wait_until(lambda: len(corrections) > 10, "corrections")
    controller.trigger_deactivate()
    cell.wait_for_status("compensation: correction", "held: no joint states for")
    cell.wait_for_silence(corrections)
    before = len(corrections)
    controller.trigger_activate()
    cell.wait_until(lambda: len(corrections) > before, "corrections again")
