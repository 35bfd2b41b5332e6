"""A recording in several files: how rosbag2 users split bags, and what keeps a recorder's memory bounded."""

from __future__ import annotations

import errno
import os
import subprocess
import sys
import tracemalloc
from pathlib import Path

import pytest
import yaml

from rotary_error_monitor.bags.part import BagPart
from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.bags.recovery import recover
from rotary_error_monitor.bags.writer import BagTopic, BagWriter, RecordingStoppedError
from rotary_error_monitor.codec.contents import TYPES, Temperature
from rotary_error_monitor.codec.messages import encode
from rotary_error_monitor.errors import InputError

from .conftest import START, halted, read_by_mcap, read_by_rosbags

TOPICS = [BagTopic(f"/t/{name}", TYPES[Temperature]) for name in "ab"]
SECOND = 1_000_000_000

# Records so many messages a tenth of a second apart, in files of a second, and waits for its end.
ENDLESS = f"""
import sys, time
from rotary_error_monitor.codec.contents import Temperature
from rotary_error_monitor.codec.messages import encode
from rotary_error_monitor.bags.writer import BagTopic, BagWriter
topics = [BagTopic(f"/t/{{name}}", "sensor_msgs/msg/Temperature") for name in "ab"]
writer = BagWriter(sys.argv[1], topics, flush_period=0.0, max_file_duration=1.0)
for number in range(int(sys.argv[2])):
    time_ns = {START} + number * {SECOND} // 10
    writer.write(topics[number % 2].name, encode(Temperature({START} + number, float(number))), time_ns)
print("written", flush=True)
time.sleep(60)
"""


def _message(number: int, size: int = 0) -> bytes:
    return encode(Temperature(START + number, float(number), 0.0, "x" * size))


