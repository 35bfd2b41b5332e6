"""Arguments that steps of `calibrate` share, and what they do alike."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from datetime import UTC, date, datetime
from pathlib import Path

from rotary_error_monitor.calibration.known_readings import ReadingPlace
from rotary_error_monitor.calibration.machine_file import MachineFile
from rotary_error_monitor.calibration.steps import Job
from rotary_error_monitor.calibration.yaml_document import changing
from rotary_error_monitor.commands.values import day, number_of, split_word
from rotary_error_monitor.description.column_layout import ColumnLayout
from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.files import check_outputs, check_places

NOT_GOOD = 10
"""Exit code of a calibration that does not fit, as of the other commands that find something wrong."""

PICTURES = (".png", ".svg", ".pdf")
"""Endings of pictures: pixels for a page, or lines for a report."""

Subparsers = argparse._SubParsersAction  # the type that argparse gives has no public name


def add_changed(parser: argparse.ArgumentParser, what: str, help_: str = "") -> None:
    """Describe the file that is calibrated, a `machine` or `stage`, and what is written instead of it, when and how."""
    name = f"{what.upper()}.yaml"
    parser.add_argument(f"--{what}", type=Path, required=True, metavar=name, help=f"the file to calibrate{help_}")
    parser.add_argument("-o", "--output", type=Path, help=f"write here instead of changing {name}")
    parser.add_argument("--date", type=day, help="day of the calibration (default: today)")
    parser.add_argument(
        "--force", action="store_true", help="write what does not fit as well, with an uncertainty that covers it"
    )


def picture(text: str) -> Path:
    """The path of a picture, as an argument's type."""
    if Path(text).suffix.lower() not in PICTURES:
        raise argparse.ArgumentTypeError(f"{text} must end in {', '.join(PICTURES[:-1])} or {PICTURES[-1]}")
    return Path(text)


def add_figure(parser: argparse.ArgumentParser, help_: str = "draw what was found", name: str = "--figure") -> None:
    """Describe `--figure`, or another picture."""
    kinds = ", ".join(ending[1:].upper() for ending in PICTURES)
    parser.add_argument(name, type=picture, metavar="PNG", help=f"{help_} ({kinds})")


def add_columns(
    parser: argparse._ActionsContainer, example: str, of: str = "of a table", name: str = "--columns"
) -> None:
    """Describe `--columns`, or that of another table."""
    parser.add_argument(
        name,
        nargs="+",
        default=[],
        metavar="WHAT=HEADER,UNIT",
        help=f"{of} as an instrument writes it: which column is what, and its unit, such as {example}; lines "
        "before the headers and other columns are passed over, and semicolons or tabs may separate columns; #1, #2, … "
        "for HEADER are columns by number, of a table without headers",
    )


def add_place(
    parser: argparse.ArgumentParser, temperature: str = "of the axis, °C (default: that of reference)"
) -> None:
    """Describe where and how warm an axis was while an instrument read, for what the file's other errors make there."""
    group = parser.add_argument_group(
        "where it was read", "for what other errors of the file make of the readings there"
    )
    group.add_argument(
        "--at", nargs="+", default=[], metavar="Y=100", help="the other axes, mm or degrees (default: at zero)"
    )
    add_point(group, "--beside-mm", "from the tool's origin to the line that was measured, in the frame of the tool")
    if temperature:
        group.add_argument("--temperature-c", type=float, help=temperature)


def add_point(parser: argparse._ActionsContainer, name: str, told: str, ending: str = "") -> None:
    """Take a point in mm, the origin unless it is given, of which `told` says what it is."""
    words = f"{told} (default 0 0 0){ending}"
    origin = (0.0, 0.0, 0.0)
    parser.add_argument(name, type=float, nargs=3, default=origin, metavar=("X", "Y", "Z"), help=words)


def place_of(arguments: argparse.Namespace, machine: MachineDescription) -> ReadingPlace:
    """The place that arguments say.

    Raises:
        InputError: a word is wrong, or an axis is beyond its travel.
    """
    others = {}
    for name, value in map(split_word, arguments.at):
        axis = machine.axis(name)
        scale, unit = axis.shown
        others[name] = number_of(value, f"--at {name}={value}") / scale
        if not axis.travel[0] <= others[name] <= axis.travel[1]:
            low, high = (end * scale for end in axis.travel)
            raise InputError(f"--at {name}={value}: beyond the travel of {name}, {low:g} to {high:g} {unit}")
    x, y, z = (each * 1e-3 for each in arguments.beside_mm)
    return ReadingPlace(others, (x, y, z), getattr(arguments, "temperature_c", None))


def today() -> date:
    """The day in UTC."""
    return datetime.now(UTC).date()


def step(
    steps: Subparsers[argparse.ArgumentParser], name: str, run: Callable[[argparse.Namespace], int], text: str
) -> argparse.ArgumentParser:
    """A step that reads measurements and writes a machine file."""
    parser = steps.add_parser(name, help=text)
    parser.add_argument(
        "source", type=Path, metavar="MEASUREMENTS", help="CSV file; a bag as well where poses are read"
    )
    add_changed(parser, "machine", "; the parameters of a twin become a tree of bodies")
    parser.set_defaults(run=run)
    return parser


@contextmanager
def changed_file(
    arguments: argparse.Namespace, file: Path, read: Sequence[Path | None] = (), written: Sequence[Path | None] = ()
) -> Iterator[Path]:
    """Where a step that calibrates `file` writes it; that is the step's own from before it is read.

    `read` and `written` are files beside measurements, calibrated file and figure.

    Raises:
        InputError: something would be written over what is read or cannot be written.
    """
    output: Path = arguments.output or file
    inputs = [arguments.source, *read]
    check_outputs([arguments.output], inputs)
    further = [getattr(arguments, "figure", None), *written]
    check_outputs(further, [*inputs, file, output])
    check_places(path for path in further if path is not None)
    with changing(output):
        yield output


def layout_of(arguments: argparse.Namespace) -> ColumnLayout | None:
    """The columns that `--columns` names; None where it is not given.

    Raises:
        InputError: a word is wrong.
    """
    columns = getattr(arguments, "columns", [])
    return ColumnLayout.of(columns) if columns else None


@contextmanager
def job_of(
    arguments: argparse.Namespace, read: Sequence[Path | None] = (), written: Sequence[Path | None] = ()
) -> Iterator[Job]:
    """What a step on a machine file needs; arguments as of `changed_file`.

    Raises:
        InputError: as `changed_file`, or the machine file cannot be used.
    """
    with changed_file(arguments, arguments.machine, read, written) as output:
        layout, file = layout_of(arguments), MachineFile(arguments.machine)
        yield Job(arguments.source, file, output, arguments.date or today(), arguments.force, layout)
