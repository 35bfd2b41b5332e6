"""Files of bags as other programs write them, split, packed, damaged in their index or their metadata."""

from __future__ import annotations

import os
import shutil
import sqlite3
import struct
from pathlib import Path

import pytest
from fuzz.bags import write_with_rosbags
from mcap.opcode import Opcode
from mcap.writer import CompressionType, Writer
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import CompressionMode, StoragePlugin
from rosbags.typesys import Stores, get_typestore

from rotary_error_monitor.bags import recorded_files
from rotary_error_monitor.bags.metadata import type_definition
from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.bags.recovery import recover
from rotary_error_monitor.bags.unpacking import MOST_AT_ONCE, Budget, DamageError, unpack
from rotary_error_monitor.bags.writer import write_messages
from rotary_error_monitor.codec.contents import TYPES, Content, PointStamped, Temperature
from rotary_error_monitor.codec.messages import encode
from rotary_error_monitor.description.wire import load_wire
from rotary_error_monitor.errors import InputError

from .conftest import START, assert_same, read_by_rosbags

TYPESTORE = get_typestore(Stores.ROS2_JAZZY)
TEMPERATURE = "/machine/temperature"


@pytest.fixture
def bag(tmp_path: Path, contents: dict[str, list[Content]]) -> Path:
    write_messages(tmp_path / "bag", contents, load_wire())
    return tmp_path / "bag"


def write_mcap(path: Path, values: list[Content], compression: CompressionType = CompressionType.NONE) -> Path:
    """One topic, a few messages a chunk."""
    writer = Writer(str(path), chunk_size=200, compression=compression)
    writer.start("ros2")
    schema = writer.register_schema(TYPES[Temperature], "ros2msg", type_definition(TYPES[Temperature]).encode())
    channel = writer.register_channel(TEMPERATURE, "cdr", schema)
    for value in values:
        writer.add_message(channel, value.stamp_ns, encode(value), value.stamp_ns)
    writer.finish()  # type: ignore[no-untyped-call]
    return path


def temperatures(first: int, last: int) -> list[Content]:
    return [Temperature(START + k, 20.0 + k) for k in range(first, last)]


@pytest.mark.parametrize(
    ("storage", "mode"),
    [
        (StoragePlugin.MCAP, CompressionMode.NONE),
        (StoragePlugin.MCAP, CompressionMode.STORAGE),
        (StoragePlugin.MCAP, CompressionMode.FILE),
        (StoragePlugin.MCAP, CompressionMode.MESSAGE),
        (StoragePlugin.SQLITE3, CompressionMode.NONE),
        (StoragePlugin.SQLITE3, CompressionMode.FILE),
        (StoragePlugin.SQLITE3, CompressionMode.MESSAGE),
    ],
)
def test_every_way_of_packing_is_read_as_rosbags_reads_it(tmp_path, contents, storage, mode) -> None:
    folder = write_with_rosbags(tmp_path / "bag", contents, storage, mode)
    reader = BagReader(folder)
    assert reader.damage is None
    found = sorted((message.topic, message.log_time_ns, message.data) for message in reader.messages())
    assert found == read_by_rosbags(folder)
    with AnyReader([folder]) as other:
        assert {name: topic.count for name, topic in reader.topics.items()} == {
            connection.topic: connection.msgcount for connection in other.connections
        }
    for name, values in reader.read().items():
        for one, expected in zip(values, contents[name], strict=True):
            assert_same(one, expected)


def test_a_file_of_sqlite_alone_and_without_metadata_is_read(tmp_path, contents) -> None:
    folder = write_with_rosbags(tmp_path / "bag", contents, StoragePlugin.SQLITE3, CompressionMode.NONE)
    (folder / "metadata.yaml").unlink()
    (file,) = folder.iterdir()
    assert BagReader(folder).read().keys() == BagReader(file).read().keys() == contents.keys()


