"""A whole machine cell on mock sensors: run it, record it, replay it, hold it against what is true.

Each node is a process of its own on real DDS. The mock stage and machine have exact geometry and share no formula with
estimator and compensation, so what they say is an independent truth. An external force comes and goes (Lou et al. 2019,
Figure 15), and the LVDT is set to one height after the other.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Never

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from rotary_error_monitor.signals.blocks import NANOSECONDS
from rotary_error_monitor.testing.domains import own_domain
from rotary_error_monitor.testing.processes import NodeProcess, parameter_arguments

HEIGHTS = (0.005, 0.016, 0.060)
"""Heights of the LVDT above the ring, m: those of the paper."""

SPEEDS = (1.5707963267948966, 6.283185307179586)
"""Speeds of a cycle of the stage, rad/s."""

_TICK = 0.1


@dataclass(frozen=True)
class MockCell:
    """What is run.

    Attributes:
        folder: of the recording and what is made of it; it must not exist.
        duration: of the recording, s.
        machine: name or file of the machine.
        stage: file of the stage; None for the embedded one.
        seed: of the mock stage.
        rate: samples a second of heads and autocollimator.
        quiet: no progress line.
    """

    folder: Path
    duration: float = 30.0
    machine: str = "xyzac_trt"
    stage: Path | None = None
    seed: int = 1
    rate: float = 10_000.0
    quiet: bool = False


@dataclass
class Recording:
    """What came of a run.

    Attributes:
        bag: the recording.
        epoch_ns: when the mock stage began, timestamp (ns).
        heights: height (m) of the LVDT, from and until when (ns) it stood there.
        exit_codes: of each process, by the name of its node.
    """

    bag: Path
    epoch_ns: int
    heights: list[tuple[float, int, int]] = field(default_factory=list)
    exit_codes: dict[str, int] = field(default_factory=dict)


def record(cell: MockCell) -> Recording:
    """Start all processes of the cell, record for its duration, end them with SIGINT."""
    epoch_ns = time.time_ns()
    recording = Recording(cell.folder / "bag", epoch_ns)
    mock: dict[str, object] = {"mock.seed": cell.seed, "mock.epoch": epoch_ns, "mock.speeds": SPEEDS}
    stage: dict[str, object] = {"stage": str(cell.stage)} if cell.stage else {}
    machine = {"machine": cell.machine}
    with ExitStack() as stack:
        domain = stack.enter_context(own_domain())

        def start(executable: str, name: str, **parameters: object) -> NodeProcess:
            process = NodeProcess(executable, name, domain, parameter_arguments(stage | parameters))
            stack.callback(process.close)
            return process

        # the recorder first: what the others say from their start on is in the bag
        processes = [start("recorder", "recorder", folder=str(recording.bag))]
        _wait_for(recording.bag / "metadata.yaml", processes[0])
        processes.append(start("compensation", "compensation", **machine))
        processes.append(start("error_estimator", "error_estimator"))
        processes.append(start("mock_controller", "mock_controller", **mock, **machine))
        processes.append(start("autocollimator", "autocollimator", **mock, rate=cell.rate))
        for head in "abcd":
            processes.append(start("encoder_head", f"encoder_head_{head}", **mock, head=head, rate=cell.rate))
        with _progress(cell.duration, cell.quiet) as progress:
            for height in HEIGHTS:
                lvdt = start("lvdt", "lvdt", **mock, **{"mock.height": height})
                begin_ns = time.time_ns()
                _watch(cell.duration / len(HEIGHTS), [*processes, lvdt], progress, f"LVDT at {height * 1e3:.0f} mm")
                recording.heights.append((height, begin_ns, time.time_ns()))
                _end(lvdt, recording)
        for process in reversed(processes):
            _end(process, recording)
    return recording


def _watch(duration: float, processes: list[NodeProcess], progress: tqdm[Never], what: str) -> None:
    """Let time pass; an early end of a process ends the run with its own words."""
    progress.set_description(what)
    begin = last = time.monotonic()
    while (now := time.monotonic()) - begin < duration:
        progress.update(now - last)
        last = now
        for process in processes:
            _check_alive(process)
        time.sleep(_TICK)


def _check_alive(process: NodeProcess) -> None:
    if process.exit_code is not None:
        raise RuntimeError(f"{process.name} ended with exit code {process.exit_code}; it wrote:\n{process.output}")


def _wait_for(path: Path, process: NodeProcess, deadline: float = 20.0) -> None:
    begin = time.monotonic()
    while not path.exists():
        _check_alive(process)
        if time.monotonic() - begin > deadline:
            raise RuntimeError(f"{process.name} made no {path} within {deadline} s; it wrote:\n{process.output}")
        time.sleep(_TICK)


def _end(process: NodeProcess, recording: Recording) -> None:
    code = process.stop()
    recording.exit_codes[process.name] = max(recording.exit_codes.get(process.name, 0), abs(code))


@contextmanager
def _progress(duration: float, quiet: bool) -> Iterator[tqdm[Never]]:
    form = "{desc}: {bar:30} {n:.0f}/{total:.0f} s"
    with tqdm(total=duration, bar_format=form, disable=quiet or None) as progress:
        yield progress


def seconds(stamp_ns: NDArray[np.int64], epoch_ns: int) -> NDArray[np.float64]:
    """(n,) time (s) since the mock stage began."""
    return np.asarray((stamp_ns - epoch_ns) / NANOSECONDS, np.float64)
