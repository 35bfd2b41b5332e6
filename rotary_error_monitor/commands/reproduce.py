"""`rotary_error_monitor reproduce`: a paper's whole procedure on a simulation with the paper's numbers."""

from __future__ import annotations

import argparse
from importlib import import_module
from pathlib import Path

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.files import exists, make_folder, write_whole

NOT_KEPT = 10
"""Exit code where the paper's statements do not hold, as of the other commands that find something wrong."""

PAPERS = {
    "lou2019": "error motion of a rotary stage by four read heads and an autocollimator",
    "pan2013": "error model and calibration of a five-axis machine by laser interferometer and tracker",
    "zhou2023": "straightness of guideways, spliced, and compensated on a ground workpiece",
}


def add(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments."""
    parser.epilog = (
        "exit codes: 0 each statement of the paper that a simulation can keep holds; 10 one does not; 2 wrong "
        "input. " + " ".join(f"{name}: {what}." for name, what in PAPERS.items())
    )
    parser.add_argument("paper", choices=PAPERS, metavar="PAPER", help=f"one of {', '.join(PAPERS)}")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR", help="new folder for all results")
    parser.add_argument("--seed", type=int, default=1, help="of noise and all that is drawn (default 1)")


def run(arguments: argparse.Namespace) -> int:
    """Carry it out, print the table, write the page; the exit code says whether the paper's statements hold."""
    folder: Path = arguments.output
    if exists(folder) and not (folder.is_dir() and not any(folder.iterdir())):
        raise InputError(f"--output {folder} exists already; give a new folder, nothing is written over")
    if arguments.seed < 0:
        raise InputError(f"--seed is {arguments.seed}; it must be 0 or more")
    make_folder(folder)
    from rotary_error_monitor.reproduction.page import page, text_table
    from rotary_error_monitor.reproduction.procedure import Bench

    procedure = import_module(f"rotary_error_monitor.reproduction.{arguments.paper}")
    found = procedure.reproduce(Bench(folder, lambda line: print(line, flush=True)), arguments.seed)
    write_whole(folder / "page.html", page(found).encode())
    print(f"simulated: {found.simulated}")
    print(text_table(found.rows))
    print(f"page: {folder / 'page.html'}")
    return 0 if found.kept else NOT_KEPT
