"""`rotary_error_monitor replay`: estimator and compensation over a bag."""

from __future__ import annotations

import argparse
from pathlib import Path

from rotary_error_monitor.bags.kept_rows import kept_beside
from rotary_error_monitor.commands.progress_bar import progress_bar
from rotary_error_monitor.commands.questions import add_heights, heights_of
from rotary_error_monitor.commands.values import add_max_gap, add_naming, naming_of, settings_of, tell
from rotary_error_monitor.description.machine import load_machine, machine_path
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.files import check_outputs, check_places
from rotary_error_monitor.machine.kernel import describe_kernel
from rotary_error_monitor.recordings.replay import check_estimated, period_of, replay_bag, replay_long
from rotary_error_monitor.recordings.replayed import LongReplay, Replay
from rotary_error_monitor.resources import config

NOT_REPEATED = 10
"""Exit code: done, and the result is not as one would have it. So end `check`, `calibrate` and `diagnose` as well."""


def add(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments."""
    parser.epilog = (
        "exit codes: 0 OUT.npz holds what the bag gives, the numbers published live where it holds these; 10 some "
        "of these cannot be repeated, for the bag lacks samples that they rest on (array 'unrepeated' of OUT.npz, and "
        "'lost_stamp_ns': when there is no number at all), or a machine has no tool offset at all; 2 wrong input. What "
        "the bag lacks is said on standard error."
    )
    parser.add_argument("bag", type=Path, metavar="BAG")
    parser.add_argument("--twin", type=Path, help="YAML with a section 'stage' (default: config/stage.yaml)")
    parser.add_argument("--machine", help="machine YAML, or the name of one that ships, such as xyzac_trt")
    add_naming(parser)
    add_heights(parser, "at which radial error motion is written as well (default: none)")
    parser.add_argument("--period-ms", type=float, default=1.0, help="distance of estimates where the bag tells none")
    add_max_gap(parser)
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="OUT.npz")


def run(arguments: argparse.Namespace) -> int:
    """Replay the bag and write OUT.npz."""
    heights = heights_of(arguments)
    period_ns = period_of(arguments.period_ms, 1_000_000, f"--period-ms is {arguments.period_ms}")
    read = [arguments.bag, arguments.twin or config("stage.yaml")]
    check_outputs([arguments.output], [*read, machine_path(arguments.machine) if arguments.machine else None])
    stage = load_stage(arguments.twin)
    machine = load_machine(arguments.machine) if arguments.machine else None
    check_places([arguments.output])
    settings, naming = settings_of(arguments, period_ns), naming_of(arguments)
    result: Replay | LongReplay
    if described := machine is not None and machine.monitored is None:
        result = replay_bag(arguments.bag, stage, machine, settings, naming=naming)
    else:
        keep, progress = kept_beside(arguments.output), progress_bar("replay")
        result = replay_long(arguments.bag, stage, machine, settings, naming, keep, progress)
    if machine is not None:
        tell(filter(None, [describe_kernel()]))
    tell(result.remarks)
    check_estimated(result, arguments.bag, stage)
    result.save(arguments.output, heights)
    begin_ns, end_ns = result.span_ns
    what = "joint states" if described else "estimates"
    print(f"{len(result)} {what} over {(end_ns - begin_ns) * 1e-9:.1f} s written to {arguments.output}")
    if result.held is not None:
        offsets = len(result) - result.held
        print(f"{offsets} tool offsets, {result.correction_count} corrections, {result.held} ticks held")
    is_held = result.held == len(result)
    return 0 if result.is_complete and not is_held else NOT_REPEATED