def test_a_split_bag_is_read_in_the_order_of_its_files(tmp_path: Path) -> None:
    bag = tmp_path / "bag"
    bag.mkdir()
    names = ["bag_9.mcap", "bag_10.mcap"]  # their names in the order of the alphabet are not that of the recording
    write_mcap(bag / names[0], temperatures(0, 10))
    write_mcap(bag / names[1], temperatures(10, 20), CompressionType.LZ4)
    write_mcap(bag / "other.mcap", temperatures(50, 60))
    listed = f"rosbag2_bagfile_information: {{relative_file_paths: [{', '.join(names)}]}}"
    (bag / "metadata.yaml").write_text(listed)
    reader = BagReader(bag)
    assert reader.damage is None and reader.topics[TEMPERATURE].count == 20
    assert [message.log_time_ns - START for message in reader.messages()] == list(range(20))
    (bag / names[0]).unlink()
    reader = BagReader(bag)
    assert reader.damage == f"{bag}: metadata.yaml tells of bag_9.mcap, which is not there"
    assert [message.log_time_ns - START for message in reader.messages()] == list(range(10, 20))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("{]", "metadata.yaml:1: no valid YAML"),
        ("a: &a [*a]", "stands within what it names"),
        ("rosbag2_bagfile_information: {version: 9}", "relative_file_paths is missing"),
        ("rosbag2_bagfile_information: {relative_file_paths: [5]}", "expected names of files"),
        ("rosbag2_bagfile_information: {relative_file_paths: ['..']}", "no file of a bag; it is a folder"),
        ("\udcff", "cannot be read"),
        ("- " * 50_000, "nested more than"),
    ],
)
def test_metadata_that_cannot_be_used_is_said(bag: Path, text: str, said: str) -> None:
    expected = BagReader(bag).topics
    (bag / "metadata.yaml").write_text(text, encoding="utf-8", errors="surrogateescape")
    if "'..'" in text:
        with pytest.raises(InputError, match=said):
            BagReader(bag)
        return
    reader = BagReader(bag)
    assert reader.topics == expected
    assert said in str(reader.damage) and f"read without it were {bag.name}_0.mcap" in str(reader.damage)
    assert recover(bag).rewritten == () and BagReader(bag).damage is None


def test_a_path_out_of_the_bag_is_not_followed(bag: Path, tmp_path: Path) -> None:
    write_mcap(tmp_path / "secret.mcap", temperatures(0, 3))
    listed = "rosbag2_bagfile_information: {relative_file_paths: [../secret.mcap]}"
    (bag / "metadata.yaml").write_text(listed)
    reader = BagReader(bag)
    assert reader.damage == f"{bag}: metadata.yaml tells of secret.mcap, which is not there"
    assert TEMPERATURE in reader.topics and reader.topics[TEMPERATURE].count == 12


def records(content: bytes) -> dict[int, int]:
    """Where the payload of the last record of each kind begins."""
    found, position = {}, 8
    while position < len(content) - 8:
        opcode, length = struct.unpack_from("<BQ", content, position)
        found[opcode] = position + 9
        position += 9 + length
    return found


@pytest.mark.parametrize(
    ("opcode", "offset", "said"),
    [
        (Opcode.STATISTICS, 0, "the index says 21 messages where there are 20"),
        (Opcode.CHUNK_INDEX, 16, "the index does not name the chunks that are there"),
    ],
)
def test_an_index_that_does_not_fit_is_said_and_not_needed(tmp_path: Path, opcode, offset, said) -> None:
    path = write_mcap(tmp_path / "a.mcap", temperatures(0, 20))
    content = bytearray(path.read_bytes())
    content[records(content)[opcode] + offset] += 1
    path.write_bytes(content)
    assert "the checksum of the index does not fit; all messages were read without it" in str(BagReader(path).damage)
    path.write_bytes(content[:-12] + bytes(4) + content[-8:])  # as of a writer that makes no checksum
    reader = BagReader(path)
    assert said in str(reader.damage)
    assert reader.read()[TEMPERATURE] == temperatures(0, 20)
    assert recover(path).rewritten == ("a.mcap",)
    assert BagReader(path).damage is None and BagReader(path).read()[TEMPERATURE] == temperatures(0, 20)


def test_messages_of_a_topic_that_the_file_does_not_name_are_damage(tmp_path, contents) -> None:
    folder = write_with_rosbags(tmp_path / "bag", contents, StoragePlugin.MCAP, CompressionMode.NONE)
    (file,) = folder.glob("*.mcap")
    content = file.read_bytes()
    at = content.index(struct.pack("<HIQ", 1, 0, contents["/stage/head_a/samples"][1].stamp_ns))
    file.write_bytes(content[:at] + b"\x77" + content[at + 1 :])
    with pytest.raises(InputError, match=r"bag: damaged: bag\.mcap: 1 messages of topics that the file does not name"):
        BagReader(folder)


def test_a_topic_of_two_types_or_of_another_encoding_is_refused(tmp_path: Path) -> None:
    writer = Writer(str(tmp_path / "two.mcap"))
    writer.start("ros2")
    for k, value in enumerate((Temperature(START, 1.0), PointStamped(START, [0.0, 0.0, 0.0]))):  # type: ignore[arg-type]
        name = TYPES[type(value)]
        schema = writer.register_schema(name, "ros2msg", type_definition(name).encode())
        channel = writer.register_channel("/t", "cdr", schema)
        writer.add_message(channel, START + k, encode(value), START)
        other = writer.register_channel("/json", "json", schema)
        writer.add_message(other, START + k, b"{}" * 20, START)
    writer.finish()  # type: ignore[no-untyped-call]
    reader = BagReader(tmp_path / "two.mcap")
    with pytest.raises(InputError, match=r"/t carries sensor_msgs/msg/Temperature and geometry_msgs/msg/PointStamped"):
        reader.read(["/t"])
    with pytest.raises(InputError, match=r"/json is encoded as 'json'; readable is cdr"):
        reader.read(["/json"])


