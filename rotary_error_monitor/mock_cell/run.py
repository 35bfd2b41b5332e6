"""A whole machine cell on mock sensors: run it, record it, replay it, hold it against what is true.

Each node is a process of its own on real DDS. The mock stage and machine have exact geometry and share no formula with
estimator and compensation, so what they say is an independent truth. An external force comes and goes (Lou et al. 2019,
Figure 15), and the reference is set to one height after the other.
"""

from __future__ import annotations

import signal
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Never

import numpy as np
from lifecycle_msgs.msg import Transition
from numpy.typing import NDArray
from tqdm import tqdm

from rotary_error_monitor.description.listed_sensors import name_of
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.streams import OWN_REFERENCE, REFERENCE_TITLE
from rotary_error_monitor.signals.blocks import NANOSECONDS
from rotary_error_monitor.sources.mock import MOCK
from rotary_error_monitor.testing import Cell, NodeProcess

HEIGHTS = (0.005, 0.016, 0.060)
"""Heights of the reference above the ring, m: those of the paper."""

SPEEDS = (1.5707963267948966, 3.141592653589793)
"""Speeds of a cycle of the stage, rad/s."""

FORCE_CYCLE = 14.0
"""Time after which the pushes at the shaft repeat, s: a run of 21 s has some at each height."""

STARTING = 60.0
"""How long the cell may take to find itself, s."""

BLOCK_PERIOD = 0.02
"""Time covered by one sample block, s: a quarter of the default's messages, for computers that do more than this."""

