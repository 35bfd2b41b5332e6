"""`rotary_error_monitor analyse`: how good a stage is, from a recording of it."""

from __future__ import annotations

import argparse
from pathlib import Path

from rotary_error_monitor.commands.questions import add_question, question_of
from rotary_error_monitor.commands.values import files_of, tell


def add(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments."""
    parser.epilog = (
        "exit codes: 0 within all limits, or none were given; 10 beyond a limit; 11 neither can be told, for a value "
        "is as near to its limit as its uncertainty, or not told; 2 wrong input. doc/analysis.md says what the figures "
        "mean."
    )
    parser.add_argument("bag", type=Path, metavar="BAG")
    add_question(parser)
    parser.add_argument("--against", type=Path, metavar="OTHER_BAG", help="say what changed since another recording")


def run(arguments: argparse.Namespace) -> int:
    """Analyse, write the results, and give the verdict's exit code."""
    outputs = files_of(arguments)
    question = question_of(arguments)
    from rotary_error_monitor.commands.progress_bar import progress_bar
    from rotary_error_monitor.recordings.analysis import FileAnalysis
    from rotary_error_monitor.report.analysis import changes_sentence, verdict_sentence

    files = FileAnalysis(arguments.bag, arguments.twin, arguments.machine, question, outputs, arguments.against)
    analysis, changes = files.run(progress_bar("analyse"))
    print(verdict_sentence(analysis))
    if changes is not None:
        print(changes_sentence(changes))
    tell(f"{segment.name}: {remark}" for segment in analysis.segments for remark in segment.remarks)
    tell(analysis.remarks)
    return analysis.outcome.exit_code
