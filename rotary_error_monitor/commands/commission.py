"""`rotary_error_monitor commission`: from a newly built stage, or a recording of it, to its stage file."""

from __future__ import annotations

import argparse
from datetime import UTC, datetime
from pathlib import Path

from rotary_error_monitor.calibration.yaml_document import changing
from rotary_error_monitor.commands.live_commissioning import add_live, record_live
from rotary_error_monitor.commands.values import add_naming, day, naming_of
from rotary_error_monitor.commissioning.commission import Commissioning
from rotary_error_monitor.commissioning.report import commissioning_text
from rotary_error_monitor.commissioning.stage_file import commission_stage, write_stage
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.files import check_outputs, check_places, write_whole

NOT_SETTLED = 10
"""Exit code: done, and the result is not as one would have it, as of `calibrate`, `check` and `recover`."""


def add(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments."""
    parser.description = (
        "Record a stage with the recorder while it turns at least once each way, slowly, or have a running "
        "cell recorded with --live, which says when that is enough. What was plugged, mounted or set otherwise than "
        "the data sheets say is named and put right in the stage file."
    )
    parser.epilog = (
        "exit codes: 0 STAGE.yaml is written and nothing is left wrong; 10 something is wrong that no stage "
        "file puts right (not written without --force); 2 wrong input"
    )
    source = parser.add_mutually_exclusive_group(required=True)
    source.add_argument("bag", type=Path, nargs="?", metavar="BAG")
    source.add_argument("--live", action="store_true", help="record a running cell, which keeps the recording")
    add_live(parser)
    add_naming(parser)
    parser.add_argument("--stage", type=Path, required=True, metavar="NOMINAL.yaml", help="what the data sheets say")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="STAGE.yaml")
    parser.add_argument("--page", type=Path, metavar="PAGE.html", help="the same with pictures, whatever the exit code")
    parser.add_argument("--date", type=day, help="day of the commissioning (default: today)")
    parser.add_argument("--force", action="store_true", help="write the file whatever is left wrong, and what that is")


def run(arguments: argparse.Namespace) -> int:
    """Commission, print, write, and give the exit code."""
    pages = [] if arguments.page is None else [arguments.page]
    check_outputs([arguments.output, *pages], [arguments.bag, arguments.topics])
    check_places(pages)
    naming = naming_of(arguments)
    if arguments.live and naming.is_given:
        raise InputError("--cell and --topics are of bags; with --live give --namespace")
    bag = record_live(arguments) if arguments.live else arguments.bag
    with changing(arguments.output):
        try:
            stage, result = commission_stage(bag, arguments.stage, naming)
        except InputError as error:
            raise InputError(f"{error} (the recording stays in {bag})" if arguments.live else str(error)) from error
        print(commissioning_text(stage, result))
        if arguments.page is not None:
            _write_page(arguments.page, stage, result, bag, arguments.stage)
        if not (result.settled or arguments.force):
            print("not written: put right what is wrong and record again; --force writes it all the same")
            return NOT_SETTLED
        dated = arguments.date or datetime.now(UTC).date()
        write_stage(stage, result, bag, arguments.stage, arguments.output, dated)
    cell = f" --cell {arguments.cell}" if arguments.cell else ""
    cell += f" --topics {arguments.topics}" if arguments.topics else ""
    print(f"written to {arguments.output}; next: rotary_error_monitor check {bag} --stage {arguments.output}{cell}")
    return 0 if result.settled else NOT_SETTLED


def _write_page(path: Path, stage: StageDescription, result: Commissioning, bag: Path, stage_file: Path) -> None:
    """The page with its pictures: whole, or what stood there stays."""
    # what draws takes long to load
    from rotary_error_monitor.bags.metadata import recorded_span
    from rotary_error_monitor.report.commissioning import page
    from rotary_error_monitor.report.commissioning_figure import draw
    from rotary_error_monitor.report.page import made_by

    about = {
        "recording": str(bag),
        "recorded": recorded_span(bag),
        "described by": str(stage_file),
        "made by": made_by(),
    }
    title = "/".join(bag.resolve().parts[-2:])
    write_whole(path, page(stage, result, draw(stage, result), title, about).encode())
