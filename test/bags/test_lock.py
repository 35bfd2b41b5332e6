"""One process at a time has a bag: recorders and recoveries keep away from one another's, readers need not."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import os
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from faults.documenting import Row, shows

from rotary_error_monitor.bags.lock import BagLock, holder, writer_of
from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.bags.recovery import recover
from rotary_error_monitor.bags.writer import BagTopic, BagWriter, RecordingStoppedError
from rotary_error_monitor.cli import main
from rotary_error_monitor.codec.contents import TYPES, Temperature
from rotary_error_monitor.codec.messages import encode
from rotary_error_monitor.errors import InputError

from .conftest import START, read_by_rosbags

TOPIC = BagTopic("/machine/temperature", TYPES[Temperature])

# Records a message for each line that it reads, and says so; closes the bag at the end of the lines.
RECORDER = """
import sys
from rotary_error_monitor.codec.contents import Temperature
from rotary_error_monitor.codec.messages import encode
from rotary_error_monitor.bags.writer import BagTopic, BagWriter
with BagWriter(sys.argv[1], [BagTopic("/machine/temperature", "sensor_msgs/msg/Temperature")], flush_period=0.0) as bag:
    print("ready", flush=True)
    for number, _ in enumerate(sys.stdin):
        bag.write("/machine/temperature", encode(Temperature(number, float(number))), 1_763_700_000 * 10**9 + number)
        print(number, flush=True)
