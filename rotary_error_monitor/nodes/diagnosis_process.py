"""Diagnoses in a process of their own, of lowest priority: whatever happens there, the node goes on undelayed."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rotary_error_monitor.bags.writer import RecordingStoppedError, write_messages
from rotary_error_monitor.description.wire import Wire
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.signals.blocks import SampleBlock

LATEST = "latest"
"""Folder, below the one that is given, of recording and results of the latest diagnosis."""

_LOWEST_PRIORITY = 19
_VERDICTS = (0, 10, 11, 12)
_BAD_INPUT = 2
_PREFIX = "rotary_error_monitor: "


@dataclass(frozen=True)
class DiagnosisEnd:
    """How a diagnosis ended.

    Attributes:
        sentence: the verdict, or why there is none.
        content: of `diagnosis.json`; None where there is no verdict.
        duration: s.
    """

    sentence: str
    content: Mapping[str, Any] | None
    duration: float


class DiagnosisProcess:
    """Runs the command `diagnose`, one recording at a time.

    Recordings and results pass through files, as when a user records a bag and asks: the verdict is the same.
    """

    def __init__(self, wire: Wire, options: Sequence[str], patience: float, folder: Path | None = None) -> None:
        """Run nothing yet.

        Args:
            wire: contract for the stage's heads.
            options: of the command, behind the bag; all but those for its output.
            patience: longest time that a diagnosis may take, s.
            folder: keeps recording, results and report of the latest diagnosis; None keeps nothing.
        """
        self._wire = wire
        self._options = tuple(options)
        self._patience = patience
        self._folder = folder
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None
        self._process: subprocess.Popen[str] | None = None
        self._outcome: DiagnosisEnd | None = None
        self._began = 0.0
        self._stopping = False

    @property
    def is_running(self) -> bool:
        """Whether a diagnosis is under way, or its outcome was not taken yet."""
        return self._thread is not None

    @property
    def pid(self) -> int | None:
        """Process id of the diagnosis; None while there is none."""
        process = self._process
        return None if process is None else process.pid

    @property
    def elapsed(self) -> float:
        """Time since the last start, s."""
        return time.monotonic() - self._began

    def start(self, blocks: Mapping[str, Sequence[SampleBlock]]) -> None:
        """Diagnose sample blocks by stream, while the caller goes on.

        Raises:
            RuntimeError: the last one is still running.
        """
        if self.is_running:
            raise RuntimeError("a diagnosis is still running")
        self._began = time.monotonic()
        self._thread = threading.Thread(target=self._work, args=(blocks,), name="diagnosis")
        self._thread.start()

    def take(self) -> DiagnosisEnd | None:
        """The outcome once there is one; after that the next diagnosis may start."""
        thread = self._thread
        if thread is None or thread.is_alive():
            return None
        thread.join()
        self._thread = None
        outcome, self._outcome = self._outcome, None
        return outcome

    def stop(self) -> None:
        """End what is running, for good; when this returns, there is no process and no file of it any more."""
        with self._lock:
            self._stopping = True
            if self._process is not None:
                _kill(self._process)
        if self._thread is not None:
            self._thread.join()
            self._thread = None

    def _work(self, blocks: Mapping[str, Sequence[SampleBlock]]) -> None:
        try:
            with tempfile.TemporaryDirectory(prefix="gap_monitor_", dir=self._folder) as folder:
                sentence, content = self._diagnose(Path(folder), blocks)
                if content is not None and self._folder is not None:
                    _replace(self._folder / LATEST, Path(folder))
        except (OSError, InputError, RecordingStoppedError) as error:
            sentence, content = f"no verdict: {error}", None
        except Exception as error:  # a fault here must not pass for a diagnosis that goes on
            sentence, content = f"no verdict: {type(error).__name__}: {error}", None
        self._outcome = DiagnosisEnd(sentence, content, self.elapsed)

    def _diagnose(
        self, folder: Path, blocks: Mapping[str, Sequence[SampleBlock]]
    ) -> tuple[str, Mapping[str, Any] | None]:
        topics = {stream: self._wire.of_stream(stream).name for stream in blocks}
        write_messages(folder / "bag", {topics[stream]: each for stream, each in blocks.items()}, self._wire)
        process = self._open(folder)
        if process is None:
            return "no verdict: the node ends", None
        try:
            said, complaint = process.communicate(timeout=self._patience)
        except subprocess.TimeoutExpired:
            _kill(process)
            process.communicate()
            return f"no verdict: ended after {self._patience:g} s without a result", None
        finally:
            self._process = None
        code = process.returncode
        if code in _VERDICTS:
            return said.strip(), json.loads((folder / "out" / "diagnosis.json").read_text(encoding="utf-8"))
        if code == _BAD_INPUT:
            return f"no verdict: {complaint.strip().removeprefix(_PREFIX)}", None
        end = f"was ended by {signal.Signals(-code).name}" if code < 0 else f"ended with exit code {code}"
        last = complaint.strip().splitlines()[-1:]
        return ": ".join([f"no verdict: the process of the diagnosis {end}", *last]), None

    def _open(self, folder: Path) -> subprocess.Popen[str] | None:
        """The process, unless there shall be none any more."""
        report = [] if self._folder is not None else ["--no-report"]
        command = [sys.executable, "-m", "rotary_error_monitor.cli", "diagnose", str(folder / "bag")]
        with self._lock:
            if self._stopping:
                return None
            self._process = subprocess.Popen(
                [*command, *self._options, "-o", str(folder / "out"), *report],
                env={**os.environ, "OMP_NUM_THREADS": "1", "MPLBACKEND": "Agg"},
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.PIPE,
                text=True,
                start_new_session=True,  # Ctrl-C is for the node alone, which ends the process itself
            )
            os.setpriority(os.PRIO_PROCESS, self._process.pid, _LOWEST_PRIORITY)
            return self._process


def _kill(process: subprocess.Popen[str]) -> None:
    """End a diagnosis with the process that draws its page; both are of one session."""
    if process.poll() is None:
        with contextlib.suppress(ProcessLookupError):  # it may end by itself meanwhile, in the thread that waits for it
            os.killpg(process.pid, signal.SIGKILL)


def _replace(target: Path, source: Path) -> None:
    """Move what is in `source` to `target`, in place of what was there."""
    shutil.rmtree(target, ignore_errors=True)
    target.mkdir(parents=True)
    for item in source.iterdir():
        shutil.move(item, target / item.name)
