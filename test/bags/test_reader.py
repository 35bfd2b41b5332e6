"""Reading bags: the order of stamps, what is missing or broken, and the recorded cases."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import CompressionType, Writer
from rosbags.rosbag2 import Reader, StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from rosbags.typesys import Stores, get_typestore

from rotary_error_monitor.bags.metadata import type_definition
from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.bags.writer import BagTopic, BagWriter, write_messages
from rotary_error_monitor.codec.contents import TYPES, Content, Temperature
from rotary_error_monitor.codec.messages import encode
from rotary_error_monitor.description.wire import load_wire
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.signals.blocks import SampleBlock, block_from_samples

from .conftest import START, assert_same

CASES = Path(__file__).resolve().parents[3] / "shared" / "cases"
BAGS = sorted(CASES.glob("open/*/bag"))
TYPESTORE = get_typestore(Stores.ROS2_JAZZY)


@pytest.fixture
def bag(tmp_path: Path, contents: dict[str, list[Content]]) -> Path:
    write_messages(tmp_path / "bag", contents, load_wire())
    return tmp_path / "bag"


@pytest.mark.skipif(not BAGS, reason=f"no recorded cases in {CASES}")
def test_recorded_cases_are_read_as_rosbags_reads_them() -> None:
    for path in BAGS:
        bag = BagReader(path)
        assert bag.damage is None
        blocks = bag.read_blocks()
        seen = dict.fromkeys(blocks, 0)
        with Reader(path) as reader:
            assert {name: topic.count for name, topic in bag.topics.items()} == {
                connection.topic: connection.msgcount for connection in reader.connections
            }
            for connection, _, data in reader.messages():
                if connection.topic not in blocks:
                    continue
                message = TYPESTORE.deserialize_cdr(data, connection.msgtype)
                # In these bags each topic is recorded in the order of its stamps.
                block = blocks[connection.topic][seen[connection.topic]]
                assert block.rows.tobytes() == message.data.tobytes(), (path, connection.topic)  # type: ignore[attr-defined]
                seen[connection.topic] += 1
        assert seen == {name: len(values) for name, values in blocks.items()}


def test_everything_written_is_read(bag: Path, contents: dict[str, list[Content]]) -> None:
    reader = BagReader(bag)
    assert reader.damage is None
    assert {name: topic.type for name, topic in reader.topics.items()} == {
        name: TYPES[type(values[0])] for name, values in contents.items()
    }
    read = reader.read()
    assert read.keys() == contents.keys()
    for name, values in contents.items():
        for one, other in zip(read[name], values, strict=True):
            assert_same(one, other)


def test_replay_goes_by_stamp_and_name_however_messages_arrived(tmp_path: Path) -> None:
    random = np.random.default_rng(3)
    topics = [BagTopic(f"/t/{name}", TYPES[Temperature]) for name in "dcba"]
    rows = [(START + int(stamp), f"/t/{name}") for stamp in random.integers(0, 60, 50) for name in "abcd"]
    arrivals = random.permutation(len(rows))
    with BagWriter(tmp_path / "bag", topics) as writer:
        for arrival, row in enumerate(arrivals):
            stamp, name = rows[row]
            writer.write(name, encode(Temperature(stamp, float(arrival))), START + arrival)
    found = list(BagReader(tmp_path / "bag").replay())
    keys = [(content.stamp_ns, name) for name, content in found]
    assert keys == sorted(rows)
    # Of equal stamps on one topic, the one recorded first comes first.
    order = [(key, content.temperature) for key, (_, content) in zip(keys, found, strict=True)]  # type: ignore[union-attr]
    assert order == sorted(order)


def test_replay_of_some_topics_leaves_the_others_out(bag: Path) -> None:
    names = ["/machine/tool_probe", "/stage/head_a/samples"]
    found = [name for name, _ in BagReader(bag).replay(names)]
    assert found == names * 12  # equal stamps: by name
    assert list(BagReader(bag).replay([])) == []


def test_a_bag_of_sqlite_is_read(tmp_path: Path) -> None:
    with RosbagsWriter(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connection = writer.add_connection("/machine/temperature", TYPES[Temperature], typestore=TYPESTORE)
        writer.write(connection, START, encode(Temperature(START, 21.5)))
    read = BagReader(tmp_path / "bag").read()
    assert read == {"/machine/temperature": [Temperature(START, 21.5)]}


@pytest.mark.parametrize("compression", list(CompressionType))
def test_an_mcap_file_alone_is_read(tmp_path: Path, compression: CompressionType) -> None:
    path = tmp_path / "alone.mcap"
    writer = Writer(str(path), chunk_size=100, compression=compression)
    writer.start()
    schema = writer.register_schema(TYPES[Temperature], "ros2msg", type_definition(TYPES[Temperature]).encode())
    channel = writer.register_channel("/machine/temperature", "cdr", schema)
    expected = [Temperature(START + i, 20.0 + i) for i in range(20)]
    for value in expected:
        writer.add_message(channel, value.stamp_ns, encode(value), value.stamp_ns)
    writer.finish()  # type: ignore[no-untyped-call]
    reader = BagReader(path)
    assert reader.damage is None
    assert reader.read() == {"/machine/temperature": expected}


def test_what_cannot_be_decoded_is_passed_over_unless_asked_for(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag", load_wire()) as writer:
        writer.write("/diagnostics", struct.pack("<IiIIII", 256, 5, 6, 1, 0, 0), START)
    reader = BagReader(tmp_path / "bag")
    assert [message.topic for message in reader.messages()] == ["/diagnostics"]
    assert not any(reader.read().values()) and "/diagnostics" not in reader.read()
    with pytest.raises(InputError, match=r"cannot read messages of type diagnostic_msgs/msg/DiagnosticArray"):
        reader.read(["/diagnostics"])


def test_missing_topics_are_named(bag: Path, tmp_path: Path) -> None:
    reader = BagReader(bag)
    reader.check_topics(["/stage/head_a/samples"])
    with pytest.raises(InputError, match=r"bag: no message on /stage/head_b/samples, /x; the bag has .*tool_probe"):
        reader.check_topics(["/stage/head_a/samples", "/stage/head_b/samples", "/x"])
    with pytest.raises(InputError, match=r"bag: no topic /x; the bag has /stage/head_a/samples"):
        reader.read(["/x"])
    with pytest.raises(InputError, match=r"/machine/tool_probe is a geometry_msgs/msg/PointStamped; sample blocks are"):
        reader.read_blocks(["/machine/tool_probe"])
    with BagWriter(tmp_path / "empty", load_wire()):
        pass
    with pytest.raises(InputError, match=r"no message on /diagnostics; the bag has no message at all"):
        BagReader(tmp_path / "empty").check_topics(["/diagnostics"])


def test_what_is_no_bag_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nothing: no such bag; give the folder"):
        BagReader(tmp_path / "nothing")
    with pytest.raises(InputError, match=r"no readable bag: .*metadata"):
        BagReader(tmp_path)
    (tmp_path / "metadata.yaml").write_text("{]")
    with pytest.raises(InputError, match="no readable bag"):
        BagReader(tmp_path)
    (tmp_path / "text.mcap").write_text("this is a text")
    with pytest.raises(InputError, match=r"text\.mcap: no mcap file; it starts with b'this is "):
        BagReader(tmp_path / "text.mcap")


def test_a_sample_that_is_not_finite_is_named_with_topic_and_stamp(tmp_path: Path) -> None:
    blocks: list[Content] = []
    for i in range(3):
        block = block_from_samples(START + 10 * i + np.arange(4), ["angle"], np.ones((4, 1)))
        block.rows[2, 1] = np.nan if i == 1 else 1.0
        blocks.append(block)
    write_messages(tmp_path / "bag", {"/stage/head_a/samples": blocks})
    why = rf"bag: /stage/head_a/samples, message with stamp {START + 10} ns: sample 2 of 'angle' is nan"
    with pytest.raises(InputError, match=why):
        BagReader(tmp_path / "bag").read_blocks()
    with pytest.raises(InputError, match=why):
        list(BagReader(tmp_path / "bag").replay())


def test_broken_messages_are_named(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag", [BagTopic("/t", TYPES[SampleBlock])]) as writer:
        writer.write("/t", b"\0\1\0\0" + struct.pack("<iI", 1, 2), START)
    with pytest.raises(InputError, match=r"bag: /t, message with stamp 1000000002 ns: 12 bytes are no"):
        BagReader(tmp_path / "bag").read()
    with BagWriter(tmp_path / "other", [BagTopic("/t", TYPES[SampleBlock])]) as writer:
        writer.write("/t", b"\0\1", START)
    with pytest.raises(InputError, match=rf"other: /t, recorded at {START} ns: a message of 2 bytes holds no header"):
        list(BagReader(tmp_path / "other").replay())


def test_a_damaged_chunk_is_said(bag: Path) -> None:
    (file,) = bag.glob("*.mcap")
    content = bytearray(file.read_bytes())
    content[content.index(b"workpiece") + 40] ^= 0xFF
    file.write_bytes(content)
    with pytest.raises(InputError, match=r"bag: damaged: .*recover the bag"):
        BagReader(bag).read()
