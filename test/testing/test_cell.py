"""The harness: what it starts it stops, and what goes wrong it tells."""

from __future__ import annotations

import os
import signal
import socket
import time
from contextlib import nullcontext

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from rotary_error_monitor.nodes import messages
from rotary_error_monitor.nodes.encoder_head import EncoderHead
from rotary_error_monitor.testing import Cell, domains, silence
from rotary_error_monitor.testing.domains import own_domain
from rotary_error_monitor.testing.processes import NodeProcess, parameter_arguments, postponed_signals


def is_alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return True


def test_the_example_of_its_documentation():
    with Cell() as cell:
        cell.run(EncoderHead, "encoder_head_a", source="mock")
        cell.start("encoder_head", "encoder_head_b", source="mock")
        blocks = cell.collect(cell.wire.topic("head_samples", "a"))
        cell.wait_until(lambda: len(blocks) > 3, "blocks of head a")
        assert blocks[0].width > 0
        assert cell.status("encoder_head_a: state").message == "active"


def test_everything_is_stopped_when_a_test_fails():
    with pytest.raises(ZeroDivisionError), Cell() as cell:
        process = cell.start("encoder_head", "encoder_head_a", source="mock")
        cell.wait_for_status("encoder_head_a: state", "active", 30)
        _ = 1 / 0
    assert not is_alive(process.pid)


def test_two_cells_do_not_hear_one_another():
    with Cell() as one, Cell() as other:
        heard = other.collect(other.wire.topic("head_samples", "a"))
        own = one.collect(one.wire.topic("head_samples", "a"))
        one.run(EncoderHead, "encoder_head_a", source="mock")
        one.wait_until(lambda: len(own) > 20, "blocks")
        other.spin_for(0.2)
        assert heard == []


def test_waiting_has_an_end_and_says_how_the_nodes_fared():
    with Cell() as cell:
        cell.run(EncoderHead, "encoder_head_a", source="mock")
        cell.status("encoder_head_a: state")
        with pytest.raises(TimeoutError, match=r"waited 0\.1 s for a miracle") as caught:
            cell.wait_until(lambda: False, "a miracle", 0.1)
        assert "encoder_head_a: state: active" in str(caught.value)


def test_a_condition_that_takes_long_leaves_the_nodes_their_time():
    """As one that asks a browser: a node that speaks 100 times a second is heard all the same."""
    with Cell() as cell:
        said, asked = [], []
        cell.node.create_timer(0.01, lambda: said.append(1))

        def slow():
            asked.append(1)
            time.sleep(0.1)
            return len(said) >= 100

        cell.wait_until(slow, "100 calls")
        assert len(asked) < 50, "of ten that are due meanwhile, more than two"


def test_messages_wait_for_the_nodes_that_are_named():
    """The recorder of the harness is there at once; who is named comes later, and misses nothing."""
    with Cell() as cell:
        topic = cell.wire.topic("machine_joint_states")
        cell.collect(topic)
        send = cell.publish_on(topic, "late_listener")
        heard = []

        class Late(Node):
            def __init__(self, name, *, context, parameter_overrides):
                super().__init__(name, context=context, parameter_overrides=parameter_overrides)
                self.create_subscription(JointState, topic.name, heard.append, 10)

        begin = time.monotonic()

        def start_late():
            if time.monotonic() - begin > 0.5 and not cell._nodes:
                cell.run(Late, "late_listener")

        cell.node.create_timer(0.1, start_late)
        send(messages.joint_state_message(1, "", ["X"], [0.0]))
        assert time.monotonic() - begin > 0.5
        cell.wait_until(lambda: len(heard) == 1, "the first message")


def test_a_node_that_is_named_and_does_not_come_is_said(monkeypatch):
    monkeypatch.setattr("rotary_error_monitor.testing.cell.Cell.wait_until.__defaults__", (0.2,))
    with Cell() as cell:
        topic = cell.wire.topic("machine_joint_states")
        cell.collect(topic)
        with pytest.raises(TimeoutError, match=f"compensation to listen to {topic.name}"):
            cell.publish_on(topic, "compensation")(messages.joint_state_message(1, "", ["X"], [0.0]))


def test_silence_begins_with_the_last_message():
    with Cell() as cell:
        received = []
        timer = cell.node.create_timer(0.2, lambda: received.append(time.monotonic()))
        ending = cell.node.create_timer(1.0, timer.cancel)
        cell.wait_for_silence(received, 0.5)
        ending.cancel()
        assert received
        assert time.monotonic() - received[-1] >= 0.5


def test_something_that_goes_on_is_no_silence():
    with Cell() as cell:
        received = []
        cell.node.create_timer(0.05, lambda: received.append(1))
        with pytest.raises(TimeoutError):
            cell.wait_until(silence(received, 1.0), "silence", 2.0)


def test_time_without_a_look_is_no_silence():
    is_silent = silence([], 0.3)
    assert not is_silent()
    time.sleep(0.5)
    assert not is_silent(), "of the nap counts a tenth of a second"
    looks = 0
    while not is_silent():
        time.sleep(0.02)
        looks += 1
    assert looks > 1


