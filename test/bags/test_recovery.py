"""Recovery: a bag cut off at any byte gives every message that lies before the cut, to every reader."""

from __future__ import annotations

import itertools
import shutil
from pathlib import Path

import pytest
from mcap.opcode import Opcode
from mcap.records import Channel
from mcap.writer import CompressionType, Writer

from rotary_error_monitor.bags.metadata import channel_profiles, type_definition
from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.bags.recovery import recover
from rotary_error_monitor.bags.writer import BagTopic, BagWriter, write_messages
from rotary_error_monitor.cli import main
from rotary_error_monitor.codec.contents import TYPES, Content, Temperature
from rotary_error_monitor.codec.messages import encode
from rotary_error_monitor.description.wire import load_wire
from rotary_error_monitor.errors import InputError

from .conftest import START, halted, read_by_mcap, read_by_rosbags, records

TOPICS = [BagTopic(f"/t/{name}", TYPES[Temperature]) for name in "ab"]
COUNT = 24
PER_CHUNK = 5


def _message(number: int) -> bytes:
    return encode(Temperature(START + number, 1000.0 + number))


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """Small bag of several chunks."""
    with BagWriter(tmp_path / "bag", TOPICS, clock=halted) as writer:
        for number in range(COUNT):
            writer.write(TOPICS[number % 2].name, _message(number), START + number)
            if number % PER_CHUNK == PER_CHUNK - 1:
                writer.flush()
    return tmp_path / "bag"


def _file(bag: Path) -> Path:
    (file,) = bag.glob("*.mcap")
    return file


def _interesting(content: bytes) -> list[int]:
    """Lengths around every border: of records, their heads, messages in chunks; and some in between."""
    borders = {0, 8, len(content) - 8, len(content)}
    for opcode, start, end in records(content):
        borders |= {start, start + 1, start + 9, end}
        if opcode == Opcode.CHUNK:
            borders |= {start + 9 + 40, start + 9 + 40 + 9}
    for number in range(COUNT):
        start = content.index(_message(number))
        borders |= {start - 31, start - 22, start, start + len(_message(number))}
    lengths = {border + step for border in borders for step in (-1, 0, 1)} | set(range(3, len(content), 211))
    return sorted(length for length in lengths if 0 <= length < len(content))


def _numbers(bag: Path) -> list[int]:
    return sorted(
        int(content.temperature) - 1000
        for values in BagReader(bag).read().values()
        for content in values
        if isinstance(content, Temperature)
    )


@pytest.mark.long
def test_a_file_cut_anywhere_gives_all_before_the_cut(bag: Path) -> None:
    file = _file(bag)
    content = file.read_bytes()
    ends = [content.index(_message(number)) + len(_message(number)) for number in range(COUNT)]
    for length in _interesting(content):
        file.write_bytes(content[:length])
        expected = [number for number, end in enumerate(ends) if end <= length]
        reader = BagReader(file)
        assert reader.damage is not None and f"readable are {len(expected)} messages" in reader.damage, length
        assert _numbers(file) == expected, length


def test_a_recovered_file_is_read_by_every_reader(bag: Path) -> None:
    file = _file(bag)
    content = file.read_bytes()
    metadata = (bag / "metadata.yaml").read_bytes()
    whole = read_by_rosbags(bag)
    assert len(whole) == COUNT
    for length in _interesting(content)[::13]:
        file.write_bytes(content[:length])
        (bag / "metadata.yaml").write_bytes(metadata)
        expected = _numbers(bag)
        assert expected == _numbers(file), length
        if not expected:
            before = _bytes(bag)
            with pytest.raises(InputError, match=rf"{bag}: nothing to recover, .* in {file.name} of {length} bytes$"):
                recover(bag)
            assert _bytes(bag) == before, length
            continue
        report = recover(bag)
        assert (report.counts.total(), report.rewritten) == (len(expected), (file.name,)), length
        assert read_by_rosbags(bag) == read_by_mcap(bag), length
        assert [row for row in whole if row[1] - START in expected] == read_by_rosbags(bag), length
        assert BagReader(bag).damage is None
        assert recover(bag).rewritten == ()
        assert sorted(path.name for path in bag.iterdir()) == [file.name, "metadata.yaml"]


