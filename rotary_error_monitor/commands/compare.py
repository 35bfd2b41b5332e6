"""`rotary_error_monitor compare`: the monitor held against a reference that was recorded beside it."""

from __future__ import annotations

import argparse
from pathlib import Path

from rotary_error_monitor.commands.questions import add_heights, add_results, heights_of
from rotary_error_monitor.commands.values import files_of, naming_of, settings_of, tell


def add(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments."""
    parser.epilog = (
        "exit codes: 0 the monitor agrees with the reference within its stated uncertainty; 10 it does not; 2 wrong "
        "input. doc/compare.md says what is compared and how it is judged."
    )
    parser.add_argument("bag", type=Path, metavar="BAG")
    parser.add_argument("--twin", type=Path, help="YAML with a section 'stage' (default: config/stage.yaml)")
    add_heights(parser, "at which a reference stood (default: each at which one was recorded)")
    parser.add_argument(
        "--reference",
        nargs="+",
        default=(),
        metavar="NAME",
        help="lvdt, or radial probes by their names in 'sensors', which the estimate then does without (default: lvdt, "
        "or all radial probes where there is none)",
    )
    add_results(parser, required=False)


def run(arguments: argparse.Namespace) -> int:
    """Compare, print the table, write the results, and give the verdict's exit code."""
    outputs = files_of(arguments)
    heights, naming = heights_of(arguments), naming_of(arguments)
    from rotary_error_monitor.recordings.verification import FileVerification
    from rotary_error_monitor.report.verification import notes_of, text_table, verdict_sentence

    files = FileVerification(
        arguments.bag, arguments.twin, heights, arguments.reference, naming, outputs, settings_of(arguments)
    )
    found = files.run()
    print(verdict_sentence(found))
    print(text_table(found))
    tell(notes_of(found))
    return found.exit_code
