"""One node as a process: from its start to the signal that ends it, and the exit code that says how it ended.

rclpy's own signal handlers wake the executor first and end the context after that, from a thread of their own: an
executor that is back in its wait by then sleeps on, a node without timers for ever; a signal before the context stands
is lost; callbacks find their context gone halfway. Here a signal completes a future that the executor waits for, and
the node puts its things away while its context still stands.
"""

from __future__ import annotations

import atexit
import gc
import signal
import socket
import sys
import threading
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from functools import partial
from types import FrameType
from typing import Self

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import try_shutdown

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.nodes.deadline import end_within
from rotary_error_monitor.nodes.managed import ManagedNode
from rotary_error_monitor.nodes.protection import check_environment, explained
from rotary_error_monitor.nodes.transport import steady_transport

BAD_INPUT = 2

_ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

_LAST_MOMENTS = 5.0
"""What libraries may take to put themselves away once the node has done so, s: ten times what they take on a busy
computer, and a third of what `up` waits for a node to end."""


def run(node_class: Callable[[], ManagedNode], args: Sequence[str] | None = None) -> int:
    """Run one node until SIGINT, SIGTERM or SIGHUP; for the main thread of a process that does nothing else.

    The signals stay without effect afterwards: a second one shall not strike while the process puts itself away.

    Returns:
        Exit code: 0 after a signal; 2 after wrong input, or where security is enforced and cannot be had, which is
        said on standard error.
    """
    code = 1
    try:
        code = _run(node_class, args)
    finally:
        atexit.register(_let_go)
        atexit.register(end_within, _LAST_MOMENTS, code)  # the last one registered comes first
    return code


def program(node_class: Callable[[str], ManagedNode], name: str) -> Callable[[], int]:
    """Entry point of an executable that runs one node, called `name`, as `run` does."""
    return partial(run, partial(node_class, name))


def _let_go() -> None:
    """Delete what is left of the node, so that its participant leaves the domain while everything else still stands.

    rclpy's objects refer to one another in circles, which were frozen: left to the destructors of the libraries, the
    participant goes while its own threads still listen to others that go.
    """
    gc.unfreeze()
    gc.collect()


def _run(node_class: Callable[[], ManagedNode], args: Sequence[str] | None) -> int:
    with ExitStack() as stack:
        try:
            signals = stack.enter_context(EndSignals())
            check_environment(args)
            stack.enter_context(steady_transport())
            rclpy.init(args=None if args is None else list(args), signal_handler_options=SignalHandlerOptions.NO)
            stack.callback(try_shutdown)
            node = node_class()
        except InputError as error:
            return _refused(error)
        except RuntimeError as error:  # so rcl refuses command lines, parameter files and keys
            return _refused(explained(error))
        code = 1
        try:
            _spin(node, signals)
            code = 0
        except InputError as error:
            code = _refused(error)
        finally:
            _stop(node, code)
    return code


def _stop(node: ManagedNode, code: int) -> None:
    """Let the node put its things away, for as long as that takes, and the middleware its own, which may hang."""
    node.put_away()
    end_within(_LAST_MOMENTS, code)
    node.stop()


class EndSignals:
    """SIGINT, SIGTERM and SIGHUP while in its `with` statement: nothing is interrupted by them, one callback is told.

    A SIGHUP that whoever started the process has it ignore stays ignored.

    Python's own handlers run on the main thread once it is back from C, and rcl's wait goes on through signals. The
    interpreter writes each signal's number to a descriptor at once, though, which a thread can wait for.
    """

    def __init__(self) -> None:
        self._came = threading.Event()
        self._lock = threading.Lock()
        self._callback: Callable[[], None] | None = None

    def __enter__(self) -> Self:
        self._reader, self._writer = socket.socketpair()
        self._writer.setblocking(False)
        self._former = signal.set_wakeup_fd(self._writer.fileno(), warn_on_full_buffer=False)
        self._thread = threading.Thread(target=self._watch, name="signals")
        self._thread.start()
        for number in _ENDING:
            if number != signal.SIGHUP or signal.getsignal(number) != signal.SIG_IGN:  # as under nohup
                signal.signal(number, _go_on)
        return self

    def __exit__(self, *_: object) -> None:
        signal.set_wakeup_fd(self._former)
        self._writer.close()
        self._thread.join()
        self._reader.close()

    def call(self, callback: Callable[[], None]) -> None:
        """Call back, once and on any thread, when the first signal comes, or now if it came already."""
        with self._lock:
            self._callback = callback
            if self._came.is_set():
                callback()

    def _watch(self) -> None:
        while numbers := self._reader.recv(64):
            if not self._came.is_set() and any(number in numbers for number in _ENDING):
                with self._lock:
                    self._came.set()
                    if self._callback is not None:
                        self._callback()


def _go_on(number: int, frame: FrameType | None) -> None:
    """The watching thread does what there is to do; without a handler the process would break off."""


def _spin(node: ManagedNode, signals: EndSignals) -> None:
    """Let the node work until a signal comes; a fault of the program on its worker is raised here."""
    signals.call(partial(node.end.set_result, None))
    node.autostart()
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    # What stands now stands to the end: the collector need not walk through it while blocks are waiting.
    gc.collect()
    gc.freeze()
    try:
        _spin_until(executor, node)
        node.end.result()
    finally:
        executor.shutdown()


def _spin_until(executor: SingleThreadedExecutor, node: ManagedNode) -> None:
    """Run callbacks until the node shall end.

    The executor's own `spin_until_future_complete` hangs one more callback to the future for each one that it runs.
    """
    woken = node.create_guard_condition(_nothing)
    node.end.add_done_callback(lambda _: woken.trigger())
    while node.context.ok() and not node.end.done():
        executor.spin_once()


def _nothing() -> None:
    """What is done when the executor is woken: nothing but to look whether the node shall end."""


def _refused(error: Exception) -> int:
    print(f"error: {error}", file=sys.stderr)
    return BAD_INPUT
