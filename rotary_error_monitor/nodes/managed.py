"""What all nodes of the cell share: life cycle, parameters, quality of service, diagnostics, orderly end.

A node of the package is a `ManagedNode` with things of its own: its `settings`, `open()` which builds what it works
with, `conditions()` which says how it fares, and `release()` where something must be put away. Its module ends in

    main = program(MyNode, "my_node")
"""

from __future__ import annotations

import time
from collections.abc import Hashable, Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

from rcl_interfaces.msg import SetParametersResult
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter

from rotary_error_monitor.description.settings import Setting
from rotary_error_monitor.description.stage import StageDescription, load_stage
from rotary_error_monitor.description.wire import Wire, wire_of
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.nodes import messages, parameters
from rotary_error_monitor.nodes.connected import SIM_TIME, ConnectedNode
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
from rotary_error_monitor.nodes.qos import profile

AUTOSTART = Setting("autostart", True, "configure and activate at start; false waits for a life cycle manager")
_DIAGNOSTICS_PERIOD = 1.0
_TELL_PERIOD = 0.2  # s; what comes and goes many times a second shall not flood anybody


class ManagedNode(ConnectedNode):
    """A life cycle node that starts by itself, talks by the wire contract only, and says how it fares.

    It does so at 1 Hz, and at once when its `news` are others or something is refused that was not in the last report.

    Attributes:
        settings: parameters of the node beside `autostart`, `security` and `stage`; read when the node configures.
        stage: description of the rotary stage, from `open()` on.
        contract: the wire contract for the heads of that stage, as it stands in `msg_defs/` and in bags.
        wire: the same with the names that topics have in the node's namespace.
        simulates: whether what it publishes is simulated; the node says so in the log and in its diagnostics.
        look_period: time between two looks whether there are news, s.
    """

    settings: tuple[Setting, ...] = ()
    simulates: bool = False
    look_period: ClassVar[float] = _TELL_PERIOD

    def __init__(self, name: str, **how: Any) -> None:  # noqa: ANN401 (as `ConnectedNode`)
        """Declare the parameters; nothing else happens before the node configures.

        Raises:
            InputError: a parameter is unknown, has the wrong type, or is out of range; or security is enforced and not
                in effect.
        """
        super().__init__(name, **how)
        self.stage: StageDescription
        self.contract: Wire
        self._settings = (AUTOSTART, SECURITY, *cell_settings("stage"), *self.settings)
        self._failure: InputError | None = None
        self._told: tuple[Hashable, float] = (None, 0.0)
        self._refused = frozenset[str]()
        self._clock_watch = ClockWatch()
        self._configured = False
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

    def news(self, now_ns: int) -> Hashable:
        """What of the conditions is said at once when it is not what it was, such as reasons without their numbers."""
        return ()

    def origin(self) -> dict[str, object]:
        """Figures that say where what the node publishes comes from, where that matters: of a simulation."""
        return simulation_figures(self.hardware, self._outgoing) if self.simulates else {}

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
        self._simulated = bool(self.setting(SIM_TIME))
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
        self.disconnect()

    def _judge_parameters(self, changed: list[Parameter]) -> SetParametersResult:
        """Refuse what no node could use, and everything that is read when the node configures once it has."""
        where, closed = self.get_fully_qualified_name(), (SIM_TIME,) if self._configured else None
        reason = parameters.refusal(where, self._settings, changed, closed)
        return SetParametersResult(successful=not reason, reason=reason)

    def _open_diagnostics(self) -> None:
        """Diagnostics flow in every state once configured."""
        topic = self.wire.topic("diagnostics")
        publisher = self.create_publisher(messages.message_class(topic.type), topic.name, profile(topic))
        self._entities.append(partial(self.destroy_publisher, publisher))
        self._diagnostics = publisher
        self.every(_DIAGNOSTICS_PERIOD, self._speak, in_turn=False)
        self.every(self.look_period, self._look, in_turn=False)

    def _speak(self) -> None:
        self._diagnostics.publish(self.diagnose())

    def _look(self) -> None:
        """Publish the diagnostics at once where they say something new; of a node that is busy, later."""
        if not self.busy.acquire(timeout=self.look_period):
            return
        try:
            if self.active:
                self._tell(self.news(self.now_ns()))
        finally:
            self.busy.release()

    def _tell(self, news: Hashable) -> None:
        now = time.monotonic()
        new = news != self._told[0] or self._refusals.keys() - self._refused
        if new and now - self._told[1] >= _TELL_PERIOD:
            self._told = news, now
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
        self._refused = frozenset(self._refusals)
        self._refusals.clear()
        return self.report(now_ns, conditions)

    def report(self, now_ns: int, conditions: Iterable[Condition]) -> messages.Message:
        """Message for `/diagnostics`; two machines in two namespaces are told apart by it."""
        hardware = self.hardware or Path(self.setting("stage") or "stage").stem
        return diagnostic_array(messages.stamp_from_ns(now_ns), self.get_fully_qualified_name(), hardware, conditions)

    def _life(self, now_ns: int) -> Condition:
        halted = self._clock_watch.trouble(now_ns) if self._simulated else ""
        return life_condition(halted and f"{SIM_TIME} is set, {halted}", self.origin(), active=self.active)

    def _wrong_publishers(self) -> Iterator[Condition]:
        everyones = self.wire.topic("diagnostics").name
        wrong = ((topic, "; ".join(reasons)) for topic, reasons in self.listening.wrong() if topic != everyones)
        yield from (Condition(f"publishers of {topic}", Level.ERROR, reasons) for topic, reasons in wrong)
