"""The mock stage that goes where a controller commands it."""

import time

import numpy as np
import pytest
from received_blocks import block_of

from rotary_error_monitor.nodes.stage_follower import StageFollower
from rotary_error_monitor.signals.blocks import block_from_samples
from rotary_error_monitor.testing import Cell

COMMAND = "stage_follower: command"


def test_all_instruments_speak_once_the_command_is_known():
    with Cell() as cell:
        streams = [cell.wire.topic("head_samples", head) for head in "abcd"] + [
            cell.wire.topic("autocollimator_samples")
        ]
        people = [cell.wire.topic("head_joint_states", "a"), cell.wire.topic("autocollimator_tilt")]
        received = [cell.collect(topic) for topic in (*streams, *people)]
        command = cell.wire.topic("command_samples")
        node = cell.run(StageFollower, "stage_follower", block_period=0.02)
        published = {name for name, _ in node.get_publisher_names_and_types_by_node("stage_follower", "/")}
        assert not {command.name, cell.wire.topic("command_joint_states").name} & published, "the controller's to tell"
        cell.wait_for_status(COMMAND, f"waiting for a command on {command.name}")
        send = cell.publish_blocks(command)

        def turn():
            times = time.time_ns() - np.array([2_000_000, 1_000_000])
            send(block_from_samples(times, command.columns, np.array([[0.7, 0.0]] * 2)))
            return all(len(each) > 1 for each in received) and cell.has_status(COMMAND, "following")

        cell.wait_until(turn, "all instruments")
        cell.wait_for_status(COMMAND, "the stage stands: no command for")
        assert block_of(received[0][-1]).column("angle")[-1] == pytest.approx(0.7, abs=1e-3)


def test_of_two_commands_none_is_followed():
    with Cell() as cell:
        command = cell.wire.topic("command_samples")
        cell.run(StageFollower, "stage_follower", block_period=0.02)
        senders = [cell.publish_blocks(command) for _ in range(2)]

        def both():
            for send in senders:
                send(block_from_samples(np.array([time.time_ns()]), command.columns, np.array([[0.7, 0.0]])))
            return cell.has_status(f"stage_follower: refused {command.name}", "several publishers share")

        cell.wait_until(both, "it to be said")
