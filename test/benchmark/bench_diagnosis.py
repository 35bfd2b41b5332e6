"""Time and memory of a diagnosis: against the length of the recording, and of drawn cases of each group.

Figures are printed, none is a bound. Against the length, with BENCH_LONG=1 also of 40 min, the time counts from the
start of the command to its end. Of the drawn cases, about `BENCH_CASES` (2) of each group, family and floor, drawn from
`BENCH_SEED` (1), it is that of the processor from the bag to the verdict, in a process of its own that has loaded all.
"""

from __future__ import annotations

import multiprocessing
import os
import resource
import sys
import time
from multiprocessing.connection import Connection
from pathlib import Path

import numpy as np
import pytest

from rotary_error_monitor.blind_check.cases import Family, draw_machine, make_case, plan_cases, write_case
from rotary_error_monitor.cases.making import make_machine_case, make_stage_case
from rotary_error_monitor.gap.diagnosis import diagnose
from rotary_error_monitor.gap.loading import load_problem, load_twin

DURATIONS = (40.0, 160.0, 640.0)
LONG = 2400.0
GROUPS = ("variant", "unknown", "mimic", "loud", "pair", "single", "null")
EFFECT = "unbalance"
SIZE = (300.0, 300.0)


def run_diagnosis(folder: Path) -> tuple[float, float, float, int]:
    """Wall time and time of the processor in s, memory at its peak in MB, and exit code of the command on a case."""
    command = [
        "diagnose",
        str(folder / "bag"),
        "--twin",
        str(folder / "twin.yaml"),
        "-o",
        str(folder / "out"),
        "--no-report",
    ]
    start = time.perf_counter()
    process = os.posix_spawn(sys.executable, [sys.executable, "-m", "rotary_error_monitor.cli", *command], os.environ)
    _, status, usage = os.wait4(process, 0)
    seconds, busy = time.perf_counter() - start, usage.ru_utime + usage.ru_stime
    return seconds, busy, usage.ru_maxrss / 1024, os.waitstatus_to_exitcode(status)


def report(words: str, folder: Path, duration: float | None) -> None:
    seconds, busy, memory, code = run_diagnosis(folder)
    each = f"{1000 * busy / duration:8.1f}" if duration else " " * 8
    print(f"{words:22s} {seconds:8.1f} {busy:8.1f} {each} {memory:8.0f} {code:6d}", flush=True)


def test_time_and_memory_against_length(tmp_path):
    """One machine case, and stage cases of growing length, clean and as on a shop floor."""
    durations = (*DURATIONS, LONG) if os.environ.get("BENCH_LONG") else DURATIONS
    print(f"\n{'recording':22s} {'s':>8s} {'busy s':>8s} {'ms per s':>8s} {'MB':>8s} {'exit':>6s}")
    write_case(make_machine_case(draw_machine(1), 1, "single", ["squareness"], rough=True), tmp_path / "machine")
    report("machine, 160 poses", tmp_path / "machine", None)
    for rough in (False, True):
        for duration in durations:
            name = f"{'rough' if rough else 'clean'} stage, {duration:.0f} s"
            write_case(make_stage_case(1, "single", [EFFECT], SIZE, rough, duration), tmp_path / name)
            report(name, tmp_path / name, duration)


def diagnose_apart(folder: Path) -> tuple[float, float]:
    """Time of the processor in s and memory at its peak in MB, of a diagnosis that leaves this process as it is."""
    context = multiprocessing.get_context("fork")
    receiver, sender = context.Pipe(duplex=False)
    process = context.Process(target=_diagnose, args=(folder, sender))
    process.start()
    sender.close()
    seconds, memory = receiver.recv()
    process.join()
    return seconds, memory


def _diagnose(folder: Path, sender: Connection) -> None:
    start = time.process_time()
    diagnose(load_problem(folder / "bag", load_twin(folder / "twin.yaml")))
    sender.send((time.process_time() - start, resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024))


@pytest.mark.parametrize("family", ["stage", "machine"])
def test_time_and_memory_of_drawn_cases(tmp_path, family: Family):
    """A line for each group, and one for all of a family."""
    seed, count = int(os.environ.get("BENCH_SEED", "1")), int(os.environ.get("BENCH_CASES", "2"))
    write_case(make_case(plan_cases(seed, 1, [family], [False], ["null"])[0]), tmp_path / "first")
    diagnose(load_problem(tmp_path / "first" / "bag", load_twin(tmp_path / "first" / "twin.yaml")))  # loads all
    print(f"\n{family:10s} {'cases':>6s} {'median s':>9s} {'95 % s':>8s} {'worst s':>8s} {'median MB':>10s} {'MB':>6s}")
    found: dict[str, list[tuple[float, float]]] = {group: [] for group in GROUPS}
    for group in GROUPS:
        for plan in plan_cases(seed, count, [family], [False, True], [group]):
            folder = tmp_path / f"{group} {plan.name}"
            write_case(make_case(plan), folder)
            found[group].append(diagnose_apart(folder))
    for name, rows in {**found, "all": [row for own in found.values() for row in own]}.items():
        seconds, memory = np.array(rows).T
        times = f"{np.median(seconds):9.2f} {np.percentile(seconds, 95):8.2f} {seconds.max():8.2f}"
        print(f"{name:10s} {len(rows):6d} {times} {np.median(memory):10.0f} {memory.max():6.0f}", flush=True)
