"""Arguments that steps of `calibrate` share, and what they do alike."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, date, datetime
from pathlib import Path

from rotary_error_monitor.errors import InputError

NOT_GOOD = 10
"""Exit code of a calibration that does not fit, as of the other commands that find something wrong."""

Subparsers = argparse._SubParsersAction  # the type that argparse gives has no public name


def add_force(parser: argparse.ArgumentParser) -> None:
    """Describe `--force`."""
    parser.add_argument(
        "--force", action="store_true", help="write what does not fit as well, with an uncertainty that covers it"
    )


def add_figure(parser: argparse.ArgumentParser, help_: str = "draw what was found") -> None:
    """Describe `--figure`."""
    parser.add_argument("--figure", type=Path, metavar="PNG", help=help_)


def add_columns(parser: argparse.ArgumentParser, example: str) -> None:
    """Describe `--columns`."""
    parser.add_argument(
        "--columns",
        nargs="+",
        default=[],
        metavar="WHAT=HEADER,UNIT",
        help=f"of a table as an instrument writes it: which column is what, and its unit, such as {example}; lines "
        "before the headers and other columns are passed over, and semicolons or tabs may separate columns",
    )


def today() -> date:
    """The day in UTC."""
    return datetime.now(UTC).date()


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Say of a file that cannot be written what would do.

    Raises:
        InputError: it cannot be written.
    """
    try:
        yield
    except OSError as error:
        raise InputError(
            f"{path}: cannot be written ({error.strerror}); give a file in a folder that exists"
        ) from error
