"""What each part of the diagnosis buys: the same sealed cases with one part switched off at a time.

Figures are printed, none is a bound. `make bench` tries the parts of `BENCH_PARTS` (separated by commas; nothing and
departures by default) on `BENCH_CASES` cases of `BENCH_SEED`. In pieces, put together in one file:

    python test/benchmark/bench_ablation.py --part nothing --part departures -o ablation.json
    python test/benchmark/bench_ablation.py --part rivals -o ablation.json
"""

from __future__ import annotations

import argparse
import dataclasses
import hashlib
import json
import multiprocessing
import os
import sys
import tempfile
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parent))

from ablation import PARTS, WHOLE, diagnose_without

if __name__ != "__mp_main__":  # a process that diagnoses loads a script too, and may not load what makes cases
    from rotary_error_monitor.blind_check.benchmark import write_plan
    from rotary_error_monitor.blind_check.cases import plan_cases
    from rotary_error_monitor.blind_check.scores import FINDABLE, score_case

GROUPS = ("variant", "loud", "mimic", "unknown", "single")
FAMILIES = ("stage", "machine")
FLOORS = {"clean": False, "rough": True}
HEAD = (
    "variants right",
    "explained",
    "departures told",
    "loud right",
    "mimics named",
    "unknown right",
    "singles right",
    "seconds",
)
"""Variants are right where they are named at all; explained where nothing is left beside them either."""


def ablate(seed, cases, parts, output, families=FAMILIES, floors=(False, True), groups=GROUPS):
    """Outcomes of the cases by part, with those that the file `output` has of the same cases already.

    The file is written after each part. Cases are the same for all parts and all runs with the same arguments.
    """
    plans = plan_cases(seed, cases, families, floors, groups)
    with tempfile.TemporaryDirectory(prefix="ablation_") as name:
        truths = [write_plan(plan, Path(name) / plan.name) for plan in plans]
        seal = hashlib.sha256(json.dumps(truths, sort_keys=True).encode()).hexdigest()
        print(f"{len(plans)} cases; sealed truth: sha256 {seal}", flush=True)
        known = earlier_parts(output, seal)
        for part in parts:
            answers = answers_without(part, plans, Path(name))
            found = [score_case(p, t, *answer) for p, t, answer in zip(plans, truths, answers, strict=True)]
            known[part] = [dataclasses.asdict(outcome) for outcome in found]
            if output is not None:
                output.write_text(json.dumps({"sha256": seal, "parts": known}, indent=1) + "\n", encoding="utf-8")
            print(format_row(part, known[part]), flush=True)
    return known


def earlier_parts(output, seal):
    if output is None or not output.exists():
        return {}
    content = json.loads(output.read_text(encoding="utf-8"))
    if content["sha256"] != seal:
        raise SystemExit(
            f"{output} holds outcomes of other cases; name another file, or give the arguments of that run"
        )
    return content["parts"]


def answers_without(part, plans, folder):
    """Diagnosis and time of each case, by a process of its own that can neither make cases nor see the truth."""
    context = multiprocessing.get_context("spawn")
    ours, theirs = context.Pipe()
    process = context.Process(target=diagnose_without, args=(theirs, part), daemon=True)
    process.start()
    theirs.close()  # so that its end is ours to see
    try:
        return [answer_of(ours, folder / plan.name, plan.left_out) for plan in plans]
    finally:
        process.terminate()
        process.join()


def answer_of(connection, place, left_out):
    connection.send((place, left_out))
    answer = connection.recv()
    if isinstance(answer, Exception):
        raise answer
    return answer


def format_table(parts):
    """One row for each part, in the order of the parts."""
    width = max(len(name) for name in PARTS)
    head = f"{'left out':<{width}}  {'  '.join(HEAD)}"
    return "\n".join([head, *(format_row(name, parts[name]) for name in PARTS if name in parts)])


def format_row(part, rows):
    """Cases that are right, or named, among those that stand out of noise and uncertainty far enough to be found."""
    by_group = {
        group: [row for row in rows if row["plan"]["group"] == group and row["size"] >= FINDABLE] for group in GROUPS
    }
    right = {group: share([row["right"] for row in own]) for group, own in by_group.items()}
    explained = share([row["verdict"] == "explained" for row in by_group["variant"] if row["right"]])
    told = share([row["told"] for row in rows if row["told"] is not None])
    named = share([bool(row["named"]) for row in by_group["mimic"]])
    seconds = f"{np.mean([row['seconds'] for row in rows]):.1f}"
    cells = (right["variant"], explained, told, right["loud"], named, right["unknown"], right["single"], seconds)
    width = max(len(name) for name in PARTS)
    return (
        f"{part:<{width}}  {'  '.join(cell.ljust(len(head)) for cell, head in zip(cells, HEAD, strict=True))}".rstrip()
    )


def share(flags):
    return f"{sum(flags)}/{len(flags)}" if flags else "-"


def test_what_each_part_buys():
    parts = [part for part in os.environ.get("BENCH_PARTS", f"{WHOLE},departures").split(",") if part]
    seed, cases = int(os.environ.get("BENCH_SEED", "1")), int(os.environ.get("BENCH_CASES", "5"))
    print()
    print("\n" + format_table(ablate(seed, cases, parts, None)))


def main(arguments=None):
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=1, help="everything is drawn from it (default: 1)")
    parser.add_argument("--cases", type=int, default=5, help="about how many of each family and floor (default: 5)")
    parser.add_argument("--part", choices=PARTS, action="append", help="left out; may be given again (default: each)")
    parser.add_argument("--family", choices=FAMILIES, action="append")
    parser.add_argument("--floor", choices=FLOORS, action="append")
    parser.add_argument("--group", choices=GROUPS, action="append")
    parser.add_argument("-o", "--output", type=Path, metavar="OUT.json", help="outcomes; joins those that it has")
    chosen = parser.parse_args(arguments)
    floors = tuple(FLOORS[floor] for floor in chosen.floor or FLOORS)
    families, groups = tuple(chosen.family or FAMILIES), tuple(chosen.group or GROUPS)
    found = ablate(chosen.seed, chosen.cases, chosen.part or PARTS, chosen.output, families, floors, groups)
    print("\n" + format_table(found))


if __name__ == "__main__":
    main()
