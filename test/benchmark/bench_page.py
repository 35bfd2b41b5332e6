"""What the page of an analysis costs, from the start of Python to the file, and of what. Figures are printed."""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import time
from pathlib import Path

import pytest
from mock_bags import write_stage_bag

from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.recordings.analysis import FileAnalysis, Question
from rotary_error_monitor.recordings.replay import replay_bag
from rotary_error_monitor.report.analysis_figure import draw

SECONDS = float(os.environ.get("BENCH_SECONDS", "40"))
TRIES = int(os.environ.get("BENCH_TRIES", "5"))
"""The fastest counts: whatever else the computer does only slows."""

RUN = ["-m", "rotary_error_monitor.cli", "analyse"]
LOAD = "import rotary_error_monitor.recordings.analysis, rotary_error_monitor.report.analysis_figure"


def of_a_process(arguments: list[str], folder: Path) -> float:
    """Least processor time of Python with these arguments, s; compiled files are kept, as where it is installed."""
    environment = {name: text for name, text in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    environment["PYTHONPYCACHEPREFIX"] = str(folder)
    times = []
    for _ in range(TRIES + 1):
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        subprocess.run([sys.executable, *arguments], env=environment, check=True, capture_output=True)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        times.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
    return min(times[1:])


def fastest(function, *arguments) -> float:
    times = []
    for _ in range(TRIES):
        begin = time.process_time()
        function(*arguments)
        times.append(time.process_time() - begin)
    return min(times)


@pytest.mark.parametrize("given", sorted(filter(None, [os.environ.get("BENCH_CASE"), "a mock cell's stage"])))
def test_seconds_of_a_page(given, tmp_path, capsys):
    """Of a bag made here; and of a folder `BENCH_CASE` with `bag` and `twin.yaml`."""
    case, twin = Path(given), None
    if case.is_dir():
        bag, twin = case / "bag", case / "twin.yaml"
    else:
        bag = write_stage_bag(tmp_path / "bag", SECONDS)
    page = tmp_path / "page.html"
    whole = of_a_process([*RUN, str(bag), *(["--twin", str(twin)] if twin else []), "-o", str(page)], tmp_path / "kept")
    analysing = FileAnalysis(bag, twin, None, Question(), {})
    analysis, _ = analysing.analyse()
    estimating = fastest(replay_bag, bag, load_stage(twin))
    parts = {
        "Python alone": of_a_process(["-c", "pass"], tmp_path / "kept"),
        "what is loaded": of_a_process(["-c", LOAD], tmp_path / "kept"),
        "reading and estimating": estimating,
        "figures": fastest(analysing.analyse) - estimating,
        "pictures": fastest(draw, analysis),
    }
    parts["what is loaded"] -= parts["Python alone"]
    pictures = sum(map(len, draw(analysis).values()))
    with capsys.disabled():
        print(
            f"\n{given}: page of an analysis {whole:.2f} s of processor, {pictures} pictures, "
            f"{page.stat().st_size / 1e3:.0f} kB"
        )
        for name, used in parts.items():
            print(f"  {name}: {used:.2f} s")
