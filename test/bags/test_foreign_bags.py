"""Bags whose words come from anybody: names, types, encodings and notes that a terminal would obey."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from mcap.writer import CompressionType, Writer

from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.cli import main
from rotary_error_monitor.codec.contents import SAMPLE_BLOCK, TYPES, JointState, Temperature
from rotary_error_monitor.codec.messages import encode
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.resources import config
from rotary_error_monitor.signals.blocks import block_from_samples

from .conftest import START

RED = "\x1b[31m\r\x07\u202e\u2028"
HEADS = [f"/stage/head_{letter}/samples" for letter in "abcd"]
COMMAND = "/stage/command/samples"
Row = tuple[str, str, str, bytes]


def _block(field: str = "angle", count: int = 200) -> bytes:
    return encode(block_from_samples(START + np.arange(count) * 1_000_000, [field], np.zeros((count, 1))))


def _write(path: Path, rows: Sequence[Row], definition: bytes = b"") -> Path:
    """An mcap file of messages: topic, type, encoding, bytes."""
    writer = Writer(str(path), compression=CompressionType.NONE)
    writer.start("ros2")
    for topic, msgtype, encoding, data in rows:
        schema = writer.register_schema(msgtype, "ros2msg", definition)
        channel = writer.register_channel(topic, encoding, schema)
        writer.add_message(channel, START, data, START)
    writer.finish()  # type: ignore[no-untyped-call]
    return path


def _stage(**changes: Row) -> list[Row]:
    """Four heads and the command, some of them otherwise."""
    rows = {name: (name, SAMPLE_BLOCK, "cdr", _block()) for name in (*HEADS, COMMAND)}
    return list((rows | {row[0]: row for row in changes.values()}).values())


FOREIGN: dict[str, list[Row]] = {
    "a type": _stage(command=(COMMAND, f"evil/msg/{RED}", "cdr", _block())),
    "a type of a head": _stage(head=(HEADS[1], f"evil/msg/{RED}", "cdr", _block())),
    "an encoding": _stage(command=(COMMAND, SAMPLE_BLOCK, RED, _block())),
    "a topic": _stage(other=(f"/{RED}", SAMPLE_BLOCK, "cdr", _block())),
    "only a topic": [(f"/{RED}", SAMPLE_BLOCK, "cdr", _block())],
    "a field": _stage(command=(COMMAND, SAMPLE_BLOCK, "cdr", _block(RED))),
    "two types": [*_stage(), (COMMAND, f"evil/msg/{RED}", "cdr", _block())],
    "an axis": [
        *_stage(),
        (
            "/machine/joint_states",
            TYPES[JointState],
            "cdr",
            encode(JointState(START, (RED, RED), np.zeros(2), np.zeros(0), np.zeros(0), RED)),
        ),
    ],
}


@pytest.mark.parametrize("rows", FOREIGN.values(), ids=FOREIGN)
def test_no_word_of_a_bag_reaches_the_terminal_as_it_is(
    rows: list[Row], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag, out = str(_write(tmp_path / "bag.mcap", rows)), str(tmp_path / "out")
    stage = str(config("stage.yaml"))
    main(["replay", bag, "--twin", stage, "-o", out])
    main(["replay", bag, "--machine", "grinder_zhou2023", "-o", out])
    main(["check", bag, "--stage", stage])
    main(["diagnose", bag, "--twin", stage, "--no-report", "-o", out])
    main(["calibrate", "assembly", bag, "--stage", stage, "-o", out])
    main(["recover", bag])
    said = capsys.readouterr()
    for text in (said.out, said.err):
        assert text.replace("\n", "").isprintable(), repr(text)


def test_notes_and_counts_of_metadata_are_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _write(tmp_path / "bag_0.mcap", _stage())
    (tmp_path / "metadata.yaml").write_text(
        "rosbag2_bagfile_information:\n"
        '  relative_file_paths: [bag_0.mcap, "\\e[31m"]\n'
        '  topics_with_message_count: [{topic_metadata: {name: "/\\e[31m"}, message_count: 3}]\n'
        '  custom_data: {"\\e[31m": "\\e[31m"}\n'
    )
    assert all(remark.isprintable() for remark in BagReader(tmp_path).remarks)
    assert main(["recover", str(tmp_path)]) == 0
    said = capsys.readouterr()
    assert "\x1b" not in said.err + said.out and "[31m" in said.err


@pytest.mark.parametrize("encoding", ["json", "ros1", "protobuf", ""])
def test_another_encoding_is_named_before_its_bytes_are_read(encoding: str, tmp_path: Path) -> None:
    path = _write(tmp_path / "bag.mcap", [("/t", TYPES[Temperature], encoding, b"{}")])
    said = f"bag.mcap: /t is encoded as '{encoding}'; readable is cdr"
    for read in (BagReader.window, BagReader.read, BagReader.replay):
        with pytest.raises(InputError, match=said):
            list(read(BagReader(path), ["/t"]) or ())
    with pytest.raises(InputError, match=said):
        BagReader(path).read()
    assert len(list(BagReader(path).messages())) == 1


def test_another_type_is_named_before_its_bytes_are_read(tmp_path: Path) -> None:
    reader = BagReader(_write(tmp_path / "bag.mcap", [("/t", "std_msgs/msg/Empty", "cdr", b"\0\1\0\0\0")]))
    with pytest.raises(InputError, match="/t: cannot read messages of type std_msgs/msg/Empty; readable are"):
        reader.window(["/t"])


def test_a_definition_without_bounds_is_told_with_its_topic(tmp_path: Path) -> None:
    definition = b"E[2000000000] name\n" + b"=" * 80 + b"\nMSG: sensor_msgs/E\nuint8 X=1\n"
    path = _write(tmp_path / "bag.mcap", [("/t", TYPES[JointState], "cdr", bytes(40))], definition)
    with pytest.raises(InputError, match=r"bag\.mcap: /t: sensor_msgs/msg/JointState as the bag defines it cannot be"):
        list(BagReader(path).replay())