def test_a_process_that_ends_by_itself_is_told():
    with Cell() as cell:
        cell.start("encoder_head", "encoder_head_x", source="mock")
        with pytest.raises(RuntimeError, match=r"encoder_head_x ended with exit code 2; it wrote:") as caught:
            cell.wait_until(lambda: False, "nothing", 30)
        assert "the stage has the heads" in str(caught.value)


def test_a_process_that_ended_badly_fails_a_test_that_did_not_look():
    with pytest.raises(AssertionError, match="encoder_head_x ended with exit code 2"), Cell() as cell:
        process = cell.start("encoder_head", "encoder_head_x", source="mock")
        cell.node.get_logger().debug("the test does not wait")
        os.waitid(os.P_PID, process.pid, os.WEXITED | os.WNOWAIT)


def test_a_process_that_ignores_its_end_is_killed():
    with Cell() as cell:
        process = cell.start("encoder_head", "encoder_head_a", source="mock")
        cell.wait_for_status("encoder_head_a: state", "active", 30)
        os.kill(process.pid, signal.SIGSTOP)
        with pytest.raises(TimeoutError, match=r"encoder_head_a did not end within 0\.2 s"):
            process.stop(deadline=0.2)
        assert process.exit_code == -signal.SIGKILL


def test_a_signal_waits_until_a_child_is_known():
    known = []
    with pytest.raises(KeyboardInterrupt), postponed_signals():
        os.kill(os.getpid(), signal.SIGINT)
        known.append("the child")
    assert known
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_any_node_of_a_user_can_take_part():
    class Mine(Node):
        def __init__(self, name, *, context, parameter_overrides):
            super().__init__(name, context=context, parameter_overrides=parameter_overrides)
            self.declare_parameter("gain", 1.0)
            self.create_service(Trigger, "~/gain", self._tell)

        def _tell(self, request, response):
            response.message = str(self.get_parameter("gain").value)
            return response

    with Cell() as cell:
        node = cell.run(Mine, "mine", gain=2.5)
        assert cell.call(Trigger, "/mine/gain").message == "2.5"
        cell.remove(node)


def test_domains_are_reserved_and_errors_of_a_test_pass_through():
    before = os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE")
    with own_domain() as one, own_domain() as other:
        assert one != other
        assert os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"
    with pytest.raises(OSError, match="of the test"), own_domain():
        raise OSError("of the test")
    assert os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE") == before
    with socket.socket() as free:
        free.bind(("", 32768 + one))


def test_parameters_on_a_command_line():
    assert parameter_arguments({"a": True, "b": 1.0, "c": "x y", "d": [1, 2.5]}) == [
        *("-p", "a:=true"),
        *("-p", "b:=1.0"),
        *("-p", "c:='x y'"),
        *("-p", "d:=[1, 2.5]"),
    ]


LINES = "i=0; while [ $i -lt 3000 ]; do echo out $i; echo err $i >&2; i=$((i+1)); done"


def test_what_a_process_writes_is_all_there_however_often_it_is_read():
    """It goes on where it stood, not where the reader stands."""
    process = NodeProcess("encoder_head", "head", 1, [], within=("sh", "-c", LINES))
    try:
        while process.exit_code is None:
            _ = process.output
        said = [f"{kind} {number}" for number in range(3000) for kind in ("out", "err")]
        assert process.output.splitlines() == said
    finally:
        process.close()


def test_a_recorder_that_waits_for_its_disk_is_waited_for():
    """It says so alone, without the topics that are silent."""
    with Cell() as cell:
        publisher = cell.node.create_publisher(DiagnosticArray, "/diagnostics", 10)

        def say(**figures):
            values = [KeyValue(key=key, value=value) for key, value in figures.items()]
            status = DiagnosticStatus(name="recorder: recording", values=values)
            publisher.publish(DiagnosticArray(status=[status]))
            cell.spin_for(0.1)

        cell.wait_until(lambda: publisher.get_subscription_count() > 0, "the harness to listen")
        say(waiting_s="2.0")
        assert not cell.recorder_hears({"/stage/head_a/samples"})
        say(silent_topics="/stage/head_a/samples, /stage/head_b/samples")
        assert not cell.recorder_hears({"/stage/head_a/samples"})
        say(silent_topics="none")
        assert cell.recorder_hears({"/stage/head_a/samples"})


def test_what_ran_in_one_cell_is_not_in_the_next(monkeypatch):
    """Nor while somebody holds the node still, as a test does until its end: the next cell may have the same domain."""
    held = []
    with own_domain() as domain:  # for all of them, so that no other test has it between two
        monkeypatch.setattr(domains, "domain_id", lambda _: nullcontext(domain))
        for _ in range(4):
            with Cell() as cell:
                assert cell.node.context.get_domain_id() == domain
                cell.spin_for(1.0)
                assert cell.node.get_node_names() == ["test_harness"]
                held.append(cell.run(EncoderHead, "encoder_head_a", source="mock"))
                cell.wait_for_status("encoder_head_a: state", "active")
    assert len(held) == 4