"""

# A recorder that knows nothing of locks.
OTHER = """
import sys
file = open(sys.argv[1], "r+b")
print("ready", flush=True)
sys.stdin.read()
"""


@contextmanager
def running(script: str, path: Path) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-c", script, str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None and process.stdout.readline() == "ready\n"
        try:
            yield process
        finally:
            process.kill()


def record(process: subprocess.Popen[str], count: int) -> None:
    assert process.stdin is not None and process.stdout is not None
    for _ in range(count):
        process.stdin.write("\n")
        process.stdin.flush()
        process.stdout.readline()


@shows(
    Row(
        "files",
        "Somebody recovers a bag that is being recorded",
        "exit code 2: who is recording it",
        "the bag is its recorder's alone",
        "the recording goes on",
        "when the recorder has ended",
    ),
)
def test_a_bag_that_is_being_recorded_is_not_recovered(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bag = tmp_path / "bag"
    with running(RECORDER, bag) as recorder:
        record(recorder, 20)
        inode = (bag / "bag_0.mcap").stat().st_ino
        for path in (bag, bag / "bag_0.mcap"):
            assert main(["recover", str(path)]) == 2
            assert f"{bag}: process {recorder.pid} is recording or recovering it" in capsys.readouterr().err
        reader = BagReader(bag)
        assert reader.topics[TOPIC.name].count == 20, "it can be read meanwhile"
        assert reader.damage is not None and f"process {recorder.pid} is recording it" in reader.damage
        record(recorder, 20)
        assert (bag / "bag_0.mcap").stat().st_ino == inode
        assert recorder.stdin is not None
        recorder.stdin.close()
        assert recorder.wait() == 0
    assert len(read_by_rosbags(bag)) == 40, "nothing of what followed is lost"
    assert holder(bag) == ""


def test_the_lock_goes_with_a_killed_recorder(tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    with running(RECORDER, bag) as recorder:
        record(recorder, 5)
        recorder.kill()
        recorder.wait()
        assert recover(bag).counts.total() == 5
    assert sorted(path.name for path in bag.iterdir()) == ["bag_0.mcap", "metadata.yaml"]


@pytest.mark.long
def test_no_moment_is_left_at_which_a_recovery_harms_a_recording(tmp_path: Path) -> None:
    """Recoveries one after the other, from before the bag is there until its recorder is killed."""
    for attempt in range(1, 9):
        bag = tmp_path / f"bag{attempt}"
        ended = threading.Event()
        recovered = []

        def hammer(bag: Path = bag, ended: threading.Event = ended, recovered: list[int] = recovered) -> None:
            while not ended.is_set():
                with contextlib.suppress(InputError):
                    recovered.append(recover(bag).counts.total())

        hammering = threading.Thread(target=hammer)
        hammering.start()
        try:
            with running(RECORDER, bag) as recorder:
                record(recorder, 10 * attempt)
        finally:
            ended.set()
            hammering.join()
        assert {*recovered} <= {10 * attempt}, "only once all was written"
        assert recover(bag).counts.total() == 10 * attempt


def test_a_second_recorder_is_refused(tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    with (
        running(RECORDER, bag) as recorder,
        pytest.raises(
            InputError, match=rf"exists already and process {recorder.pid} has it; give the path of a new bag"
        ),
    ):
        BagWriter(bag, [TOPIC])


def test_of_two_that_recover_one_is_refused(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag", [TOPIC]) as writer:
        writer.write(TOPIC.name, encode(Temperature(0, 0.0)), START)
    with (
        BagLock(tmp_path / "bag"),
        pytest.raises(InputError, match=rf"process {os.getpid()} is recording or recovering"),
    ):
        recover(tmp_path / "bag")
    assert recover(tmp_path / "bag").counts.total() == 1


def test_a_recorder_without_locks_is_seen_by_its_open_file(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag", [TOPIC]) as writer:
        writer.write(TOPIC.name, encode(Temperature(0, 0.0)), START)
    file = tmp_path / "bag" / "bag_0.mcap"
    with file.open("rb"):  # who reads does no harm
        assert writer_of([file]) == ""
    with running(OTHER, file) as other, pytest.raises(InputError, match=f"process {other.pid} has its files open"):
        recover(tmp_path / "bag")
    assert recover(tmp_path / "bag").rewritten == ()


def test_a_file_system_without_locks_is_said_and_recorded_to(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def unknown(*_: object) -> None:
        raise OSError(errno.ENOTSUP, os.strerror(errno.ENOTSUP))

    monkeypatch.setattr(fcntl, "flock", unknown)
    with BagWriter(tmp_path / "bag", [TOPIC]) as writer:
        assert not writer.locked
        writer.write(TOPIC.name, encode(Temperature(0, 0.0)), START)
    assert len(read_by_rosbags(tmp_path / "bag")) == 1


def test_a_folder_that_is_renamed_takes_its_recording_along(tmp_path: Path) -> None:
    bag, later = tmp_path / "bag", tmp_path / "later"
    with BagWriter(bag, [TOPIC], flush_period=0.0, max_file_duration=1e-8) as writer:
        assert writer.moved is None
        for number in range(30):
            writer.write(TOPIC.name, encode(Temperature(number, float(number))), START + number)
            if number == 14:
                bag.rename(later)
        assert writer.moved == later
        assert holder(later) == f"process {os.getpid()}"
    assert not bag.exists() and sorted(path.name for path in later.glob("*.mcap")) == [
        "bag_0.mcap",
        "bag_1.mcap",
        "bag_2.mcap",
    ]
    assert len(read_by_rosbags(later)) == 30


@pytest.mark.parametrize("folder", [True, False])
def test_what_is_removed_ends_the_recording(tmp_path: Path, folder: bool) -> None:
    bag = tmp_path / "bag"
    writer = BagWriter(bag, [TOPIC], flush_period=0.0, max_file_duration=1e-8)
    for number in range(15):
        writer.write(TOPIC.name, encode(Temperature(number, float(number))), START + number)
    if folder:
        shutil.rmtree(bag)
        said = "the folder was removed; what was recorded is gone with it"
    else:
        (bag / "bag_1.mcap").unlink()
        said = "bag_1.mcap was removed; its 5 messages are gone with it"
    with pytest.raises(RecordingStoppedError, match=rf"bag: recording stopped: {said}"):
        writer.flush()
    assert writer.stopped is not None and writer.moved is None
    if not folder:
        remark, *_ = BagReader(bag).remarks
        assert "metadata.yaml tells of bag_1.mcap, which is not there" in remark
        assert BagReader(bag).topics[TOPIC.name].count == 10
