"""The compensation as a node: corrections that null the offset, and none at all when something is wrong."""

from __future__ import annotations

import math
import signal
import time

import numpy as np
import pytest
from faults.documenting import Row, shows
from kernels import computing_by
from nodes.plant_samples import assert_figures
from received_blocks import block_of
from std_srvs.srv import Trigger

from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.description.wire import Topic, load_wire
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.machine.error_model import predict_tool_offset
from rotary_error_monitor.machine.kinematics import arrange_machine
from rotary_error_monitor.nodes import managed, messages
from rotary_error_monitor.nodes.compensation import Compensation
from rotary_error_monitor.nodes.mock_controller import MockController
from rotary_error_monitor.pipeline.corrections import OFFSET
from rotary_error_monitor.signals.blocks import block_from_samples
from rotary_error_monitor.testing import silence

STEP_NS = 20_000_000
ALL_BUT_AXIAL = 0b111011
RELAXED = {"age_limit": 1.0, "hold_limit": 600.0}  # the tests share few cores, and look at holds
COLUMNS = load_wire().topic("error_motion_samples").columns


class MotionFeed:
    """Publishes error motion as an estimator would, in step with the clock: `exc` as told, theta as commanded."""

    def __init__(self, cell, plant) -> None:
        self._cell, self._plant = cell, plant
        self._topic = cell.wire.topic("error_motion_samples")
        self._send = cell.publish_on(self._topic)
        self.frame = self._topic.frame
        self.sent_ns = 0
        self.observable = ALL_BUT_AXIAL

    def send(self, exc: float = 2e-6, theta_offset: float = 0.0, ahead_ns: int = 0) -> int:
        now_ns = self._cell.node.get_clock().now().nanoseconds + ahead_ns
        stamps = (now_ns // STEP_NS) * STEP_NS - np.arange(3, -1, -1) * 5_000_000
        if stamps[0] <= self.sent_ns:
            return self.sent_ns
        rows = np.zeros((len(stamps), len(COLUMNS)))
        command, _ = self._plant.motion.at((stamps - self._plant.epoch_ns) * 1e-9)
        lives = exc * (1.0 + 1e-9 * np.sin(1e-9 * (stamps % 10**9)))  # no estimate of a rotor in motion is constant
        values = {"theta": command + theta_offset, "exc": lives, "observable": self.observable, "streams": 63}
        values |= {f"var_{name}": 1e-16 for name in ("exc", "eyc", "eac", "ebc", "ecc")}
        for name, value in values.items():
            rows[:, COLUMNS.index(name)] = value
        self._send(messages.block_bytes(block_from_samples(stamps, COLUMNS, rows), self.frame))
        self.sent_ns = self.sent_ns if ahead_ns else int(stamps[-1])
        return self.sent_ns

    def run_until(self, condition, what: str, exc: float = 2e-6, theta_offset: float = 0.0) -> None:
        def fed() -> bool:
            self.send(exc, theta_offset)
            return condition()

        self._cell.wait_until(fed, what)

    def run_for(self, seconds: float, **motion: float) -> None:
        end_ns = self._cell.node.get_clock().now().nanoseconds + round(seconds * 1e9)
        self.run_until(lambda: self._cell.node.get_clock().now().nanoseconds > end_ns, "time to pass", **motion)


@pytest.fixture
def feed(cell, plant):
    return MotionFeed(cell, plant)


@pytest.fixture
def corrections(cell):
    return cell.collect(cell.wire.topic("axis_corrections"))


def is_held_for(cell, reason: str):
    def held() -> bool:
        return cell.has_status("compensation: correction", f"held: {reason}")

    return held


def test_corrections_null_the_offset(cell, plant, feed, corrections):
    offsets, left, blocks, figures = (
        cell.collect(cell.wire.topic(key))
        for key in ("tool_offset_pose", "corrected_offset_pose", "tool_offset_samples", "tool_offset_figures")
    )
    cell.run(MockController, "mock_controller", machine="xyzac_trt")
    cell.run(Compensation, "compensation", machine="xyzac_trt", **RELAXED)
    feed.run_until(lambda: len(corrections) > 100 and len(left) > 20, "corrections")
    position = left[-1].pose.pose.position
    assert np.hypot(position.x, np.hypot(position.y, position.z)) < 1e-9
    position = offsets[-1].pose.pose.position
    assert np.hypot(position.x, np.hypot(position.y, position.z)) > 1e-6
    assert np.diag(np.reshape(offsets[-1].pose.covariance, (6, 6))).min() >= -1.0
    assert list(corrections[-1].name) == ["X", "Y", "Z", "A", "C"]
    assert all(math.isfinite(value) for value in [*corrections[-1].position, *corrections[-1].velocity])
    feed.run_until(lambda: cell.has_status("compensation: correction", "correcting"), "a word that all is well")
    block = block_of(blocks[-1])
    assert block.names == ("t", *cell.wire.topic("tool_offset_samples").columns)
    assert_figures(figures, blocks, OFFSET)


def test_the_offset_is_that_of_the_model(cell, plant, feed):
    """At a pose that the test knows: joint states of its own, standing still."""
    machine = load_machine("xyzac_trt")
    blocks = cell.collect(cell.wire.topic("tool_offset_samples"))
    send_joints = cell.publish_on(cell.wire.topic("machine_joint_states"))
    cell.run(Compensation, "compensation", machine="xyzac_trt", **RELAXED, position_tolerance=3.15)
    pose = [0.1, -0.05, 0.02, 0.3]

    def told() -> bool:
        now_ns = cell.node.get_clock().now().nanoseconds
        send_joints(messages.joint_state_message(now_ns, "base", "XYZA", pose, [1.0, 1.0, 1.0, 1.0]))
        return len(blocks) > 3

    feed.run_until(told, "offsets")
    block = block_of(blocks[-1])
    command, _ = plant.motion.at((block.times_ns[:1] - plant.epoch_ns) * 1e-9)
    live = np.array([[2e-6, 0.0, np.nan, 0.0, 0.0, 0.0]])
    expected = predict_tool_offset(
        arrange_machine(machine),
        np.array([[*pose, command[0]]]),
        direction=np.array([[1.0, 1.0, 1.0, 1.0, 0.0]]),
        temperature=np.array([20.0]),
        monitored=live,
    )
    np.testing.assert_allclose(block.rows[0, 1:7], expected[0], rtol=0, atol=1e-12)


def test_by_which_form_of_the_model_it_computes_is_logged_where_it_is_the_slower_one(cell, capfd):
    with computing_by("numpy"):
        cell.run(Compensation, "compensation", machine="xyzac_trt")
    log = capfd.readouterr().err
    assert log.count("the machine model is computed by numpy, which is slower: ROTARY_ERROR_MONITOR_KERNEL=numpy") == 1


def test_the_first_correction_goes_on_from_what_is_in_effect_by_then(cell, plant, feed, corrections):
    """Started while the controller is on its way: what it said at first is no longer so when corrections may go out."""
    send_joints, send_applied = (
        cell.publish_on(cell.wire.topic(name)) for name in ("machine_joint_states", "applied_corrections")
    )
    cell.run(Compensation, "compensation", machine="xyzac_trt", **RELAXED)

    def stand(applied: float) -> None:
        now_ns = cell.node.get_clock().now().nanoseconds
        turned, speed = plant.motion.at(np.array([(now_ns - plant.epoch_ns) * 1e-9]))
        pose, moving = [0.1, -0.05, 0.02, 0.3, float(turned[0])], [0.0, 0.0, 0.0, 0.0, float(speed[0])]
        send_joints(messages.joint_state_message(now_ns, "base", "XYZAC", pose, moving))
        send_applied(messages.joint_state_message(now_ns, "base", "XYZAC", [applied, 0.0, 0.0, 0.0, 0.0], [0.0] * 5))

    def waits() -> bool:
        stand(9e-5)
        return cell.has_status("compensation: correction", "held: no error motion yet")

    def flows() -> bool:
        stand(4e-4)
        return bool(corrections)

    cell.wait_until(waits, "the compensation to wait")
    cell.spin_for(0.5)
    stand(4e-4)
    cell.spin_for(0.5)
    feed.run_until(flows, "corrections")
    assert corrections[0].position[0] == pytest.approx(4e-4, abs=2e-3 * 0.02)


def test_what_is_stamped_an_hour_ahead_is_refused_and_said_and_costs_nothing_else(cell, plant, feed, corrections):
    """One block of error motion, one joint state: the rest of the hour was not "after the one before"."""
    send_joints = cell.publish_on(cell.wire.topic("machine_joint_states"))
    cell.run(Compensation, "compensation", machine="xyzac_trt", **RELAXED, feedback_patience=0.0)

    def stand(ahead_ns: int = 0) -> None:
        now_ns = cell.node.get_clock().now().nanoseconds
        turned, speed = plant.motion.at(np.array([(now_ns - plant.epoch_ns) * 1e-9]))
        pose, moving = [0.1, -0.05, 0.02, 0.3, float(turned[0])], [0.0, 0.0, 0.0, 0.0, float(speed[0])]
        send_joints(messages.joint_state_message(now_ns + ahead_ns, "base", "XYZAC", pose, moving))

    def come(count: int) -> bool:
        stand()
        return len(corrections) >= count

    feed.run_until(lambda: come(20), "corrections")
    for word, send in (
        ("error_motion", lambda: feed.send(ahead_ns=3600 * 10**9)),
        ("joint_states", lambda: stand(3600 * 10**9)),
    ):
        send()
        feed.run_until(
            lambda word=word: (
                stand() or any(word in name and "ahead" in each.message for name, each in cell.statuses.items())
            ),
            f"a word about {word}",
        )
        before = len(corrections)
        feed.run_until(lambda before=before: come(before + 20), f"corrections after that of {word}")
    newest = max(messages.ns_from_stamp(each.header.stamp) for each in corrections)
    assert newest < cell.node.get_clock().now().nanoseconds + 10**9


def test_joint_states_stop(cell, feed, corrections):
    controller = cell.run(MockController, "mock_controller", machine="xyzac_trt")
    cell.run(Compensation, "compensation", machine="xyzac_trt", **RELAXED)
    feed.run_until(lambda: len(corrections) > 10, "corrections")
    controller.trigger_deactivate()
    stopped_ns = cell.node.get_clock().now().nanoseconds
    feed.run_until(is_held_for(cell, "no joint states for"), "the reason")
    feed.run_until(silence(corrections), "no more corrections")
    newest = corrections[-1].header.stamp
    assert messages.ns_from_stamp(newest) < stopped_ns + 700_000_000
    before = len(corrections)
    controller.trigger_activate()
    feed.run_until(lambda: len(corrections) > before, "corrections again")
    feed.run_until(lambda: not cell.has_status("compensation: correction", "held"), "a word that they flow")


def test_error_motion_stops_and_comes_back(cell, feed, corrections):
    cell.run(MockController, "mock_controller", machine="xyzac_trt")
    cell.run(Compensation, "compensation", machine="xyzac_trt", **RELAXED)
    cell.wait_for_status("compensation: correction", "held: no error motion yet")
    feed.run_until(lambda: len(corrections) > 10, "corrections")
    cell.wait_for_status("compensation: correction", "held: no error motion for")
    cell.wait_for_silence(corrections)
    before = len(corrections)
    feed.run_until(lambda: len(corrections) > before, "corrections again")
    step = np.abs(np.subtract(corrections[before].position, corrections[before - 1].position))
    assert (step[:3] <= 2e-3 * 0.1 + 1e-12).all(), "no jump: the pause counts for the rate limit as a short one"


def test_a_long_hold_goes_on_to_what_the_description_says(cell, plant, feed, corrections):
    """And from there back to the error motion, both at the rate limit."""
    reports = cell.collect(cell.wire.topic("corrected_offset_pose"))
    cell.run(MockController, "mock_controller", machine="xyzac_trt")
    cell.run(Compensation, "compensation", machine="xyzac_trt", age_limit=1.0, hold_limit=0.5)
    feed.run_until(lambda: len(corrections) > 10, "corrections")
    cell.wait_for_status("compensation: correction", "from the description alone")
    before = len(reports)
    cell.wait_until(lambda: len(reports) > before + 3, "what is left")
    assert np.diag(np.reshape(reports[-1].pose.covariance, (6, 6)))[:3].max() > 1e-14, "more than with error motion"
    feed.run_until(lambda: cell.has_status("compensation: correction", "correcting"), "a word that all is well")
    positions = np.array([message.position for message in corrections])
    stamps = np.array([messages.ns_from_stamp(message.header.stamp) for message in corrections])
    allowed = np.array([2e-3, 2e-3, 2e-3, 2e-2, 2e-2]) * np.minimum(np.diff(stamps) * 1e-9, 0.1)[:, None]
    assert (np.abs(np.diff(positions, axis=0)) <= allowed + 1e-12).all()


def test_an_error_limit_latches_until_it_is_reset(cell, feed, corrections):
    small = {"linear__warning": 1e-5, "linear__error": 2e-5}  # a stage may have a larger error motion than that
    cell.run(MockController, "mock_controller", machine="xyzac_trt")
    cell.run(Compensation, "compensation", machine="xyzac_trt", **RELAXED, **small)
    feed.run_until(lambda: len(corrections) > 10, "corrections")
    feed.run_until(is_held_for(cell, "error limit latched until ~/reset is called: correction"), "the latch", exc=4e-5)
    feed.run_until(silence(corrections), "it to hold though what made it latch is gone")
    assert all(abs(value) <= 2e-5 for message in corrections for value in list(message.position)[:3])
    before = len(corrections)
    answer = cell.call(Trigger, "/compensation/reset")
    assert answer.success
    assert "beyond the error limit" in answer.message
    feed.run_until(lambda: len(corrections) > before, "corrections after the reset")
    assert cell.call(Trigger, "/compensation/reset").message == "nothing was latched"


TWO = "several publishers share {topic}"


@shows(
    Row(
        "joints",
        "Two thermometers on the topic of the machine's temperature",
        "by the order of the messages' numbers, with the third message: held, and who publishes",
        "neither is believed; where no axis expands, a temperature is not needed and nothing is held",
        "no correction",
        "1 s after the last message of the other, or 2.5 pauses between two messages",
    )
)
def test_of_two_thermometers_none_is_believed_and_corrections_hold(cell, feed, corrections):
    temperature = cell.wire.topic("machine_temperature")
    cell.run(MockController, "mock_controller", machine="xyzac_trt")
    cell.run(Compensation, "compensation", machine="xyzac_trt", **RELAXED)
    feed.run_until(lambda: len(corrections) > 10, "corrections")
    send = cell.publish_on(temperature)
    due = 0.0

    def is_held() -> bool:
        nonlocal due
        if time.monotonic() > due:
            due = time.monotonic() + 0.3
            send(messages.temperature_message(cell.node.get_clock().now().nanoseconds, temperature.frame, 20.3))
        return is_held_for(cell, TWO.format(topic=temperature.name))()

    feed.run_until(is_held, "the reason")
    is_silent = silence(corrections)

    def is_held_and_silent() -> bool:
        is_held()  # speaks
        return is_silent()

    feed.run_until(is_held_and_silent, "no more corrections while both speak")
    before = len(corrections)
    feed.run_until(lambda: len(corrections) > before, "corrections of one thermometer")


def test_encoder_and_joint_states_contradict_one_another(cell, feed, corrections):
    cell.run(MockController, "mock_controller", machine="xyzac_trt")
    cell.run(Compensation, "compensation", machine="xyzac_trt", **RELAXED)
    feed.run_until(is_held_for(cell, "axis C stands at"), "the reason", theta_offset=0.3)
    assert corrections == []


def test_warning_and_rate_limits_are_told(cell, feed, corrections):
    cell.run(MockController, "mock_controller", machine="xyzac_trt")
    cell.run(Compensation, "compensation", machine="xyzac_trt", **RELAXED, linear__warning=1e-8, linear__rate=1e-3)
    feed.run_until(lambda: cell.has_status("compensation: correction", "beyond the warning limit"), "the warning")
    feed.run_until(lambda: len(corrections) > 0, "corrections all the same")


def test_what_comes_later_than_the_age_limit_is_not_published(cell, plant, corrections):
    offsets = cell.collect(cell.wire.topic("tool_offset_samples"))
    feed = MotionFeed(cell, plant)
    cell.run(MockController, "mock_controller", machine="xyzac_trt")
    cell.run(Compensation, "compensation", machine="xyzac_trt", age_limit=0.001)
    feed.run_for(1.5)
    feed.run_until(is_held_for(cell, ""), "a word that nothing flows")
    assert offsets == corrections == []


def test_wrong_joint_states_are_refused(cell, feed):
    topic: Topic = cell.wire.topic("machine_joint_states")
    send = cell.publish_on(topic)
    cell.run(Compensation, "compensation", machine="xyzac_trt")
    now_ns = cell.node.get_clock().now().nanoseconds
    message = messages.joint_state_message(now_ns, "base", "XYZAC", [math.nan] * 5)
    send(message)
    cell.wait_for_status(f"compensation: refused {topic.name}", "all must be finite")
    send(messages.joint_state_message(now_ns, "base", "XY", [0.0, 0.0]))
    cell.wait_for_status(f"compensation: refused {topic.name}", "lacks axis")


@shows(
    Row(
        "messages",
        "Error motion, or corrections, in another frame than the contract's, or in none",
        "`compensation: refused …/error_motion/samples`; `corrections` of the controller's node, `refused_frame`: both "
        "frames are named",
        "the message is refused: its components are along other axes, though their sizes tell nothing of it",
        "corrections are held",
        "with the first message in the right frame",
    )
)
@pytest.mark.parametrize("frame", ["workpiece", ""])
def test_error_motion_in_another_frame_is_refused_and_both_are_named(cell, feed, corrections, frame):
    cell.run(MockController, "mock_controller", machine="xyzac_trt")
    cell.run(Compensation, "compensation", machine="xyzac_trt", age_limit=0.5)
    feed.run_until(lambda: bool(corrections), "corrections")
    feed.frame = frame
    refused = f"compensation: refused {cell.wire.topic('error_motion_samples').name}"
    feed.run_until(lambda: cell.has_status(refused, f"in the frame '{frame}'; expected 'stage'"), "a word")
    feed.run_until(is_held_for(cell, "no error motion for"), "the hold")
    before = len(corrections)
    feed.frame = "stage"
    feed.run_until(lambda: len(corrections) > before, "corrections again")


WRONG_INPUTS = {
    "mm for m": (lambda position: 1e3 * position, 20.0, "joint states are not believed: axis X at 70 m is beyond"),
    "huge": (lambda position: 1e300, 20.0, "joint states are not believed: axis X at 1e+300 m is beyond"),
    "a temperature in another unit": (lambda position: position, 1e6, "temperature not believed: 1e+06 °C is beyond"),
}
"""What becomes of the position of X, the temperature (°C) beside it, and what is to be said."""


@pytest.mark.parametrize(("of_x", "warmth", "said"), WRONG_INPUTS.values(), ids=WRONG_INPUTS)
def test_a_wrong_input_is_told_by_its_value_and_not_as_an_age(cell, feed, corrections, of_x, warmth, said):
    """With all other inputs fresh and right."""
    joints, temperature = (cell.wire.topic(key) for key in ("machine_joint_states", "machine_temperature"))
    send_joints, send_temperature = cell.publish_on(joints), cell.publish_on(temperature)
    cell.run(Compensation, "compensation", machine="xyzac_trt", **RELAXED, position_tolerance=3.15)
    heard = cell.collect(cell.wire.topic("diagnostics"))
    pose = [of_x(0.07), -0.05, 0.02, 0.3, 0.0]

    def told() -> bool:
        now_ns = cell.node.get_clock().now().nanoseconds
        send_joints(messages.joint_state_message(now_ns, "base", "XYZAC", pose, [0.0] * 5))
        send_temperature(messages.temperature_message(now_ns, temperature.frame, warmth))
        return cell.has_status("compensation: correction", said)

    feed.run_until(told, f"the reason: {said}")
    assert not any(any(correction.position) for correction in corrections)
    words = [each.message for array in heard for each in array.status if each.name.endswith("compensation: correction")]
    assert words and not [text for text in words if "age limit" in text]


def test_what_is_not_believed_is_said_without_waiting_for_the_next_second(cell, plant, feed, corrections, monkeypatch):
    """Here no such second comes: a fault of 0.3 s between two reports would not have been told."""
    monkeypatch.setattr(managed, "_DIAGNOSTICS_PERIOD", 3600.0)
    joints, temperature = (cell.wire.topic(key) for key in ("machine_joint_states", "machine_temperature"))
    send_joints, send_temperature = cell.publish_on(joints), cell.publish_on(temperature)
    cell.run(Compensation, "compensation", machine="xyzac_trt", **RELAXED, position_tolerance=3.15)

    def said(words: str, of_x: float, warmth: float) -> bytes:
        def told() -> bool:
            now_ns = cell.node.get_clock().now().nanoseconds
            angle, _ = plant.motion.at((now_ns - plant.epoch_ns) * 1e-9)
            pose = [of_x, -0.05, 0.02, 0.3, float(angle)]
            send_joints(messages.joint_state_message(now_ns, "base", "XYZAC", pose, [0.0] * 5))
            send_temperature(messages.temperature_message(now_ns, temperature.frame, warmth))
            return cell.has_status("compensation: correction", words)

        feed.run_until(told, words)
        return cell.status("compensation: correction").level

    said("nobody says on", 0.07, 20.0)  # they flow, and the next word is another one
    assert corrections
    assert said("temperature not believed: 1e+06", 0.07, 1e6) == b"\x01"
    feed.observable &= 0b100111
    assert said("tilt from the description: no autocollimator is heard", 0.07, 20.0) == b"\x01"
    assert said("axis X at 70 m is beyond", 70.0, 20.0) == b"\x02"


@pytest.mark.parametrize(
    ("parameters", "problem"),
    [
        ({}, "parameter 'machine' is empty"),
        ({"machine": "no_such_machine"}, "no_such_machine"),
        ({"machine": "xyzac_trt", "linear__error": 1e-5}, "0 < warning <= error"),
    ],
)
def test_what_cannot_be_compensated(cell, parameters, problem):
    with pytest.raises(InputError, match=problem):
        cell.run(Compensation, "compensation", **parameters)


@pytest.mark.cell
def test_the_estimator_is_killed_and_comes_back(cell, corrections):
    """A whole cell of processes: no correction while the estimator is gone, none that jumps when it is back."""
    slower = {"rate": 500.0, "block_period": 0.02}  # which leaves a loaded computer some room
    for head in "abcd":
        cell.start("encoder_head", f"encoder_head_{head}", source="mock", **slower)
    cell.start("autocollimator", source="mock", **slower)
    cell.start("mock_controller", machine="xyzac_trt", **slower)
    cell.start("compensation", machine="xyzac_trt", **RELAXED)
    estimator = cell.start("error_estimator", period=0.005)
    cell.wait_until(lambda: len(corrections) > 10, "corrections", 90)
    estimator.send(signal.SIGKILL)
    cell.wait_until(is_held_for(cell, "no error motion for"), "the reason")
    cell.wait_for_silence(corrections)
    before = len(corrections)
    cell.start("error_estimator", period=0.005)
    cell.wait_until(lambda: len(corrections) > before + 10, "corrections again")
    positions = np.array([message.position for message in corrections])
    stamps = np.array([messages.ns_from_stamp(message.header.stamp) for message in corrections])
    assert (np.diff(stamps) > 0).all()
    rate = np.array([2e-3, 2e-3, 2e-3, 2e-2, 2e-2])
    allowed = rate * np.minimum(np.diff(stamps) * 1e-9, 0.1)[:, None]
    assert (np.abs(np.diff(positions, axis=0)) <= allowed + 1e-12).all()
