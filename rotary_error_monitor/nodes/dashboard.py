"""The cell as a live page for the person at the machine: error motion, tool offset, limits, health, recording, the day.

ros2 run rotary_error_monitor dashboard --ros-args -p port:=8088
"""

from __future__ import annotations

import asyncio
import time
from collections.abc import Awaitable, Callable

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped, TwistStamped
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rclpy.client import Client
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger

from rotary_error_monitor.codec.cdr_blocks import BlockDecoder
from rotary_error_monitor.codec.error_motion_blocks import error_motion_from_block
from rotary_error_monitor.dashboard.board import PORT, Action, PageBoard
from rotary_error_monitor.dashboard.cards import CardDrawer, ShownMoment
from rotary_error_monitor.dashboard.health import NodeStatus, label_of
from rotary_error_monitor.dashboard.model import CellModel
from rotary_error_monitor.dashboard.server import WebServer
from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.description.settings import Setting
from rotary_error_monitor.description.wire import load_services
from rotary_error_monitor.errors import told_of
from rotary_error_monitor.nodes import messages, parameters
from rotary_error_monitor.nodes.diagnostics import Condition, Level, status_name
from rotary_error_monitor.nodes.managed import ManagedNode
from rotary_error_monitor.nodes.process import program
from rotary_error_monitor.nodes.qos import onlooker_profile
from rotary_error_monitor.signals.blocks import SampleBlock
from rotary_error_monitor.units import MICRO

_GATHER = 0.05
"""s that messages gather: the page is drawn a few times a second, and each wake-up costs."""

_BLOCKS, _WAITING, _STATUSES, _LATEST = 16, 8, 50, 1
"""Messages that may wait: blocks and offsets of a wake-up, what all nodes say at once, and of what stands the last."""

_PATIENCE = 5.0
"""s that a node may take to answer what a person asked for."""

_UNKNOWN_RADIUS = 0.1
"""m, of the drawn ring of a stage without one."""


