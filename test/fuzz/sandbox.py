"""A child process for commands that get damaged or hostile files: what hangs, grows or crashes there is caught."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

CPU = 5
"""Processor time (s) of a run; time by the clock would measure what else the computer does."""

MEMORY = 1 << 30
"""Bytes that a run may ask for beside the loaded package."""

LONGEST_MESSAGE = 4000
"""Characters: more is no message that anybody reads."""

WARNS = "prints a warning"

CLEAN = frozenset({0, 2, 10, 11, 12})
"""Exit codes of the package's commands; 2 is wrong input."""


@dataclass(frozen=True)
class Run:
    """How a command ended: exit code or signal, what it printed, processor time (s)."""

    arguments: tuple[str, ...]
    code: int | None
    signal: int | None
    cpu: float
    said: str

    @property
    def fault(self) -> str | None:
        """Why this is no clean end; None for one that is."""
        if self.signal is not None:
            return f"ended by signal {self.signal} after {self.cpu:.1f} s of processor time"
        for word in ("Traceback", "MemoryError", "RecursionError", "not enough memory"):
            if word in self.said:
                return f"prints {word}"
        if "Warning:" in self.said:
            return WARNS
        if self.code not in CLEAN:
            return f"exit code {self.code}"
        if self.code == 2 and "rotary_error_monitor: " not in self.said:
            return "says nothing"
        if self.code == 2 and len(self.said) > LONGEST_MESSAGE:
            return f"says {len(self.said)} characters"
        return None

    def __str__(self) -> str:
        return f"{' '.join(self.arguments)}: {self.fault or self.code}\n{self.said[-3000:]}"


class Sandbox:
    """Runs commands one after another, each with limits of its own.

    Use it as a context manager.
    """

    def __init__(self, folder: Path) -> None:
        self._output = folder / "said"
        self._process = subprocess.Popen(
            [sys.executable, str(Path(__file__).with_name("worker.py"))],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            cwd=folder,
            env={**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MPLBACKEND": "Agg"},
        )
        assert self._answer() == {"ready": True}

    def run(self, arguments: Sequence[str | Path], cpu: int = CPU, memory: int = MEMORY) -> Run:
        """Run `rotary_error_monitor` with these arguments."""
        words = tuple(map(str, arguments))
        job = {"arguments": words, "cpu": cpu, "memory": memory, "output": str(self._output)}
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(job) + "\n")
        self._process.stdin.flush()
        answer = self._answer()
        said = self._output.read_text(encoding="utf-8", errors="replace")
        return Run(words, answer["code"], answer["signal"], answer["cpu"], said)

    def _answer(self) -> Any:
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        assert line, "the sandbox ended"
        return json.loads(line)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        assert self._process.stdin is not None and self._process.stdout is not None
        self._process.stdin.close()
        self._process.wait()
        self._process.stdout.close()
