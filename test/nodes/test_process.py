"""A node as a process: it ends by a signal at any moment, orderly, and in any case."""

from __future__ import annotations

import gc
import os
import signal
import subprocess
import sys
import tracemalloc

import pytest
from faults.live.other_programs import stated
from rclpy.signals import SignalHandlerOptions, get_current_signal_handlers_options

from rotary_error_monitor.nodes import process as node_process
from rotary_error_monitor.nodes.managed import ManagedNode
from rotary_error_monitor.nodes.process import EndSignals, run
from rotary_error_monitor.testing.domains import own_domain

SIGNALS = [signal.SIGINT, signal.SIGTERM, signal.SIGHUP]


@pytest.fixture
def handlers():
    """What a process of a node keeps to its end, and this one shall not."""
    kept = {number: signal.getsignal(number) for number in SIGNALS}
    yield
    for number, handler in kept.items():
        signal.signal(number, handler)


@pytest.fixture
def ends(monkeypatch):
    """What would end this process and shall not: bounds set at once, and what is left for its exit."""
    told = []
    monkeypatch.setattr(node_process.atexit, "register", lambda *call: told.append(call))
    monkeypatch.setattr(node_process, "end_within", lambda *bound: told.append(("within", *bound)))
    return told


@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_ends_a_node_with_exit_code_zero(cell, number):
    process = cell.start("encoder_head", "encoder_head_a", source="mock")
    cell.wait_for_status("encoder_head_a: state", "active")
    with stated("its end", 10.0):
        assert process.stop(number) == 0
    assert "Traceback" not in process.output


def test_a_node_that_shall_outlive_its_terminal_does(handlers):
    signal.signal(signal.SIGHUP, signal.SIG_IGN)  # as nohup does
    told = []
    with EndSignals() as signals:
        signals.call(lambda: told.append("ended"))
        os.kill(os.getpid(), signal.SIGHUP)
        assert signal.sigtimedwait([], 0.2) is None
    assert told == []


def test_a_signal_ends_nodes_that_nothing_else_wakes(cell):
    """A node that waits to be configured has no timer: what wakes it must not come before what it shall see."""
    heads = [
        cell.start("encoder_head", f"encoder_head_{head}", head=head, autostart=False, source="mock") for head in "abcd"
    ]
    cell.wait_until(lambda: all("waiting to be configured" in head.output for head in heads), "four heads")
    cell.spin_for(0.5)
    assert [head.stop() for head in heads] == [0, 0, 0, 0]


@pytest.mark.parametrize("number", SIGNALS)
def test_a_signal_is_told_once_whenever_it_came(handlers, number):
    told = []
    with EndSignals() as signals:
        signals.call(lambda: told.append("before"))
        os.kill(os.getpid(), number)
        os.kill(os.getpid(), number)
        deadline = signal.sigtimedwait([], 1.0)  # a second without any signal of ours, in C
        assert deadline is None
        assert told == ["before"]
        signals.call(lambda: told.append("after"))
    assert told == ["before", "after"]


def test_a_signal_during_the_start_ends_the_node(handlers, ends, monkeypatch):
    class Struck(ManagedNode):
        def open(self) -> None:
            assert get_current_signal_handlers_options() == SignalHandlerOptions.NO
            os.kill(os.getpid(), signal.SIGINT)

    with own_domain() as domain:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        assert run(lambda: Struck("struck"), []) == 0
    assert ends == [("within", 5.0, 0), (node_process._let_go,), (node_process.end_within, 5.0, 0)]


def test_a_fault_of_the_program_ends_the_process(handlers, ends, monkeypatch):
    """In this process, as `main` does it; the default context needs a domain of its own like any other."""

    class Faulty(ManagedNode):
        def open(self) -> None:
            self.at_each(10_000_000, lambda _: [][0])

    with own_domain() as domain, pytest.raises(IndexError):
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        run(lambda: Faulty("faulty"), [])
    assert ends == [("within", 5.0, 1), (node_process._let_go,), (node_process.end_within, 5.0, 1)]


