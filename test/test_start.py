"""A signal ends a program without a traceback whenever it comes: while libraries load, at work, at its end."""

from __future__ import annotations

import os
import random
import re
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from rotary_error_monitor import start
from rotary_error_monitor.bags.writer import write_messages
from rotary_error_monitor.description.wire import load_wire
from rotary_error_monitor.signals.blocks import block_from_samples
from rotary_error_monitor.testing.domains import LOCALHOST, discovery_environment, own_domain

SIGNALS = (signal.SIGINT, signal.SIGTERM)
SPAN = 3.0
"""Time (s) over which the moment of the signal is drawn: twice what a node takes to be active on a loaded computer."""

DRAWS = 12
"""Moments for each program and signal, one in each twelfth of the span, drawn anew in each run."""

# Python's own start is over once this speaks; what the program then does is the program's.
SPEAK = "from rotary_error_monitor import start; start.end_at_once(); print('begun', flush=True)\n"
NODE = SPEAK + "import sys; sys.exit(start.node(sys.argv.pop(1)))"
COMMAND = SPEAK + "import sys; sys.exit(start.command())"

# Strikes itself at its n-th import, whatever that is.
STRUCK = """
import os, signal, sys
from rotary_error_monitor import start
left = int(sys.argv.pop(1))
def strike(event, _):
    global left
    left -= event == "import"
    if event == "import" and left == 0:
        os.kill(os.getpid(), signal.SIGINT)
start.end_at_once()
sys.addaudithook(strike)
import rotary_error_monitor.nodes.{module}
print("all loaded", flush=True)
"""

# The signal comes where Python throws exceptions away.
LOST = """
import gc, os, signal, sys, time, weakref
from rotary_error_monitor import start
from rotary_error_monitor.unwinding import unwinding
start.end_at_once()
number, place = int(sys.argv[1]), sys.argv[2]
def strike(*_):
    os.kill(os.getpid(), number)
    time.sleep(0.01)
class Thing:
    def __del__(self):
        if place == "destructor":
            strike()
def lose():
    thing = Thing()
    kept = weakref.ref(thing, strike if place == "weak reference" else None)
    if place == "collector":
        gc.callbacks[:] = [strike]
        gc.collect()
        gc.callbacks.clear()
with unwinding():
    lose()
    time.sleep(5)
    print("went on")
"""

# What only the collector frees stays until the process is gone; what is registered for the end is done.
CYCLE = """
import atexit, sys
from rotary_error_monitor import cli, start
class Thing:
    def __del__(self):
        print("collected")
def main():
    thing = Thing()
    thing.itself = thing
    atexit.register(print, "closed")
    {how}
cli.main = main
sys.exit(start.command())
"""


# What scipy names of numpy is not loaded until somebody uses it, and then is as it always is.
UNUSED = """
import sys
from rotary_error_monitor import start
start.load_when_used()
start.load_when_used()
import numpy, scipy.special
def loaded(name):
    return any(module.startswith(name + ".") for module in sys.modules)
print([name for name in start.UNUSED if loaded(name)])
import numpy.testing
from numpy import f2py
numpy.testing.assert_array_equal([1.0], [1.0])
print(f2py.__name__, [name for name in start.UNUSED if loaded(name)], len(sys.meta_path) - len(set(sys.meta_path)))
"""


def bag(folder: Path) -> Path:
    """Two seconds of two opposed heads and a command that stand still."""
    wire = load_wire()
    times = np.arange(0, 2_000_000_000, 100_000)
    blocks = {
        wire.topic("head_samples", head).name: [
            block_from_samples(part, ("angle",), np.zeros((len(part), 1))) for part in np.split(times, 400)
        ]
        for head in "ab"
    }
    write_messages(folder, blocks, wire)
    return folder


def ends(script: str, arguments: Sequence[str], number: signal.Signals, moments: Sequence[float]) -> list[str]:
    """How the program ended that was struck at each moment (s after its first line): exit code and what it wrote."""

    def end(moment: float) -> str:
        with own_domain() as domain:
            process = subprocess.Popen(
                [sys.executable, "-c", script, *(argument.format(moment=moment) for argument in arguments)],
                env={**os.environ, **discovery_environment(LOCALHOST), "ROS_DOMAIN_ID": str(domain)},
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
            )
            with process:
                assert process.stdout is not None
                assert process.stdout.readline() == "begun\n"
                time.sleep(moment)  # this is what varies here
                process.send_signal(number)
                written, _ = process.communicate(timeout=60)
        return f"{process.returncode} {written}"

    with ThreadPoolExecutor(2) as pool:
        return list(pool.map(end, moments))


