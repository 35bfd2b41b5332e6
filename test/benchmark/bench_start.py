"""How long one waits: for a cell to be up, for `make run`, for a diagnosis with its page. Figures are printed.

Times are those of a clock on the wall, for that is what one waits by; `BENCH_TRIES` (3) of each, the fastest counts.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from rotary_error_monitor.blind_check.cases import draw_machine, write_case
from rotary_error_monitor.cases.making import make_machine_case, make_stage_case
from rotary_error_monitor.mock_cell.run import MockCell
from rotary_error_monitor.testing.domains import own_domain

TRIES = int(os.environ.get("BENCH_TRIES", "3"))
ROOT = Path(__file__).parents[2]

NODES = (
    *(f"encoder_head_{letter}" for letter in "abcd"),
    *("autocollimator", "lvdt", "mock_controller", "error_estimator", "compensation", "recorder"),
)
"""The ten processes of a mock cell."""


def command(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "rotary_error_monitor.cli", *arguments]


def seconds_until_active(folder: Path, domain: int) -> tuple[float, float]:
    """From the start of `up` until every node is active, and from SIGINT to the end of all, s."""
    rows = [f"/**/{name}: {{ros__parameters: {{source: mock}}}}" for name in NODES if "head" in name]
    rows += [f"/**/{name}: {{ros__parameters: {{source: mock}}}}" for name in ("autocollimator", "lvdt")]
    rows += [f"/**/{name}: {{ros__parameters: {{machine: xyzac_trt}}}}" for name in ("mock_controller", "compensation")]
    rows += ["/**/error_estimator: {ros__parameters: {}}", "/**/recorder: {ros__parameters: {folder: bag}}"]
    (folder / "cell.yaml").write_text("\n".join(rows) + "\n")
    with (folder / "said").open("w") as said:
        begin = time.perf_counter()
        cell = subprocess.Popen(
            command("up", "cell.yaml"),
            cwd=folder,
            env={**os.environ, "ROS_DOMAIN_ID": str(domain)},
            stdout=said,
            stderr=subprocess.STDOUT,
        )
        try:
            while len(re.findall(r"\]: active$", (folder / "said").read_text(), re.MULTILINE)) < len(NODES):
                assert cell.poll() is None, (folder / "said").read_text()
                assert time.perf_counter() - begin < 120.0, (folder / "said").read_text()
                time.sleep(0.02)
            up = time.perf_counter() - begin
            begin = time.perf_counter()
        finally:
            cell.send_signal(signal.SIGINT)
            code = cell.wait(60)
    assert code == 0, (folder / "said").read_text()
    return up, time.perf_counter() - begin


def test_a_cell_of_ten_processes(tmp_path: Path) -> None:
    found = []
    for attempt in range(TRIES):
        folder = tmp_path / str(attempt)
        folder.mkdir()
        with own_domain() as domain:
            found.append(seconds_until_active(folder, domain))
    up, down = (min(times) for times in zip(*found, strict=True))
    print(f"\na cell of {len(NODES)} processes, from `up` until all are active: {up:.1f} s; its end {down:.1f} s")


def test_make_run() -> None:
    """Once, for it takes as long as it records."""
    begin = time.perf_counter()
    done = subprocess.run(["make", "run"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    print(f"\nmake run, {MockCell.duration:.0f} s of recording among it: {time.perf_counter() - begin:.1f} s")


@pytest.mark.parametrize("family", ["stage", "machine"])
def test_a_diagnosis_with_its_page(family: str, tmp_path: Path) -> None:
    case = tmp_path / "case"
    if family == "stage":
        write_case(make_stage_case(1, "single", ["unbalance"], (300.0, 300.0)), case)
    else:
        write_case(make_machine_case(draw_machine(1), 1, "single", ["squareness"]), case)
    times = []
    for attempt in range(TRIES):
        begin = time.perf_counter()
        output = str(tmp_path / f"out{attempt}")
        done = subprocess.run(
            command("diagnose", str(case / "bag"), "--twin", str(case / "twin.yaml"), "-o", output),
            capture_output=True,
            text=True,
            check=False,
        )
        times.append(time.perf_counter() - begin)
        assert done.returncode == 10, done.stdout + done.stderr  # there is a gap
    print(f"\n`diagnose` of a {family}, from the start of Python to the page: {min(times):.1f} s")
