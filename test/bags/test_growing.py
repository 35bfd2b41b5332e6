"""A bag that is read while somebody records it: what was there when it was opened, in every pass over it."""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from pathlib import Path

import pytest
from faults.documenting import Row, shows
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from rosbags.typesys import Stores, get_typestore

from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.bags.writer import BagTopic, BagWriter
from rotary_error_monitor.codec.contents import TYPES, Temperature
from rotary_error_monitor.codec.messages import encode
from rotary_error_monitor.errors import InputError

from .conftest import START

TOPIC = BagTopic("/t", TYPES[Temperature])
SECOND = 1_000_000_000


def _data(number: int) -> bytes:
    return encode(Temperature(START + number * SECOND // 10, float(number)))


def _record(writer: BagWriter, numbers: range) -> None:
    for number in numbers:
        writer.write(TOPIC.name, _data(number), START + number * SECOND // 10)
    writer.flush()


def _read(reader: BagReader) -> list[float]:
    return [content.temperature for _, content in reader.replay() if isinstance(content, Temperature)]


def _go_on(writer: BagWriter) -> None:
    _record(writer, range(20, 25))


def _close(writer: BagWriter) -> None:
    _record(writer, range(20, 25))
    writer.close()


def _split(writer: BagWriter) -> None:
    _record(writer, range(20, 60))


@shows(
    Row(
        "files",
        "A bag is read while it is recorded",
        "a note on standard error: who is recording it",
        "what was there when it was opened is read",
        "what that gives",
        "not needed",
    ),
)
@pytest.mark.parametrize("meanwhile", [_go_on, _close, _split])
def test_what_was_there_at_the_beginning_is_read(meanwhile: Callable[[BagWriter], None], tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag", [TOPIC], flush_period=0.0, max_file_duration=3.0) as writer:
        _record(writer, range(20))
        reader = BagReader(tmp_path / "bag")
        window = reader.window([TOPIC.name])
        assert window is not None
        meanwhile(writer)
        assert _read(reader) == [float(number) for number in range(20)]
        assert len(list(reader.messages())) == reader.topics[TOPIC.name].count == 20
        (remark,) = reader.remarks
        assert "is recording it; readable are 20 messages on 1 topics" in remark


def test_messages_that_come_between_two_passes_wait_for_the_next_reader(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag", [TOPIC], flush_period=0.0) as writer:
        _record(writer, range(20))
        reader = BagReader(tmp_path / "bag")
        replayed = reader.replay()
        next(replayed)  # the first pass is over and the second one has begun
        _record(writer, range(20, 40))
        assert len(list(replayed)) == 19
        assert len(_read(BagReader(tmp_path / "bag"))) == 40


def test_a_recorder_without_locks_is_named(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag", [TOPIC]) as writer:
        _record(writer, range(20))
    (file,) = (tmp_path / "bag").glob("*.mcap")
    content = file.read_bytes()
    with file.open("r+b") as stream:
        stream.truncate(len(content) // 2)
        assert "is recording it" in str(BagReader(file).damage)
    assert "the recording was not closed" in str(BagReader(file).damage)


def test_a_database_that_grows(tmp_path: Path) -> None:
    with RosbagsWriter(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connection = writer.add_connection("/t", TYPES[Temperature], typestore=get_typestore(Stores.ROS2_JAZZY))
        for number in range(20):
            writer.write(connection, START + number, _data(number))
    (file,) = (tmp_path / "bag").glob("*.db3")
    reader = BagReader(file)
    with sqlite3.connect(file) as database:
        rows = [(START + number, _data(number)) for number in range(20, 2000)]
        database.executemany("INSERT INTO messages(topic_id, timestamp, data) VALUES (1, ?, ?)", rows)
    database.close()
    assert _read(reader) == [float(number) for number in range(20)]
    assert len(_read(BagReader(file))) == 2000


@pytest.mark.parametrize("size", [0, 100, -30])
def test_a_file_that_loses_what_was_there_is_told(size: int, tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag", [TOPIC]) as writer:
        _record(writer, range(20))
    (file,) = (tmp_path / "bag").glob("*.mcap")
    reader = BagReader(file)
    assert reader.window([TOPIC.name]) is not None
    content = file.read_bytes()
    file.write_bytes(content[:size])
    with pytest.raises(InputError, match=r"mcap: .*(changed|became shorter) while it was read"):
        _read(reader)
    file.unlink()
    with pytest.raises(InputError, match="cannot be read"):
        _read(reader)
