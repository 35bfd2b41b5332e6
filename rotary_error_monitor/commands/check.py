"""`rotary_error_monitor check`: whether the description of a stage fits a recording of it, or what they tell."""

from __future__ import annotations

import argparse
from pathlib import Path

from rotary_error_monitor.commands.values import add_max_gap, add_naming, naming_of, settings_of
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.pipeline.surfaces import surfaces_text
from rotary_error_monitor.recordings.stage_check import check_stage, check_text

CONTRADICTED, UNPROVEN = 10, 12


def add(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments."""
    parser.epilog = "exit codes: 0 it fits; 10 it does not, or an instrument is wrong; 12 no whole turn; 2 wrong input"
    parser.add_argument(
        "bag", type=Path, nargs="?", metavar="BAG", help="without one: what the stage's sensors tell, and what not"
    )
    parser.add_argument("--stage", type=Path, help="YAML with a section 'stage' (default: config/stage.yaml)")
    add_naming(parser)
    add_max_gap(parser)


def run(arguments: argparse.Namespace) -> int:
    """Check, print, and give the exit code."""
    stage = load_stage(arguments.stage)
    if arguments.bag is None:
        print("\n".join(surfaces_text(stage)))
        return 0
    check = check_stage(arguments.bag, stage, naming_of(arguments), settings_of(arguments))
    print("\n".join(check_text(check)))
    if not check.fits:
        return CONTRADICTED
    return 0 if check.is_whole else UNPROVEN