CORRECTION_PERIOD = 0.02
"""Distance of two corrections, s."""

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
        rate: samples a second of heads, autocollimator and command.
        quiet: no progress line.
        dashboard: port of a live page of the cell; None for none.
    """

    folder: Path
    duration: float = 21.0
    machine: str = "xyzac_trt"
    stage: Path | None = None
    seed: int = 1
    rate: float = 10_000.0
    quiet: bool = False
    dashboard: int | None = None


@dataclass
class RunOutcome:
    """What came of a run.

    Attributes:
        bag: the recording.
        epoch_ns: when the mock stage began, timestamp (ns).
        heights: height (m) of the reference, from and until when (ns) it stood there.
        failures: of each process that did not end with exit code 0, how it ended and what it wrote.
    """

    bag: Path
    epoch_ns: int
    heights: list[tuple[float, int, int]] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)


def record(cell: MockCell, stage: StageDescription) -> RunOutcome:
    """Start all processes of a cell, record once it corrects, end them with SIGINT.

    Args:
        cell: what is run.
        stage: content of its file, which tells the read heads and listed sensors; each is a node.

    Raises:
        RuntimeError: a process ended before its time; the message holds what it wrote.
        TimeoutError: the cell does not come to correct; the message says how its nodes fare.
    """
    recording = RunOutcome(cell.folder / "bag", time.time_ns())
    shared: dict[str, object] = {"stage": str(cell.stage)} if cell.stage else {}
    mock: dict[str, Any] = {
        "mock.seed": cell.seed,
        "mock.epoch": recording.epoch_ns,
        "mock.speeds": SPEEDS,
        "mock.force_cycle": FORCE_CYCLE,
        "block_period": BLOCK_PERIOD,
    }
    sensed: dict[str, Any] = {"source": MOCK, **mock}
    machine: dict[str, Any] = {"machine": cell.machine}
    letters, sensors = tuple(stage.azimuths), stage.listed
    with Cell(letters, shared, sensors=tuple(sensors)) as running, _progress(cell.duration, cell.quiet) as progress:
        progress.set_description("starting")
        watching = _serve_dashboard(running, cell)
        # the recorder first: what the others say from their start on is in the bag
        recorder = running.start("recorder", folder=str(recording.bag))
        running.wait_for_status("recorder: state", "active", STARTING)
        instruments = [
            running.start("mock_controller", **mock, **machine, rate=cell.rate),
            running.start("autocollimator", **sensed, rate=cell.rate),
            *(running.start("encoder_head", f"encoder_head_{x}", **sensed, head=x, rate=cell.rate) for x in letters),
            *(
                running.start("listed_sensor", f"listed_sensor_{name_of(x, sensors[x])}", **sensed, sensor=x)
                for x in sensors
            ),
        ]
        reckoning = [
            running.start("error_estimator", autostart=False),
            running.start("compensation", autostart=False, **machine, correction_period=CORRECTION_PERIOD),
        ]
        reference = running.start(OWN_REFERENCE, autostart=False, **sensed)
        _activate_once_all_is_recorded(running, [process.name for process in reckoning])
        running.wait_until(lambda: _corrects(running), "the cell to correct", STARTING)
        recording.heights += [_at_height(running, height, cell.duration / len(HEIGHTS), progress) for height in HEIGHTS]
        # against the stream: whatever a process says to its end is heard by the next, and by the recorder
        for processes in ([*reckoning, reference], instruments, [recorder], watching):
            _end_together(processes, recording)
    return recording


def _serve_dashboard(running: Cell, cell: MockCell) -> list[NodeProcess]:
    """The process of the page, where one is wanted, once it serves."""
    if cell.dashboard is None:
        return []
    process = running.start("dashboard", port=cell.dashboard, machine=cell.machine)
    serving = running.wait_for_status("dashboard: server", "serving", STARTING)
    print(f"dashboard: {serving.message.rpartition(' ')[2]}", flush=True)
    return [process]


def _activate_once_all_is_recorded(running: Cell, names: Sequence[str]) -> None:
    """Nobody reckons with what the recorder does not hear yet, and it is there for what they say first."""
    instruments = {"encoder_head", "autocollimator", "listed_sensor", "mock_controller"}
    wanted = {topic.name for topic in running.wire if instruments.intersection(topic.publishers)}
    running.wait_until(lambda: running.recorder_hears(wanted), "the recorder to hear every instrument", STARTING)
    for name in names:
        _take_through(running, name, Transition.TRANSITION_CONFIGURE)
    for name in names:
        running.wait_for_status(f"{name}: state", "inactive", STARTING)
    for name in names:
        _take_through(running, name, Transition.TRANSITION_ACTIVATE)


def _take_through(running: Cell, node: str, *transitions: int) -> None:
    for transition in transitions:
        if not running.change_state(node, transition):
            raise RuntimeError(f"{node} refused transition {transition} of its life cycle; its log says why")


def _corrects(running: Cell) -> bool:
    return not running.status("compensation: correction").message.startswith("held")


def _at_height(running: Cell, height: float, duration: float, progress: tqdm[Never]) -> tuple[float, int, int]:
    """Let the reference stand at a height (m) for a time (s); give the height, from and until when (ns) it stood there.

    Raises:
        RuntimeError: the node refuses the height.
    """
    if not running.set_parameter(OWN_REFERENCE, "mock.height", height):
        raise RuntimeError(f"{OWN_REFERENCE} refused mock.height {height} m; its log says why")
    _take_through(running, OWN_REFERENCE, Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_ACTIVATE)
    progress.set_description(f"{REFERENCE_TITLE} at {height * 1e3:.0f} mm")
    begin_ns, begin = time.time_ns(), time.monotonic()
    last = begin
    while (now := time.monotonic()) - begin < duration:
        progress.update(now - last)
        last = now
        running.spin_for(_TICK)
    end_ns = time.time_ns()
    _take_through(running, OWN_REFERENCE, Transition.TRANSITION_DEACTIVATE, Transition.TRANSITION_CLEANUP)
    return height, begin_ns, end_ns


def _end_together(processes: Sequence[NodeProcess], recording: RunOutcome) -> None:
    for process in processes:
        process.send(signal.SIGINT)
    for process in processes:
        if process.wait() != 0:
            recording.failures.append(process.ending)


@contextmanager
def _progress(duration: float, quiet: bool) -> Iterator[tqdm[Never]]:
    form = "{desc}{bar:30} {n:.0f}/{total:.0f} s"
    with tqdm(total=duration, bar_format=form, disable=quiet or None) as progress:
        yield progress


def seconds(stamp_ns: NDArray[np.int64], epoch_ns: int) -> NDArray[np.float64]:
    """(n,) time (s) since the mock stage began."""
    return np.asarray((stamp_ns - epoch_ns) / NANOSECONDS, np.float64)
