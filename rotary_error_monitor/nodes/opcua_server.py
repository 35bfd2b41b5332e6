"""The cell for machine controls, SCADA and historians: an OPC UA server that reads, and resets where it is allowed to.

ros2 run rotary_error_monitor opcua_server --ros-args -p machine:=xyzac_trt
"""

from __future__ import annotations

import asyncio
import ipaddress
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped, TwistStamped
from rclpy.task import Future
from sensor_msgs.msg import JointState, Temperature
from std_srvs.srv import Trigger

from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.description.settings import Setting
from rotary_error_monitor.description.wire import Topic
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.error_motion import COMPONENTS
from rotary_error_monitor.nodes import compensation, messages, parameters
from rotary_error_monitor.nodes.diagnostics import Condition, Level, status_name
from rotary_error_monitor.nodes.managed import ManagedNode
from rotary_error_monitor.nodes.process import program
from rotary_error_monitor.opcua.board import Board, Status
from rotary_error_monitor.opcua.model import CellDescription, information_model
from rotary_error_monitor.pipeline.corrections import OFFSET
from rotary_error_monitor.pipeline.observability import possible_components
from rotary_error_monitor.security.opcua_certificate import APPLICATION, application_uri
from rotary_error_monitor.security.users import load_users
from rotary_error_monitor.units import MICRO

if TYPE_CHECKING:
    from rotary_error_monitor.opcua.server import CellServer, Reset, ServerAccess

NAME = "opcua_server"
_NONE, _ENCRYPTED = "None", "Basic256Sha256"
_PATIENCE = 2.0
"""s for which a reset is waited for."""


