"""How time and memory grow with the length of a recording, beside rosbags alone on the same bag. Figures are printed.

Each way runs in a process of its own, its start included; the lengths in turn. `BENCH_LENGTHS` (s) for others: those of
the documentation are 40,160,640,2400.
"""

from __future__ import annotations

import itertools
import os
import re
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from peak_memory import measured

from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.codec.cdr_blocks import BlockDecoder
from rotary_error_monitor.resources import config

from .long_bag import write_long_bag

LENGTHS = tuple(map(float, os.environ.get("BENCH_LENGTHS", "40,160,640").split(",")))
RATE = float(os.environ.get("BENCH_GROWTH_RATE", "500"))
"""Samples a second of heads, autocollimator and LVDT: as the recordings of the other benchmarks."""

_BY_ROSBAGS = """
import sys
from pathlib import Path
from rosbags.highlevel import AnyReader
with AnyReader([Path(sys.argv[1])]) as reader:
    for connection, _, data in reader.messages():
        reader.deserialize(data, connection.msgtype)
print(open("/proc/self/status").read())
"""


class Took(NamedTuple):
    """Of one way with one bag: processor time, s, and most memory, MB."""

    seconds: float
    peak_mb: float


def by_rosbags(bag: Path, output: Path) -> float:
    """Every message deserialised; most memory, MB."""
    done = subprocess.run([sys.executable, "-c", _BY_ROSBAGS, str(bag)], capture_output=True, text=True, check=True)
    found = re.search(r"VmHWM:\s+(\d+) kB", done.stdout)
    assert found
    return int(found[1]) / 1024


def by_command(name: str, *options: str) -> Callable[[Path, Path], float]:
    """A command of the package; most memory, MB."""

    def run(bag: Path, output: Path) -> float:
        found = measured([name, bag, *options, "-o", output])
        assert found.code in (0, 10, 11, 12), f"{name} ended with exit code {found.code}"
        return found.peak

    return run


WAYS: Mapping[str, Callable[[Path, Path], float]] = {
    "rosbags alone": by_rosbags,
    "replay": by_command("replay"),
    "analyse": by_command("analyse"),
    "diagnose": by_command("diagnose", "--twin", str(config("stage.yaml"))),
}
SUFFIXES = {"replay": ".npz", "analyse": ".html"}


def took(way: Callable[[Path, Path], float], bag: Path, output: Path) -> Took:
    """Run a way, and take the processor time of its processes."""
    before = os.times()
    peak = way(bag, output)
    after = os.times()
    used = (after.children_user - before.children_user) + (after.children_system - before.children_system)
    return Took(used, peak)


def samples_of(bag: Path) -> tuple[int, int]:
    """Messages and samples of a bag."""
    decoder, messages, samples = BlockDecoder(), 0, 0
    for message in BagReader(bag).messages():
        messages += 1
        samples += decoder.span(message.data)[2]
    return messages, samples


def test_growth_with_the_length(tmp_path, capsys, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "1")  # as the command line does, and `measured` too late
    found: dict[str, list[Took]] = {name: [] for name in WAYS}
    sizes = []
    for length in LENGTHS:
        bag = tmp_path / f"bag_{length:.0f}"
        write_long_bag(bag, seconds=length, rate=RATE)
        sizes.append(samples_of(bag))
        for name, way in WAYS.items():
            found[name].append(took(way, bag, tmp_path / f"{name}_{length:.0f}{SUFFIXES.get(name, '')}"))
    with capsys.disabled():
        print(f"\na stage alone, {RATE:.0f} samples a second of each instrument, blocks of 0.1 s")
        for name, rows in found.items():
            _print(name, rows, sizes, found["rosbags alone"])


def _print(name: str, rows: Sequence[Took], sizes: Sequence[tuple[int, int]], floor: Sequence[Took]) -> None:
    for length, (messages, samples), row, least in zip(LENGTHS, sizes, rows, floor, strict=True):
        print(
            f"  {name:<14} {length:5.0f} s, {samples:9,} samples in {messages:7,} messages: {row.seconds:6.1f} s of "
            f"processor, {samples / row.seconds / 1e6:5.2f} million samples a second, "
            f"{row.seconds / least.seconds:5.2f} times rosbags; {row.peak_mb:5.0f} MB at most"
        )
    for (short, long), (before, after) in zip(itertools.pairwise(LENGTHS), itertools.pairwise(rows), strict=True):
        print(
            f"    from {short:.0f} to {long:.0f} s: {(after.seconds - before.seconds) / (long - short) * 1e3:.1f} ms "
            f"and {(after.peak_mb - before.peak_mb) / (long - short) * 1e3:+.1f} kB more for each second"
        )
