"""Writing bags: what other readers find, killed recorders, full and failing disks."""

from __future__ import annotations

import errno
import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import yaml
from draws import seeds
from faults.documenting import Row, shows
from rosbags.highlevel import AnyReader
from rosbags.interfaces import QosDurability, QosReliability

from rotary_error_monitor.bags.part import CHUNK_SIZE
from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.bags.recovery import recover
from rotary_error_monitor.bags.storage import RecordFile
from rotary_error_monitor.bags.writer import RESERVE, BagTopic, BagWriter, RecordingStoppedError, write_messages
from rotary_error_monitor.codec.contents import TYPES, Content, Temperature
from rotary_error_monitor.codec.messages import encode
from rotary_error_monitor.description.wire import load_wire
from rotary_error_monitor.errors import InputError

from .conftest import START, read_by_mcap, read_by_rosbags

TOPIC = BagTopic("/machine/temperature", TYPES[Temperature])

# Records numbered messages as fast as the argument says until something ends it; says when the first is handed over.
RECORD = """
import sys, time
from rotary_error_monitor.codec.contents import Temperature
from rotary_error_monitor.codec.messages import encode
from rotary_error_monitor.bags.writer import BagTopic, BagWriter, RecordingStoppedError
folder, period = sys.argv[1], float(sys.argv[2])
topics = [BagTopic("/machine/temperature", "sensor_msgs/msg/Temperature")]
writer = BagWriter(folder, topics, compression=(sys.argv[3:] or ["none"])[0])
data = [encode(Temperature(number, number, 0.0, "x" * 80)) for number in range(40_000)]
print("ready", flush=True)
try:
    for number, message in enumerate(data):
        writer.write("/machine/temperature", message, time.time_ns())
        time.sleep(period)
except RecordingStoppedError as error:
    print(number, error, flush=True)
"""

# Runs in a mount namespace of its own, so that the small disk goes with the process.
SMALL_DISK = """
import shutil, subprocess, sys
from pathlib import Path
disk, out = Path(sys.argv[1]), Path(sys.argv[2])
subprocess.run(["mount", "-t", "tmpfs", "-o", "size=" + sys.argv[3], "tmpfs", str(disk)], check=True)
exec(sys.argv[4])
"""


def _numbers(bag: Path) -> list[int]:
    contents = BagReader(bag).read().get(TOPIC.name, [])
    return [int(content.temperature) for content in contents if isinstance(content, Temperature)]


