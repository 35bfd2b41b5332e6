"""`rotary_error_monitor gap-benchmark`: the blind check of diagnosis on cases made from a seed."""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
from pathlib import Path
from typing import NoReturn

from tqdm import tqdm

from rotary_error_monitor.blind_check.benchmark import run_benchmark
from rotary_error_monitor.blind_check.cases import GROUPS, Family, plan_cases
from rotary_error_monitor.blind_check.scores import format_scores
from rotary_error_monitor.errors import InputError

_FAMILIES: dict[str, tuple[Family, ...]] = {"stage": ("stage",), "machine": ("machine",), "both": ("stage", "machine")}
_FLOORS = {"clean": (False,), "rough": (True,), "both": (False, True)}


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Describe the command's arguments."""
    parser = subparsers.add_parser(
        "gap-benchmark",
        help="diagnose cases whose truth is sealed in another process, then open and score",
        epilog="The plant that makes the cases has exact geometry and shares no formula with the twin.",
    )
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
    parser.add_argument("-o", "--output", type=Path, metavar="OUT.json", help="every outcome, for tables of your own")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the check and print its tables."""
    if arguments.cases < 1:
        raise InputError(f"--cases is {arguments.cases}; it must be at least 1")
    families, floors = _FAMILIES[arguments.family], _FLOORS[arguments.floor]
    plans = plan_cases(arguments.seed, arguments.cases, families, floors, arguments.group)
    if not plans:
        raise InputError(f"--group {arguments.group[0]} has no cases of family {arguments.family}; give --family stage")
    with tqdm(total=2 * len(plans), desc="gap-benchmark", unit="step", disable=None, file=sys.stderr) as bar:
        result = run_benchmark(
            plans, lambda seal: print(f"sealed truth: sha256 {seal}", flush=True), lambda: _step(bar)
        )
    print(f"opened truth: sha256 {result.opened}\n")
    print(format_scores(result.outcomes))
    if arguments.output is not None:
        rows = [dataclasses.asdict(outcome) for outcome in result.outcomes]
        arguments.output.write_text(
            json.dumps({"sha256": result.opened, "outcomes": rows}, indent=1) + "\n", encoding="utf-8"
        )
    return 0


def _step(bar: tqdm[NoReturn]) -> None:
    bar.update()
