"""Test harness for nodes, the package's own and those of a user's cell; no launch files, no sleeping.

    from rotary_error_monitor.nodes.encoder_head import EncoderHead
    from rotary_error_monitor.testing import Cell

    def test_my_driver() -> None:
        with Cell() as cell:                                    # a ROS domain of its own
            cell.run(EncoderHead, "encoder_head_a", source="mock")       # in this process: breakpoints, coverage work
            cell.start("encoder_head", "encoder_head_b", source="mock")  # the same as a process of its own
            blocks = cell.collect(cell.wire.topic("head_samples", "a"))
            cell.wait_until(lambda: len(blocks) > 3, "blocks of head a")
            assert blocks[0].width > 0
            assert cell.status("encoder_head_a: state").message == "active"

What the cell started is stopped at the end of the `with` block, also when the test fails. To feed a node under test,
publish on its inputs: `send = cell.publish_blocks(topic)`, then `send(block)`; where several nodes listen, name the one
that must not miss the first: `cell.publish_blocks(topic, "error_estimator")`. That something has ended shows
`cell.wait_for_silence(blocks)`. `cell.run` takes any rclpy node class whose constructor has the arguments `context` and
`parameter_overrides`.
"""

from rotary_error_monitor.testing.cell import Cell
from rotary_error_monitor.testing.processes import NodeProcess
from rotary_error_monitor.testing.silence import silence

__all__ = ["Cell", "NodeProcess", "silence"]