def _run_on_small_disk(tmp_path: Path, size: str, script: str) -> str:
    if shutil.which("unshare") is None:
        pytest.skip("no unshare to mount a small disk with")
    (tmp_path / "disk").mkdir()
    (tmp_path / "out").mkdir()
    command = ["unshare", "--mount", *(["--map-root-user"] if os.geteuid() else [])]
    if subprocess.run([*command, "true"], capture_output=True).returncode:
        pytest.skip("this machine does not allow mount namespaces")
    arguments = [str(tmp_path / "disk"), str(tmp_path / "out"), size, script]
    done = subprocess.run([*command, sys.executable, "-c", SMALL_DISK, *arguments], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_rosbags_and_mcap_read_what_was_written(tmp_path: Path, contents: dict[str, list[Content]]) -> None:
    folder = tmp_path / "deep" / "bag"
    wire = load_wire()
    write_messages(folder, contents, wire)
    assert sorted(path.name for path in folder.iterdir()) == ["bag_0.mcap", "metadata.yaml"]
    expected = sorted(
        (name, int(getattr(value, "times_ns", [value.stamp_ns])[-1]), encode(value, wire.named(name).frame))
        for name, values in contents.items()
        for value in values
    )
    assert read_by_rosbags(folder) == expected
    assert read_by_mcap(folder) == expected


def test_metadata_says_what_rosbag2_expects(tmp_path: Path, contents: dict[str, list[Content]]) -> None:
    wire = load_wire()
    write_messages(tmp_path / "bag", contents, wire)
    information = yaml.safe_load((tmp_path / "bag" / "metadata.yaml").read_text())["rosbag2_bagfile_information"]
    first, last = START, START + 11 * 10_000_000 + 19 * 500_000 + 77
    assert information["version"] == 9
    assert information["starting_time"]["nanoseconds_since_epoch"] == first
    assert information["duration"]["nanoseconds"] == last - first
    assert information["message_count"] == information["files"][0]["message_count"] == 72
    with AnyReader([tmp_path / "bag"]) as reader:
        for connection in reader.connections:
            (profile,) = connection.ext.offered_qos_profiles  # type: ignore[union-attr]
            topic = wire.named(connection.topic)
            assert (profile.depth, profile.reliability) == (
                topic.qos.depth,
                QosReliability[topic.qos.reliability.upper()],
            )
            assert profile.durability == QosDurability[topic.qos.durability.upper()]
            assert connection.digest.startswith("RIHS01_")


def test_metadata_is_there_from_the_start(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag", load_wire()) as writer:
        text = (tmp_path / "bag" / "metadata.yaml").read_text()
        information = yaml.safe_load(text)["rosbag2_bagfile_information"]
        assert len(information["topics_with_message_count"]) == len(load_wire().topics)
        assert information["relative_file_paths"] == ["bag_0.mcap"]
        assert (writer.stopped, writer.counts.total()) == (None, 0)
    assert read_by_rosbags(tmp_path / "bag") == []


def test_a_message_leaves_the_process_within_the_flush_period(tmp_path: Path) -> None:
    now = 0.0
    with BagWriter(tmp_path / "bag", [TOPIC], flush_period=0.2, clock=lambda: now) as writer:
        writer.write(TOPIC.name, encode(Temperature(0, 0.0)), START)
        now = 0.1
        writer.write(TOPIC.name, encode(Temperature(1, 1.0)), START)
        assert _numbers(tmp_path / "bag") == []
        now = 0.2
        writer.write(TOPIC.name, encode(Temperature(2, 2.0)), START)
        assert _numbers(tmp_path / "bag") == [0, 1, 2]
        writer.write(TOPIC.name, encode(Temperature(3, 3.0)), START)
        writer.flush()  # as a timer does where messages are rare
        assert _numbers(tmp_path / "bag") == [0, 1, 2, 3]


@pytest.mark.few(2)
@pytest.mark.parametrize("seed", seeds(4))
@pytest.mark.parametrize("compression", ["none", "zstd"])
def test_what_came_a_second_before_a_kill_can_be_read(tmp_path: Path, seed: int, compression: str) -> None:
    folder = tmp_path / "bag"
    with subprocess.Popen(
        [sys.executable, "-c", RECORD, str(folder), "0.0005", compression], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout is not None and process.stdout.readline() == "ready\n"
        time.sleep(random.Random(seed).uniform(0.05, 2.0))  # the moment of the kill is what varies here
        killed = time.time_ns()
        process.send_signal(signal.SIGKILL)
    reader = BagReader(folder)
    assert reader.damage is not None and "not closed" in reader.damage
    before = _numbers(folder)
    assert before == list(range(len(before)))
    times = [message.log_time_ns for message in reader.messages()]
    assert not times or killed - times[-1] < 1_000_000_000
    assert recover(folder).counts.total() == len(before)
    assert _numbers(folder) == before
    assert [row[1] for row in read_by_rosbags(folder)] == [row[1] for row in read_by_mcap(folder)] == times


@pytest.mark.long
def test_a_file_that_may_not_grow_keeps_what_was_written(tmp_path: Path) -> None:
    folder = tmp_path / "bag"
    done = subprocess.run(
        [sys.executable, "-c", RECORD, str(folder), "0"],
        capture_output=True,
        text=True,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (4_000_000, 4_000_000)),
    )
    assert done.returncode == 0, done.stderr
    number, said = done.stdout.splitlines()[1].split(" ", 1)
    assert "recording stopped: File too large; what was written is kept" in said and "recover it" in said
    kept = _numbers(folder)
    assert kept == list(range(len(kept)))
    assert len(kept) > 5_000
    assert int(number) - len(kept) < CHUNK_SIZE / len(encode(Temperature(0, 0.0, 0.0, "x" * 80)))  # the last chunk
    recover(folder)
    assert _numbers(folder) == kept and len(read_by_rosbags(folder)) == len(read_by_mcap(folder)) == len(kept)


def test_a_full_disk_leaves_a_whole_bag(tmp_path: Path) -> None:
    said = _run_on_small_disk(
        tmp_path,
        "4m",
        f"""
sys.argv[1:] = [str(disk / "bag"), "0"]
exec({RECORD!r})
assert not (disk / "bag" / {RESERVE!r}).exists()
print(writer.counts.total(), writer.stopped)
try:
    writer.write("/machine/temperature", data[0], 0)
except RecordingStoppedError as error:
    assert str(error) == writer.stopped
shutil.copytree(disk / "bag", out / "bag")
""",
    )
    count, stopped = said.splitlines()[-1].split(" ", 1)
    assert "recording stopped: No space left on device; the bag is complete up to here" in stopped
    bag = tmp_path / "out" / "bag"
    assert BagReader(bag).damage is None
    assert _numbers(bag) == list(range(int(count))) and int(count) > 5_000
    assert len(read_by_rosbags(bag)) == len(read_by_mcap(bag)) == int(count)


def test_a_disk_filled_by_others_costs_no_message(tmp_path: Path) -> None:
    said = _run_on_small_disk(
        tmp_path,
        "4m",
        """
from rotary_error_monitor.codec.contents import Temperature
from rotary_error_monitor.codec.messages import encode
from rotary_error_monitor.bags.writer import BagTopic, BagWriter, RecordingStoppedError
writer = BagWriter(disk / "bag", [BagTopic("/machine/temperature", "sensor_msgs/msg/Temperature")], flush_period=1e9)
for number in range(100):
    writer.write("/machine/temperature", encode(Temperature(number, number)), number)
try:
    with (disk / "other").open("wb", buffering=0) as other:
        while other.write(bytes(1000)) == 1000:
            pass
except OSError:
    pass
try:
    writer.flush()
except RecordingStoppedError as error:
    print(error)
shutil.copytree(disk / "bag", out / "bag")
""",
    )
    assert "No space left on device; the bag is complete up to here with 100 messages" in said
    assert _numbers(tmp_path / "out" / "bag") == list(range(100))
    assert len(read_by_rosbags(tmp_path / "out" / "bag")) == 100


def test_a_disk_without_room_for_a_recording_is_said_at_once(tmp_path: Path) -> None:
    said = _run_on_small_disk(
        tmp_path,
        "100k",
        """
from rotary_error_monitor.bags.writer import BagTopic, BagWriter, RecordingStoppedError
try:
    BagWriter(disk / "bag", [BagTopic("/machine/temperature", "sensor_msgs/msg/Temperature")])
except RecordingStoppedError as error:
    print(error)
(disk / "other").write_bytes(bytes(88_000))
try:
    BagWriter(disk / "bag2", [BagTopic("/machine/temperature", "sensor_msgs/msg/Temperature")])
except OSError as error:
    print(error)
""",
    )
    assert "bag: recording stopped: No space left on device; the bag is complete up to here with 0 messages" in said
    assert "[Errno 28]" in said


def test_a_disk_that_cannot_store_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    now = 0.0
    writer = BagWriter(tmp_path / "bag", [TOPIC], flush_period=0.2, sync_period=1.0, clock=lambda: now)

    def fail(_: int) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr(os, "fsync", fail)
    with pytest.raises(RecordingStoppedError, match="Input/output error; what was written is kept"):
        for number in range(1000):
            now += 0.3
            writer.write(TOPIC.name, encode(Temperature(number, float(number))), START + number)
            time.sleep(0.001)  # lets the thread that stores get on
    assert number < 900
    monkeypatch.undo()
    assert _numbers(tmp_path / "bag") == list(range(number + 1))
    writer.close()  # what has stopped can be closed


@shows(
    Row(
        "files",
        "The disk turns read-only while it is recorded to",
        "`recording`: ERROR, and in the log: read-only file system",
        "recording stops; what was written is kept",
        "everything else goes on",
        "a new recording; `recover` makes the old one whole",
    )
)
def test_a_disk_that_turns_read_only_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As a kernel makes it after an error: nothing can be written, made longer, renamed or removed any more."""
    writer = BagWriter(tmp_path / "bag", [TOPIC], flush_period=0.0)
    for number in range(10):
        writer.write(TOPIC.name, encode(Temperature(number, float(number))), START + number)

    def refuse(*_: object, **__: object) -> None:
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    monkeypatch.setattr(RecordFile, "_append", refuse)
    for name in ("posix_fallocate", "unlink", "rename", "replace"):
        monkeypatch.setattr(os, name, refuse)
    with pytest.raises(RecordingStoppedError, match=r"Read-only file system; what was written is kept"):
        writer.write(TOPIC.name, encode(Temperature(10, 10.0)), START + 10)
    monkeypatch.undo()
    assert _numbers(tmp_path / "bag") == list(range(10))
    assert recover(tmp_path / "bag").counts.total() == 10


def test_a_folder_that_cannot_be_made_is_refused(tmp_path: Path) -> None:
    said = _run_on_small_disk(
        tmp_path,
        "8m",
        """
from rotary_error_monitor.bags.writer import BagTopic, BagWriter
subprocess.run(["mount", "-o", "remount,ro", str(disk)], check=True)
try:
    BagWriter(disk / "bag", [BagTopic("/machine/temperature", "sensor_msgs/msg/Temperature")])
except OSError as error:
    print(error)
""",
    )
    assert "Read-only file system" in said


def test_wrong_use_is_refused(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag", [TOPIC]) as writer, pytest.raises(InputError, match=r"topic /x is not recorded"):
        writer.write("/x", b"", 0)
    with pytest.raises(InputError, match=r"bag: the bag is closed"):
        writer.write(TOPIC.name, b"", 0)
    with pytest.raises(InputError, match=r"bag: exists already; give the path of a new bag"):
        BagWriter(tmp_path / "bag", [TOPIC])
    with pytest.raises(InputError, match=r"topic /x: my_msgs/msg/Own is no standard message"):
        BagWriter(tmp_path / "own", [BagTopic("/x", "my_msgs/msg/Own")])
    assert not (tmp_path / "own").exists()
    with pytest.raises(InputError, match=r"topic /x holds \[''\]; give it contents of one kind"):
        write_messages(tmp_path / "none", {"/x": []})
    write_messages(tmp_path / "known", {"/machine/tool_probe": []}, load_wire())
    assert BagReader(tmp_path / "known").topics["/machine/tool_probe"].count == 0
