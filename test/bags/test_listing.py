"""What metadata.yaml tells of and the files do not hold is said by whatever reads the bag."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest
import yaml

from rotary_error_monitor.bags.listing import bag_files, read_listing
from rotary_error_monitor.bags.metadata import BagMetadata
from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.bags.recovery import recover
from rotary_error_monitor.bags.writer import BagTopic, BagWriter
from rotary_error_monitor.cli import main
from rotary_error_monitor.codec.contents import TYPES, Temperature
from rotary_error_monitor.codec.messages import encode

from .conftest import START, read_by_rosbags

TOPICS = [BagTopic(f"/t/{name}", TYPES[Temperature]) for name in "ab"]
SECOND = 1_000_000_000


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """Three files of ten messages."""
    with BagWriter(tmp_path / "bag", TOPICS, flush_period=0.0, max_file_duration=1.0) as writer:
        for number in range(30):
            data = encode(Temperature(START + number, float(number)))
            writer.write(TOPICS[number % 2].name, data, START + number * SECOND // 10)
    return tmp_path / "bag"


def _change(bag: Path, old: str, new: str) -> None:
    path = bag / "metadata.yaml"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def test_a_whole_bag_has_no_remark(bag: Path) -> None:
    assert BagReader(bag).remarks == recover(bag).remarks == ()


def test_a_file_that_is_missing_is_named(bag: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (bag / "bag_1.mcap").unlink()
    reader = BagReader(bag)
    assert reader.damage is not None and reader.remarks == (reader.damage,)
    assert "metadata.yaml tells of bag_1.mcap, which is not there" in reader.damage
    assert sum(topic.count for topic in reader.topics.values()) == 20
    assert main(["recover", str(bag)]) == 0
    said = capsys.readouterr()
    assert "20 messages; the files that are there are whole" in said.out
    assert "files missing when the bag was recovered: bag_1.mcap" in said.err
    assert len(read_by_rosbags(bag)) == 20
    (remark,) = BagReader(bag).remarks
    assert "missing when the bag was recovered: bag_1.mcap" in remark, "also once metadata.yaml was put right"
    (bag / "bag_0.mcap").unlink()
    recover(bag)
    assert "bag_0.mcap, bag_1.mcap" in BagReader(bag).remarks[0]
    assert recover(bag).remarks == BagReader(bag).remarks


def test_counts_that_do_not_fit_are_said(bag: Path) -> None:
    _change(bag, "message_count: 15", "message_count: 1")
    reader = BagReader(bag)
    assert reader.damage is None
    (remark,) = reader.remarks
    assert "another number of messages than metadata.yaml says: /t/a 15 instead of 1, /t/b 15 instead of 1" in remark
    assert {topic.count for topic in reader.topics.values()} == {15}, "the files are right"
    (remark,) = recover(bag).remarks
    assert "/t/a 15 instead of 1" in remark and "it was put right" in remark
    assert BagReader(bag).remarks == ()


def test_a_file_that_metadata_does_not_know_is_read(bag: Path) -> None:
    """Its recorder was killed after it had begun the file and before it said so."""
    information = yaml.safe_load((bag / "metadata.yaml").read_text())
    content = information["rosbag2_bagfile_information"]
    content["relative_file_paths"].pop()
    content["files"].pop()
    (bag / "metadata.yaml").write_text(yaml.safe_dump(information))
    (bag / "copy.mcap").write_bytes((bag / "bag_0.mcap").read_bytes())  # somebody's, and no part of the bag
    reader = BagReader(bag)
    assert len(list(reader.messages())) == sum(topic.count for topic in reader.topics.values()) == 30
    assert recover(bag).counts.total() == len(read_by_rosbags(bag)) == 30


@pytest.mark.parametrize(
    "text",
    ["", "[", "a: b", "rosbag2_bagfile_information: {relative_file_paths: 3}", "!!python/object:os.system x", "x" * 99],
)
def test_metadata_that_cannot_be_read_says_nothing(bag: Path, text: str) -> None:
    (bag / "metadata.yaml").write_text(text)
    assert read_listing(bag) == BagMetadata()
    assert BagReader(bag).topics["/t/a"].count == 15


def _name(bag: Path, names: list[str]) -> None:
    """Have `metadata.yaml` name these files."""
    information = yaml.safe_load((bag / "metadata.yaml").read_text())
    information["rosbag2_bagfile_information"]["relative_file_paths"] = names
    (bag / "metadata.yaml").write_text(yaml.safe_dump(information))


def _symlink(target: Path, link: Path) -> None:
    link.symlink_to(target.name)


@pytest.mark.parametrize(
    "names",
    [
        ["bag_0.mcap"] * 2,
        ["bag_0.mcap"] * 5000,
        ["bag_0.mcap", "./bag_0.mcap"],
        ["bag_0.mcap", "../bag/bag_0.mcap"],
        ["bag_0.mcap", "bag_7.mcap"],
        ["bag_7.mcap", "bag_0.mcap"],
        ["bag_0.mcap", "copy.mcap"],
    ],
    ids=["twice", "5000 times", "./", "../bag/", "another name", "the other way round", "a name of another kind"],
)
@pytest.mark.parametrize("link", [_symlink, os.link])
def test_a_file_that_is_named_more_than_once_is_read_once(
    names: list[str], link: Callable[[Path, Path], None], bag: Path
) -> None:
    for name in {*names} - {"bag_0.mcap"}:
        if "/" not in name:
            link(bag / "bag_0.mcap", bag / name)
    _name(bag, [*names, "bag_1.mcap", "bag_2.mcap"])
    reader = BagReader(bag)
    assert reader.topics["/t/a"].count == 15 and len(list(reader.replay())) == 30
    assert reader.damage is None
    (remark,) = reader.remarks
    assert "named more than once" in remark and "each file was read once" in remark and len(remark) < 1000
    recover(bag)
    assert len(read_by_rosbags(bag)) == 30
    assert not [remark for remark in BagReader(bag).remarks if "another number" in remark]


def test_files_that_are_links_of_one_another_are_one_without_metadata(bag: Path) -> None:
    (bag / "metadata.yaml").unlink()
    (bag / "bag_7.mcap").symlink_to("bag_1.mcap")
    assert len(list(BagReader(bag).replay())) == 30
    recover(bag)
    assert len(read_by_rosbags(bag)) == 30


def test_files_come_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    names = ["bag_0.mcap", "bag_2.mcap", "bag_9.mcap", "bag_10.mcap", "bag_11.mcap"]
    for name in reversed(names):
        (tmp_path / name).touch()
    (tmp_path / "bag_3.mcap").mkdir()
    assert [path.name for path in bag_files(tmp_path)] == names


def test_what_a_recorder_noted_is_said(tmp_path: Path) -> None:
    with BagWriter(tmp_path / "bag", TOPICS) as writer:
        writer.write("/t/a", encode(Temperature(START, 0.0)), START)
        writer.notes["messages lost"] = "7 of /t/a"
    assert BagReader(tmp_path / "bag").remarks == (f"{tmp_path / 'bag'}: messages lost: 7 of /t/a",)
    assert len(read_by_rosbags(tmp_path / "bag")) == 1