def test_a_whole_bag_is_left_as_it_is(bag: Path) -> None:
    before = {path.name: (path.read_bytes(), path.stat().st_mtime_ns) for path in bag.iterdir()}
    report = recover(bag)
    assert str(report) == f"{bag}: the bag is whole, {COUNT} messages"
    assert {path.name: (path.read_bytes(), path.stat().st_mtime_ns) for path in bag.iterdir()} == before


@pytest.mark.parametrize("text", [None, "", "{]", "rosbag2_bagfile_information: {version: 9}\n"])
def test_metadata_is_made_good(bag: Path, text: str | None) -> None:
    expected = (bag / "metadata.yaml").read_text()
    (bag / "metadata.yaml").unlink()
    if text is not None:
        (bag / "metadata.yaml").write_text(text)
    assert len(_numbers(bag)) == COUNT  # it is not needed to read the bag here
    assert recover(bag).rewritten == ()
    assert (bag / "metadata.yaml").read_text() == expected


def test_metadata_of_the_start_is_made_good(tmp_path: Path) -> None:
    # Killed after the index was written, before the final metadata.yaml was.
    with BagWriter(tmp_path / "bag", TOPICS) as writer:
        shutil.copy(tmp_path / "bag" / "metadata.yaml", tmp_path / "early.yaml")
        writer.write("/t/a", _message(0), START)
    (tmp_path / "early.yaml").replace(tmp_path / "bag" / "metadata.yaml")
    assert BagReader(tmp_path / "bag").damage is None and _numbers(tmp_path / "bag") == [0]
    recover(tmp_path / "bag")
    assert len(read_by_rosbags(tmp_path / "bag")) == 1


