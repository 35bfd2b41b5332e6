"""A bag damaged at any place: what is whole is recovered bit for bit, the rest is counted, the original is kept."""

from __future__ import annotations

import random
import shutil
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest
from faults.documenting import Row, shows
from mcap.opcode import Opcode

from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.bags.recovery import recover
from rotary_error_monitor.bags.torn import TornFile
from rotary_error_monitor.bags.writer import BagTopic, BagWriter
from rotary_error_monitor.cli import main
from rotary_error_monitor.codec.contents import TYPES, Temperature
from rotary_error_monitor.codec.messages import encode
from rotary_error_monitor.errors import InputError

from .conftest import START, halted, read_by_mcap, read_by_rosbags, records

TOPICS = [BagTopic(f"/t/{name}", TYPES[Temperature]) for name in "ab"]
COUNT, PER_CHUNK = 60, 5

Message = tuple[str, int, bytes]


def message(number: int) -> bytes:
    return encode(Temperature(START + number, 1000.0 + number / 7.0))


def messages(numbers: range) -> Counter[Message]:
    return Counter((TOPICS[number % 2].name, START + number, message(number)) for number in numbers)


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bag of twelve chunks."""
    folder = tmp_path_factory.mktemp("original") / "bag"
    with BagWriter(folder, TOPICS, clock=halted) as writer:
        for number in range(COUNT):
            writer.write(TOPICS[number % 2].name, message(number), START + number)
            if number % PER_CHUNK == PER_CHUNK - 1:
                writer.flush()
    return folder


@pytest.fixture
def damaged(original: Path, tmp_path: Path) -> Callable[[bytes], Path]:
    """The bag with another content of its file."""

    def make(content: bytes) -> Path:
        folder = tmp_path / "bag"
        shutil.rmtree(folder, ignore_errors=True)
        shutil.copytree(original, folder)
        (folder / "bag_0.mcap").write_bytes(content)
        return folder

    return make


def chunks(content: bytes) -> list[tuple[int, int]]:
    return [(start, end) for opcode, start, end in records(content) if opcode == Opcode.CHUNK]


def hurt(content: bytes, draw: random.Random) -> tuple[bytes, int, int, str]:
    """A content with one damage, the bytes of the old one that it touches, and what it is."""
    start = draw.randrange(len(content))
    if draw.random() < 0.3:  # where records and chunks begin, damage does most
        start = min(draw.choice(records(content))[1] + draw.randrange(60), len(content) - 1)
    length = min(draw.choice([1, 2, 8, 40, 700, 3000]), len(content) - start)
    kind = draw.choice(["bit", "bit", "bit", "removed", "inserted", "zeros", "noise"])
    if kind == "bit":
        flipped = bytes([content[start] ^ 1 << draw.randrange(8)])
        return content[:start] + flipped + content[start + 1 :], start, start + 1, kind
    new = {"removed": b"", "zeros": bytes(length)}.get(kind, draw.randbytes(length))
    end = start if kind == "inserted" else start + length
    return content[:start] + new + content[end:], start, end, kind


def spared(content: bytes, start: int, end: int) -> Counter[Message]:
    """Messages of the chunks that a damage from `start` to `end` does not touch."""
    found: Counter[Message] = Counter()
    for number, (first, last) in enumerate(chunks(content)):
        if last <= start or end <= first or (start == end and not first < start < last):
            found += messages(range(PER_CHUNK * number, PER_CHUNK * (number + 1)))
    return found


def read(bag: Path) -> Counter[Message]:
    return Counter((topic, stamp, data) for topic, stamp, data, *_ in read_by_mcap(bag))


def check_recovered(folder: Path, content: bytes, least: Counter[Message], what: object) -> None:
    file = folder / "bag_0.mcap"
    torn = TornFile(file)
    parts = list(torn.records())
    extent = torn.extent
    assert extent.readable + extent.left_out + extent.at_end == extent.size == len(content), what
    assert parts or not least, what
    report = recover(folder)
    found = read(folder)
    assert not found - messages(range(COUNT)), what
    assert not least - found, what
    assert report.counts.total() == found.total() == len(read_by_rosbags(folder)), what
    assert (report.lost, report.left_out) == (extent.at_end, extent.left_out), what
    complete = found == messages(range(COUNT))
    if report.rewritten and not complete and report.left_out:
        assert not report.whole and report.kept, what
    if report.kept:
        assert (folder / report.kept[0]).read_bytes() == content, what
    elif report.rewritten:
        assert complete or not report.left_out, what
    else:
        assert file.read_bytes() == content, what
    assert recover(folder).rewritten == (), what
    assert BagReader(folder).damage is None, what


@pytest.mark.few(1)
@pytest.mark.parametrize("part", range(3))
def test_a_bag_that_was_closed_and_is_damaged_anywhere(original, damaged, part) -> None:
    content = (original / "bag_0.mcap").read_bytes()
    for seed in range(50 * part, 50 * (part + 1)):
        changed, start, end, kind = hurt(content, random.Random(seed))
        check_recovered(damaged(changed), changed, spared(content, start, end), (seed, kind, start, end))


@pytest.mark.long
@pytest.mark.parametrize("part", range(2))
def test_a_bag_without_its_end_that_is_damaged_anywhere_but_at_its_end(original, damaged, part) -> None:
    """Its first chunk names the topics, and the last, without its end, has a checksum that nobody can form."""
    whole = (original / "bag_0.mcap").read_bytes()
    (_, first), *_, (last, _) = chunks(whole)
    content = whole[: last + 150]
    for seed in range(50 * part, 50 * (part + 1)):
        draw = random.Random(seed)
        changed, start, end, kind = hurt(content, draw)
        if start < first or end > last:
            continue
        check_recovered(damaged(changed), changed, spared(whole[:last], start, end), (seed, kind, start, end))


@shows(
    Row(
        "files",
        "A bag is damaged in its middle: bits turned over, bytes lost or overwritten",
        "`recover` says what is left out and ends with exit code 10; readers say how much is readable, or refuse a bag "
        "with a hole (exit code 2)",
        "reading goes on at the next chunk whose checksum fits",
        "every message of every whole chunk, bit for bit",
        "`rotary_error_monitor recover`; the file as it was is kept as `….mcap.damaged`",
    ),
)
def test_bytes_that_are_lost_cost_their_chunk_alone(original, damaged, capsys) -> None:
    content = (original / "bag_0.mcap").read_bytes()
    (start, end), (following, _) = chunks(content)[3:5]
    broken = content[: start + 200] + content[start + 201 :]
    bag = damaged(broken)
    with pytest.raises(
        InputError, match=rf"readable are {COUNT - PER_CHUNK} messages on 2 topics, \d+ of {len(broken)}"
    ):
        BagReader(bag)
    assert main(["recover", str(bag)]) == 10
    said = capsys.readouterr()
    left_out = following - 1 - start  # with what the file says of its messages' places
    assert f"recovered {COUNT - PER_CHUNK} messages on 2 topics; without 0 bytes at the end" in said.out
    assert f"and 1 damaged record ({left_out} bytes before the end); kept as it was: bag_0.mcap.damaged" in said.out
    assert f"recovered were {COUNT - PER_CHUNK} of {COUNT} messages, without {left_out} bytes" in said.err
    assert (bag / "bag_0.mcap.damaged").read_bytes() == broken
    assert read(bag) == spared(content, start, end)
    (remark,) = BagReader(bag).remarks
    assert "damaged when the bag was recovered: bag_0.mcap: chunk at byte" in remark
    assert main(["recover", str(bag)]) == 0 and "the bag is whole" in capsys.readouterr().out


@pytest.mark.parametrize("bit", range(0, 64, 5))
@pytest.mark.parametrize("number", [0, 5, COUNT // PER_CHUNK - 1])
def test_a_length_that_is_wrong_costs_nothing(original, damaged, capsys, number, bit) -> None:
    content = bytearray((original / "bag_0.mcap").read_bytes())
    content[chunks(bytes(content))[number][0] + 1 + bit // 8] ^= 1 << bit % 8
    bag = damaged(bytes(content))
    assert "its length is damaged; all messages were read without it; recover the bag" in str(BagReader(bag).damage)
    assert main(["recover", str(bag)]) == 0
    assert f"recovered {COUNT} messages on 2 topics" in capsys.readouterr().out
    assert read(bag) == messages(range(COUNT))


@pytest.mark.parametrize("front", [b"\x89MCAP0\r\n", b"\0", b"a line\n"])
def test_what_stands_in_front_costs_nothing(original, damaged, front) -> None:
    content = (original / "bag_0.mcap").read_bytes()
    bag = damaged(front + content)
    assert "all messages were read without it" in str(BagReader(bag).damage)
    assert recover(bag).whole and read(bag) == messages(range(COUNT))


def test_a_bag_of_which_nothing_is_left_stays_as_it_is(original, damaged, capsys) -> None:
    content = (original / "bag_0.mcap").read_bytes()
    (_, start), *_, (_, end) = chunks(content)
    broken = content[:start][:60] + random.Random(1).randbytes(end - 60)
    bag = damaged(broken)
    assert "readable are 0 messages on 0 topics" in str(BagReader(bag).damage)
    with pytest.raises(
        InputError, match=r"no message on /t/a; .*the recording was not closed; readable are 0 messages"
    ):
        BagReader(bag).check_topics(["/t/a"])
    assert main(["recover", str(bag)]) == 2
    assert f"no whole message in bag_0.mcap of {len(broken)} bytes" in capsys.readouterr().err
    assert (bag / "bag_0.mcap").read_bytes() == broken


@pytest.mark.parametrize("linked", [True, False])
def test_an_original_never_takes_the_place_of_another(original, damaged, monkeypatch, linked) -> None:
    """Also on a disk where a file has one name only."""
    content = (original / "bag_0.mcap").read_bytes()
    start, _ = chunks(content)[3]
    broken = content[: start + 200] + content[start + 201 :]
    bag = damaged(broken)
    (bag / "bag_0.mcap.damaged").write_text("of somebody")

    def refuse(*_: object, **__: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    if not linked:
        monkeypatch.setattr("os.link", refuse)
    assert recover(bag).kept == ("bag_0.mcap.damaged.2",)
    assert (bag / "bag_0.mcap.damaged").read_text() == "of somebody"
    assert (bag / "bag_0.mcap.damaged.2").read_bytes() == broken
    assert read(bag).total() == COUNT - PER_CHUNK
