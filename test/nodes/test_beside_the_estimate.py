"""Processes that the estimate does not need, or all of whose streams it needs, are killed and come back."""

import signal
import time

import numpy as np
from faults.documenting import Row, shows

from rotary_error_monitor.nodes import messages
from rotary_error_monitor.nodes.error_estimator import ErrorEstimator
from rotary_error_monitor.nodes.qos import profile
from rotary_error_monitor.signals.blocks import block_from_samples
from rotary_error_monitor.testing import Cell


class Table:
    """Commands the machine's table to stand while it waits, for a stage that goes there."""

    def __init__(self, cell):
        self._command = command = cell.wire.topic("command_samples")
        self._cell = cell
        kind = messages.message_class(command.type)
        self._publisher = cell.node.create_publisher(kind, command.name, profile(command))
        self._estimates = cell.collect(cell.wire.topic("error_motion_samples"))

    def wait_until(self, condition, what):
        def told():
            block = block_from_samples(np.array([time.time_ns()]), self._command.columns, np.array([[0.7, 0.0]]))
            self._publisher.publish(messages.block_bytes(block, self._command.frame))
            return condition()

        self._cell.wait_until(told, what)

    def wait_for_estimates(self):
        self._estimates.clear()
        self.wait_until(lambda: len(self._estimates) > 5, "estimates")


@shows(
    Row(
        "processes",
        "the stage follower, the LVDT or the gap monitor is killed",
        "by who listens: of the stage follower heads and tilt are stale at the estimator, the LVDT at the gap monitor; "
        "the gap monitor's own diagnostics fail to come",
        "the LVDT is no input of the estimate, and nothing waits for a diagnosis",
        "without the stage follower no estimate; otherwise everything else",
        "with the first blocks of the successor; a gap monitor begins with an empty recording",
    )
)
def test_processes_beside_the_estimate_are_killed_and_come_back():
    kinds = {"stage_follower": {}, "lvdt": {"source": "mock"}, "gap_monitor": {}}
    with Cell(parameters={"block_period": 0.05}) as cell:
        table = Table(cell)
        running = {kind: cell.start(kind, **parameters) for kind, parameters in kinds.items()}
        cell.run(ErrorEstimator, "error_estimator", check_turns=0.0)
        lvdt, monitor = f"gap_monitor: {cell.wire.topic('lvdt_samples').name}", "gap_monitor: diagnosis"
        table.wait_for_estimates()
        table.wait_until(lambda: cell.has_status(lvdt, "alive"), "the LVDT")

        running["lvdt"].stop(signal.SIGKILL)
        table.wait_until(lambda: cell.has_status(lvdt, "stale"), "a word of it")
        table.wait_for_estimates()
        cell.start("lvdt", source="mock")
        table.wait_until(lambda: cell.has_status(lvdt, "alive"), "the LVDT again")

        running["gap_monitor"].stop(signal.SIGKILL)
        table.wait_for_estimates()
        cell.forget_status(monitor)
        cell.start("gap_monitor")
        table.wait_until(lambda: cell.has_status(monitor, "waiting"), "its successor")

        running["stage_follower"].stop(signal.SIGKILL)
        cell.wait_for_status("error_estimator: estimate", "no estimate")
        cell.start("stage_follower", **kinds["stage_follower"])
        table.wait_for_estimates()
