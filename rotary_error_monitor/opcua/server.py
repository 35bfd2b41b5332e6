"""The OPC UA server of a cell, on an event loop and a thread of its own; only this file knows the library."""

from __future__ import annotations

import asyncio
import contextlib
import threading
from collections.abc import Awaitable, Callable, Sequence
from concurrent.futures import Future
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from asyncua import Node, Server, ua
from asyncua.crypto.permission_rules import User, UserRole

from rotary_error_monitor.errors import excerpt
from rotary_error_monitor.opcua.board import Board, Point
from rotary_error_monitor.opcua.model import NAMESPACE, Variable, health_variables
from rotary_error_monitor.opcua.units import NAMESPACE as UNITS_NAMESPACE

MOST_STATUSES = 300
"""Statuses that the address space shows: a whole cell has some seventy, and anybody may speak on `/diagnostics`."""

CELL = "cell"
_PATIENCE = 30.0
"""Longest time for the server to stand, s: its standard address space alone takes a second of computing."""

_LAST_MOMENTS = 1.0
"""Longest time for clients to be told that the server ends, s."""

_VARIANTS = {float: ua.VariantType.Double, str: ua.VariantType.String, bool: ua.VariantType.Boolean}
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
Reset = Callable[[], Awaitable[tuple[bool, str]]]


@dataclass(frozen=True)
class ServerAccess:
    """Where the server listens, and to whom.

    Attributes:
        address: of this computer.
        port: TCP port.
        application: URI of the application.
        encrypted: certificate and key (PEM) of an encrypted server; none for one without any security.
        accepts: whether a name and a password are let in; none where nobody needs any.
    """

    address: str
    port: int
    application: str
    encrypted: tuple[Path, Path] | None = None
    accepts: Callable[[str | None, str | None], bool] | None = None


class _Gate:
    """Lets in who may come; everybody reads, nobody is an administrator."""

    def __init__(self, access: ServerAccess) -> None:
        self._access = access

    def get_user(
        self,
        iserver: Any,  # noqa: ANN401 (the library's signature)
        username: str | None = None,
        password: str | None = None,
        certificate: Any = None,  # noqa: ANN401
    ) -> User | None:
        # the library takes unsecured channels whatever its policies are; they have no certificate of the client
        if self._access.encrypted is not None and not certificate:
            return None
        if self._access.accepts is not None and not self._access.accepts(username, password):
            return None
        return User(role=UserRole.User, name=username)


