"""Starting and ending an instance, and the other side of its programs, without LinuxCNC."""

import os
import time

import pytest
from faults.live.other_programs import stated

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.linuxcnc_controller import instance as instances
from rotary_error_monitor.linuxcnc_controller import presence
from rotary_error_monitor.linuxcnc_controller.connection import Connection
from rotary_error_monitor.linuxcnc_controller.instance import Instance
from rotary_error_monitor.linuxcnc_controller.protocol import ClearRequest, End, Hello, LinkSettings, encode

LINUXCNC = """#!/bin/sh
echo "DUMMY DISPLAY MODULE, press <ENTER> to continue."
echo $HOME > $HOME/place
{then}
"""


@pytest.fixture
def install(monkeypatch, tmp_path):
    """Install programs that stand for LinuxCNC's; gives the path of an ini file."""
    programs, ini = tmp_path / "bin", tmp_path / "config" / "machine.ini"
    programs.mkdir()
    ini.parent.mkdir()
    ini.touch()
    monkeypatch.setenv("PATH", f"{programs}:{os.environ['PATH']}")
    monkeypatch.setattr(presence, "find_namesakes", lambda processes: [])

    def write(then="read line", listing="33  User  inihal  75 ready"):
        for name, text in (("linuxcnc", LINUXCNC.format(then=then)), ("halcmd", f"#!/bin/sh\necho '{listing}'\n")):
            (programs / name).write_text(text)
            (programs / name).chmod(0o755)
        return ini

    return write


def test_an_instance_works_on_a_copy_and_is_gone_afterwards(install):
    with Instance(install(), isolated=False) as running:
        assert running.is_running
        assert running.enter == ()
        assert (running.folder / "config" / "machine.ini").is_file()
        assert (running.folder / "home" / "place").read_text().strip() == running.environment["HOME"]
        assert "DUMMY DISPLAY" in running.log
        folder = running.folder
    assert not folder.exists()
    assert running.log == ""
    assert not running.is_running


@pytest.mark.parametrize(
    ("then", "patience", "reason"),
    [
        ("echo 'no such kins'; exit 1", 60.0, r"(?s)did not start with .*machine.ini; its log ends:.*no such kins"),
        ("read line", 0.5, "did not start"),
    ],
)
def test_an_instance_that_does_not_start_is_cleared_away(install, monkeypatch, then, patience, reason):
    monkeypatch.setattr(instances, "_START", patience)
    unborn = Instance(install(then, listing="nothing"), isolated=False)
    begin = time.monotonic()
    with pytest.raises(InputError, match=reason):
        unborn.__enter__()
    assert then == "read line" or time.monotonic() - begin < patience / 2, "that it has ended is seen, not waited for"
    assert not unborn.folder.exists()


def test_an_isolated_instance_that_does_not_come_up_is_started_again(install, monkeypatch, tmp_path):
    """LinuxCNC hangs in its start now and then; `env` and a script stand for the commands that isolate it."""
    monkeypatch.setattr(instances, "_START", 3.0)  # what comes up does so within this on a busy computer too
    monkeypatch.setattr(instances, "_isolation", lambda: ("env",))
    monkeypatch.setattr(instances, "_child", lambda pid: pid)
    monkeypatch.setattr(instances, "_PRIVATE_TMP", 'exec "$@"')
    tries = tmp_path / "tries"
    ini = install()
    linuxcnc = tmp_path / "bin" / "linuxcnc"
    hang = f"#!/bin/sh\necho try >> {tries}\n[ $(wc -l < {tries}) -gt 2 ] || exec sleep 60\n"
    linuxcnc.write_text(hang + linuxcnc.read_text())
    nsenter = tmp_path / "bin" / "nsenter"
    nsenter.write_text('#!/bin/sh\nshift 2\nwhile [ "${1#--}" != "$1" ]; do shift; done\nexec "$@"\n')
    nsenter.chmod(0o755)
    with Instance(ini) as running:
        assert running.is_running
    assert tries.read_text().count("try") == 3


def test_an_instance_that_does_not_end_is_ended(install, monkeypatch):
    monkeypatch.setattr(instances, "_STOP", 0.2)
    with stated("start and end", 5.0), Instance(install(then="exec sleep 60"), isolated=False) as running:
        pass
    assert not running.is_running


def test_what_is_missing_is_named(install, monkeypatch, tmp_path):
    ini = install()
    with pytest.raises(InputError, match=r"no LinuxCNC configuration .*other\.ini"):
        Instance(tmp_path / "other.ini")
    monkeypatch.setattr(instances, "_isolation", lambda: ())
    with pytest.raises(InputError, match="the system allows no namespaces"):
        Instance(ini, isolated=True)
    assert not Instance(ini).isolated
    monkeypatch.setattr(presence, "find_namesakes", lambda processes: [4711])
    with pytest.raises(InputError, match="another LinuxCNC runs here"):
        Instance(ini).__enter__()
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(InputError, match="LinuxCNC is not installed; apt-get install linuxcnc-uspace"):
        Instance(ini)


def test_processes_of_any_linuxcnc_are_found_but_not_their_remains(tmp_path):
    for number, (name, state) in enumerate((("milltask", "S"), ("linuxcncsvr", "Z"), ("bash (x) y", "R"))):
        folder = tmp_path / str(number)
        folder.mkdir()
        (folder / "stat").write_text(f"{number} ({name}) {state} 1 1")
    (tmp_path / "9").mkdir()
    assert presence.find_namesakes(tmp_path) == [0]


@pytest.fixture
def talk(tmp_path):
    """A connection to a shell script in place of the link, and what it hands over."""
    connections = []

    def start(script):
        python = tmp_path / "python3"
        python.write_text(f"#!/bin/sh\n{script}\n")
        python.chmod(0o755)
        records = []
        connections.append(Connection(LinkSettings(), records.append, python=str(python)))
        return connections[-1], records

    yield start
    for connection in connections:
        connection.close()


def wait(condition):
    end = time.monotonic() + 60
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.01)


def test_records_come_through_and_the_end_of_the_program_is_told(talk):
    hello = encode(Hello(("X",))).decode().strip()
    _, records = talk(f"echo 'Running with fallback_uid'; echo '{hello}'; echo 'out of luck' >&2; exit 3")
    wait(lambda: len(records) == 2)
    assert records == [Hello(("X",)), End("the program beside LinuxCNC ended with exit code 3: out of luck")]


def test_a_program_that_says_why_it_ends_is_believed(talk):
    end = encode(End("gone")).decode().strip()
    connection, records = talk(f"echo '{end}'; exit 1")
    wait(lambda: records == [End("gone")])
    connection.send(ClearRequest())
    connection.close()
    assert records == [End("gone")]


def test_a_program_that_does_not_listen_blocks_nobody_and_is_ended(talk):
    connection, records = talk("exec sleep 60")
    for _ in range(10_000):
        connection.send(ClearRequest())
    assert connection.dropped > 0
    with stated("its end", 3.0):
        connection.close()
    assert isinstance(records[-1], End)
