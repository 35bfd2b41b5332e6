"""`rotary_error_monitor run`: a whole machine cell on mock sensors."""

from __future__ import annotations

import argparse
import sys
from datetime import UTC, datetime
from pathlib import Path

from rotary_error_monitor.dashboard.board import PORT
from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.description.streams import REFERENCE_TITLE, TWO_AXIS
from rotary_error_monitor.errors import InputError

OUT_OF_BOUNDS = 1
SHORTEST = 9.0


def add(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments."""
    parser.description = "Exit code 0 where every figure is within its bound, 1 where one is not."
    parser.add_argument("--duration", type=float, default=21.0, help="of the recording, s (default 21)")
    parser.add_argument("--machine", default="xyzac_trt", help="machine YAML, or the name of one that ships")
    parser.add_argument("--stage", type=Path, help="stage YAML, with all sensors (default: config/stage.yaml)")
    parser.add_argument("--seed", type=int, default=1, help="of the mock stage")
    parser.add_argument("--rate", type=float, default=10_000.0, help="samples a second of heads and autocollimator")
    parser.add_argument("--folder", type=Path, help="new folder for the recording (default: runs/<date>_<time>)")
    parser.add_argument(
        "--dashboard",
        type=int,
        nargs="?",
        const=PORT,
        metavar="PORT",
        help="show the cell meanwhile as a live page on this computer, on a port from 1024 (default %(const)s)",
    )


def run(arguments: argparse.Namespace) -> int:
    """Run, replay, print; the exit code says whether all figures are within their bounds."""
    # ROS is imported only where it is used, so that the commands without it start fast and work without it
    from rotary_error_monitor.mock_cell.figures import figures, table
    from rotary_error_monitor.mock_cell.picture import draw_cell
    from rotary_error_monitor.mock_cell.run import MockCell, record

    if not arguments.duration >= SHORTEST:
        raise InputError(
            f"--duration is {arguments.duration} s; {SHORTEST} s are needed for three heights of the {REFERENCE_TITLE}"
        )
    folder = arguments.folder or Path("runs") / datetime.now(UTC).strftime("%Y%m%d_%H%M%S")
    if arguments.dashboard is not None and not 1024 <= arguments.dashboard <= 65535:
        raise InputError(f"--dashboard is {arguments.dashboard}; expected a port from 1024 to 65535")
    if folder.exists():
        raise InputError(f"--folder {folder} exists already; give a new one, a recording is never overwritten")
    stage, machine = load_stage(arguments.stage), load_machine(arguments.machine)
    for section in ("encoder", *TWO_AXIS):
        if getattr(stage, section) is None:
            raise InputError(f"{arguments.stage}: the stage has no section '{section}', which this run shows")
    if machine.monitored is None:
        raise InputError(
            f"machine {machine.name} has no monitored axis for the cell's stage; start mock_controller and "
            "compensation with it instead"
        )
    folder.mkdir(parents=True)
    cell = MockCell(
        folder,
        arguments.duration,
        arguments.machine,
        arguments.stage,
        arguments.seed,
        arguments.rate,
        dashboard=arguments.dashboard,
    )
    print(
        "Simulated: the stage, its sensors and the machine. Real: nodes, DDS, recording, everything computed.",
        flush=True,
    )
    try:
        recording = record(cell, stage)
    except (RuntimeError, TimeoutError) as error:
        print(f"rotary_error_monitor: {error}", file=sys.stderr)
        return OUT_OF_BOUNDS
    result = figures(cell, recording, stage, machine)
    print(table(result.rows))
    for failure in recording.failures:
        print(f"rotary_error_monitor: {failure}", file=sys.stderr)
    picture = folder / "cell.png"
    draw_cell(result, recording.epoch_ns, picture)
    print(f"bag: {recording.bag}\npicture: {picture}")
    return 0 if result.ok else OUT_OF_BOUNDS