def test_a_damaged_chunk_costs_its_own_messages_alone(bag: Path) -> None:
    file = _file(bag)
    content = bytearray(file.read_bytes())
    content[content.index(_message(PER_CHUNK + 2)) + 20] ^= 0xFF
    file.write_bytes(content)
    left = [number for number in range(COUNT) if number // PER_CHUNK != 1]
    report = recover(bag)
    assert (report.damaged, report.rewritten) == (1, (file.name,))
    assert "1 damaged record" in str(report)
    assert _numbers(bag) == left and len(read_by_mcap(bag)) == len(read_by_rosbags(bag)) == len(left)


def test_blocks_that_never_reached_the_disk_end_the_file(bag: Path) -> None:
    file = _file(bag)
    content = file.read_bytes()
    chunk = [start for opcode, start, _ in records(content) if opcode == Opcode.CHUNK][2]
    file.write_bytes(content[:chunk] + bytes(5000))
    report = recover(bag)
    assert report.lost == 5000 and "without 5000 bytes at the end" in str(report)
    assert _numbers(bag) == list(range(2 * PER_CHUNK))
    assert len(read_by_rosbags(bag)) == 2 * PER_CHUNK


@pytest.mark.parametrize("compression", list(CompressionType))
def test_bags_of_other_recorders_are_recovered(tmp_path: Path, compression: CompressionType) -> None:
    folder = tmp_path / "bag"
    folder.mkdir()
    for part in range(2):
        writer = Writer(str(folder / f"bag_{part}.mcap"), chunk_size=400, compression=compression)
        writer.start("ros2")
        schema = writer.register_schema(TYPES[Temperature], "ros2msg", type_definition(TYPES[Temperature]).encode())
        unknown = writer.register_schema("my_msgs/msg/Own", "ros2msg", b"float64 value\n")
        for number in range(COUNT):
            channel = writer.register_channel(f"/t/{number % 3}", "cdr", schema) if number < 3 else 1 + number % 3
            writer.add_message(channel, START + 100 * part + number, _message(number), START)
        channel = writer.register_channel("/own", "cdr", unknown, {"offered_qos_profiles": ""})
        writer.add_message(channel, START + 100 * part + COUNT, b"\0\1\0\0" + bytes(8), START)
        writer.finish()  # type: ignore[no-untyped-call]
    last = folder / "bag_1.mcap"
    content = last.read_bytes()
    chunks = [start for opcode, start, _ in records(content) if opcode == Opcode.CHUNK]
    last.write_bytes(content[: chunks[3] + 200])
    expected = sum(topic.count for topic in BagReader(folder).topics.values())
    assert expected > COUNT + 3 * 3
    report = recover(folder)
    assert report.rewritten == ("bag_1.mcap",) and report.counts.total() == expected
    rows = read_by_rosbags(folder)
    assert len(rows) == expected and {topic for topic, *_ in rows} == {"/t/0", "/t/1", "/t/2", "/own"}


def _alone(folder: Path, name: str, cut: int = 0) -> Path:
    """An mcap file, whole or without its last bytes."""
    with BagWriter(folder / "made", TOPICS, clock=halted) as writer:
        for number in range(COUNT):
            writer.write(TOPICS[number % 2].name, _message(number), START + number)
    content = _file(folder / "made").read_bytes()
    shutil.rmtree(folder / "made")
    (folder / name).write_bytes(content[: len(content) - cut])
    return folder / name


def _bytes(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


def test_a_file_is_recovered_alone(tmp_path: Path) -> None:
    monday, tuesday = _alone(tmp_path, "monday.mcap"), _alone(tmp_path, "tuesday.mcap", 400)
    before = _bytes(tmp_path)
    report = recover(monday)
    assert str(report) == f"{monday}: the file is whole, {COUNT} messages" and _bytes(tmp_path) == before
    report = recover(tuesday)
    assert report.rewritten == ("tuesday.mcap",) and str(report).startswith(f"{tuesday}: recovered {COUNT} messages")
    assert BagReader(tuesday).damage is None and len(_numbers(tuesday)) == COUNT
    del before["tuesday.mcap"]
    after = _bytes(tmp_path)
    assert {name: after[name] for name in before} == before and len(after) == 2, "nothing else came to be"


@pytest.mark.parametrize("content", [b"garbage" * 1000, b"SQLite format 3\0" + bytes(5000)])
def test_a_file_that_is_none_is_told_also_beside_a_whole_bag(content: bytes, bag: Path) -> None:
    before = _bytes(bag)
    for name in ("wednesday.mcap", "wednesday.db3", "wednesday"):
        (bag / name).write_bytes(content)
        with pytest.raises(InputError, match=rf"{name}: no mcap file"):
            recover(bag / name)
        (bag / name).unlink()
    assert _bytes(bag) == before


def test_a_file_that_is_the_whole_bag_is_recovered_as_such(bag: Path) -> None:
    file = _file(bag)
    file.write_bytes(file.read_bytes()[:-400])
    assert recover(file).rewritten == (file.name,)
    assert len(read_by_rosbags(bag)) == COUNT


def test_a_file_beside_a_bag_that_is_not_its_own_leaves_the_bag_alone(bag: Path) -> None:
    _file(bag).write_bytes(_file(bag).read_bytes()[:-300])
    before = _bytes(bag)
    assert recover(_alone(bag, "copy.mcap", 400)).rewritten == ("copy.mcap",)
    after = _bytes(bag)
    assert {name: after[name] for name in before} == before
    (bag / "metadata.yaml").write_text("{]")
    (remark,) = recover(bag / "copy.mcap").remarks
    assert "metadata.yaml cannot be read" in remark and (bag / "metadata.yaml").read_text() == "{]"


def test_one_file_of_several_is_not_recovered_without_the_others(tmp_path: Path) -> None:
    folder = tmp_path / "bag"
    with BagWriter(folder, TOPICS, flush_period=0.0, max_file_duration=1.0) as writer:
        for number in range(COUNT):
            writer.write(TOPICS[number % 2].name, _message(number), START + number * 100_000_000)
    before = _bytes(folder)
    for name in ("bag_0.mcap", "bag_2.mcap"):
        with pytest.raises(InputError, match=rf"{name}: one of 3 files of the bag {folder}; .*recover the folder"):
            recover(folder / name)
    assert _bytes(folder) == before


def test_recovery_keeps_the_quality_of_service(tmp_path: Path, contents: dict[str, list[Content]]) -> None:
    folder = tmp_path / "bag"
    write_messages(folder, contents, load_wire())
    expected = (folder / "metadata.yaml").read_text()
    file = _file(folder)
    content = file.read_bytes()
    cut = next(start for opcode, start, _ in records(content) if opcode == Opcode.DATA_END)
    file.write_bytes(content[:cut])
    recover(folder)
    assert (folder / "metadata.yaml").read_text() == expected


@pytest.mark.parametrize("text", ["", "[]", "{]", "depth: 5"])
def test_an_unreadable_quality_of_service_is_none(text: str) -> None:
    channel = Channel(id=1, topic="/t", message_encoding="cdr", metadata={"offered_qos_profiles": text}, schema_id=1)
    assert channel_profiles(channel) == []


def test_an_interrupted_recovery_leaves_the_old_file(bag: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = _file(bag)
    content = file.read_bytes()[:-100]
    file.write_bytes(content)
    calls = itertools.count()

    def fail(_: int) -> None:
        next(calls)
        raise OSError(5, "Input/output error")

    monkeypatch.setattr("os.fsync", fail)
    with pytest.raises(OSError, match="Input/output error"):
        recover(bag)
    assert next(calls) == 1 and file.read_bytes() == content
    assert sorted(path.name for path in bag.iterdir()) == [file.name, "metadata.yaml"]
    monkeypatch.undo()
    assert recover(bag).counts.total() == COUNT


def test_a_disk_without_room_is_said(bag: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = _file(bag)
    file.write_bytes(file.read_bytes()[:-100])
    usage = shutil.disk_usage(bag)._replace(free=1000)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage)
    with pytest.raises(
        InputError, match=rf"bag_0\.mcap: recovery writes a copy of {file.stat().st_size} bytes, .* 1000"
    ):
        recover(bag)


@pytest.mark.parametrize("length", [0, 5, 8, 60])
@pytest.mark.parametrize("kind", ["bag", "bag without metadata.yaml", "file alone", "file of a bag"])
def test_where_no_message_is_left_nothing_is_called_recovered(
    bag: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], kind: str, length: int
) -> None:
    """Name and size of the file are told, and it stays as it is: an empty bag in its place would hide what happened."""
    file = _file(bag)
    file.write_bytes(file.read_bytes()[:length])
    given = file if kind.startswith("file") else bag
    if kind == "file alone":
        given = file.rename(tmp_path / "alone.mcap")
    elif kind != "bag":
        (bag / "metadata.yaml").unlink()
    before = _bytes(given.parent if given.is_file() else given)
    assert main(["recover", str(given)]) == 2
    said = capsys.readouterr()
    name = given.name if given.is_file() else file.name
    assert said.out == "" and f"no whole message in {name} of {length} bytes" in said.err
    assert _bytes(given.parent if given.is_file() else given) == before


def test_an_empty_file_beside_one_with_messages_is_made_readable(bag: Path) -> None:
    """A recorder that was killed as it began its next file."""
    (bag / "bag_1.mcap").write_bytes(b"")
    report = recover(bag)
    assert (report.counts.total(), report.rewritten, report.whole) == (COUNT, ("bag_1.mcap",), True)
    assert len(read_by_rosbags(bag)) == COUNT


def test_what_is_no_bag_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"nowhere: no such bag; give the folder"):
        recover(tmp_path / "nowhere")
    with pytest.raises(InputError, match="no mcap file to recover"):
        recover(tmp_path)
    (tmp_path / "text.mcap").write_text("this is a text")
    with pytest.raises(InputError, match=r"text\.mcap: no mcap file"):
        recover(tmp_path)
