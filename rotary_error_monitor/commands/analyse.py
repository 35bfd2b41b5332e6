"""`rotary_error_monitor analyse`: how good a stage is, from a recording of it."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from rotary_error_monitor.commands.values import add_naming, naming_of
from rotary_error_monitor.description.error_motion_limits import limits_of
from rotary_error_monitor.errors import one_line
from rotary_error_monitor.metrology.turns import MOST_WAVES
from rotary_error_monitor.recordings.formats import FORMATS, outputs_of

_EPILOG = (
    "exit codes: 0 within all limits, or none were given; 10 beyond a limit; 11 neither can be told, for a value is as "
    "near to its limit as its uncertainty, or not told; 2 wrong input. doc/analysis.md says what the figures mean."
)


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Describe the command's arguments."""
    parser = subparsers.add_parser(
        "analyse", help="say how good a stage is: error motion values (ISO 230-7) of a recording", epilog=_EPILOG
    )
    parser.add_argument("bag", type=Path, metavar="BAG")
    parser.add_argument("--twin", type=Path, help="YAML with a section 'stage' (default: config/stage.yaml)")
    parser.add_argument("--machine", help="machine YAML, or the name of one that ships, such as xyzac_trt")
    parser.add_argument(
        "--height",
        type=float,
        nargs="+",
        default=(),
        metavar="MM",
        help="heights above the ring at which radial error motion is told (default: ring, LVDT, probes)",
    )
    parser.add_argument(
        "--limits",
        nargs="+",
        default=(),
        metavar="LIMIT",
        help="YAML with a section 'error_motion_limits', or words such as radial_synchronous_um=2 tilt_total_urad=50 "
        "(default: that section of the twin's file, if it has one)",
    )
    parser.add_argument(
        "--waves",
        type=int,
        default=MOST_WAVES,
        metavar="N",
        help=f"cut-off of the filter over the angle, waves a turn, at most (default: {MOST_WAVES})",
    )
    parser.add_argument(
        "--format",
        default="",
        metavar="LIST",
        help=f"of {','.join(FORMATS)}: files beside one another, by the name of OUT (default: as OUT ends)",
    )
    parser.add_argument("--against", type=Path, metavar="OTHER_BAG", help="say what changed since another recording")
    add_naming(parser)
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="OUT", help="file, such as PAGE.html")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Analyse, write the results, and give the verdict's exit code."""
    outputs = outputs_of(arguments.output, arguments.format)
    # what analyses takes long to load, and the help shall not wait for it
    from rotary_error_monitor.recordings.analysis import HIGHEST, FileAnalysis, Question, check_height, check_waves
    from rotary_error_monitor.report.analysis import changes_sentence, verdict_sentence

    for height in arguments.height:
        check_height(height, HIGHEST * 1e3, "mm", f"--height is {height}")
    check_waves(arguments.waves, f"--waves is {arguments.waves}")
    limits = limits_of(arguments.limits, arguments.twin)
    heights = sorted({height * 1e-3 for height in arguments.height})
    question = Question(limits, heights, arguments.waves, naming_of(arguments))
    files = FileAnalysis(arguments.bag, arguments.twin, arguments.machine, question, outputs, arguments.against)
    analysis, changes = files.run()
    print(verdict_sentence(analysis))
    if changes is not None:
        print(changes_sentence(changes))
    for segment in analysis.segments:
        for remark in segment.remarks:
            print(f"note: {segment.name}: {remark}", file=sys.stderr)
    for remark in analysis.remarks:
        print(f"note: {one_line(remark)}", file=sys.stderr)
    code: int = analysis.outcome.exit_code
    return code
