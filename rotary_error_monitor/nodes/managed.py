"""What all nodes of the cell share: life cycle, parameters, quality of service, diagnostics, orderly end.

A node of the package is a `ManagedNode` with things of its own: its `settings`, `open()` which builds what it works
with, `conditions()` which says how it fares, and `release()` where something must be put away. Its module ends in

    main = program(MyNode, "my_node")
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.context import Context
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile
from rclpy.task import Future

from rotary_error_monitor.bags.part import Recordable
from rotary_error_monitor.codec.cdr_blocks import BlockDecoder
from rotary_error_monitor.description.settings import Setting
from rotary_error_monitor.description.stage import StageDescription, load_stage
from rotary_error_monitor.description.wire import Topic, Wire, wire_of
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.nodes import messages, parameters
from rotary_error_monitor.nodes.diagnostics import (
    ClockWatch,
    Condition,
    Level,
    diagnostic_array,
    life_condition,
    simulation_figures,
)
from rotary_error_monitor.nodes.parameters import cell_settings
from rotary_error_monitor.nodes.protection import SECURITY, judge_node, security_conditions
from rotary_error_monitor.nodes.publishers import Listening
from rotary_error_monitor.nodes.qos import OVERRIDABLE, profile
from rotary_error_monitor.nodes.worker import MessageInfo, NotByExecutor, Worker
from rotary_error_monitor.signals.blocks import SampleBlock

AUTOSTART = Setting("autostart", True, "configure and activate at start; false waits for a life cycle manager")
_DIAGNOSTICS_PERIOD = 1.0
_TELL_PERIOD = 0.2  # s; what comes and goes many times a second shall not flood anybody
_SIM_TIME = "use_sim_time"


class ManagedNode(LifecycleNode):
    """A life cycle node that starts by itself, talks by the wire contract only, and says at 1 Hz how it fares.

    Attributes:
        settings: parameters of the node beside `autostart`, `security` and `stage`; read when the node configures.
        stage: description of the rotary stage, from `open()` on.
        contract: the wire contract for the heads of that stage, as it stands in `msg_defs/` and in bags.
        wire: the same with the names that topics have in the node's namespace.
        hardware: where what it publishes comes from, such as the device that is its source; empty for
            the stage.
        simulates: whether that is a simulation; the node says so in the log and in its diagnostics.
        listening: the topics that it listens to, and who speaks there.
        active: whether the life cycle state is active; messages are handled only then.
        busy: held by whatever callback runs, so that callbacks of worker and executor take turns.
        end: done once the node shall end: by a signal, or with the exception that its worker met.
    """

    settings: tuple[Setting, ...] = ()
    hardware: str = ""
    simulates: bool = False

    def __init__(
        self,
        name: str,
        *,
        context: Context | None = None,
        parameter_overrides: Sequence[Parameter] = (),
        cli_args: Sequence[str] | None = None,
    ) -> None:
        """Declare the parameters; nothing else happens before the node configures.

        Raises:
            InputError: a parameter is unknown, has the wrong type, or is out of range; or security is enforced and not
                in effect.
        """
        super().__init__(
            name,
            context=context,
            parameter_overrides=list(parameter_overrides),
            cli_args=None if cli_args is None else list(cli_args),
        )
        self.active = False
        self.stage: StageDescription
        self.contract: Wire
        self.wire: Wire
        self._settings = (AUTOSTART, SECURITY, *cell_settings("stage"), *self.settings)
        self.end = Future()
        self._failure: InputError | None = None
        self._refusals: dict[str, tuple[int, str]] = {}
        self.listening = Listening(self)
        self._told: tuple[object, float] = (None, 0.0)
        self._entities: list[Callable[[], object]] = []
        self._outgoing: list[str] = []
        self._clock_watch = ClockWatch()
        self._worker = Worker(self.context, self.now_ns, self._fail)
        self.busy = threading.RLock()  # callbacks of the worker and of the executor take turns
        self._configured = False
        self._simulated = bool(self.get_parameter(_SIM_TIME).value)
        parameters.declare(self, self._settings)
        self._security = judge_node(self)
        self.add_on_set_parameters_callback(self._judge_parameters)

    # What a node of the package fills in.

    def open(self) -> None:
        """Build what the node works with: core objects, publishers, listeners, timers. Called when it configures."""

    def release(self) -> None:
        """Put away what `open` built and the base does not know: files, devices. Called at cleanup and at the end."""

    def conditions(self, now_ns: int) -> list[Condition]:
        """How the node fares at `now_ns`, for `/diagnostics`."""
        return []

    def origin(self) -> dict[str, object]:
        """Figures that say where what the node publishes comes from, where that matters: of a simulation."""
        return simulation_figures(self.hardware, self._outgoing) if self.simulates else {}

    # What a node of the package uses.

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
        """The same for sample blocks, without building a message: they come thousands of times a second."""
        decoder = BlockDecoder()
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

    # Life cycle.

    def autostart(self) -> None:
        """Configure and activate, unless the parameter `autostart` is false.

        Raises:
            InputError: the node cannot be configured; the message says what is wrong.
        """
        if not self.setting(AUTOSTART.name):
            self.get_logger().info("waiting to be configured")
            return
        if self.trigger_configure() != TransitionCallbackReturn.SUCCESS:
            raise self._failure or InputError(f"{self.get_fully_qualified_name()}: could not be configured")
        self.trigger_activate()

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Read the stage and the contract and open the node; wrong input leaves it unconfigured and is logged."""
        self._simulated = bool(self.setting(_SIM_TIME))
        try:
            parameters.check_given(self, self._settings)
            self.stage = load_stage(self.setting("stage") or None)
            self.contract = wire_of(self.stage)
            self.wire = self.contract.within(self.get_namespace())
            self._open_diagnostics()
            self.open()
            parameters.check_known(self, [*self._parameters], opened=True)
            if self.simulates:
                self.get_logger().warning(f"source {self.hardware}: simulated are {', '.join(self._outgoing)}")
        except InputError as error:
            self._failure = error
            self.get_logger().fatal(str(error))
            self._close()
            return TransitionCallbackReturn.FAILURE
        self._failure = None
        self._configured = True
        self._worker.start()
        return super().on_configure(state)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin to handle messages."""
        self.active = True
        self.get_logger().info("active")
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Fall silent; diagnostics go on."""
        self.active = False
        self.get_logger().info("inactive")
        return super().on_deactivate(state)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Put everything away, ready to be configured anew."""
        self._close()
        return super().on_cleanup(state)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Put everything away for good."""
        self._close()
        return super().on_shutdown(state)

    def stop(self) -> None:
        """Put everything away and destroy the node; fit for any state, also after the context has ended."""
        self._close()
        # rclpy leaves it to whoever lets go of the node last; until then the node would stay in the graph
        self._state_machine.destroy_when_not_in_use()
        self.destroy_node()

    def put_away(self) -> None:
        """End what the node does, and put away what is its own; what the middleware keeps for it is left."""
        self.active = False
        self._configured = False
        self._worker.stop()
        self.release()

    def _close(self) -> None:
        self.put_away()
        for destroy in reversed(self._entities):
            destroy()
        self._entities.clear()
        self._outgoing.clear()
        self.listening.clear()

    def _judge_parameters(self, changed: list[Parameter]) -> SetParametersResult:
        """Refuse what no node could use, and everything that is read when the node configures once it has."""
        where, closed = self.get_fully_qualified_name(), (_SIM_TIME,) if self._configured else None
        reason = parameters.refusal(where, self._settings, changed, closed)
        return SetParametersResult(successful=not reason, reason=reason)

    def _open_diagnostics(self) -> None:
        """Diagnostics flow in every state once configured."""
        topic = self.wire.topic("diagnostics")
        publisher = self.create_publisher(messages.message_class(topic.type), topic.name, profile(topic))
        self._entities.append(partial(self.destroy_publisher, publisher))
        self._diagnostics = publisher
        self.every(_DIAGNOSTICS_PERIOD, self._speak, in_turn=False)

    def _speak(self) -> None:
        self._diagnostics.publish(self.diagnose())

    def tell(self, what: object) -> None:
        """Publish the diagnostics at once where `what` they would say is not what it was at the last call."""
        now = time.monotonic()
        if what != self._told[0] and now - self._told[1] >= _TELL_PERIOD:
            self._told = what, now
            self._speak()

    def diagnose(self) -> messages.Message:
        """The message for `/diagnostics`: the life cycle, the node's conditions, and what had to be refused."""
        with self.busy:
            return self._diagnose(self.now_ns())

    def _diagnose(self, now_ns: int) -> messages.Message:
        conditions = [self._life(now_ns), *self.conditions(now_ns), *self._wrong_publishers()]
        conditions += security_conditions(self._security)
        for source, (count, reason) in self._refusals.items():
            conditions.append(Condition(f"refused {source}", Level.ERROR, reason, {"refused_messages": count}))
        self._refusals.clear()
        return self.report(now_ns, conditions)

    def report(self, now_ns: int, conditions: Iterable[Condition]) -> messages.Message:
        """Message for `/diagnostics`; two machines in two namespaces are told apart by it."""
        hardware = self.hardware or Path(self.setting("stage") or "stage").stem
        return diagnostic_array(messages.stamp_from_ns(now_ns), self.get_fully_qualified_name(), hardware, conditions)

    def _life(self, now_ns: int) -> Condition:
        halted = self._clock_watch.trouble(now_ns) if self._simulated else ""
        return life_condition(halted and f"{_SIM_TIME} is set, {halted}", self.origin(), active=self.active)

    def _wrong_publishers(self) -> Iterator[Condition]:
        everyones = self.wire.topic("diagnostics").name
        wrong = ((topic, "; ".join(reasons)) for topic, reasons in self.listening.wrong() if topic != everyones)
        yield from (Condition(f"publishers of {topic}", Level.ERROR, reasons) for topic, reasons in wrong)
