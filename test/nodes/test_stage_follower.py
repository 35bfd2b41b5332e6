"""The mock stage under a machine's table."""

import time

import pytest

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.nodes import messages
from rotary_error_monitor.nodes.stage_follower import StageFollower
from rotary_error_monitor.testing import Cell

AXIS = "stage_follower: axis"


def test_all_instruments_speak_once_the_axis_is_known():
    with Cell() as cell:
        streams = [cell.wire.topic("head_samples", head) for head in "abcd"]
        streams += [cell.wire.topic(f"{stream}_samples") for stream in ("autocollimator", "command")]
        people = [cell.wire.topic("head_joint_states", "a"), cell.wire.topic("autocollimator_tilt")]
        people.append(cell.wire.topic("command_joint_states"))
        received = [cell.collect(topic) for topic in (*streams, *people)]
        joints = cell.wire.topic("machine_joint_states")
        cell.run(StageFollower, "stage_follower", machine="xyzac_trt", block_period=0.02)
        cell.wait_for_status(AXIS, f"waiting for a joint state of axis C on {joints.name}")
        send = cell.publish_on(joints)

        def turn():
            send(messages.joint_state_message(time.time_ns(), joints.frame, list("XYZAC"), [0.0] * 4 + [0.7]))
            return all(len(each) > 1 for each in received) and cell.has_status(AXIS, "following C")

        cell.wait_until(turn, "all instruments")
        assert list(received[8][-1].name) == ["stage"], "as the contract calls it"
        cell.wait_for_status(AXIS, "no joint state of axis C for")
        assert messages.block_from_message(received[5][-1]).column("angle")[-1] == pytest.approx(0.7, abs=1e-6)
        assert messages.block_from_message(received[0][-1]).column("angle")[-1] == pytest.approx(0.7, abs=1e-3)
        send(messages.joint_state_message(time.time_ns(), joints.frame, ["X"], [0.0]))
        cell.wait_for_status(f"stage_follower: refused {joints.name}", "lacks axis C")


def test_a_machine_without_a_table_to_follow_is_refused():
    with Cell() as cell, pytest.raises(InputError, match="no monitored axis"):
        cell.run(StageFollower, "stage_follower", machine="grinder_zhou2023")
