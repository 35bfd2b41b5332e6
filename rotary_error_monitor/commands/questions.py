"""Arguments of commands that ask recordings for error motion values: what is asked, and where the answers go."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from rotary_error_monitor.commands.values import add_max_gap, add_naming, naming_of, settings_of
from rotary_error_monitor.description.error_motion_limits import limits_of
from rotary_error_monitor.metrology.turns import MOST_WAVES
from rotary_error_monitor.recordings.formats import FORMATS
from rotary_error_monitor.units import without_rounding_error

if TYPE_CHECKING:  # takes long to load, and is needed once the arguments are right
    from rotary_error_monitor.recordings.analysis import Question


def add_question(parser: argparse.ArgumentParser) -> None:
    """Describe the arguments that say what is asked, and where the answers go."""
    parser.add_argument("--twin", type=Path, help="YAML with a section 'stage' (default: config/stage.yaml)")
    parser.add_argument("--machine", help="machine YAML, or the name of one that ships, such as xyzac_trt")
    add_heights(parser, "at which radial error motion is told (default: ring, LVDT, probes)")
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
    add_results(parser, required=True)


def add_heights(parser: argparse.ArgumentParser, which: str) -> None:
    """Describe the argument that names heights; `which` says what they are the heights of."""
    parser.add_argument(
        "--height", type=float, nargs="+", default=(), metavar="MM", help=f"heights above the ring {which}"
    )


def add_results(parser: argparse.ArgumentParser, required: bool) -> None:
    """Describe the arguments that say which cell of a bag is meant, and where the answers go."""
    parser.add_argument(
        "--format",
        default="",
        metavar="LIST",
        help=f"of {','.join(FORMATS)}: files beside one another, by the name of OUT (default: as OUT ends)",
    )
    add_naming(parser)
    add_max_gap(parser)
    parser.add_argument("-o", "--output", type=Path, required=required, metavar="OUT", help="file, such as PAGE.html")


def heights_of(arguments: argparse.Namespace) -> list[float]:
    """Heights above the ring, m, ascending.

    Raises:
        InputError: one of them is out of range.
    """
    from rotary_error_monitor.pipeline.radial_heights import HIGHEST, check_height  # the help shall not wait for it

    for height in arguments.height:
        check_height(height, HIGHEST * 1e3, "mm", f"--height is {height}")
    return sorted({without_rounding_error(height / 1e3) for height in arguments.height})


def question_of(arguments: argparse.Namespace) -> Question:
    """What these arguments ask.

    Raises:
        InputError: one of them is out of range, or a file that they name is wrong.
    """
    # what analyses takes long to load, and the help shall not wait for it
    from rotary_error_monitor.recordings.analysis import Question, check_waves

    heights = heights_of(arguments)
    check_waves(arguments.waves, f"--waves is {arguments.waves}")
    limits = limits_of(arguments.limits, arguments.twin)
    return Question(limits, heights, arguments.waves, naming_of(arguments), settings_of(arguments).max_gap_ns)