def _record(folder: Path, count: int, **limits: float) -> BagWriter:
    """Messages a tenth of a second apart, flushed each."""
    writer = BagWriter(folder, TOPICS, flush_period=0.0, **limits)  # type: ignore[arg-type]
    for number in range(count):
        writer.write(TOPICS[number % 2].name, _message(number), START + number * SECOND // 10, sequence=number)
    return writer


def _numbers(bag: Path) -> list[int]:
    contents = BagReader(bag).read()
    return sorted(int(c.temperature) for each in contents.values() for c in each if isinstance(c, Temperature))


def _information(bag: Path) -> dict[str, object]:
    content: dict[str, object] = yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    return content


def test_a_file_ends_after_its_duration(tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    _record(bag, 125, max_file_duration=1.0).close()
    names = [f"bag_{part}.mcap" for part in range(13)]
    assert {path.name for path in bag.glob("*.mcap")} == set(names)
    information = _information(bag)
    assert information["relative_file_paths"] == names
    assert [file["message_count"] for file in information["files"]] == [10] * 12 + [5]  # type: ignore[attr-defined]
    assert information["message_count"] == 125
    starts = [file["starting_time"]["nanoseconds_since_epoch"] for file in information["files"]]  # type: ignore[attr-defined]
    assert starts == [START + part * SECOND for part in range(13)]
    assert _numbers(bag) == list(range(125)), "also where bag_10 comes before bag_2 in the alphabet"
    assert len(read_by_rosbags(bag)) == 125
    assert BagReader(bag).damage is None and recover(bag).rewritten == ()


def test_a_file_ends_at_its_size(tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    with BagWriter(bag, TOPICS, flush_period=0.0, max_file_size=100_000) as writer:
        for number in range(500):
            writer.write("/t/a", _message(number, 1000), START + number)
    sizes = [path.stat().st_size for path in sorted(bag.glob("*.mcap"), key=lambda path: path.stat().st_mtime_ns)]
    assert len(sizes) > 4 and all(100_000 < size < 150_000 for size in sizes[:-1]), "its index comes on top"
    assert _numbers(bag) == list(range(500)) and len(read_by_rosbags(bag)) == 500


@pytest.mark.few(1)
@pytest.mark.parametrize("count", [95, 100, 105])
def test_a_killed_recording_of_several_files(tmp_path: Path, count: int) -> None:
    """All closed files, and the last one as far as it goes."""
    bag = tmp_path / "bag"
    with subprocess.Popen([sys.executable, "-c", ENDLESS, str(bag), str(count)], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None and process.stdout.readline() == b"written\n"
        process.kill()
    assert _numbers(bag) == list(range(count))
    damage = BagReader(bag).damage
    assert damage is not None and "not closed" in damage
    assert recover(bag).counts.total() == count
    assert len(read_by_rosbags(bag)) == count and BagReader(bag).damage is None
    assert _information(bag)["relative_file_paths"] == [f"bag_{part}.mcap" for part in range(-(-count // 10))]


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_compressed_bags_are_read_by_all(tmp_path: Path, compression: str) -> None:
    bag = tmp_path / "bag"
    with BagWriter(bag, TOPICS, compression=compression, clock=halted) as writer:
        for number in range(30):
            writer.write("/t/a", _message(number, 5000), START + number * SECOND // 10)
    size = sum(path.stat().st_size for path in bag.glob("*.mcap"))
    assert size > 150_000 if compression == "none" else size < 30_000
    assert _numbers(bag) == list(range(30)) and len(read_by_rosbags(bag)) == len(read_by_mcap(bag)) == 30
    assert BagReader(bag).remarks == () and _information(bag)["compression_mode"] == "", "chunks, not messages or files"


@pytest.mark.few(1)
@pytest.mark.parametrize(
    ("kept", "first"),
    [({"keep_duration": 4.0}, 80), ({"keep_duration": 4.4}, 70), ({"keep_size": 160_000, "max_file_size": 40_000}, 90)],
)
def test_the_oldest_files_go(tmp_path: Path, kept: dict[str, float], first: int) -> None:
    """What stays is a whole bag, at every moment: names, numbers and times in it are those of its files."""
    bag = tmp_path / "bag"
    writer = BagWriter(bag, TOPICS, flush_period=0.0, **{"max_file_duration": 1.0, **kept})  # type: ignore[arg-type]
    for number in range(125):
        writer.write(TOPICS[number % 2].name, _message(number, 3000), START + number * SECOND // 10)
        there = {path.name for path in bag.glob("*.mcap")}
        assert there == set(_information(bag)["relative_file_paths"])  # type: ignore[call-overload]
        if "keep_size" in kept:
            closed = sorted(bag.glob("*.mcap"), key=lambda path: path.stat().st_mtime_ns)[:-1]
            assert sum(path.stat().st_size for path in closed) + 40_000 <= 160_000
    writer.close()
    numbers = _numbers(bag)
    assert numbers == list(range(first, 125)) and len(read_by_rosbags(bag)) == len(numbers)
    information = _information(bag)
    assert information["message_count"] == len(numbers)
    assert information["starting_time"] == {"nanoseconds_since_epoch": START + first * SECOND // 10}
    counts = [topic["message_count"] for topic in information["topics_with_message_count"]]  # type: ignore[attr-defined]
    assert sum(counts) == len(numbers)
    (remark,) = BagReader(bag).remarks
    assert f"{first // 10} files with {first} messages, up to" in remark
    assert writer.counts.total() == 125


def test_a_file_that_cannot_be_removed_stays_in_the_bag(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(path: Path, **_: object) -> None:
        raise OSError(errno.EPERM, os.strerror(errno.EPERM))

    monkeypatch.setattr(Path, "unlink", refuse)
    writer = _record(tmp_path / "bag", 50, max_file_duration=1.0, keep_duration=1.0)
    monkeypatch.undo()
    writer.close()
    assert _numbers(tmp_path / "bag") == list(range(50)) and BagReader(tmp_path / "bag").remarks == ()


@pytest.mark.parametrize(
    ("limits", "said"),
    [
        ({"keep_size": 10_000}, "without files that end"),
        ({"keep_duration": 10.0}, "without files that end"),
        ({"keep_size": 10_000, "max_file_size": 6000}, "10000 bytes: expected at least two files of 6000"),
        ({"keep_duration": 10.0, "max_file_duration": 60.0}, r"10.0 s: expected a file of 60.0 s or more"),
    ],
)
def test_less_than_a_file_cannot_be_kept(tmp_path: Path, limits: dict[str, float], said: str) -> None:
    with pytest.raises(InputError, match=said):
        BagWriter(tmp_path / "bag", TOPICS, **limits)  # type: ignore[arg-type]
    assert not (tmp_path / "bag").exists()


@pytest.mark.long
def test_memory_does_not_grow_with_the_recording(tmp_path: Path) -> None:
    """Counted, not timed: what is held after the 5th file and after the 25th, each of 200 chunks."""
    each = 200
    with BagWriter(tmp_path / "bag", TOPICS, flush_period=0.0, max_file_duration=float(each)) as writer:
        held = []
        tracemalloc.start()
        try:
            for number in range(25 * each + 1):
                writer.write("/t/a", _message(0), START + number * SECOND)
                if number in (5 * each, 25 * each):
                    held.append(tracemalloc.get_traced_memory()[0])
        finally:
            tracemalloc.stop()
    within = 20 * each * 200  # a fifth of what the index of that many chunks takes
    assert held[1] - held[0] < within / 10, "a file's entry in metadata.yaml, no more"


def test_a_file_that_cannot_be_begun_ends_the_recording_whole(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bag = tmp_path / "bag"
    writer = _record(bag, 30, max_file_duration=1.0)

    def refuse(*_: object) -> None:
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    monkeypatch.setattr(BagPart, "_begin", refuse)
    with pytest.raises(RecordingStoppedError, match=r"Read-only file system; the bag is complete .* with 30 messages"):
        writer.write("/t/a", _message(30), START + 3 * SECOND)
    monkeypatch.undo()
    assert _numbers(bag) == list(range(30)) and len(read_by_rosbags(bag)) == 30
    assert BagReader(bag).damage is None


def test_the_number_of_a_message_is_kept(tmp_path: Path) -> None:
    from mcap.reader import make_reader

    _record(tmp_path / "bag", 5).close()
    with (tmp_path / "bag" / "bag_0.mcap").open("rb") as file:
        assert [message.sequence for _, _, message in make_reader(file).iter_messages()] == list(range(5))
    assert len(read_by_mcap(tmp_path / "bag")) == 5
