"""Values on the command line: numbers as types of arguments, and words of an axis with its value."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Callable, Iterable, Mapping
from datetime import date
from pathlib import Path

from rotary_error_monitor.bags.naming import Naming, read_naming
from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.errors import InputError, one_line
from rotary_error_monitor.pipeline.estimator_settings import EstimatorSettings, max_gap_of
from rotary_error_monitor.recordings.formats import outputs_of

HELD = "axes not named stand at 0, or at the end of their travel nearest to it"
"""Where the axes of a pose or grid are that the words do not name, for the help: `Axis.home`."""


def _number(text: str, expected: str, fault: str, fits: Callable[[float], bool]) -> float:
    """The number, as an argument's type; argparse would name this function for what is none, and not what is right."""
    try:
        value = float(text)
    except ValueError:
        right = "write a decimal point, not a comma" if "," in text else f"expected {expected}"
        raise argparse.ArgumentTypeError(f"'{text}' is no number; {right}") from None
    if not (math.isfinite(value) and fits(value)):
        raise argparse.ArgumentTypeError(f"{text} is {fault}")
    return value


def positive(text: str) -> float:
    """A number above zero, as an argument's type."""
    return _number(text, "one above 0", "not above 0", lambda value: value > 0)


def finite(text: str) -> float:
    """A number, as an argument's type."""
    return _number(text, "a finite one", "not finite", lambda value: True)


def not_negative(text: str) -> float:
    """A number that is zero or above, as an argument's type."""
    return _number(text, "one that is 0 or above", "below 0", lambda value: value >= 0)


def day(text: str) -> date:
    """A day, as an argument's type."""
    try:
        return date.fromisoformat(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is no day; write year-month-day, such as 2026-11-28") from None


def flatness_um(text: str) -> float | None:
    """Flatness in µm, as an argument's type; None where it is unknown."""
    if text == "unknown":
        return None
    try:
        float(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"'{text}' is no number, and not 'unknown'") from None
    return not_negative(text)


def tell(notes: Iterable[str]) -> None:
    """Print notes on standard error, a line each."""
    for note in notes:
        print(f"note: {one_line(note)}", file=sys.stderr)


def add_naming(parser: argparse.ArgumentParser) -> None:
    """Describe the arguments that say which cell of a bag is meant, and how the bag calls its topics."""
    parser.add_argument(
        "--cell", metavar="/NAMESPACE", help="which cell of a bag that holds several, / for that without a namespace"
    )
    parser.add_argument(
        "--topics",
        type=Path,
        metavar="MAP.yaml",
        help="lines `topic of the wire contract: topic in the bag`, for those of other names",
    )


def add_max_gap(parser: argparse.ArgumentParser) -> None:
    """Describe the argument that says how far apart samples are joined."""
    parser.add_argument(
        "--max-gap-ms",
        type=float,
        default=EstimatorSettings.max_gap_ns * 1e-6,
        metavar="MS",
        help="samples further apart are not joined, as by max_gap of error_estimator; what a live run joined that the "
        "bag holds is joined again (default: %(default)g)",
    )


def settings_of(arguments: argparse.Namespace, period_ns: int = EstimatorSettings.period_ns) -> EstimatorSettings:
    """How an estimator samples, with this argument.

    Raises:
        InputError: it is out of range.
    """
    given = arguments.max_gap_ms
    return EstimatorSettings(period_ns=period_ns, max_gap_ns=max_gap_of(given, 1_000_000, f"--max-gap-ms is {given}"))


def naming_of(arguments: argparse.Namespace) -> Naming:
    """What these arguments say.

    Raises:
        InputError: the file of topics is wrong.
    """
    return read_naming(arguments.cell, arguments.topics)


def limits_of(words: list[str], machine: MachineDescription) -> dict[str, tuple[float, float]]:
    """Limits (m or rad) by axis from words such as X=-100,100 in mm or degrees.

    Raises:
        InputError: a word is none of these; the message names it.
    """
    limits = {}
    for name, value in map(split_word, words):
        # Division keeps -1400 mm at -1.4 m; a product with 1e-3 would leave the travel by its last bit.
        scale, _ = machine.axis(name).shown
        low, comma, high = value.partition(",")
        if not comma:
            raise InputError(f"{name}={value}: expected two numbers, such as {name}=-100,100")
        limits[name] = (number_of(low, f"{name}={value}") / scale, number_of(high, f"{name}={value}") / scale)
    return limits


def split_word(word: str) -> tuple[str, str]:
    """Axis and value of a word such as X=5.

    Raises:
        InputError: there is no equals sign; the message names the word.
    """
    name, mark, value = word.partition("=")
    if not mark:
        raise InputError(f"'{word}': expected an axis, =, and a value, such as X=5")
    return name, value


def count_of(text: str, what: str) -> int:
    """A whole number; `what` is named where it is none.

    Raises:
        InputError: it is no whole number.
    """
    value = number_of(text, what)
    if not value.is_integer():
        raise InputError(f"{what}: expected a whole number of points")
    return int(value)


def number_of(text: str, what: str) -> float:
    """A number; `what` is named where it is none.

    Raises:
        InputError: it is no number.
    """
    try:
        return float(text)
    except ValueError:
        raise InputError(f"{what}: '{text}' is no number") from None


def add_effect_files(parser: argparse.ArgumentParser) -> None:
    """The argument that names files with effects of a user's own."""
    parser.add_argument(
        "--effects",
        type=Path,
        action="append",
        default=[],
        metavar="FILE.py",
        help="file with effects of your own; it runs as code, with all that you may do",
    )


def files_of(arguments: argparse.Namespace) -> Mapping[str, Path]:
    """File of each format; none where no output is given.

    Raises:
        InputError: a format that there is not, or one without an output.
    """
    if arguments.output is None:
        if arguments.format:
            raise InputError(f"--format is {arguments.format}; it needs -o OUT, by which its files are named")
        return {}
    return outputs_of(arguments.output, arguments.format)
