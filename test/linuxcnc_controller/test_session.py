"""Programs beside LinuxCNC: they serve until something ends, and say what."""

import os
import signal
import sys
import tempfile
import types

import pytest

from rotary_error_monitor.linuxcnc_controller import modules, presence, session
from rotary_error_monitor.linuxcnc_controller.clock import Moment
from rotary_error_monitor.linuxcnc_controller.protocol import Absent, ClearRequest, End, Hello, decode, encode

COMPONENTS = """Loaded HAL Components:
ID      Type  Name                                            PID   State
    35  User  halcmd80                                           80 ready
    33  User  inihal                                          {pid} ready
    24  RT    __servo-thread                                        ready
"""
SEGMENTS = "       key      shmid perms\n{hal}  1 600\n      1002  2 600\n"
HAL_KEY = 0x48414C32


class Recorder:
    """Looks at nothing, and notes what it is told."""

    def __init__(self):
        self.told = []
        self.looks = 0

    def handle(self, record, now):
        self.told.append((record, now))

    def look(self, clock):
        self.looks += 1
        return Hello((str(clock().stamp_ns),))


@pytest.fixture
def pipes():
    """Read and write ends of two pipes: the task's, and the other side's."""
    ends = [*os.pipe(), *os.pipe()]
    yield ends
    for end in ends:
        try:
            os.close(end)
        except OSError:
            continue


def test_records_are_taken_up_whole_and_looks_go_on_until_the_other_side_closes(pipes):
    task, _, source, other = pipes
    recorder, sent = Recorder(), []
    line = encode(ClearRequest())
    os.write(other, line + line[:5])

    def send(record):
        sent.append(record)
        if len(sent) == 2:
            os.write(other, line[5:])
        if len(sent) == 4:
            os.close(other)

    now = Moment(42, 7)
    assert session.serve(recorder, 0.001, task, source, send, lambda: now) == ""
    assert recorder.told == [(ClearRequest(), now)] * 2
    assert sent[0] == Hello(("42",))
    assert recorder.looks == len(sent)


def test_the_end_of_the_task_process_ends_it(pipes):
    task, end, source, _ = pipes
    os.close(end)
    assert session.serve(Recorder(), 0.001, task, source, lambda record: None) == session.TASK_ENDED


def test_presence_is_read_from_the_table_of_shared_memory():
    assert presence.runs(SEGMENTS.format(hal=HAL_KEY))
    assert not presence.runs(SEGMENTS.format(hal=4))
    assert not presence.runs("       key      shmid perms\n\n")
    assert not presence.runs("")


def test_the_task_process_is_found_among_the_components():
    listing = COMPONENTS.format(pid=75)
    assert presence.component_pid(listing, "inihal") == 75
    assert presence.component_pid(listing, "__servo-thread") is None


@pytest.fixture
def machine(controller, monkeypatch, tmp_path):
    """LinuxCNC's modules and programs, as far as a session uses them."""
    table = tmp_path / "shm"
    table.write_text(SEGMENTS.format(hal=HAL_KEY))
    monkeypatch.setattr(presence, "SHARED_MEMORY", table)
    halcmd = tmp_path / "halcmd"
    halcmd.write_text(f"#!/bin/sh\ncat <<'E'\n{COMPONENTS.format(pid=os.getpid())}E\n")
    halcmd.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    machine = types.SimpleNamespace(table=table, halcmd=halcmd, axis_mask=0b101111, exited=0, controller=controller)

    class Status:
        linear_units, angular_units, axis_mask, polls = 1.0, 1.0, 0, 0

        def poll(self):
            self.polls += 1
            if self.polls == 1:
                raise SystemError("<method 'poll' of 'linuxcnc.stat' objects> returned NULL")
            self.axis_mask = machine.axis_mask if self.polls > 2 else 0  # the first status after a start is empty

    hal, linuxcnc = types.ModuleType("hal"), types.ModuleType("linuxcnc")
    for name in ("get_value", "set_p", "get_info_pins"):
        setattr(hal, name, getattr(controller, name))

    def leave():
        machine.exited += 1

    hal.component = lambda name: types.SimpleNamespace(ready=lambda: None, exit=leave)
    linuxcnc.stat = Status
    monkeypatch.setitem(sys.modules, "hal", hal)
    monkeypatch.setitem(sys.modules, "linuxcnc", linuxcnc)
    # a session asks for it for itself; here it would last, for the tests after it and for all that they start
    machine.scheduled = []
    monkeypatch.setattr(os, "sched_setscheduler", lambda *asked: machine.scheduled.append(asked[:2]))
    return machine


@pytest.fixture
def speak(monkeypatch, pipes):
    """Run a session, by default with the other side closed already; gives its exit code and what it said."""
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)}

    def run(start=lambda settings, pins: (Recorder(), 0.001), closed=True):
        _, _, source, other = pipes
        if closed:
            os.close(other)
        monkeypatch.setattr(sys, "stdin", types.SimpleNamespace(fileno=lambda: source))
        with tempfile.TemporaryFile() as said:
            monkeypatch.setattr(sys, "stdout", types.SimpleNamespace(buffer=said, fileno=said.fileno))
            code = session.run("test", start, ["{}"])
            said.seek(0)
            return code, [decode(line) for line in said.read().splitlines()]

    yield run
    for number, handler in handlers.items():
        signal.signal(number, handler)