class OpcuaServer(ManagedNode):
    """Shows what the cell publishes as variables of OPC UA, with unit, range, quality and the time of measurement.

    Nothing can be written. With `allow_control` the method `compensation/reset` calls the service of the compensation.
    """

    settings = (
        *parameters.cell_settings("machine"),
        Setting("address", "127.0.0.1", "address of this computer on which clients are served; 0.0.0.0 for all of its"),
        Setting("port", 4840, "TCP port on which clients are served", (1024, 65535)),
        Setting("period", 0.1, "time between two looks at what has changed, s", (0.02, 10.0)),
        Setting(
            "security_policy",
            _NONE,
            "None only on this computer; Basic256Sha256 signs and encrypts, with certificate and private_key",
            choices=(_NONE, _ENCRYPTED),
        ),
        Setting("certificate", "", "PEM file of the server's certificate; empty for none"),
        Setting("private_key", "", "PEM file of its key, without a password; empty for none"),
        Setting("users", "", "file of users with hashed passwords; empty lets everybody in"),
        Setting(
            "insecure",
            False,
            "allow other computers without encryption, and the method reset without users",
            at_start=True,
        ),
        Setting("allow_control", False, "offer the method reset of the compensation", at_start=True),
    )

    def open(self) -> None:
        """Serve what the cell says, and listen to it."""
        try:
            from rotary_error_monitor.opcua.library_log import LibraryLog
            from rotary_error_monitor.opcua.server import CellServer
        except ImportError:
            raise InputError(
                "opcua_server needs the package asyncua: pip install 'rotary_error_monitor[opcua]'"
            ) from None
        access, name = self._access(), self.setting("machine")
        machine = load_machine(name) if name else None
        model = information_model(
            CellDescription(self.stage.limits, possible_components(self.stage), machine, self._status_of)
        )
        self._board = Board(self.now_ns)
        reset = self._resetter() if self.setting("allow_control") else None
        self._log = LibraryLog(self._say)
        self._server = CellServer(access, model, self._board, self.setting("period"), reset=reset, fail=self._fail)
        try:
            self._server.start()
        except OSError as error:
            raise InputError(
                f"{self.get_fully_qualified_name()}: nothing can be served on {access.address}:{access.port} "
                f"({error}); another program has it, or the address is none of this computer's: set port or address"
            ) from error
        self._listen(() if machine is None else machine.letters)
        self.get_logger().info(f"OPC UA on opc.tcp://{access.address}:{access.port}/, {self._openness()}")

    def release(self) -> None:
        """Serve no longer."""
        server: CellServer | None = self.__dict__.pop("_server", None)
        if server is not None:
            server.stop()
        client = self.__dict__.pop("_client", None)
        if client is not None:
            self.destroy_client(client)
        log = self.__dict__.pop("_log", None)
        if log is not None:
            log.close()

    def conditions(self, now_ns: int) -> list[Condition]:
        """What is served, and to whom."""
        server = self._server
        figures = {
            "address": self.setting("address"),
            "port": self.setting("port"),
            "security_policy": self.setting("security_policy"),
            "connections": server.connections,
            "variables": server.variables,
            "statuses_left_out": server.left_out,
        }
        remarks = [] if self._is_kept_private() else ["insecure: other computers are served without encryption"]
        if server.left_out:
            remarks.append(f"{server.left_out} statuses of /diagnostics are left out: too many")
        message = "; ".join([f"serving, {self._openness()}", *remarks])
        return [Condition("server", Level.WARN if remarks else Level.OK, message, figures)]

    # Who may come.

    def _access(self) -> ServerAccess:
        """Where is served, and to whom.

        Raises:
            InputError: the parameters would let in whoever comes, or name files that will not do.
        """
        from rotary_error_monitor.opcua.server import ServerAccess

        where, address, port = self.get_fully_qualified_name(), self.setting("address"), self.setting("port")
        users = load_users(Path(self.setting("users"))) if self.setting("users") else None
        accepts = None if users is None else users.accepts
        if not (self._is_kept_private() or self.setting("insecure")):
            raise InputError(
                f"{where}: parameter 'security_policy' is 'None' and parameter 'address' is '{address}', which other "
                f"computers reach; set security_policy:={_ENCRYPTED} with certificate and private_key, or address to "
                "127.0.0.1, or insecure:=true"
            )
        if (
            self.setting("allow_control")
            and accepts is None
            and not (_is_loopback(address) or self.setting("insecure"))
        ):
            raise InputError(
                f"{where}: parameter 'allow_control' is true and parameter 'users' empty: whoever reaches '{address}' "
                "could reset; give a file of users, or address 127.0.0.1, or insecure:=true"
            )
        if self.setting("security_policy") == _NONE:
            return ServerAccess(address, port, APPLICATION, accepts=accepts)
        for name in ("certificate", "private_key"):
            if not self.setting(name):
                raise InputError(
                    f"{where}: parameter '{name}' is empty; security_policy {_ENCRYPTED} needs a PEM file, as "
                    "`rotary_error_monitor security opcua FOLDER` writes it"
                )
        certificate, key = Path(self.setting("certificate")), Path(self.setting("private_key"))
        return ServerAccess(address, port, application_uri(certificate, key), (certificate, key), accepts)

    def _is_kept_private(self) -> bool:
        return self.setting("security_policy") != _NONE or _is_loopback(self.setting("address"))

    def _openness(self) -> str:
        policy = "not encrypted" if self.setting("security_policy") == _NONE else "encrypted"
        who = "users of a file" if self.setting("users") else "everybody"
        return f"{policy}, to {who}, {'reset allowed' if self.setting('allow_control') else 'to read only'}"

    # What is shown.

    def _status_of(self, node: str, what: str) -> str:
        return status_name(f"{self.get_namespace().rstrip('/')}/{node}: {what}")

    def _listen(self, letters: Sequence[str]) -> None:
        wire = self.wire
        self._take(wire.topic("error_motion_figures"), partial(self._note_figures, "error_motion", COMPONENTS))
        self._take(wire.topic("stage_temperature"), partial(self._note_temperature, "temperature/stage"))
        if letters:
            self._take(wire.topic("machine_temperature"), partial(self._note_temperature, "temperature/machine"))
            self._take(wire.topic("tool_offset_figures"), partial(self._note_figures, "tool_offset", OFFSET))
            self._take(wire.topic("corrected_offset_pose"), self._note_pose)
            for key in ("axis_corrections", "applied_corrections"):
                self._take(wire.topic(key), partial(self._note_axes, key, letters))
        self.listen_to(wire.topic("diagnostics"), self._note_diagnostics)

    def _take(self, topic: Topic, note: Callable[[messages.Message, int], None]) -> None:
        """Call back with each message and its stamp; two that speak at once make no value of one."""

        def receive(message: messages.Message) -> None:
            if self.listening.is_shared(topic.name):
                raise InputError(self.listening.publishers_of(topic.name))
            note(message, messages.measured_ns(message.header))

        self.listen_to(topic, receive)

    def _note_figures(self, folder: str, names: Sequence[str], message: TwistStamped, stamp_ns: int) -> None:
        vectors = (message.twist.linear, message.twist.angular)
        values = [value for vector in vectors for value in (vector.x, vector.y, vector.z)]
        for name, value in zip(names, values, strict=True):
            self._board.note(f"{folder}/{name}", value, stamp_ns)

    def _note_pose(self, message: PoseWithCovarianceStamped, stamp_ns: int) -> None:
        position = message.pose.pose.position
        values = [position.x, position.y, position.z, *messages.rotation_vector(message.pose.pose.orientation).tolist()]
        for name, value in zip(OFFSET, values, strict=True):
            self._board.note(f"corrected_offset/{name}", MICRO * value, stamp_ns)

    def _note_axes(self, folder: str, letters: Sequence[str], message: JointState, stamp_ns: int) -> None:
        positions, _ = messages.joint_motion(message)
        for letter in positions.keys() & set(letters):
            self._board.note(f"{folder}/{letter}", MICRO * positions[letter], stamp_ns)

    def _note_temperature(self, path: str, message: Temperature, stamp_ns: int) -> None:
        self._board.note(path, message.temperature, stamp_ns)

    def _note_diagnostics(self, message: DiagnosticArray) -> None:
        stamp_ns = messages.ns_from_stamp(message.header.stamp)
        for status in message.status:
            figures = {each.key: each.value for each in status.values}
            self._board.note_status(Status(status.name, status.level[0], status.message, figures), stamp_ns)

    # What can be asked.

    def _resetter(self) -> Reset:
        """Function that asks the compensation to reset, on the server's event loop; the executor takes the answer."""
        client = self.create_client(Trigger, f"{self.get_namespace().rstrip('/')}/{compensation.NAME}/reset")
        self._client = client

        async def reset() -> tuple[bool, str]:
            self.get_logger().warning("a client of OPC UA asks the compensation to reset")
            if not client.service_is_ready():
                return False, f"no compensation answers {client.srv_name}; is it running?"
            loop = asyncio.get_running_loop()
            answer: asyncio.Future[Trigger.Response] = loop.create_future()
            asked = client.call_async(Trigger.Request())
            asked.add_done_callback(lambda done: loop.call_soon_threadsafe(_hand_on, done, answer))
            try:
                response = await asyncio.wait_for(answer, _PATIENCE)
            except TimeoutError:
                return False, f"{client.srv_name} has not answered within {_PATIENCE:g} s; it may have been carried out"
            return bool(response.success), str(response.message)

        return reset

    def _say(self, line: str) -> None:
        self.get_logger().warning(f"OPC UA: {line}", throttle_duration_sec=1.0)


def _hand_on(done: Future, answer: asyncio.Future[Trigger.Response]) -> None:
    if not answer.done():
        answer.set_result(done.result())


def _is_loopback(address: str) -> bool:
    try:
        return ipaddress.ip_address(address).is_loopback
    except ValueError:
        return address == "localhost"


main = program(OpcuaServer, NAME)

if __name__ == "__main__":
    raise SystemExit(main())
