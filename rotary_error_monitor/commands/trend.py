"""`rotary_error_monitor trend`: error motion values over time, of all recordings below a folder."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from rotary_error_monitor.commands.questions import add_question, question_of
from rotary_error_monitor.commands.values import files_of
from rotary_error_monitor.commands.work import add_work, bar_of, check_work
from rotary_error_monitor.errors import one_line
from rotary_error_monitor.gap.options import FALSE_ALARMS, check_false_alarms


def add(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments."""
    parser.epilog = (
        "exit codes: 0 every stage is within all limits by its latest recording, or none were given; 10 one is beyond "
        "a limit; 11 neither can be told; 2 wrong input. doc/trend.md says how steps and slopes are told."
    )
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="with bags below it, at any depth")
    add_question(parser)
    parser.add_argument(
        "--index", type=Path, metavar="FILE", help="what is known of bags that were read (default: FOLDER/trend.duckdb)"
    )
    parser.add_argument(
        "--false-alarms",
        type=float,
        default=FALSE_ALARMS,
        metavar="RATE",
        help=f"largest chance that a change is told of a stage that does not change (default: {FALSE_ALARMS})",
    )
    add_work(parser)


def run(arguments: argparse.Namespace) -> int:
    """Read what is new, write the results, and give the verdict's exit code."""
    check_false_alarms(arguments.false_alarms, f"--false-alarms is {arguments.false_alarms}")
    check_work(arguments)
    outputs = files_of(arguments)
    question = question_of(arguments)
    from rotary_error_monitor.recordings.trend import FileTrend
    from rotary_error_monitor.report.trend import trend_sentence

    trend = FileTrend(
        arguments.folder,
        arguments.twin,
        arguments.machine,
        question,
        outputs,
        arguments.index,
        arguments.jobs,
        arguments.scheduler,
        arguments.false_alarms,
        arguments.by_folder,
    ).run(bar_of("trend"))
    print(trend_sentence(trend))
    print(f"{trend.read} bags were read, {trend.known} were known.")
    for each in (*trend.unread, *trend.undone):
        print(f"note: {one_line(each.bag)}: {each.reason}", file=sys.stderr)
    for bag in trend.gone:
        print(f"note: {one_line(bag)}: no longer there, and left out", file=sys.stderr)
    return trend.outcome.exit_code
