"""A cell under test: nodes in this process and in others, in a ROS domain of their own, and waiting on conditions."""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Mapping, Sequence, Set
from contextlib import ExitStack
from types import TracebackType
from typing import Self, TypeVar

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.srv import SetParameters
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock

from rotary_error_monitor.description.wire import Topic, Wire, load_wire
from rotary_error_monitor.nodes import messages
from rotary_error_monitor.nodes.diagnostics import status_name
from rotary_error_monitor.nodes.managed import ManagedNode
from rotary_error_monitor.nodes.qos import profile
from rotary_error_monitor.nodes.transport import steady_transport
from rotary_error_monitor.signals.blocks import SampleBlock
from rotary_error_monitor.testing.domains import LOCALHOST, own_domain
from rotary_error_monitor.testing.processes import NodeProcess, parameter_arguments, postponed_signals
from rotary_error_monitor.testing.silence import silence

PATIENCE = 60.0
"""How long to wait for anything, s. Discovery alone may take more than three, and where six processes wait for each
core, one was seen to wait seven for the first tenth of a second that it needs to start."""

_STEP = 0.02
AnyNode = TypeVar("AnyNode", bound=Node)


class Cell:
    """A ROS domain with everything that a test starts in it; use it in a `with` statement.

    Nothing spins in the background: nodes in this process run while the test waits, on the test's own thread.

    Attributes:
        wire: the wire contract for the heads and listed sensors of the cell.
        node: the harness's own node, for what the methods do not offer.
    """

    node: Node

    def __init__(
        self,
        heads: Sequence[str] = ("a", "b", "c", "d"),
        parameters: Mapping[str, object] | None = None,
        reach: str = LOCALHOST,
        sensors: Sequence[str] = (),
    ) -> None:
        """A cell for a stage with these heads and listed sensors.

        Args:
            heads: their letters.
            parameters: given to every node, such as `stage` or `mock.seed`.
            reach: how far its nodes find one another: `LOCALHOST`, or `SUBNET` for a cell on several computers, which
                then hears every cell of that domain there.
            sensors: streams of the sensors that its stage lists, such as `axial_probe_top`.
        """
        self.wire: Wire = load_wire(heads, sensors=sensors)
        self._parameters = dict(parameters or {})
        self._reach = reach
        self._stack = ExitStack()
        self._nodes: list[Node] = []
        self._processes: list[NodeProcess] = []
        self._statuses: dict[str, DiagnosticStatus] = {}

    def __enter__(self) -> Self:
        """Reserve a domain and listen to its diagnostics."""
        with ExitStack() as stack:
            self._domain = stack.enter_context(own_domain(self._reach))
            self._context = Context()
            with steady_transport():
                rclpy.init(context=self._context, domain_id=self._domain, args=[])
                stack.callback(self._context.try_shutdown)
                self._executor = SingleThreadedExecutor(context=self._context)
                stack.callback(self._executor.shutdown)
                self.node = Node("test_harness", context=self._context)
            stack.callback(self.node.destroy_node)
            self._executor.add_node(self.node)
            topic = self.wire.topic("diagnostics")
            self.node.create_subscription(DiagnosticArray, topic.name, self._note_diagnostics, profile(topic))
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Stop everything; a process that ends badly is an error, unless the test has failed already."""
        problems: list[str] = []
        for node in reversed(self._nodes):
            self.remove(node)
        for process in self._processes:
            if process.exit_code is None:
                process.send(signal.SIGINT)
        for process in self._processes:
            problems += _end(process, self._is_up(process))
        self._stack.close()
        if problems and error is None:
            raise AssertionError("\n".join(problems))

    # Starting and stopping.

    def run(
        self, node_class: Callable[..., AnyNode], name: str, ros_args: Sequence[str] = (), **parameters: object
    ) -> AnyNode:
        """Run a node in this process; `__` in a parameter's name stands for a point.

        Args:
            node_class: called with name, `context`, `parameter_overrides` and, where `ros_args` are given, `cli_args`.
            name: of the node.
            ros_args: further arguments as behind `--ros-args` on a command line.
            parameters: by name.

        Raises:
            InputError: a node of the package refuses its parameters or what they lead to.
        """
        values = {**self._parameters, **_dotted(parameters)}
        overrides = [Parameter(key, value=value) for key, value in values.items()]
        arguments = {"cli_args": ["--ros-args", *ros_args]} if ros_args else {}
        node = node_class(name, context=self._context, parameter_overrides=overrides, **arguments)
        self._nodes.append(node)
        self._executor.add_node(node)
        if isinstance(node, ManagedNode):
            node.autostart()
        return node

    def remove(self, node: Node) -> None:
        """Stop a node in this process before the cell ends."""
        if node in self._nodes:
            self._nodes.remove(node)
            self._executor.remove_node(node)
            if isinstance(node, ManagedNode):
                node.stop()
            else:
                node.destroy_node()

    def start(
        self,
        executable: str,
        name: str = "",
        ros_args: Sequence[str] = (),
        within: Sequence[str] = (),
        **parameters: object,
    ) -> NodeProcess:
        """Start an executable of the package as a process; `__` in a parameter's name stands for a point.

        Args:
            executable: of the package.
            name: of its node, by default that of the executable.
            ros_args: further arguments as behind `--ros-args` on a command line.
            within: command that starts the process in place of itself, such as `taskset -c 0` or `nsenter …`.
            parameters: by name.
        """
        values = {**self._parameters, **_dotted(parameters)}
        arguments = [*ros_args, *parameter_arguments(values)]
        with postponed_signals():
            process = NodeProcess(
                executable, name or executable, self._domain, arguments, reach=self._reach, within=within
            )
            self._processes.append(process)
        return process

    # Talking and listening.

    def publish_on(self, topic: Topic, *listeners: str) -> Callable[[messages.Message], None]:
        """Function that publishes a message on a topic of the contract, once it is heard.

        Args:
            topic: of the contract.
            listeners: names of the nodes that are to hear it, without namespace. Without any whoever listens will do,
                which is enough where one node listens: of several, those found later would miss the first messages.
        """
        publisher = self.node.create_publisher(messages.message_class(topic.type), topic.name, profile(topic))
        who = ", ".join(listeners) or "someone"

        def is_heard() -> bool:
            if not listeners:
                return bool(publisher.get_subscription_count())
            # the graph knows names, and the publisher how many of those that are listed there it has found
            there = self.node.get_subscriptions_info_by_topic(topic.name)
            return {*listeners} <= {each.node_name for each in there} and (
                publisher.get_subscription_count() >= len(there)
            )

        def send(message: messages.Message) -> None:
            self.wait_until(is_heard, f"{who} to listen to {topic.name}")
            publisher.publish(message)

        return send

    def publish_blocks(self, topic: Topic, *listeners: str) -> Callable[[SampleBlock], None]:
        """The same for sample blocks."""
        send = self.publish_on(topic, *listeners)
        return lambda block: send(messages.block_bytes(block, topic.frame))

    def collect(self, topic: Topic) -> list[messages.Message]:
        """List that grows by each message on a topic of the contract."""
        received: list[messages.Message] = []
        kind = messages.message_class(topic.type)
        self.node.create_subscription(kind, topic.name, received.append, profile(topic))
        return received

    def call(self, kind: type[messages.Message], name: str, **request: object) -> messages.Message:
        """Answer of a service; without `request`, the fields of the message, to an empty one."""
        client = self.node.create_client(kind, name)
        try:
            self.wait_until(client.service_is_ready, f"service {name}")
            future = client.call_async(kind.Request(**request))
            self.wait_until(future.done, f"answer of {name}")
            return future.result()
        finally:
            self.node.destroy_client(client)

    def change_state(self, node: str, transition: int) -> bool:
        """Take a managed node through a transition of `lifecycle_msgs/msg/Transition`; whether it went through."""
        request = Transition(id=transition)
        return bool(self.call(ChangeState, f"/{node}/change_state", transition=request).success)

    def set_parameter(self, node: str, name: str, value: object) -> bool:
        """Set a parameter of a node, also in another process; whether the node took it."""
        wanted = Parameter(name, value=value).to_parameter_msg()
        (result,) = self.call(SetParameters, f"/{node}/set_parameters", parameters=[wanted]).results
        return bool(result.successful)

    def clock(self) -> Callable[[int], None]:
        """Function that sets simulated time (ns) for nodes run with `use_sim_time=True`."""
        publisher = self.node.create_publisher(Clock, "/clock", 10)

        def set_time(time_ns: int) -> None:
            self.wait_until(lambda: publisher.get_subscription_count() > 0, "someone to listen to /clock")
            publisher.publish(Clock(clock=messages.stamp_from_ns(time_ns)))

        return set_time

    def status(self, name: str) -> DiagnosticStatus:
        """Latest status of that name, such as `encoder_head_a: state`, waiting for the first.

        Topics and namespaces in a name may be written as paths, as ROS writes them: they are shown with dots.

        Raises:
            TimeoutError: no such status came.
        """
        shown = status_name(name)
        self.wait_until(lambda: shown in self._statuses, f"status '{name}'")
        return self._statuses[shown]

    def wait_for_status(self, name: str, message: str, deadline: float = PATIENCE) -> DiagnosticStatus:
        """Wait until the status of that name holds `message`."""
        self.wait_until(lambda: self.has_status(name, message), f"status '{name}' to say '{message}'", deadline)
        return self.status(name)

    def has_status(self, name: str, message: str) -> bool:
        """Whether the latest status of that name holds `message`."""
        found = self._statuses.get(status_name(name))
        return found is not None and message in found.message

    def figures(self, name: str) -> dict[str, str]:
        """Figures of the latest status of that name, waiting for the first.

        Raises:
            TimeoutError: no such status came.
        """
        return {each.key: each.value for each in self.status(name).values}

    def recorder_hears(self, topics: Set[str], recorder: str = "recorder") -> bool:
        """Whether a recorder has heard something on each of the topics, by its latest status, waiting for the first.

        Raises:
            TimeoutError: no such status came.
        """
        # a recorder that waits for its disk says that alone
        silent = self.figures(f"{recorder}: recording").get("silent_topics")
        return silent is not None and topics.isdisjoint(silent.split(", "))

    @property
    def statuses(self) -> Mapping[str, DiagnosticStatus]:
        """Latest status by name, as `/diagnostics` shows it, of all that came so far."""
        return dict(self._statuses)

    def forget_status(self, name: str) -> None:
        """Forget a status, so that the next wait sees only what is said from now on."""
        self._statuses.pop(status_name(name), None)

    # Waiting.

    def wait_until(self, condition: Callable[[], bool], what: str, deadline: float = PATIENCE) -> None:
        """Let everything run until the condition holds.

        A condition that takes long, such as one that asks a browser, leaves the nodes as much time as it takes itself.

        Raises:
            TimeoutError: it did not within `deadline` s; the message says how the nodes fared.
            RuntimeError: a process ended meanwhile.
        """
        begin = time.monotonic()
        end = begin + deadline
        while not condition():
            self._check_nodes(what)
            now = time.monotonic()
            if now > end:
                raise TimeoutError(f"waited {deadline} s for {what}; diagnostics:\n{self._report()}")
            until = min(end, now + now - begin)
            self._spin()
            while time.monotonic() < until:
                self._spin()
            begin = time.monotonic()

    def wait_for_silence(self, received: Sequence[object], duration: float = 0.5) -> None:
        """Let everything run until `received`, a list of `collect`, has not grown for `duration` s.

        To show that something has ended: what was on its way may come late, and then nothing more.

        Raises:
            TimeoutError: it goes on growing.
            RuntimeError: a process ended meanwhile.
        """
        self.wait_until(silence(received, duration), f"nothing more to come for {duration} s")

    def spin_for(self, duration: float) -> None:
        """Let everything run for a while: to show that something does *not* happen.

        Raises:
            RuntimeError: a process ended meanwhile.
        """
        end = time.monotonic() + duration
        while time.monotonic() < end:
            self._check_nodes("time to pass")
            self._spin()

    def _spin(self) -> None:
        """Run one callback that is ready, or wait a step for one.

        Always with the same timeout: the executor keeps what else was ready then, and otherwise asks all over again.
        """
        self._executor.spin_once(timeout_sec=_STEP)

    def _check_nodes(self, what: str) -> None:
        for node in self._nodes:
            if isinstance(node, ManagedNode) and node.end.done():
                node.end.result()
        for process in self._processes:
            if process.exit_code is not None and not process.expected:
                process.expected = process.judged = True
                raise RuntimeError(f"while waiting for {what}: {process.ending}")

    def _note_diagnostics(self, message: DiagnosticArray) -> None:
        self._statuses.update({status.name: status for status in message.status})

    def _is_up(self, process: NodeProcess) -> bool:
        return any(name.startswith(status_name(f"{process.name}: ")) for name in self._statuses)

    def _report(self) -> str:
        lines = [f"  {name}: {status.message}" for name, status in sorted(self._statuses.items())]
        lines += [f"  output of {process.name}:\n{process.output}" for process in self._processes]
        return "\n".join(lines) or "  (none)"


def _dotted(parameters: Mapping[str, object]) -> dict[str, object]:
    return {name.replace("__", "."): value for name, value in parameters.items()}


def _end(process: NodeProcess, up: bool) -> list[str]:
    """End a process for good; what was wrong with its end, if anything: before it is up it may just break off."""
    judged, surprising = process.judged, process.exit_code is not None and not process.expected
    try:
        code = process.wait()
    except TimeoutError as error:
        return [str(error)]
    else:
        if not judged and (surprising or code not in (0, -signal.SIGKILL, 0 if up else -signal.SIGINT)):
            return [process.ending]
        return []
    finally:
        process.close()
