"""How fast a bag is read, beside what a user would read it by, and how fast it is estimated. Figures are printed.

The floor is rosbags alone, which makes messages of the bytes and leaves the samples in them as they are. The peers come
with the extra `bench`; one that is not installed is left out, and that is said.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import pytest
from mcap.reader import make_reader
from mock_bags import write_mock_bag, write_stage_bag
from rosbags.highlevel import AnyReader
from worker_tasks import count_estimates

from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.recordings.workers import run_all
from rotary_error_monitor.signals.blocks import SampleBlock

SECONDS = float(os.environ.get("BENCH_SECONDS", "40"))
TRIES = int(os.environ.get("BENCH_TRIES", "5"))
"""Of each way in turn; the fastest counts: whatever else the computer does only slows."""

BAGS = 8
"""Bags of the same kind that are read and estimated by one process and by two."""

ESTIMATED = "this package, with the estimate"

RATE = 2_000
"""Samples a second of each stream of the mock cell's bag."""


def by_rosbags(bag: Path) -> int:
    """Every message deserialised, which is the floor; gives their number."""
    with AnyReader([bag]) as reader:
        return sum(
            reader.deserialize(data, connection.msgtype) is not None for connection, _, data in reader.messages()
        )


def by_rosbags_dataframe(bag: Path) -> int:
    """Each topic as a pandas table of all its fields."""
    from rosbags.dataframe import get_dataframe

    with AnyReader([bag]) as reader:
        fields = {name: reader.typestore.get_msgdef(str(topic.msgtype)).fields for name, topic in reader.topics.items()}
        return sum(len(get_dataframe(reader, name, [key for key, _ in each])) for name, each in fields.items())


def by_mcap_ros2_support(bag: Path) -> int:
    """Every message decoded by the mcap library's reader for ROS 2."""
    from mcap_ros2.decoder import DecoderFactory

    (path,) = bag.glob("*.mcap")
    with path.open("rb") as file:
        return sum(1 for _ in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages())


def by_this_package(bag: Path) -> int:
    """All contents, samples as columns and times."""
    return sum(map(len, BagReader(bag).read().values()))


READERS = {
    "rosbags alone": by_rosbags,
    "rosbags-dataframe": by_rosbags_dataframe,
    "mcap-ros2-support": by_mcap_ros2_support,
    "this package": by_this_package,
    ESTIMATED: count_estimates,
}
BAGS_OF = {
    "a stage, 500 Hz, blocks of 0.25 s": partial(write_stage_bag, seconds=SECONDS),
    "a mock cell, 2 kHz, blocks of 0.1 s, 100 joint states a second": partial(
        write_mock_bag, samples=round(RATE * SECONDS)
    ),
}


def processor_times(ways: dict[str, Callable[[Path], int]], bag: Path) -> Iterator[tuple[str, float, int]]:
    """Each way, its shortest processor time, s, and what it gave; the ways in turn, so that all meet the same load."""
    found: dict[str, tuple[float, int]] = {}
    for _ in range(TRIES):
        for name, way in ways.items():
            begin = time.process_time()
            given = way(bag)
            found[name] = min(found.get(name, (float("inf"), given)), (time.process_time() - begin, given))
    for name, (used, given) in found.items():
        yield name, used, given


def installed(bag: Path) -> tuple[dict[str, Callable[[Path], int]], list[str]]:
    """Readers that are there, and the names of those that are not; what is loaded at the first call is loaded now."""
    there, missing = {}, []
    for name, way in READERS.items():
        try:
            way(bag)
        except ModuleNotFoundError:
            missing.append(name)
        else:
            there[name] = way
    return there, missing


@pytest.mark.parametrize("kind", BAGS_OF)
def test_samples_a_second(kind, tmp_path, capsys):
    bag = BAGS_OF[kind](tmp_path / "bag")
    contents = [each for topic in BagReader(bag).read().values() for each in topic]
    samples = sum(len(each.rows) if isinstance(each, SampleBlock) else 1 for each in contents)
    ways, missing = installed(bag)
    rows = list(processor_times(ways, bag))
    with capsys.disabled():
        size = sum(path.stat().st_size for path in bag.iterdir())
        print(f"\n{kind}: {SECONDS:g} s, {samples} samples in {len(contents)} messages, {size / 1e6:.1f} MB")
        floor = rows[0][1]
        for name, used, given in rows:
            print(
                f"  {name}: {used * 1e3:.0f} ms of processor, {samples / used / 1e6:.2f} million samples a second, "
                f"{used / floor:.2f} times rosbags alone"
            )
            assert name == ESTIMATED or given == len(contents), f"{name} has read {given} of {len(contents)} messages"
        for name in missing:
            print(f"  {name}: not installed; pip install 'rotary_error_monitor[bench]'")


def test_by_one_and_two_processes(tmp_path, capsys):
    bags = [write_stage_bag(tmp_path / f"bag_{seed}", SECONDS, seed=seed) for seed in range(1, BAGS + 1)]
    count_estimates(bags[0])  # what is loaded once
    rows = []
    for jobs in (1, 2):
        begin, used = time.monotonic(), sum(os.times()[:4])
        given = dict(run_all(count_estimates, bags, jobs))
        rows.append((jobs, time.monotonic() - begin, sum(os.times()[:4]) - used))
        assert sorted(given) == sorted(bags) and all(count > 0 for count in given.values())
    with capsys.disabled():
        print(f"\n{BAGS} bags of {SECONDS:g} s read and estimated, {len(os.sched_getaffinity(0))} processors")
        for jobs, wall, used in rows:
            print(f"  by {jobs}: {wall / BAGS * 1e3:.0f} ms a bag; processor {used / BAGS * 1e3:.0f} ms a bag")
        print(f"  by 2 it takes {rows[1][1] / rows[0][1]:.2f} of the time of 1, start of the processes included")