def test_what_is_beside_a_database_is_said(tmp_path, contents) -> None:
    folder = write_with_rosbags(tmp_path / "bag", contents, StoragePlugin.SQLITE3, CompressionMode.NONE)
    (file,) = folder.glob("*.db3")
    file.with_name(file.name + "-wal").write_bytes(b"what was not merged")
    assert "the recording was not closed; readable are" in str(BagReader(folder).damage)


def test_a_database_is_not_changed_by_reading_it(tmp_path, contents) -> None:
    folder = write_with_rosbags(tmp_path / "bag", contents, StoragePlugin.SQLITE3, CompressionMode.NONE)
    folder = folder.rename(tmp_path / "b a#g?%")
    (file,) = folder.glob("*.db3")
    before = file.read_bytes()
    assert BagReader(folder).read().keys() == contents.keys()
    assert file.read_bytes() == before and sorted(p.name for p in folder.iterdir()) == [file.name, "metadata.yaml"]


def test_more_topics_than_any_bag_has(tmp_path, contents) -> None:
    folder = write_with_rosbags(tmp_path / "bag", contents, StoragePlugin.SQLITE3, CompressionMode.NONE)
    (file,) = folder.glob("*.db3")
    with sqlite3.connect(file) as database:
        rows = [(100 + k, f"/t{k}") for k in range(recorded_files.MOST_TOPICS)]
        database.executemany("INSERT INTO topics VALUES (?, ?, 'a/msg/B', 'cdr', '', '')", rows)
    database.close()
    with pytest.raises(InputError, match="more than 10000 topics; no bag has as many"):
        BagReader(folder)


def test_a_bag_larger_than_the_memory_is_not_read_at_once(bag: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pages = {"SC_PHYS_PAGES": 1, "SC_PAGE_SIZE": 4096}
    monkeypatch.setattr(os, "sysconf", pages.__getitem__)
    reader = BagReader(bag)
    with pytest.raises(InputError, match=r"the messages to be read at once have .* GB of memory; give a shorter"):
        reader.read()
    assert len(list(reader.replay())) > 12  # one after another they are


def test_a_file_that_goes_away_or_may_not_be_read_is_named(bag: Path, tmp_path: Path) -> None:
    reader = BagReader(bag)
    shutil.rmtree(bag)
    with pytest.raises(InputError, match=r"_0\.mcap: cannot be read \(No such file or directory\)"):
        list(reader.messages())
    with pytest.raises(InputError, match="no such bag"):
        BagReader(tmp_path / "z\0")


@pytest.mark.parametrize("packing", ["zstd", "lz4"])
def test_what_is_packed_is_unpacked_up_to_its_size(packing: str) -> None:
    import lz4.frame
    import zstandard

    pack = {"zstd": zstandard.ZstdCompressor(write_content_size=False).compress, "lz4": lz4.frame.compress}[packing]
    data = pack(b"abc" * 1000)
    assert unpack(data, packing, 3000) == unpack(data, packing) == b"abc" * 1000
    for size, broken, said in (
        (2999, data, "it"),
        (3001, data, "it holds 3000 bytes where it says 3001"),
        (3000, data[:-5], "it cannot be unpacked"),
        (3000, b"nothing of it", "it cannot be unpacked"),
        (3000, b"", "it cannot be unpacked"),
        (MOST_AT_ONCE + 1, data, "at most 67108864 are read at once"),
    ):
        with pytest.raises(DamageError, match=said):
            unpack(broken, packing, size)
    with pytest.raises(DamageError, match="unpacked"):
        unpack(pack(bytes(MOST_AT_ONCE + 1)), packing)


def test_other_packings_and_budgets() -> None:
    assert unpack(b"abc", "", 3) == b"abc"
    with pytest.raises(DamageError, match="packed by 'bz2'; zstd and lz4 can be"):
        unpack(b"abc", "bz2", 3)
    budget = Budget("here", 100)
    budget.take(MOST_AT_ONCE + 50_000)
    with pytest.raises(InputError, match=r"here: unpacked it would be more than 67158864 bytes \(500 times its size\)"):
        budget.take(1)
