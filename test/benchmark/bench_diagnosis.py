"""Time and memory of a diagnosis against the length of the recording. Figures are printed, none is a bound.

With BENCH_LONG=1 also of 40 min. The time counts from the start of the command to its end, reading of the bag included.
"""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

from rotary_error_monitor.blind_check.cases import draw_machine, write_case
from rotary_error_monitor.cases.making import make_machine_case, make_stage_case

DURATIONS = (40.0, 160.0, 640.0)
LONG = 2400.0
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