def moments() -> list[float]:
    return [SPAN * (part + random.random()) / DRAWS for part in range(DRAWS)]


def check_clean(found: Sequence[str], codes: set[int]) -> None:
    for each in found:
        code, written = each.split(" ", 1)
        assert int(code) in codes, each
        assert not re.search("Traceback|Fatal|KeyboardInterrupt|Exception ignored", written), each


@pytest.mark.few(1)
@pytest.mark.parametrize("number", SIGNALS)
def test_a_node_ends_cleanly_whenever_a_signal_comes(tmp_path, number):
    arguments = ["recorder", "--ros-args", "-p", f"folder:={tmp_path}/{{moment}}"]
    found = ends(NODE, arguments, number, moments())
    check_clean(found, {0, -number})
    recorded = [path for path in tmp_path.glob("*/*.mcap") if not (path.parent / ".reserve").exists()]
    assert all(path.read_bytes().endswith(b"MCAP0\r\n") for path in recorded), "a bag that was begun is closed"


@pytest.mark.few(1)
@pytest.mark.parametrize("number", SIGNALS)
def test_a_command_ends_cleanly_whenever_a_signal_comes(tmp_path, number):
    recording = bag(tmp_path / "bag")
    found = ends(COMMAND, ["replay", str(recording), "-o", f"{tmp_path}/{{moment}}.npz"], number, moments())
    check_clean(found, {0, -number, 128 + number})


@pytest.mark.parametrize("number", (*SIGNALS, signal.SIGHUP))
@pytest.mark.parametrize("place", ["destructor", "weak reference", "collector"])
def test_a_signal_that_python_throws_away_strikes_again(number, place):
    done = subprocess.run(
        [sys.executable, "-c", LOST, str(int(number)), place], capture_output=True, text=True, timeout=20
    )
    assert "went on" not in done.stdout
    assert "Exception ignored" not in done.stderr
    if number != signal.SIGINT:
        assert (done.returncode, done.stderr) == (128 + number, "")


@pytest.mark.parametrize("module", ["recorder", "gap_monitor"])
def test_no_import_is_broken_off_by_an_exception(module):
    """At imports all through the load: a library that is halfway in must not see an exception."""
    script = STRUCK.format(module=module)

    def struck(number: int) -> str:
        done = subprocess.run([sys.executable, "-c", script, str(number)], capture_output=True, text=True)
        return f"{done.returncode} {done.stdout}{done.stderr}"

    assert struck(0) == "0 all loaded\n"
    for number in sorted(random.sample(range(1, 200), 6)):
        assert struck(number) == f"-{signal.SIGINT} "


def test_a_module_that_python_runs_itself_is_a_node():
    command = [sys.executable, "-m", "rotary_error_monitor.nodes.encoder_head", "--ros-args", "-p", "head:=x"]
    assert subprocess.run(command, capture_output=True).returncode == 2
    asked = "import rotary_error_monitor.nodes, signal; assert signal.getsignal(2) is signal.default_int_handler"
    subprocess.run([sys.executable, "-c", asked], check=True)


def test_what_scipy_never_uses_is_loaded_when_somebody_does():
    done = subprocess.run([sys.executable, "-W", "error", "-c", UNUSED], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines() == ["[]", "numpy.f2py ['numpy.f2py', 'numpy.testing'] 0"]


def test_who_has_decided_about_a_signal_is_not_overruled():
    kept = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        start.end_at_once()
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, kept)
    with pytest.raises(AttributeError, match="__path__"):
        _ = start.__path__


@pytest.mark.parametrize("how", ["return 3", "sys.exit(3)"])
def test_a_command_ends_without_a_look_at_all_that_it_has_made(how):
    done = subprocess.run([sys.executable, "-c", CYCLE.format(how=how)], capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (3, "closed\n", "")
