"""What all nodes of the cell share: life cycle, parameters, quality of service, diagnostics, orderly end.

A node of the package is a `ManagedNode` with things of its own: its `settings`, `open()` which builds what it works
with, `conditions()` which says how it fares, and `release()` where something must be put away. Its module ends in

    def main(args: Sequence[str] | None = None) -> int:
        return run(MyNode, args)
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, ClassVar

from rcl_interfaces.msg import SetParametersResult
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.context import Context
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.task import Future

from rotary_error_monitor.bags.cdr_blocks import BlockDecoder
from rotary_error_monitor.description.stage import StageDescription, load_stage
from rotary_error_monitor.description.wire import Topic, Wire, load_wire
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.nodes import messages, parameters
from rotary_error_monitor.nodes.diagnostics import Condition, Level, diagnostic_array
from rotary_error_monitor.nodes.parameters import Setting, cell_settings
from rotary_error_monitor.nodes.worker import NotByExecutor, Worker
from rotary_error_monitor.signals.blocks import SampleBlock

AUTOSTART = Setting("autostart", True, "configure and activate at start; false waits for a life cycle manager")
_DIAGNOSTICS_PERIOD = 1.0
_SIM_TIME = "use_sim_time"
_OVERRIDABLE = (QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH, QoSPolicyKind.RELIABILITY, QoSPolicyKind.DURABILITY)


class ManagedNode(LifecycleNode):
    """A life cycle node that starts by itself, talks by the wire contract only, and says at 1 Hz how it fares.

    Attributes:
        settings: parameters of the node beside `autostart` and `stage`; read when the node configures.
        stage: description of the rotary stage, from `open()` on.
        wire: the contract for the heads of that stage.
        active: whether the life cycle state is active; messages are handled only then.
        busy: held by whatever callback runs, so that callbacks of worker and executor take turns.
        end: done once the node shall end: by a signal, or with the exception that its worker met.
    """

    settings: ClassVar[tuple[Setting, ...]] = ()
    hardware: str = ""

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
            InputError: a parameter is unknown, has the wrong type, or is out of range.
        """
        super().__init__(
            name,
            context=context,
            parameter_overrides=list(parameter_overrides),
            cli_args=None if cli_args is None else list(cli_args),
        )
        self.active = False
        self.stage: StageDescription
        self.wire: Wire
        self._settings = (AUTOSTART, *cell_settings("stage"), *self.settings)
        self.end = Future()
        self._failure: InputError | None = None
        self._refusals: dict[str, int] = {}
        self._entities: list[Callable[[], object]] = []
        self._worker = Worker(self.context, self.now_ns, self._fail)
        self.busy = threading.RLock()  # callbacks of the worker and of the executor take turns
        self._configured = False
        self._simulated = bool(self.get_parameter(_SIM_TIME).value)
        parameters.declare(self, self._settings)
        self.add_on_set_parameters_callback(self._refuse_while_configured)

    # What a node of the package fills in.

    def open(self) -> None:
        """Build what the node works with: core objects, publishers, listeners, timers. Called when it configures."""

    def release(self) -> None:
        """Put away what `open` built and the base does not know: files, devices. Called at cleanup and at the end."""

    def conditions(self, now_ns: int) -> list[Condition]:
        """How the node fares at `now_ns`, for `/diagnostics`."""
        return []

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
            qos_overriding_options=QoSOverridingOptions(_OVERRIDABLE),
        )
        self._entities.append(partial(self.destroy_lifecycle_publisher, publisher))
        return publisher

    def listen_to(self, topic: Topic, callback: Callable[[messages.Message], None]) -> None:
        """Call back with each message of a contract's topic while the node is active."""
        self.listen(topic.name, messages.message_class(topic.type), profile(topic), callback)

    def listen_to_bytes(self, topic: Topic, callback: Callable[[bytes, int], None]) -> None:
        """The same with the message as it is serialised, and when it was received, timestamp (ns)."""

        def received(both: tuple[bytes, int]) -> None:
            callback(*both)

        self._subscribe(topic.name, messages.message_class(topic.type), profile(topic), received, raw=True)

    def listen_to_blocks(self, topic: Topic, callback: Callable[[SampleBlock], None]) -> None:
        """The same for sample blocks, without building a message: they come thousands of times a second."""
        decoder = BlockDecoder()
        self.listen_to_bytes(topic, lambda data, _: callback(decoder.decode(data)))

    def listen(self, name: str, kind: type[Any], qos: QoSProfile, callback: Callable[[messages.Message], None]) -> None:
        """The same for a topic outside the contract, such as that of a third-party driver."""
        self._subscribe(name, kind, qos, lambda both: callback(both[0]), raw=False)

    def gather(self, period: float) -> None:
        """Let messages gather for `period` s after the first has come, and handle them together."""
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

    def every(self, period: float, callback: Callable[[], None]) -> None:
        """Call back every `period` s of real time, in any state: a halted `/clock` or a pause must not hide."""

        def guarded() -> None:
            with self.busy:
                callback()

        timer = self.create_timer(period, guarded, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._entities.append(partial(self.destroy_timer, timer))

    def refuse(self, source: str, error: InputError) -> None:
        """Take note of input that cannot be used: counted, shown in the diagnostics, logged at most once a second."""
        self._refusals[source] = self._refusals.get(source, 0) + 1
        self._failure = error
        self.get_logger().error(f"{source}: {error}", throttle_duration_sec=1.0)

    def _subscribe(
        self,
        name: str,
        kind: type[Any],
        qos: QoSProfile,
        callback: Callable[[tuple[messages.Message, int]], None],
        *,
        raw: bool,
    ) -> None:
        """Have the worker call back with each message and when it was received, by the node's clock."""

        def guarded(message: messages.Message, received_ns: int) -> None:
            self._handle(name, callback, (message, self.now_ns() if self._simulated else received_ns))

        subscription = self.create_subscription(
            kind,
            name,
            lambda _: None,
            qos,
            callback_group=NotByExecutor(),
            raw=raw,
            qos_overriding_options=QoSOverridingOptions(_OVERRIDABLE),
        )
        self._worker.serve(subscription, guarded)
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
            self.stage = load_stage(self.setting("stage") or None)
            self.wire = load_wire(tuple(self.stage.encoder.azimuths))
            self._open_diagnostics()
            self.open()
            parameters.check_known(self, [*self._parameters], opened=True)
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
        return super().on_activate(state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Fall silent; diagnostics go on."""
        self.active = False
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
        self.destroy_node()

    def _close(self) -> None:
        self.active = False
        self._configured = False
        self._worker.stop()
        self.release()
        for destroy in reversed(self._entities):
            destroy()
        self._entities.clear()

    def _refuse_while_configured(self, changed: list[Parameter]) -> SetParametersResult:
        names = {setting.name for setting in self._settings} | {_SIM_TIME}
        late = [parameter.name for parameter in changed if parameter.name in names] if self._configured else []
        if late:
            return SetParametersResult(
                successful=False, reason=f"{', '.join(late)}: read when the node configures; clean it up first"
            )
        return SetParametersResult(successful=True)

    def _open_diagnostics(self) -> None:
        """Diagnostics flow in every state once configured."""
        topic = self.wire.topic("diagnostics")
        publisher = self.create_publisher(messages.message_class(topic.type), topic.name, profile(topic))
        self._entities.append(partial(self.destroy_publisher, publisher))
        self.every(_DIAGNOSTICS_PERIOD, lambda: publisher.publish(self.diagnose()))

    def diagnose(self) -> messages.Message:
        """The message for `/diagnostics`: the life cycle, the node's conditions, and what had to be refused."""
        with self.busy:
            return self._diagnose(self.now_ns())

    def _diagnose(self, now_ns: int) -> messages.Message:
        state = Condition("state", Level.OK, "active") if self.active else Condition("state", Level.WARN, "inactive")
        conditions = [state, *self.conditions(now_ns)]
        for source, count in self._refusals.items():
            conditions.append(
                Condition(f"refused {source}", Level.ERROR, str(self._failure), {"refused_messages": count})
            )
        self._refusals.clear()
        return diagnostic_array(messages.stamp_from_ns(now_ns), self.get_name(), self.hardware, conditions)


def profile(topic: Topic) -> QoSProfile:
    """Quality of service of a contract's topic."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=topic.qos.depth,
        reliability=ReliabilityPolicy[topic.qos.reliability.upper()],
        durability=DurabilityPolicy[topic.qos.durability.upper()],
    )


def driver_profile() -> QoSProfile:
    """Quality of service that fits the publisher of any driver: best effort listens to reliable ones as well."""
    return QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
