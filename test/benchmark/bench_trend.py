"""How long the trend of a folder takes: by one process and by two, and when all is known. Figures are printed."""

from __future__ import annotations

import os
import time

from mock_bags import EPOCH_NS, write_stage_bag

from rotary_error_monitor.analysis.trend import DAY_NS
from rotary_error_monitor.cli import main

BAGS = int(os.environ.get("BENCH_BAGS", "200"))
SECONDS = float(os.environ.get("BENCH_BAG_SECONDS", "4"))
"""Of each bag: some turns, as of a daily check."""


def seconds_of(folder, index, *options):
    begin, used = time.monotonic(), sum(os.times()[:4])
    arguments = ["trend", str(folder), "--height", "0", "60", "--index", str(index), *options]
    assert main([*arguments, "-o", str(folder.parent / "page.html")]) == 0
    return time.monotonic() - begin, sum(os.times()[:4]) - used


def test_seconds_a_bag(tmp_path, capsys):
    folder = tmp_path / "bags"
    for day in range(BAGS):
        write_stage_bag(folder / f"day_{day}", SECONDS, seed=day + 1, begin_ns=EPOCH_NS + day * DAY_NS)
    write_stage_bag(tmp_path / "one" / "bag", SECONDS, seed=1)
    seconds_of(tmp_path / "one", tmp_path / "first.duckdb", "--jobs", "1")  # what is loaded once
    rows = [(f"by {jobs}", *seconds_of(folder, tmp_path / f"{jobs}.duckdb", "--jobs", jobs)) for jobs in ("1", "2")]
    rows.append(("all known", *seconds_of(folder, tmp_path / "1.duckdb", "--jobs", "1")))
    capsys.readouterr()
    with capsys.disabled():
        print(f"\n{BAGS} bags of {SECONDS:g} s, page and index included")
        for name, wall, used in rows:
            print(
                f"  {name}: {wall:.1f} s, {wall / BAGS * 1e3:.0f} ms a bag, {wall / rows[0][1]:.2f} of the time of "
                f"{rows[0][0]}; processor {used:.1f} s, {used / BAGS * 1e3:.0f} ms a bag"
            )
        size = (tmp_path / "1.duckdb").stat().st_size
        print(f"  index: {size / BAGS / 1e3:.0f} kB a bag")