def run_to_its_end(program: str) -> subprocess.CompletedProcess[str]:
    """A program with a node, in a process and a domain of its own."""
    with own_domain() as domain:
        environment = {**os.environ, "ROS_DOMAIN_ID": str(domain)}
        return subprocess.run(
            [sys.executable, "-c", program], env=environment, capture_output=True, text=True, timeout=60, check=False
        )


def test_a_node_leaves_its_domain_before_libraries_are_put_away():
    """The threads of its participant are gone when the last Python of the process runs."""
    program = (
        "import atexit, os, signal\n"
        "def threads():\n"
        "    names = (open(f'/proc/self/task/{task}/comm').read().strip() for task in os.listdir('/proc/self/task'))\n"
        "    print(sum(name.startswith(('dds.udp', 'dds.ev')) for name in names), flush=True)\n"
        "atexit.register(threads)\n"
        "from rotary_error_monitor.nodes.managed import ManagedNode\n"
        "from rotary_error_monitor.nodes.process import run\n"
        "class Short(ManagedNode):\n"
        "    def open(self):\n"
        "        threads()\n"
        "        os.kill(os.getpid(), signal.SIGINT)\n"
        "raise SystemExit(run(lambda: Short('short'), []))\n"
    )
    done = run_to_its_end(program)
    assert done.returncode == 0, done.stderr
    before, after = map(int, done.stdout.split())
    assert before > 0
    assert after == 0


@pytest.mark.parametrize("code", [0, 7])
def test_a_process_that_hangs_after_python_ends_with_its_code(code):
    """The lock of the interpreter is kept, as it is when C's exit handlers hang: nothing in Python could run."""
    hang = (
        "import ctypes; from rotary_error_monitor.nodes.deadline import end_within;"
        f"end_within(0.2, {code}); ctypes.PyDLL(None).pause()"
    )
    assert subprocess.run([sys.executable, "-c", hang], timeout=30, check=False).returncode == code


@pytest.mark.few(1)
@pytest.mark.parametrize("number", SIGNALS)
def test_a_node_whose_middleware_hangs_as_it_ends_still_ends_and_says_where(number):
    """The node's own things are put away by then; the lock of the interpreter is kept, as the middleware keeps it."""
    program = (
        "import ctypes, os\n"
        "from rotary_error_monitor.nodes.managed import ManagedNode\n"
        "from rotary_error_monitor.nodes.process import run\n"
        "class Hanging(ManagedNode):\n"
        "    def open(self):\n"
        f"        os.kill(os.getpid(), {int(number)})\n"
        "    def release(self):\n"
        "        print('put away', flush=True)\n"
        "    def destroy_node(self):\n"
        "        ctypes.PyDLL(None).pause()\n"
        "raise SystemExit(run(lambda: Hanging('hanging'), []))\n"
    )
    done = run_to_its_end(program)
    assert done.returncode == 0, done.stderr
    assert "put away" in done.stdout
    assert "in destroy_node" in done.stderr


def test_a_node_keeps_nothing_of_the_callbacks_that_it_has_run(handlers, ends, monkeypatch):
    """A node runs for months: what is kept of each callback must be nothing at all."""
    callbacks = 2000
    kept: list[int] = []

    class Busy(ManagedNode):
        def open(self) -> None:
            self.count = self.reports = 0
            self.every(0.0002, self.work)

        def diagnose(self) -> object:
            self.reports += 1
            return super().diagnose()

        def work(self) -> None:
            if self.reports < 2:  # what the first report loads and keeps is none of the callbacks'
                return
            self.count += 1
            if self.count in (1, 1 + callbacks):
                gc.collect()
                kept.append(tracemalloc.get_traced_memory()[0])
            if self.count == 1 + callbacks:
                os.kill(os.getpid(), signal.SIGINT)

    tracemalloc.start()
    try:
        with own_domain() as domain:
            monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
            assert run(lambda: Busy("busy"), []) == 0
    finally:
        tracemalloc.stop()
    before, after = kept
    assert (after - before) / callbacks < 8, "bytes for each callback"