class Dashboard(ManagedNode):
    """Serves what the cell publishes as a page that goes on through restarts of nodes, to any number of browsers."""

    settings = (
        Setting("address", "127.0.0.1", "address of this computer on which the page is served; 0.0.0.0 for all of its"),
        Setting("port", PORT, "port on which the page is served", (1024, 65535)),
        Setting("period", 0.25, "time between two drawings, s", (0.2, 10.0)),
        Setting(
            "allow_control",
            False,
            "whether the page may reset the latch of the compensation and pause the recording; whoever reaches the "
            "page may then",
            at_start=True,
        ),
        *parameters.cell_settings("machine"),
    )

    def open(self) -> None:
        """Listen to the cell, take the port and serve."""
        machine = load_machine(self.setting("machine")) if self.setting("machine") else None
        radius = self.stage.encoder.disc_radius if self.stage.encoder else _UNKNOWN_RADIUS
        self._model = CellModel(
            radius,
            status_name(self.get_namespace().rstrip("/")),
            {status_name(topic.name): label_of(topic) for topic in self.wire},
            [axis.letter for axis in machine.axes if axis.kind == "rotary"] if machine else (),
        )
        title = self.setting("stage") or "stage"
        self._drawn = CardDrawer(self._model, self.stage.azimuths, f"{title} on {machine.name}" if machine else title)
        self._board, self._called = PageBoard(), list[Client]()
        if self.setting("allow_control"):
            self._board.actions = self._actions()
        self._listen()
        self.gather(_GATHER)
        self.every(self.setting("period"), self._draw)
        address, port = self.setting("address"), self.setting("port")
        with told_of(self.get_fully_qualified_name()):
            self._server = WebServer(self._board, address, port)
        self.get_logger().info(f"dashboard on http://{address}:{port}")

    def release(self) -> None:
        """Serve no longer."""
        server = self.__dict__.pop("_server", None)
        if server is not None:
            server.stop()
        for client in self.__dict__.pop("_called", ()):
            self.destroy_client(client)

    def conditions(self, now_ns: int) -> list[Condition]:
        """What is served."""
        address, port = self.setting("address"), self.setting("port")
        figures = {"address": address, "port": port, "drawings": self._board.drawn}
        if not self._server.is_alive:
            return [Condition("server", Level.ERROR, "the web server has ended; start the node anew", figures)]
        return [Condition("server", Level.OK, f"serving on http://{address}:{port}", figures)]

    def _listen(self) -> None:
        """To what nobody has to wait for: a block or a pose that is missed is missed on the page alone."""
        samples = self.wire.topic("error_motion_samples")
        decoder = BlockDecoder(frame=samples.frame)
        self._subscribe(
            samples.name,
            messages.message_class(samples.type),
            onlooker_profile(_BLOCKS),
            lambda received: self._take_motion(decoder.decode(received[0])),
            raw=True,
        )
        self._look_at("tool_offset_figures", self._take_offset, _WAITING)
        self._look_at("corrected_offset_pose", self._take_corrected_offset, _WAITING)
        self._look_at("applied_corrections", self._take_corrections, _LATEST)
        self._look_at("diagnostics", self._take_statuses, _STATUSES)

    def _look_at(self, key: str, callback: Callable[[messages.Message], None], depth: int) -> None:
        topic = self.wire.topic(key)
        self.listen(topic.name, messages.message_class(topic.type), onlooker_profile(depth), callback)

    def _take_motion(self, block: SampleBlock) -> None:
        self._model.take_motion(error_motion_from_block(block), time.monotonic(), self.now_ns())

    def _take_offset(self, message: TwistStamped) -> None:
        shift, turn = message.twist.linear, message.twist.angular  # told also while corrections are held
        offset = np.array([shift.x, shift.y, shift.z, turn.x, turn.y, turn.z])
        self._model.take_offset("before", offset, time.monotonic(), self.now_ns())

    def _take_corrected_offset(self, message: PoseWithCovarianceStamped) -> None:
        position, turn = message.pose.pose.position, messages.rotation_vector(message.pose.pose.orientation)
        offset = np.array([position.x, position.y, position.z, *turn]) * MICRO
        self._model.take_offset("after", offset, time.monotonic(), self.now_ns())

    def _take_corrections(self, message: JointState) -> None:
        self._model.take_corrections(messages.joint_motion(message)[0], time.monotonic())

    def _take_statuses(self, message: DiagnosticArray) -> None:
        found = []
        for status in message.status:
            node, _, part = status.name.partition(": ")
            figures = {each.key: each.value for each in status.values}
            found.append(NodeStatus(node, part, status.level[0], status.message, figures))
        self._model.take_statuses(found, time.monotonic())

    def _draw(self) -> None:
        if self.active and (self._board.is_watched or not self._board.drawn):
            self._board.show(self._drawn.parts(ShownMoment(time.monotonic(), self.now_ns())))

    def _actions(self) -> tuple[Action, ...]:
        services = {service.key: service for service in load_services()}

        def client(kind: type[messages.Message], key: str) -> Client:
            (server,) = services[key].servers  # beside this node, in its namespace
            found = self.create_client(kind, services[key].name.replace("~", server))
            self._called.append(found)
            return found

        reset, state = client(Trigger, "reset_compensation"), client(ChangeState, "recorder_state")

        async def release() -> str:
            answer = await _answer(reset, Trigger.Request())
            return "the compensation does not answer" if answer is None else f"compensation: {answer.message}"

        def change(transition: int, done: str) -> Callable[[], Awaitable[str]]:
            async def act() -> str:
                answer = await _answer(state, ChangeState.Request(transition=Transition(id=transition)))
                if answer is None:
                    return "the recorder does not answer"
                return done if answer.success else "the recorder refused: it is in that state already, or has ended"

            return act

        pause = change(Transition.TRANSITION_DEACTIVATE, "recording is paused")
        go_on = change(Transition.TRANSITION_ACTIVATE, "recording goes on")
        return (
            Action("Reset the latch", "Release the latch? Corrections move the axes again.", "correction", release),
            Action("Pause recording", "Pause? What comes until you go on is not recorded.", "recording", pause),
            Action("Go on recording", "Go on recording into the same bag?", "recording", go_on),
        )


async def _answer(client: Client, request: messages.Message) -> messages.Message | None:
    """Answer of a service, on the web server's loop while the node's executor does the work; None where none comes."""
    if not client.service_is_ready():
        return None
    future, end = client.call_async(request), time.monotonic() + _PATIENCE
    while not future.done() and time.monotonic() < end:
        await asyncio.sleep(0.02)
    if not future.done():
        client.remove_pending_request(future)
        return None
    return future.result()


main = program(Dashboard, "dashboard")

if __name__ == "__main__":
    raise SystemExit(main())
