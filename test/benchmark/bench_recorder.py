"""What recording costs, beside rosbags' own writer and the mcap library's, on the same messages and disk. Printed.

First the writers alone, each in a process of its own, in turn; then a whole recorder that hears blocks over DDS, beside
the one that one would write first (`plain_recorder.py`).
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.description.topics import samples_topic
from rotary_error_monitor.testing import Cell

from .even_stage import STREAMS
from .feeding import cpu_seconds, fed, on_time
from .writers import WAYS

TRIES = int(os.environ.get("BENCH_TRIES", "2"))
RATES = tuple(map(float, os.environ.get("BENCH_WRITER_RATES", "10000,50000").split(",")))
TIMES = int(os.environ.get("BENCH_WRITER_TIMES", "8"))
"""How often the messages of `SECONDS` are written one after another: 600 make 40 minutes."""

SECONDS = 4.0
LIVE_SECONDS = min(float(os.environ.get("BENCH_SECONDS", "8")), 60.0)
LIVE_RATES = tuple(map(float, os.environ.get("BENCH_RECORDER_RATES", "10000,50000,200000").split(",")))
_HERE = Path(__file__).parent


def written(way: str, folder: Path, rate: float) -> dict[str, float]:
    """What `writers.py` says of one way."""
    command = [sys.executable, str(_HERE / "writers.py"), way, str(folder), str(rate), str(SECONDS), str(TIMES)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    shutil.rmtree(folder)
    found: dict[str, float] = json.loads(done.stdout)
    return found


@pytest.mark.parametrize("rate", RATES)
def test_writers_alone(rate, tmp_path, capsys):
    rows = {way: [] for way in WAYS}
    for attempt in range(TRIES):
        for way in WAYS:
            rows[way].append(written(way, tmp_path / f"{attempt}", rate))
    one = rows["rosbags"][0]
    with capsys.disabled():
        print(
            f"\nblocks of 5 ms, {rate:.0f} samples a second of each instrument: {one['messages']:.0f} messages of "
            f"{one['bytes'] / one['messages']:.0f} bytes, {SECONDS * TIMES:.0f} s"
        )
        for way, tried in rows.items():
            used, wall = (min(each[key] for each in tried) for key in ("processor", "wall"))
            floor = min(
                each["processor"] for each in rows["rosbags, zstd" if "4" in way or "std" in way else "rosbags"]
            )
            grown = min(each["last_mb"] - each["first_mb"] for each in tried)
            print(
                f"  {way:<20} {used / one['messages'] * 1e6:5.1f} µs of processor a message, "
                f"{used / floor:.2f} of rosbags; {one['bytes'] / used / 1e6:5.0f} MB/s of processor, "
                f"{one['bytes'] / wall / 1e6:5.0f} MB/s on the wall; "
                f"{tried[0]['size'] / one['bytes']:.2f} of the size; memory {grown:+.1f} MB from the first "
                f"{SECONDS:g} s to the last"
            )


Heard = Callable[[], tuple[float, int]]
"""Ends a recorder: MB that it held, and messages of the five streams that it has written."""


@contextmanager
def package_recorder(cell: Cell, folder: Path) -> Iterator[tuple[int, Heard]]:
    process = cell.start("recorder", folder=str(folder), compression="none", within=on_time())
    cell.wait_for_status("recorder: state", "active")

    def end() -> tuple[float, int]:
        held = held_mb(process.pid)
        assert process.stop() == 0, process.ending
        topics = BagReader(folder).topics
        return held, sum(topics[samples_topic(stream)].count for stream in STREAMS)

    yield process.pid, end


@contextmanager
def plain_recorder(cell: Cell, folder: Path) -> Iterator[tuple[int, Heard]]:
    command = [*on_time(), sys.executable, str(_HERE / "plain_recorder.py"), "rosbags", str(folder)]
    environment = {**os.environ, "ROS_DOMAIN_ID": str(cell.node.context.get_domain_id())}
    topics = [samples_topic(stream) for stream in STREAMS]
    with subprocess.Popen([*command, *topics], env=environment, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None and process.stdout.readline().strip() == "listening"

            def end() -> tuple[float, int]:
                held = held_mb(process.pid)
                process.send_signal(signal.SIGINT)
                return held, int(process.communicate(timeout=60)[0])

            yield process.pid, end
        finally:
            process.kill()


def held_mb(pid: int) -> float:
    """Most memory that a process has held, MB."""
    status = Path(f"/proc/{pid}/status").read_text(encoding="ascii")
    return int(status.split("VmHWM:")[1].split()[0]) * 1024 / 1e6


RECORDERS = {"recorder": package_recorder, "plain node, rosbags": plain_recorder}


@pytest.mark.parametrize("rate", LIVE_RATES)
def test_recorders_over_dds(rate, tmp_path, capsys):
    """Processor time of the whole recording, the start of the process left out."""
    found = {}
    for name, recorder in RECORDERS.items():
        with Cell() as cell, recorder(cell, tmp_path / name.split()[0]) as (pid, end):
            begin = cpu_seconds(pid)
            sent = fed(cell, "blocks", rate, LIVE_SECONDS)
            used = cpu_seconds(pid) - begin
            blocks = len(STREAMS) * -(-sent.samples // round(rate * 0.005))
            found[name] = used, blocks, *end(), sent
    with capsys.disabled():
        print(f"\n{rate:.0f} samples a second of each of {len(STREAMS)} instruments over DDS, {LIVE_SECONDS:.0f} s")
        for name, (used, blocks, held, count, sent) in found.items():
            print(
                f"  {name:<20} {100 * used / LIVE_SECONDS:5.1f} % of a core, {used / blocks * 1e6:.0f} µs a message, "
                f"{held:.0f} MB at most; {blocks - count} of {blocks} messages lost; drivers at most "
                f"{sent.behind_ms:.0f} ms late"
            )
    blocks, count = found["recorder"][1], found["recorder"][3]
    assert count == blocks, f"{blocks - count} messages lost by the recorder of this package"
