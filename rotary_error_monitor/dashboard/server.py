"""The web server of the page: a thread with an event loop of its own, on a port that it has before it starts."""

from __future__ import annotations

import contextlib
import errno
import ipaddress
import re
import socket
import threading
from collections.abc import Awaitable, Callable, Iterator, MutableMapping
from pathlib import Path
from typing import Any, TypeAlias

from rotary_error_monitor.dashboard import page
from rotary_error_monitor.dashboard.board import PageBoard
from rotary_error_monitor.errors import InputError, excerpt

_BACKLOG = 64
"""Connections that may wait to be taken: some browsers with six or so each that come back together."""

_STARTING = 30.0
"""s that the server may take to begin on a busy computer."""

_CLOSING = 1
"""s that browsers have to let go when it ends."""

_PACKAGE = "rotary_error_monitor"
_LISTENING = "0A"
"""State of a socket that listens, in /proc/net/tcp."""

Scope: TypeAlias = MutableMapping[str, Any]
Asgi: TypeAlias = Callable[[Scope, Callable[..., Awaitable[Any]], Callable[..., Awaitable[Any]]], Awaitable[None]]


class _Site:
    """NiceGUI's one application of this process, and the board that it shows now."""

    board: PageBoard | None = None
    application: Asgi | None = None


class WebServer:
    """Serves the page of one board; a process serves one at a time."""

    def __init__(self, board: PageBoard, address: str, port: int) -> None:
        """Take the port and start.

        Raises:
            InputError: NiceGUI is not installed, the process has a dashboard already, or nothing can be served there.
        """
        if _Site.application is None:
            _Site.application = SameHost(page.application(lambda: _Site.board))
        import uvicorn

        self._listener = listen(address, port)
        if _Site.board is not None:
            self._listener.close()
            raise InputError("this process serves a dashboard already; start the other one in a process of its own")
        page.begin_anew()
        config = uvicorn.Config(
            _Site.application,
            log_config=None,
            log_level="critical",
            access_log=False,
            loop="asyncio",
            ws="websockets-sansio",
            timeout_graceful_shutdown=_CLOSING,
        )
        self._server = uvicorn.Server(config)
        # signals are the node's: uvicorn takes none outside the main thread
        self._thread = threading.Thread(target=self._server.run, args=([self._listener],), name="web", daemon=True)
        _Site.board = board
        self._thread.start()
        if not _comes_true(lambda: self._server.started or not self._thread.is_alive()) or not self.is_alive:
            self.stop()
            raise InputError(f"the web server on {address}:{port} does not start; its log says why")

    @property
    def is_alive(self) -> bool:
        """Whether it serves."""
        return self._thread.is_alive()

    def stop(self) -> None:
        """Let go of browsers and port; when this returns, its thread has ended."""
        self._server.should_exit = True
        self._thread.join(2.0 * _CLOSING)
        self._listener.close()
        _Site.board = None


class SameHost:
    """Answers those alone who name this computer by an address or as localhost, and pages that it served itself.

    A page of somebody else's that is open in the same browser may send requests here, read the answers where its name
    is made to point to this computer, and hold this page in a frame under buttons of its own: all three are refused.
    """

    def __init__(self, application: Asgi) -> None:
        """In front of an application."""
        self._application = application

    async def __call__(
        self, scope: Scope, receive: Callable[..., Awaitable[Any]], send: Callable[..., Awaitable[Any]]
    ) -> None:
        """Pass on or refuse."""

        async def unframed(message: MutableMapping[str, Any]) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message["headers"], (b"content-security-policy", b"frame-ancestors 'none'")]
            await send(message)

        if scope["type"] == "lifespan" or is_own(dict(scope["headers"])):
            await self._application(scope, receive, unframed)
        elif scope["type"] == "http":
            await send({"type": "http.response.start", "status": 403, "headers": [(b"content-type", b"text/plain")]})
            await send({"type": "http.response.body", "body": b"Open the dashboard by the address of its computer."})
        else:
            await send({"type": "websocket.close", "code": 1008})


def is_own(headers: MutableMapping[bytes, bytes]) -> bool:
    """Whether a request names this computer by address, localhost or its own name, and comes from no other page."""
    host = headers.get(b"host", b"").decode("latin-1")
    origin = headers.get(b"origin", b"").decode("latin-1")
    name = re.sub(r":\d+$", "", host).strip("[]")
    if origin and origin.partition("://")[2] != host:
        return False
    return name in ("localhost", socket.gethostname()) or _is_address(name)


def listen(address: str, port: int) -> socket.socket:
    """A socket that listens on an address of this computer.

    Raises:
        InputError: the address is none of this computer's, or the port is taken; it says by which process where that
            can be found out.
    """
    try:
        family = socket.getaddrinfo(address, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)[0][0]
        return socket.create_server((address, port), family=family, backlog=_BACKLOG)
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            holder = holder_of(port) or "another program"
            raise InputError(
                f"port {port} of {address} is taken by {holder}: end that, or set the parameter port to another"
            ) from error
        raise InputError(
            f"nothing can be served on {address}:{port} ({error}): expected an address of this computer as parameter "
            "address, such as 127.0.0.1, or 0.0.0.0 for all of its, and a port from 1024 as port"
        ) from error


def holder_of(port: int, proc: Path = Path("/proc")) -> str:
    """Which process listens on a port, in words; empty where that cannot be found out."""
    inodes = {f"socket:[{inode}]" for inode in _listening_inodes(port, proc)}
    for folder in proc.glob("[0-9]*"):
        with contextlib.suppress(OSError):  # of another user, or gone meanwhile
            if any(str(descriptor.readlink()) in inodes for descriptor in (folder / "fd").iterdir()):
                words = (folder / "cmdline").read_bytes().decode("utf-8", "replace").split("\0")
                ours = f"a node of {_PACKAGE}, " if any(_PACKAGE in word for word in words) else ""
                return f"{ours}process {folder.name} ({excerpt(' '.join(words).strip())})"
    return ""


def _listening_inodes(port: int, proc: Path) -> Iterator[str]:
    for name in ("tcp", "tcp6"):
        with contextlib.suppress(OSError):
            for line in (proc / "net" / name).read_text(encoding="ascii").splitlines()[1:]:
                words = line.split()
                if words[3] == _LISTENING and int(words[1].rpartition(":")[2], 16) == port:
                    yield words[9]


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name.partition("%")[0])
    except ValueError:
        return False
    return True


def _comes_true(condition: Callable[[], bool]) -> bool:
    """Whether a condition holds within the time that the server may take to begin."""
    waiting = threading.Event()
    steps = round(_STARTING / 0.01)
    return any(condition() or waiting.wait(0.01) for _ in range(steps))
