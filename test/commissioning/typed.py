"""What a person types, as processes in a folder of their own, and what comes of it."""

from __future__ import annotations

import json
import os
import re
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

TESTS = Path(__file__).parents[1]
ENTRY = "from rotary_error_monitor.start import command; raise SystemExit(command())"

RECORDINGS = 2
"""Recordings at most: who is told that samples were lost records once more."""


class Running:
    """A process with what it wrote."""

    def __init__(self, words: Sequence[str], folder: Path, name: str, domain: int) -> None:
        self.name, self._file = name, folder / f"{name}.out"
        with self._file.open("w") as output:
            self.process = subprocess.Popen(
                [sys.executable, *words],
                cwd=folder,
                stdin=subprocess.PIPE,
                stdout=output,
                stderr=subprocess.STDOUT,
                text=True,
                env={**os.environ, "ROS_DOMAIN_ID": str(domain), "PYTHONPATH": str(TESTS)},
            )

    @property
    def said(self) -> str:
        return self._file.read_text(encoding="utf-8")

    def wait_for(self, text: str, deadline: float = 120.0) -> None:
        """Wait until it has written a text; it must not end before."""
        end = time.monotonic() + deadline
        while text not in self.said:
            assert self.process.poll() is None, f"{self.name} ended: {self.said}"
            assert time.monotonic() < end, f"{self.name} has not said '{text}': {self.said}"
            time.sleep(0.05)

    def tell(self, word: str) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(f"{word}\n")
        self.process.stdin.flush()


class Place:
    """A folder in which somebody types commands, in a ROS domain of its own."""

    def __init__(self, folder: Path, domain: int) -> None:
        self.folder, self.domain = folder, domain
        self._running: list[Running] = []

    def start(self, words: Sequence[str], name: str) -> Running:
        self._running.append(Running(words, self.folder, name, self.domain))
        return self._running[-1]

    def type(self, line: str, name: str) -> Running:
        """Start a command of the package as it is typed."""
        program, *words = shlex.split(line)
        assert program == "rotary_error_monitor"
        return self.start(["-c", ENTRY, *words], name)

    def drive(self, name: str, **arguments: Any) -> Running:
        """Start the drivers of a stage."""
        drivers = self.start(["-m", "commissioning.drivers", json.dumps(arguments)], name)
        drivers.wait_for("ready")
        return drivers

    def end(self) -> None:
        """End all that still runs."""
        for running in reversed(self._running):
            if running.process.poll() is None:
                running.process.send_signal(signal.SIGINT)
                try:
                    running.process.wait(30)
                except subprocess.TimeoutExpired:
                    running.process.kill()
                    running.process.wait()
            if running.process.stdin is not None:
                running.process.stdin.close()


@dataclass(frozen=True)
class Attempt:
    """A commissioning: exit code, what it said, its bag, and by how much later (ns) the stamps there are than drawn."""

    code: int
    said: str
    bag: Path
    shift: int


def commissioned(place: Place, line: str, drivers: Running) -> Attempt:
    """Commission a stage that is turned when that is asked for, and do again what it says is to be done again.

    On a computer that is busy with other things all streams may stand for seconds; then it says to record again.
    """
    for number in range(RECORDINGS):
        bag = f"bag_of_{drivers.name}_{drivers.said.count('playing')}"
        drivers.tell("home")
        commission = place.type(f"{line} --record {bag}", f"said_of_{bag}")
        commission.wait_for("turn the stage slowly")
        before = drivers.said.count("playing")
        drivers.tell("turn")
        code = commission.process.wait(240)
        end = time.monotonic() + 120.0
        while drivers.said.count("stands") <= before and time.monotonic() < end:
            time.sleep(0.05)
        shift = int(re.findall(r"playing (-?\d+)", drivers.said)[before])
        said = commission.said
        if ("of its samples" not in said and "jump against the others" not in said) or number == RECORDINGS - 1:
            break
    return Attempt(code, commission.said, place.folder / bag, shift)
