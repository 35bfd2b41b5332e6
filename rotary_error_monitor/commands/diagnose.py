"""`rotary_error_monitor diagnose`: where a recording differs from its digital twin, why, and how far that is mended."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

from rotary_error_monitor.bags.marks import is_bag
from rotary_error_monitor.commands.values import add_effect_files, add_naming, naming_of, tell
from rotary_error_monitor.commands.work import add_work, bar_of, check_work
from rotary_error_monitor.errors import InputError, one_line
from rotary_error_monitor.gap.options import FALSE_ALARMS, MOST_CAUSES, check_false_alarms, check_most_causes
from rotary_error_monitor.report.painter import Painter
from rotary_error_monitor.twin.rates import MOST_RATE, check_most_rate

if TYPE_CHECKING:  # takes long to load: a painter begins before it
    from rotary_error_monitor.recordings.diagnosis import FileDiagnosis

_STEPS = 4 + MOST_CAUSES


def add(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments."""
    parser.epilog = (
        "exit codes: 0 no gap; 10 explained; 11 partly explained; 12 unknown; 2 wrong input. "
        "OUT/diagnosis.json holds everything that OUT/diagnosis.html shows."
    )
    parser.add_argument(
        "bag",
        type=Path,
        metavar="BAG",
        help="bag of a stage or a machine, or a folder with such bags below it; of another kind, its file",
    )
    parser.add_argument(
        "--twin", type=Path, required=True, help="YAML with the section of its kind, such as 'stage' or 'machine'"
    )
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="OUT", help="folder for the results")
    add_effect_files(parser)
    add_naming(parser)
    parser.add_argument(
        "--false-alarms",
        type=float,
        default=FALSE_ALARMS,
        metavar="RATE",
        help="largest chance that anything is found where there is no gap (default: 0.01)",
    )
    parser.add_argument(
        "--most-causes", type=int, default=MOST_CAUSES, metavar="N", help="effects combined at most (default: 2)"
    )
    parser.add_argument(
        "--most-rate",
        type=float,
        default=MOST_RATE,
        metavar="HZ",
        help="samples a second of one sensor of a stage that are used (default: 1000)",
    )
    parser.add_argument(
        "--write-twin", type=Path, metavar="TWIN.yaml", help="write the twin with the causes added, if there are any"
    )
    parser.add_argument("--no-report", action="store_true", help="write diagnosis.json only, no HTML and no picture")
    add_work(parser)


def run(arguments: argparse.Namespace) -> int:
    """Diagnose, write the results, and give the verdict's exit code."""
    check_false_alarms(arguments.false_alarms, f"--false-alarms is {arguments.false_alarms}")
    check_most_causes(arguments.most_causes, f"--most-causes is {arguments.most_causes}")
    check_most_rate(arguments.most_rate, f"--most-rate is {arguments.most_rate}")
    if _has_bags(arguments.bag):
        return _diagnose_folder(arguments)
    with nullcontext() if arguments.no_report else Painter() as painter, _progress_bar() as progress:
        # What diagnoses and what draws take long to load: the painter does its part meanwhile.
        from rotary_error_monitor.gap.sentences import verdict_sentence

        diagnosis = _how(arguments).run(painter, progress)
    print(verdict_sentence(diagnosis))
    tell(diagnosis.remarks)
    return diagnosis.verdict.exit_code


def _how(arguments: argparse.Namespace) -> FileDiagnosis:
    """What is diagnosed, and how."""
    from rotary_error_monitor.recordings.diagnosis import FileDiagnosis

    return FileDiagnosis(
        arguments.bag,
        arguments.twin,
        arguments.output,
        arguments.effects,
        arguments.false_alarms,
        arguments.most_causes,
        arguments.most_rate,
        arguments.write_twin,
        naming_of(arguments),
    )


def _has_bags(path: Path) -> bool:
    """Whether it is a folder that is no bag, and has some below it."""
    try:
        if not path.is_dir() or is_bag(path):
            return False
        from rotary_error_monitor.bags.search import find_bags

        return bool(find_bags(path))
    except (InputError, OSError, ValueError):  # told as of any path that is no bag
        return False


def _diagnose_folder(arguments: argparse.Namespace) -> int:
    """Diagnose each bag, write one page of all, and give the worst verdict's exit code."""
    if arguments.write_twin is not None:
        raise InputError("--write-twin is for one bag: a folder may show as many causes as it has bags; leave it out")
    check_work(arguments)
    from rotary_error_monitor.recordings.folder_diagnosis import FolderDiagnosis
    from rotary_error_monitor.report.folder_diagnosis import folder_sentence

    work = arguments.jobs, arguments.scheduler, arguments.by_folder
    found = FolderDiagnosis(_how(arguments), *work, not arguments.no_report).run(bar_of("diagnose"))
    print(folder_sentence(found))
    for row in found.bags:
        if row.reason:
            print(f"note: {one_line(row.bag)}: {row.reason}", file=sys.stderr)
    return found.worst.exit_code


@contextmanager
def _progress_bar() -> Iterator[Callable[[str], None]]:
    """Function that says what is done next; the bar's library is loaded where somebody watches."""
    if not sys.stderr.isatty():
        yield lambda step: None
        return
    from tqdm import tqdm

    with tqdm(total=_STEPS, desc="diagnose", unit="step", leave=False, file=sys.stderr) as bar:

        def progress(step: str) -> None:
            bar.set_postfix_str(step)
            bar.update()

        yield progress