def test_a_session_says_hello_and_leaves_quietly(machine, speak):
    assert speak() == (0, [Hello(("X", "Y", "Z", "A", "C"))])
    assert machine.exited == 1
    assert machine.scheduled == [(0, os.SCHED_RR)]


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (lambda m: m.halcmd.write_text("#!/bin/sh\n"), "task process (HAL component inihal) does not run"),
        (lambda m: setattr(m, "axis_mask", 0), "told of no axes"),
    ],
)
def test_a_session_that_cannot_begin_says_why(machine, speak, spoil, reason, monkeypatch):
    monkeypatch.setattr(session, "_STATUS_PATIENCE", 0.05)
    spoil(machine)
    code, said = speak()
    assert code == 1
    assert isinstance(said[-1], End)
    assert reason in said[-1].reason


def test_a_session_waits_for_a_linuxcnc_and_leaves_quietly_if_the_other_side_closes(machine, speak):
    machine.table.write_text("")
    assert speak() == (0, [Absent(session.ABSENT)])
    assert machine.exited == 0


def test_a_session_goes_on_when_a_linuxcnc_comes_whatever_was_said_meanwhile(machine, speak, pipes, monkeypatch):
    machine.table.write_text("")
    other = pipes[3]
    said = os.write(other, encode(ClearRequest()))
    looks = iter([False, False, True])

    def runs(table):
        found = next(looks)
        if found:
            os.close(other)
        return found

    monkeypatch.setattr(presence, "runs", runs)
    recorder = Recorder()
    code, records = speak(lambda settings, pins: (recorder, 0.001), closed=False)
    assert (code, records[:2]) == (0, [Absent(session.ABSENT), Hello(("X", "Y", "Z", "A", "C"))])
    assert said > 0
    assert recorder.told == []


def test_looks_go_on_while_nobody_takes_what_they_say(monkeypatch, pipes):
    """The other side is stopped: its pipe is full after some hundred states."""
    task, _, source, other = pipes
    reader, writer = os.pipe()
    with open(writer, "wb", buffering=0) as stream:  # noqa: PTH123 (a descriptor)
        monkeypatch.setattr(sys, "stdout", types.SimpleNamespace(buffer=stream, fileno=stream.fileno))
        recorder = Recorder()

        def send(record):
            session._send_if_taken(record)
            if recorder.looks == 10_000:
                os.close(other)

        assert session.serve(recorder, 0.0, task, source, send) == ""
    assert recorder.looks >= 10_000
    with open(reader, "rb") as taken:  # noqa: PTH123
        lines = taken.read().splitlines()
    assert 100 < len(lines) < 10_000
    assert all(isinstance(decode(line), Hello) for line in lines), "none is cut"


def test_a_task_process_that_is_gone_by_now_is_told(machine, speak):
    child = os.fork()
    if child == 0:
        os._exit(0)
    os.waitpid(child, 0)
    machine.halcmd.write_text(f"#!/bin/sh\ncat <<'E'\n{COMPONENTS.format(pid=child)}E\n")
    assert speak()[1] == [End(f"LinuxCNC's task process {child} has ended")]


def test_a_shutdown_of_linuxcnc_is_told(machine, speak):
    class Told(Recorder):
        def look(self, clock):
            os.kill(os.getpid(), signal.SIGTERM)

    code, said = speak(lambda settings, pins: (Told(), 0.0), closed=False)
    assert (code, said[-1]) == (1, End(session.SHUTDOWN))
    assert machine.exited == 1


def test_a_reader_that_is_gone_is_no_failure(machine, speak):
    def start(settings, pins):
        raise BrokenPipeError

    assert speak(start) == (0, [])


def test_missing_modules_name_the_package_to_install(monkeypatch, tmp_path):
    monkeypatch.setattr(modules, "SYSTEM_MODULES", tmp_path)
    with pytest.raises(modules.InputError, match="apt-get install linuxcnc-uspace"):
        modules.load_module("no_such_module_of_linuxcnc")
    assert str(tmp_path) not in sys.path


def test_modules_of_another_python_are_named(monkeypatch, tmp_path):
    (tmp_path / "linuxcnc.cpython-39-x86_64-linux-gnu.so").touch()
    monkeypatch.setattr(modules, "SYSTEM_MODULES", tmp_path)
    with pytest.raises(modules.InputError, match=r"holds linuxcnc\.cpython-39.*use the Python that it is built for"):
        modules.load_module("no_such_module_of_linuxcnc")


def test_the_programs_of_the_system_see_none_of_this_installation():
    environment = {"PATH": "/bin", "LD_LIBRARY_PATH": "/ros", "PYTHONPATH": "/ros", "VIRTUAL_ENV": "/venv"}
    assert modules.system_environment(environment) == {"PATH": "/bin"}