class CellServer:
    """Offers the variables of a board; what changes there is seen by clients after `period` s."""

    def __init__(
        self,
        access: ServerAccess,
        model: Sequence[Variable],
        board: Board,
        period: float,
        *,
        reset: Reset | None = None,
        fail: Callable[[Exception], None],
    ) -> None:
        """Nothing listens before `start`.

        Args:
            access: where, and to whom.
            model: the variables; those of health join as statuses are heard.
            board: their values.
            period: time between two looks at the board, s.
            reset: called, on the server's event loop, by the method `compensation/reset`; without it there is none.
            fail: told of a fault of the program while the server runs.
        """
        self._access = access
        self._model = tuple(model)
        self._board = board
        self._period = period
        self._reset = reset
        self._fail = fail
        self._ready: Future[None] = Future()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._main()), name="opcua")
        self._loop: asyncio.AbstractEventLoop | None = None
        self._ending: asyncio.Event | None = None
        self._variables: dict[str, tuple[Variable, Node]] = {}
        self._shown: dict[str, Point] = {}
        self._folders: dict[str, Node] = {}
        self._statuses: set[str] = set()
        self.connections = 0

    def start(self) -> None:
        """Listen; returns once clients may come.

        Raises:
            OSError: the address is none of this computer's, or its port is taken.
        """
        self._thread.start()
        try:
            self._ready.result(_PATIENCE)
        except BaseException:
            self.stop()
            raise

    def stop(self) -> None:
        """Close all connections and listen no longer."""
        if self._loop is not None and self._ending is not None and self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._ending.set)
        self._thread.join()

    @property
    def variables(self) -> int:
        """How many variables there are, those of health among them."""
        return len(self._variables)

    @property
    def left_out(self) -> int:
        """Statuses that are not shown, for there are too many."""
        return max(0, len(self._board.statuses()) - MOST_STATUSES)

    async def _main(self) -> None:
        self._loop, self._ending = asyncio.get_running_loop(), asyncio.Event()
        try:
            server = await self._opened()
        except Exception as error:  # handed to whoever waits for the start
            self._ready.set_exception(error)
            return
        self._ready.set_result(None)
        try:
            while not self._ending.is_set():
                await self._refresh(server)
                self.connections = 0 if server.bserver is None else len(server.bserver.clients)
                with contextlib.suppress(TimeoutError):
                    await asyncio.wait_for(self._ending.wait(), self._period)
        except Exception as error:
            self._fail(error)
        finally:
            await _close(server)

    async def _opened(self) -> Server:
        access = self._access
        server = Server(user_manager=_Gate(access))
        await server.init()
        await server.set_application_uri(access.application)
        server.set_server_name("rotary_error_monitor")
        server.set_endpoint(f"opc.tcp://{access.address}:{access.port}/")
        if access.encrypted is None:
            server.set_security_policy([ua.SecurityPolicyType.NoSecurity])
        else:
            await server.load_certificate(access.encrypted[0])
            await server.load_private_key(access.encrypted[1])
            server.set_security_policy([ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt])
        anonymous = access.accepts is None
        server.set_identity_tokens([ua.AnonymousIdentityToken if anonymous else ua.UserNameIdentityToken])
        self._index = await server.register_namespace(NAMESPACE)
        self._folders[""] = await server.nodes.objects.add_object(self._id(CELL), self._named(CELL))
        for variable in self._model:
            await self._add(variable)
        if self._reset is not None:
            await self._add_reset(self._reset)
        await self._refresh(server)
        await server.start()
        return server

    async def _add_reset(self, reset: Reset) -> None:
        async def call(_: ua.NodeId) -> list[ua.Variant]:
            done, message = await reset()
            return [ua.Variant(done, ua.VariantType.Boolean), ua.Variant(message, ua.VariantType.String)]

        folder = await self._folder("compensation")
        outputs = [ua.VariantType.Boolean, ua.VariantType.String]
        await folder.add_method(self._id("compensation/reset"), self._named("reset"), call, [], outputs)

    async def _refresh(self, server: Server) -> None:
        """Write what has changed on the board."""
        for name, status in self._board.statuses().items():
            if name not in self._statuses and len(self._statuses) < MOST_STATUSES:
                self._statuses.add(name)
                for variable in health_variables(name, tuple(status.figures)):
                    await self._add(variable)
        for path, (variable, node) in self._variables.items():
            point = self._board.read(variable)
            if point != self._shown.get(path):
                self._shown[path] = point
                await server.write_attribute_value(node.nodeid, _data_value(variable, point))
                await self._set_ranges(server, path, point)

    async def _set_ranges(self, server: Server, path: str, point: Point) -> None:
        """Where that was a limit, the ranges of what keeps within it."""
        if isinstance(point.value, float):
            span = ua.DataValue(ua.Variant(ua.Range(Low=-point.value, High=point.value)))
            for variable, _ in self._variables.values():
                if variable.range_of == path:
                    await server.write_attribute_value(self._id(f"{variable.path}/EURange"), span)

    async def _add(self, variable: Variable) -> None:
        if variable.path in self._variables:
            return
        folder = await self._folder(variable.folder)
        item = ua.AddNodesItem()
        item.RequestedNewNodeId, item.BrowseName = self._id(variable.path), self._named(variable.name)
        item.ParentNodeId, item.NodeClass = folder.nodeid, ua.NodeClass.Variable
        item.ReferenceTypeId = ua.NodeId(ua.ObjectIds.HasComponent)
        kind = ua.ObjectIds.AnalogUnitType if variable.type is float else ua.ObjectIds.BaseDataVariableType
        item.TypeDefinition = ua.NodeId(kind)
        item.NodeAttributes = _attributes(variable)
        (added,) = await folder.session.add_nodes([item])
        added.StatusCode.check()
        node = Node(folder.session, added.AddedNodeId)
        self._variables[variable.path] = variable, node
        if variable.type is float:
            for name, value, data_type in (
                ("EngineeringUnits", _unit(variable), ua.ObjectIds.EUInformation),
                ("EURange", ua.Range(Low=variable.range[0], High=variable.range[1]), ua.ObjectIds.Range),
            ):
                path = self._id(f"{variable.path}/{name}")
                await node.add_property(path, ua.QualifiedName(name, 0), value, datatype=ua.NodeId(data_type))

    async def _folder(self, path: str) -> Node:
        if path not in self._folders:
            outer, _, name = path.rpartition("/")
            parent = await self._folder(outer)
            self._folders[path] = await parent.add_object(self._id(path), self._named(name))
        return self._folders[path]

    def _id(self, path: str) -> ua.NodeId:
        return ua.NodeId(path, self._index)

    def _named(self, name: str) -> ua.QualifiedName:
        return ua.QualifiedName(excerpt(name), self._index)


async def _close(server: Server) -> None:
    # the library's clock sleeps a second at a time, and stopping would wait for it
    if server.iserver.time_task is not None:
        server.iserver.time_task.cancel()
        server.iserver.time_task = None
    with contextlib.suppress(TimeoutError):
        await asyncio.wait_for(server.stop(), _LAST_MOMENTS)


def _attributes(variable: Variable) -> ua.VariableAttributes:
    attributes = ua.VariableAttributes()
    attributes.DisplayName = ua.LocalizedText(excerpt(variable.name))
    attributes.Description = ua.LocalizedText(variable.meaning)
    attributes.DataType = ua.NodeId(_VARIANTS[variable.type].value)
    attributes.Value = ua.Variant(None, ua.VariantType.Null)
    attributes.ValueRank = ua.ValueRank.Scalar
    attributes.AccessLevel = attributes.UserAccessLevel = ua.AccessLevel.CurrentRead.mask
    attributes.WriteMask = attributes.UserWriteMask = 0
    attributes.Historizing = False
    return attributes


def _unit(variable: Variable) -> ua.EUInformation:
    unit = variable.unit
    return ua.EUInformation(UNITS_NAMESPACE, unit.number, ua.LocalizedText(unit.symbol), ua.LocalizedText(unit.name))


def _data_value(variable: Variable, point: Point) -> ua.DataValue:
    kind = ua.VariantType.Null if point.value is None else _VARIANTS[variable.type]
    # in whole microseconds: a floating-point number of seconds does not hold them
    stamp = None if point.stamp_ns is None else _EPOCH + timedelta(microseconds=point.stamp_ns // 1000)
    return ua.DataValue(
        ua.Variant(point.value, kind),
        StatusCode=ua.StatusCode(getattr(ua.StatusCodes, point.quality.value)),
        SourceTimestamp=stamp,
    )
