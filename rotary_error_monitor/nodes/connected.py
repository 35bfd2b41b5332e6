"""What a node speaks and hears: publishers, listeners, services and timers, that take turns and go when it closes."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.context import Context
from rclpy.lifecycle import LifecycleNode
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.task import Future

from rotary_error_monitor.codec.cdr_blocks import BlockDecoder
from rotary_error_monitor.description.wire import Topic, Wire
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.nodes import messages, parameters
from rotary_error_monitor.nodes.publishers import Listening
from rotary_error_monitor.nodes.qos import OVERRIDABLE, profile
from rotary_error_monitor.nodes.worker import MessageInfo, NotByExecutor, Worker
from rotary_error_monitor.signals.blocks import SampleBlock

if TYPE_CHECKING:  # what writes bags takes as long to load as all of rclpy
    from rotary_error_monitor.bags.part import Recordable

SIM_TIME = "use_sim_time"


class ConnectedNode(LifecycleNode):
    """A life cycle node that talks by the wire contract, on a worker that takes turns with its executor.

    Attributes:
        wire: the wire contract with the names that topics have in the node's namespace.
        hardware: where what it publishes comes from, such as the device that is its source; empty for
            the stage.
        listening: the topics that it listens to, and who speaks there.
        active: whether the life cycle state is active; messages are handled only then.
        busy: held by whatever callback runs, so that callbacks of worker and executor take turns.
        end: done once the node shall end: by a signal, or with the exception that its worker met.
    """

    hardware: str = ""

    def __init__(
        self,
        name: str,
        *,
        context: Context | None = None,
        parameter_overrides: Sequence[Parameter] = (),
        cli_args: Sequence[str] | None = None,
    ) -> None:
        """As `LifecycleNode`; it speaks and hears nothing yet."""
        super().__init__(
            name,
            context=context,
            parameter_overrides=list(parameter_overrides),
            cli_args=None if cli_args is None else list(cli_args),
        )
        self.active = False
        self.wire: Wire
        self.end = Future()
        self.listening = Listening(self)
        self.busy = threading.RLock()  # callbacks of the worker and of the executor take turns
        self._refusals: dict[str, tuple[int, str]] = {}
        self._entities: list[Callable[[], object]] = []
        self._outgoing: list[str] = []
        self._worker = Worker(self.context, self.now_ns, self._fail)
        self._simulated = bool(self.get_parameter(SIM_TIME).value)

    def setting(self, name: str) -> parameters.ParameterValue:
        """Present value of one of the settings."""
        return self.get_parameter(name).value

    def now_ns(self) -> int:
        """The node's clock, timestamp (ns); with `use_sim_time` that of `/clock`."""
        # The clock builds an object and asks three times for one number; the system's time is the same number.
        return int(self.get_clock().now().nanoseconds) if self._simulated else time.time_ns()

    def publish_on(self, topic: Topic) -> Publisher:
        """Publisher of one of the contract's topics; silent unless the node is active."""
        publisher = self.create_lifecycle_publisher(
            messages.message_class(topic.type),
            topic.name,
            profile(topic),
            qos_overriding_options=OVERRIDABLE,
        )
        self._entities.append(partial(self.destroy_lifecycle_publisher, publisher))
        if topic != self.wire.topic("diagnostics"):
            self._outgoing.append(topic.name)
        return publisher

    def listen_to(self, topic: Topic, callback: Callable[[messages.Message], None]) -> None:
        """Call back with each message of a contract's topic while the node is active."""
        self.listen(topic.name, messages.message_class(topic.type), profile(topic), callback)

    def listen_to_bytes(self, topic: Topic, callback: Callable[[bytes, int], None]) -> None:
        """The same with the message as it is serialised, and when it was received, timestamp (ns)."""
        self.listen_to_numbered(topic, lambda data, received_ns, _: callback(data, received_ns))

    def listen_to_numbered(
        self, topic: Recordable, callback: Callable[[bytes, int, int | None], None], depth: int | None = None
    ) -> None:
        """The same with the number that its publisher gave the message, None where the middleware knows none.

        Args:
            topic: of the contract, or another one with its name, type and quality of service.
            callback: takes bytes, timestamp (ns), number.
            depth: messages that may wait for this node, by default those of the contract.
        """
        qos = profile(topic)
        qos.depth = depth or qos.depth
        kind = messages.message_class(topic.type)
        self._subscribe(topic.name, kind, qos, lambda received: callback(*received), raw=True)

    def listen_to_blocks(self, topic: Topic, callback: Callable[[SampleBlock], None]) -> None:
        """The same for sample blocks, without building a message: they come thousands of times a second.

        Those that are computed are refused in another frame than the contract's. A raw stream may be of any driver: its
        topic says whose readings they are, and readings are along no axes of a frame.
        """
        decoder = BlockDecoder(frame=None if topic.is_raw else topic.frame)
        self.listen_to_bytes(topic, lambda data, _: callback(decoder.decode(data)))

    def listen(self, name: str, kind: type[Any], qos: QoSProfile, callback: Callable[[messages.Message], None]) -> None:
        """The same for a topic outside the contract, such as one of another machine; it may be relative."""
        self._subscribe(self.resolve_topic_name(name), kind, qos, lambda received: callback(received[0]), raw=False)

    def listen_raw(self, name: str, kind: type[Any], qos: QoSProfile, callback: Callable[[bytes, int], None]) -> None:
        """The same with the message as it is serialised, and when it was received, timestamp (ns)."""
        full = self.resolve_topic_name(name)
        self._subscribe(full, kind, qos, lambda received: callback(received[0], received[1]), raw=True)

    def gather(self, period: float | None) -> None:
        """Let messages gather for `period` s after the first has come, and handle them together.

        None: until the next instant of `at_each`, at most some milliseconds.
        """
        self._worker.gather = period

    def serve(
        self, kind: type[Any], name: str, callback: Callable[[messages.Message, messages.Message], messages.Message]
    ) -> None:
        """Answer a service; `name` is relative to the node, such as `~/reset`."""

        def guarded(request: messages.Message, response: messages.Message) -> messages.Message:
            with self.busy:
                return callback(request, response)

        service = self.create_service(kind, name, guarded)
        self._entities.append(partial(self.destroy_service, service))

    def at_each(self, period_ns: int, callback: Callable[[int], None]) -> None:
        """Call back, while active, at each multiple of `period_ns` of the node's clock, with that instant (ns)."""
        self._worker.at_each(period_ns, partial(self._handle, self.hardware or self.get_name(), callback))

    def after_messages(self, callback: Callable[[], None]) -> None:
        """Call back, while active, once after the messages that came together were handed to their listeners."""
        self._worker.after_messages(partial(self._handle, self.get_name(), lambda _: callback(), None))

    def every(self, period: float, callback: Callable[[], None], *, in_turn: bool = True) -> None:
        """Call back every `period` s of real time, in any state: a halted `/clock` or a pause must not hide.

        Where it is not `in_turn` with other callbacks, it takes `busy` itself for as long as it needs.
        """

        def guarded() -> None:
            with self.busy:
                callback()

        clock = Clock(clock_type=ClockType.STEADY_TIME)
        timer = self.create_timer(period, guarded if in_turn else callback, clock=clock)
        self._entities.append(partial(self.destroy_timer, timer))

    def refuse(self, source: str, error: InputError) -> None:
        """Take note of input that cannot be used: counted, shown in the diagnostics, logged at most once a second."""
        count, _ = self._refusals.get(source, (0, ""))
        self._refusals[source] = count + 1, str(error)
        self.get_logger().error(f"{source}: {error}", throttle_duration_sec=1.0)

    def _subscribe(
        self,
        name: str,
        kind: type[Any],
        qos: QoSProfile,
        callback: Callable[[tuple[messages.Message, int, int | None]], None],
        *,
        raw: bool,
    ) -> None:
        """Have the worker call back with each message, when it was received by the node's clock, and its number."""
        source = self.listening.source(name)

        def guarded(message: messages.Message, about: MessageInfo) -> None:
            number = about["publication_sequence_number"]
            source.note(number, time.monotonic())
            received_ns = self.now_ns() if self._simulated else about["received_timestamp"]
            self._handle(name, callback, (message, received_ns, number))

        subscription = self.create_subscription(
            kind,
            name,
            lambda _: None,
            qos,
            callback_group=NotByExecutor(),
            raw=raw,
            qos_overriding_options=OVERRIDABLE,
        )
        self._worker.serve(subscription, guarded)
        self.listening.subscribed(name, subscription)
        self._entities.append(partial(self.destroy_subscription, subscription))

    def _handle(self, source: str, callback: Callable[[Any], None], argument: messages.Message) -> None:
        """Call a callback of the node while it is active; wrong input is refused, anything else is a fault."""
        with self.busy:
            if not self.active:
                return
            try:
                callback(argument)
            except InputError as error:
                self.refuse(source, error)

    def _fail(self, error: Exception) -> None:
        """The worker met an error that is not the user's; at the end of the context there is always one."""
        if self.context.ok():
            self.end.set_exception(error)

    def disconnect(self) -> None:
        """Speak and hear nothing any longer."""
        for destroy in reversed(self._entities):
            destroy()
        self._entities.clear()
        self._outgoing.clear()
        self.listening.clear()
