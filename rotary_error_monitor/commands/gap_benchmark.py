"""`rotary_error_monitor gap-benchmark`: the blind check of diagnosis on cases made from a seed."""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

import numpy as np
from tqdm import tqdm

from rotary_error_monitor.blind_check.benchmark import run_benchmark
from rotary_error_monitor.blind_check.cases import GROUPS, Family, plan_cases
from rotary_error_monitor.blind_check.reliability import Told, bins_of, read_told
from rotary_error_monitor.blind_check.score_tables import format_calibration, format_scores
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.files import check_outputs

_FAMILIES: dict[str, tuple[Family, ...]] = {"stage": ("stage",), "machine": ("machine",), "both": ("stage", "machine")}
_FLOORS = {"clean": (False,), "rough": (True,), "both": (False, True)}
_DIAGRAMS = (".png", ".svg")


def add(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments."""
    parser.epilog = "The plant that makes the cases has exact geometry and shares no formula with the twin."
    parser.add_argument("--seed", type=int, default=1, help="everything is drawn from it (default: 1)")
    parser.add_argument(
        "--cases",
        type=int,
        default=100,
        metavar="N",
        help="about how many of each family and floor (default: 100); without --group 70 %% more",
    )
    parser.add_argument("--family", choices=sorted(_FAMILIES), default="both")
    parser.add_argument("--floor", choices=sorted(_FLOORS), default="both", help="clean cases, rough ones, or both")
    parser.add_argument(
        "--group",
        choices=GROUPS,
        action="append",
        default=[],
        help="cases of this group only; may be given again (variant: the effect departs from its textbook form; loud: "
        "a pair, one far louder; mimic: half of a known effect, which is none; noise: not as the twin states it)",
    )
    parser.add_argument(
        "--jobs",
        type=int,
        default=1,
        metavar="N",
        help="cases at the same time (default: 1; beside others each takes longer than a user would wait)",
    )
    parser.add_argument("-o", "--output", type=Path, metavar="OUT.json", help="every outcome, for tables of your own")
    parser.add_argument(
        "--reliability",
        type=Path,
        metavar="OUT.svg",
        help="diagram (SVG or PNG) of the probabilities of named causes against how often they were at work",
    )
    parser.add_argument(
        "--outcomes",
        type=Path,
        action="append",
        default=[],
        metavar="OUT.json",
        help="in place of a new run, calibration of outcomes that earlier ones wrote; may be given again, all together",
    )


def run(arguments: argparse.Namespace) -> int:
    """Run the check and print its tables, or the calibration of earlier runs."""
    if arguments.reliability is not None and arguments.reliability.suffix not in _DIAGRAMS:
        raise InputError(f"--reliability is {arguments.reliability}; the file must end in {' or '.join(_DIAGRAMS)}")
    if arguments.outcomes and arguments.output is not None:
        raise InputError("--outcomes runs no cases: there is nothing to write to -o")
    check_outputs([arguments.reliability], [*arguments.outcomes, arguments.output])
    if arguments.outcomes:
        told = [pair for path in arguments.outcomes for pair in read_told(path)]
        print(format_calibration("named causes", told) or "no cause is named")
    else:
        told = _run_cases(arguments)
    if arguments.reliability is not None:
        _draw(arguments.reliability, told)
    return 0


def _run_cases(arguments: argparse.Namespace) -> list[Told]:
    """Run the check and print its tables; gives the probabilities of named causes."""
    if arguments.cases < 1:
        raise InputError(f"--cases is {arguments.cases}; it must be at least 1")
    if arguments.jobs < 1:
        raise InputError(f"--jobs is {arguments.jobs}; it must be at least 1")
    families, floors = _FAMILIES[arguments.family], _FLOORS[arguments.floor]
    plans = plan_cases(arguments.seed, arguments.cases, families, floors, arguments.group)
    if not plans:
        raise InputError(f"--group {arguments.group[0]} has no cases of family {arguments.family}; give --family stage")
    with tqdm(total=2 * len(plans), desc="gap-benchmark", unit="step", disable=None, file=sys.stderr) as bar:
        result = run_benchmark(
            plans,
            lambda seal: print(f"sealed truth: sha256 {seal}", flush=True),
            lambda: _step(bar),
            min(arguments.jobs, len(plans)),
        )
    print(f"opened truth: sha256 {result.opened}\n")
    print(format_scores(result.outcomes))
    if arguments.output is not None:
        rows = [dataclasses.asdict(outcome) for outcome in result.outcomes]
        arguments.output.write_text(
            json.dumps({"sha256": result.opened, "outcomes": rows}, indent=1) + "\n", encoding="utf-8"
        )
    return [pair for outcome in result.outcomes for pair in outcome.probabilities]


def _draw(path: Path, told: Sequence[Told]) -> None:
    # The drawing library takes as long to load as a case takes, and most runs draw nothing.
    from rotary_error_monitor.report.reliability_figure import draw_reliability

    bins = bins_of(told)
    stated, share = (np.array(values) for values in ([own.stated for own in bins], [own.share for own in bins]))
    interval = np.array([own.interval for own in bins]).reshape(-1, 2)
    draw_reliability(path, stated, share, interval, f"{len(told)} named causes")


def _step(bar: tqdm[NoReturn]) -> None:
    bar.update()
