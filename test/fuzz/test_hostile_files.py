"""Files that are wrong on purpose or by accident, each through the commands that take it: clean errors, bounded costs.

Every command runs in a child with limits on memory and processor time; see `sandbox`.
"""

from __future__ import annotations

import gzip
import os
import sqlite3
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import zstandard
from faults.documenting import Row, shows
from rosbags.rosbag2 import CompressionMode, StoragePlugin

from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.blind_check.cases import write_case
from rotary_error_monitor.cases.making import make_stage_case
from rotary_error_monitor.codec.contents import Content
from rotary_error_monitor.signals.blocks import NANOSECONDS, SampleBlock

from .bags import (
    START,
    changed,
    pose_contents,
    stage_contents,
    write_bag,
    write_defined,
    write_with_rosbags,
    zstd_of_nothing,
)
from .sandbox import Run, Sandbox

ROOT = Path(__file__).parents[2]
STAGE = ROOT / "config" / "stage.yaml"
MACHINE = ROOT / "config" / "machines" / "pan2013.yaml"
HEAD = "/stage/head_a/samples"
DAY = 86400
COMMANDS = ("replay", "check", "diagnose", "assembly")
ALIASES = "".join(f"{b}: &{b} [{','.join([f'*{a}'] * 10)}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True))


@pytest.fixture
def refused(sandbox: Sandbox) -> Callable[..., str]:
    """Function that runs a command, expects exit code 2 and a clean message, and gives it."""

    def run(*arguments: str | Path) -> str:
        found = sandbox.run(arguments)
        assert found.fault is None and found.code == 2, found
        return found.said

    return run


@pytest.fixture
def clean(sandbox: Sandbox) -> Callable[..., Run]:
    """Function that runs a command and expects a clean end of whatever code."""

    def run(*arguments: str | Path) -> Run:
        found = sandbox.run(arguments)
        assert found.fault is None, found
        return found

    return run


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_bag(tmp_path_factory.mktemp("whole") / "bag", stage_contents())


def commands_with_yaml(path: Path, folder: Path, bag: Path) -> Iterator[list[str | Path]]:
    """Every command that takes a YAML file."""
    out, csv = folder / "out", ROOT / "doc" / "calibration"
    yield ["diagnose", bag, "--twin", path, "-o", out, "--no-report"]
    yield ["replay", bag, "--twin", path, "-o", out]
    yield ["replay", bag, "--machine", path, "-o", out]
    yield ["check", bag, "--stage", path]
    yield ["run", "--stage", path, "--folder", folder / "run"]
    yield ["run", "--machine", path, "--folder", folder / "run"]
    yield ["run-linuxcnc", "--machine", path]
    yield ["run-linuxcnc", "--stage", path]
    yield ["calibrate", "positioning", csv / "x_positioning.csv", "--machine", path, "--axis", "X", "-o", out]
    yield ["calibrate", "squareness", csv / "tracker.csv", "--machine", path, "-o", out]
    yield ["calibrate", "assembly", bag, "--stage", path, "-o", out]
    yield ["calibrate", "machine", bag, "--machine", path, "-o", out]
    yield ["calibrate", "tables", path, "--axis", "X", "-o", out]
    yield ["calibrate", "errors", path]
    yield ["calibrate", "flatness", path, "--vertical", "Y", "--workpiece", "X=0,1", "Z=0,1",
           "--reversal-um", "1", "--positioning-um", "1"]  # fmt: skip


WRONG_YAML = {
    "tag": "{top}: !!python/object/apply:os.system [false]\n",
    "own tag": "{top}: !mine 1\n",
    "tag of a number": "{top}: !!int abc\n",
    "5000 digits": "{top}: " + "7" * 5000 + "\n",
    "recursion": "{top}: &a {{b: *a}}\n",
    "recursion at the top": "&a\n{top}: *a\n",
    "a billion laughs": "a: &a [1,1,1,1,1,1,1,1,1,1]\n" + ALIASES + "{top}: *i\n",
    "100,000 deep": "{top}: " + "[" * 100_000 + "\n",
    "100,000 deep in blocks": "{top}:\n" + " - " + "- " * 100_000 + "\n",
    "no finite number": "{top}: 1.0e+999\n",
    "no day": "{top}: 2020-13-45\n",
    "many documents": "---\na: 1\n" * 1000,
    "zeros": "\0" * 1000,
    "no text": "\udcff\udcfe",
    "nothing": "",
    "a word": "{top}\n",
    "a list": "- {top}\n",
}


@shows(
    Row(
        "files",
        "A YAML file with tags, aliases without end, a number of 5,000 digits, 100,000 levels",
        "exit code 2: file, line and what would be right, within limits of size, depth and cost",
        "refused",
        "nothing",
        "a right file",
    ),
)
@pytest.mark.parametrize("text", WRONG_YAML.values(), ids=WRONG_YAML.keys())
def test_wrong_yaml_is_refused(text, tmp_path, bag, refused):
    for top in ("stage", "machine", "mount", "quadrature"):
        path = tmp_path / f"{top}.yaml"
        path.write_text(text.format(top=top), encoding="utf-8", errors="surrogateescape")
        assert f"{path}" in refused("diagnose", bag, "--twin", path, "-o", tmp_path / "out", "--no-report")


@pytest.mark.few(1)
@pytest.mark.parametrize("name", ["tag", "a billion laughs", "100,000 deep"])
def test_every_command_reads_yaml_in_the_same_way(name, tmp_path, bag, refused):
    path = tmp_path / "wrong.yaml"
    path.write_text(WRONG_YAML[name].format(top="stage"), encoding="utf-8")
    for command in commands_with_yaml(path, tmp_path, bag):
        assert f"{path}:" in refused(*command), command


def test_what_is_no_file_is_refused(tmp_path, bag, refused):
    os.mkfifo(tmp_path / "pipe.yaml")
    (tmp_path / "folder.yaml").mkdir()
    with (tmp_path / "large.yaml").open("wb") as file:
        file.truncate(1 << 40)
    for path in (Path("/dev/zero"), *(tmp_path / f"{name}.yaml" for name in ("pipe", "folder", "large", "nowhere"))):
        assert f"{path}" in refused("diagnose", bag, "--twin", path, "-o", tmp_path / "out")
        assert f"{path}" in refused("calibrate", "positioning", path, "--machine", MACHINE, "--axis", "X")


def test_paths_that_no_system_takes_are_refused(tmp_path, bag, refused):
    long = Path("a" * 300)
    for command in commands_with_yaml(long, tmp_path, bag):
        assert "a" * 90 in refused(*command), command
    for path in (long, Path("b" * 5000)):
        for command in COMMANDS:
            assert "no such bag" in refused(*_command(command, path, STAGE, tmp_path))
        assert "File name too long" in refused("recover", path)
    said = refused("replay", bag, "--twin", STAGE, "-o", tmp_path / long)
    assert "File name too long" in said


@pytest.fixture(scope="module")
def case(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A stage's recording with its twin."""
    folder = tmp_path_factory.mktemp("stage") / "case"
    write_case(make_stage_case(5, "null", (), (150.0, 300.0), duration=20.0), folder)
    return folder


@pytest.mark.few(4)
@shows(
    Row(
        "files",
        "Stamps in a bag far from its recording: 1969, + 30 days",
        "a note on standard error: how many, and where",
        "they are left out",
        "what the rest gives",
        "not needed",
    ),
)
@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize(
    ("move", "count", "first"),
    [
        (lambda block: replace(block, stamp_ns=-1000 * NANOSECONDS), "100", "1969-12-31 23:43:20"),
        (lambda block: replace(block, stamp_ns=block.stamp_ns + 30 * DAY * NANOSECONDS), "100", "2025-12-21 04:40:02"),
        (lambda block: with_time(block, 1e9), "1", "2057-07-30 06:26:42"),
        (lambda block: with_time(block, -1e9), "1", "1994-03-15 02:53:22"),
    ],
    ids=["1969", "30 days later", "t = 1e9 s", "t = -1e9 s"],
)
def test_stamps_far_from_the_recording_are_left_out_and_said(move, count, first, command, case, tmp_path, clean):
    contents = BagReader(case / "bag").read()
    strayed = write_bag(tmp_path / "bag", changed(contents, HEAD, 7, move))
    found = clean(*_command(command, strayed, case / "twin.yaml", tmp_path))
    assert found.code == 0
    assert f"outside of the recording: {count} of {HEAD}, the first at {first}" in found.said
    assert "the recording goes from 2025-11-21 04:40:00+00:00 to 2025-11-21 04:40:19" in found.said


@pytest.mark.parametrize("command", COMMANDS)
def test_a_recording_without_strays_is_used_whole(command, case, tmp_path, clean):
    found = clean(*_command(command, case / "bag", case / "twin.yaml", tmp_path))
    assert found.code == 0 and "left out" not in found.said


def with_time(block: SampleBlock, seconds: float) -> SampleBlock:
    """The block with its last sample at another time."""
    rows = block.rows.copy()
    rows[-1, 0] = seconds
    return SampleBlock(block.stamp_ns, block.names, rows)


def _command(name: str, bag: Path, twin: Path, folder: Path) -> list[str | Path]:
    if name == "check":
        return ["check", bag, "--stage", twin]
    if name == "assembly":
        # the shaft of these recordings turns in bearings of its own, which does not fit
        return ["calibrate", "assembly", bag, "--stage", twin, "--force", "-o", folder / "stage.yaml"]
    return [name, bag, "--twin", twin, "-o", folder / f"{name}.out", *(["--no-report"] if name == "diagnose" else [])]


@pytest.mark.long
def test_hours_of_stamps_ten_minutes_apart_cost_no_more_than_their_samples(tmp_path, clean):
    """No pause is long enough to end the recording."""
    contents: dict[str, list[Content]] = {}
    for topic, values in stage_contents(1).items():
        if topic.startswith("/stage"):
            contents[topic] = [replace(values[0], stamp_ns=START + i * 590 * NANOSECONDS) for i in range(100)]
    clean("replay", write_bag(tmp_path / "bag", contents), "--twin", STAGE, "-o", tmp_path / "out.npz")


@pytest.mark.parametrize("t", [1e300, 1e10, float("nan"), float("inf")])
def test_times_that_are_none_are_refused_with_topic_and_stamp(t, tmp_path, clean):
    contents = changed(stage_contents(), HEAD, 7, lambda block: with_time(block, t))
    strayed = write_bag(tmp_path / "bag", contents)
    for command in COMMANDS:
        run = clean(*_command(command, strayed, STAGE, tmp_path))
        # a replay goes on without the message, as the nodes do, and says so
        assert run.code == (0 if command == "replay" else 2)
        assert (
            f"{HEAD}, message with stamp {contents[HEAD][7].stamp_ns} ns: sample {len(contents[HEAD][7].rows) - 1}"
            in run.said
        )


def test_a_folder_named_as_a_bag_file(tmp_path, bag, refused):
    (tmp_path / "bag" / "x.mcap").mkdir(parents=True)
    for command in COMMANDS:
        assert "x.mcap: no file of a bag; it is a folder or a device" in refused(
            *_command(command, tmp_path / "bag", STAGE, tmp_path)
        )
    assert "no mcap file to recover" in refused("recover", tmp_path / "bag")
    os.mkfifo(tmp_path / "pipe.mcap")
    assert "pipe.mcap" in refused("replay", tmp_path / "pipe.mcap", "-o", tmp_path / "out")


@shows(
    Row(
        "files",
        "A bag that unpacks to gigabytes",
        "exit code 2: what it claims to hold",
        "refused before it is unpacked",
        "nothing",
        "a right file",
    ),
)
def test_chunks_of_gigabytes_are_refused_before_they_are_unpacked(tmp_path, refused):
    """164 kB that would be 5.3 GB: one chunk too many, or one that is too large."""
    many = zstd_of_nothing(tmp_path / "many.mcap", 64_000_000, 80)
    assert many.stat().st_size < 200_000
    assert "unpacked it would be more than" in refused("replay", many, "-o", tmp_path / "out")
    assert "unpacked it would be more than" in refused("recover", many)
    one = zstd_of_nothing(tmp_path / "one.mcap", 1000, 1, said=5_300_000_000)
    assert "unpacked it would be 5300000000 bytes; at most 67108864 are read at once; recover" in refused(
        "replay", one, "-o", tmp_path / "out"
    )


@shows(
    Row(
        "files",
        "A bag whose own definition of a message has billions of parts",
        "exit code 2: which field of which message",
        "refused before a message is read",
        "nothing",
        "a right file",
    ),
)
@pytest.mark.parametrize("kind", ["E[2000000000]", "string[2000000000]", "E[]", "E[1000000]", "sensor_msgs/JointState"])
def test_definitions_of_messages_of_gigabytes_are_refused(kind, tmp_path, refused):
    definition = f"{kind} name\n{'=' * 80}\nMSG: sensor_msgs/E\nuint8 X=1\n".encode()
    bag, out = write_defined(tmp_path / "bag.mcap", definition), ["-o", tmp_path / "out"]
    grinder = ROOT / "config/machines/grinder_zhou2023.yaml"
    for command in (
        ["replay", bag, "--machine", grinder, *out],
        ["diagnose", bag, "--twin", MACHINE, "--no-report", *out],
        ["calibrate", "machine", bag, "--machine", MACHINE, *out],
    ):
        said = refused(*command)
        assert "/machine/joint_states: sensor_msgs/msg/JointState as the bag defines it cannot be read" in said


def test_a_packed_file_of_gigabytes_is_refused(tmp_path, refused):
    folder = write_with_rosbags(tmp_path / "bag", stage_contents(2), StoragePlugin.MCAP, CompressionMode.FILE)
    (file,) = folder.glob("*.zstd")
    with file.open("wb") as target, zstandard.ZstdCompressor().stream_writer(target) as stream:
        stream.write(b"\x89MCAP0\r\n")
        for _ in range(80):
            stream.write(bytes(1_000_000))
    assert "unpacked it would be more than" in refused("replay", folder, "-o", tmp_path / "out")


def test_packed_messages_of_gigabytes_are_refused(tmp_path, refused):
    folder = write_with_rosbags(tmp_path / "bag", stage_contents(2), StoragePlugin.SQLITE3, CompressionMode.MESSAGE)
    (file,) = folder.glob("*.db3")
    with sqlite3.connect(file) as database:
        database.execute("UPDATE messages SET data = ?", [zstandard.ZstdCompressor().compress(bytes(1 << 30))])
    database.close()
    assert "unpacked it would be 1073741824 bytes" in refused("replay", folder, "-o", tmp_path / "out")


def test_a_packed_text_of_gigabytes_is_refused(tmp_path, refused):
    packed = tmp_path / "signals.csv.gz"
    with gzip.open(packed, "wb", compresslevel=9) as file:
        file.write(b"cos,sin\n")
        for _ in range(18):
            file.write(b"1,2\n" * 1_000_000)
    out = ["-o", tmp_path / "out", "--no-report"]
    assert "larger than" in refused("diagnose", packed, "--twin", ROOT / "config" / "quadrature.yaml", *out)


@pytest.mark.few(2)
@pytest.mark.parametrize(
    ("head", "line", "count", "said"),
    [
        ("cos,sin", "1,2", 16_000_000, "16000001 lines; a .csv or .csv.gz file of signals is expected, of at most"),
        ("cos,sin", "", 66_000_000, "66000001 lines"),
        ("cos,sin", "#", 33_000_000, "33000001 lines"),
        ("1", "1", 33_000_000, ":1: columns ['1']; expected"),
        ("cos,sin", "1,2" + ",3" * 30_000_000, 1, "a line of 60000003 characters"),
        ("cos,sin", "", 600, "0 samples; at least 500"),
    ],
    ids=["rows", "blank", "remarks", "no header", "one line", "600 blank"],
)
def test_signals_of_too_many_rows_are_refused(head, line, count, said, tmp_path, refused):
    """60 kB of packed text that would cost seconds and gigabytes as samples."""
    packed = tmp_path / "signals.csv.gz"
    write_packed(packed, f"{head}\n", f"{line}\n", count)
    out = ["-o", tmp_path / "out", "--no-report"]
    assert said in refused("diagnose", packed, "--twin", ROOT / "config" / "quadrature.yaml", *out)


@pytest.mark.parametrize(("line", "count"), [("1", 8_000_000), ("1 2 3 4", 2_000_000), ("", 16_000_000)])
def test_tables_of_too_many_rows_are_refused(line, count, tmp_path, refused):
    packed = tmp_path / "measured.csv"
    write_packed(packed, "target_mm,direction,cycle,deviation_um\n", f"{line}\n", count)
    machine = ROOT / "config" / "machines" / "xyzac_trt.yaml"
    out = ["-o", tmp_path / "out"]
    said = refused("calibrate", "positioning", packed, "--machine", machine, "--axis", "X", *out)
    assert "lines; a CSV file is expected, of at most 200000" in said or "larger than" in said
    said = refused("diagnose", packed, "--twin", ROOT / "config" / "mounts" / "cgx_l.yaml", *out)
    assert "lines; a pointing file is expected, of at most 200000" in said or "larger than" in said


def write_packed(path: Path, head: str, line: str, count: int) -> None:
    with gzip.open(path, "wb", compresslevel=9) as file:
        file.write(head.encode())
        part = min(count, 1_000_000)
        for _ in range(count // part):
            file.write(line.encode() * part)


@pytest.mark.parametrize(
    ("statements", "message"),
    [
        (["DROP TABLE messages", "CREATE VIEW messages AS SELECT 1 id, 1 topic_id, 1 timestamp, 1 data"], "no table"),
        (
            [
                "ALTER TABLE messages ADD COLUMN more GENERATED ALWAYS AS (zeroblob(1000000000))",
            ],
            "computes what it holds",
        ),
        (
            [
                "DROP TABLE messages",
                "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id, timestamp, data AS (zeroblob(100000000)))",
                "INSERT INTO messages(topic_id, timestamp) VALUES (1, 1), (1, 2)",
            ],
            "computes what it holds",
        ),
        (["UPDATE messages SET timestamp = 'noon'"], "damaged: a message of topic 1 recorded at noon"),
        (["UPDATE messages SET data = 'text'"], "damaged: a message of topic"),
        (["UPDATE messages SET topic_id = 77"], "messages of topics that it does not name"),
        (["UPDATE topics SET name = 5.5"], "no message on"),
        (["UPDATE topics SET type = x'ff'"], "damaged: topic"),
        (["UPDATE messages SET data = x'00'"], "holds no header"),
        (["UPDATE message_definitions SET encoded_message_definition = 7"], ""),
    ],
)
def test_databases_that_are_no_recordings(statements, message, tmp_path, clean):
    folder = write_with_rosbags(tmp_path / "bag", stage_contents(2), StoragePlugin.SQLITE3)
    (file,) = folder.glob("*.db3")
    with sqlite3.connect(file) as database:
        for statement in statements:
            database.execute(statement)
    database.close()
    for path in (folder, file):
        found = clean("replay", path, "--twin", STAGE, "-o", tmp_path / "out")
        assert message in found.said and found.code == (2 if message else 0)


def test_pages_of_a_database_that_name_one_another_end(tmp_path, clean):
    """Every page pointing at the same others would be read for years."""
    folder = write_with_rosbags(tmp_path / "bag", stage_contents(20), StoragePlugin.SQLITE3)
    (file,) = folder.glob("*.db3")
    content = bytearray(file.read_bytes())
    size = int.from_bytes(content[16:18], "big")
    inner = [at for at in range(0, len(content), size) if content[at + (100 if at == 0 else 0)] == 5]
    assert inner
    for at in inner:
        for cell in range(int.from_bytes(content[at + 3 : at + 5], "big")):
            place = at + int.from_bytes(content[at + 12 + 2 * cell : at + 14 + 2 * cell], "big")
            content[place : place + 4] = (inner[0] // size + 1).to_bytes(4, "big")
    file.write_bytes(content)
    assert clean("replay", folder, "--twin", STAGE, "-o", tmp_path / "out").code == 2


@pytest.mark.few(2)
@pytest.mark.parametrize("name", ["tag", "5000 digits", "recursion", "a billion laughs", "100,000 deep", "no text"])
def test_wrong_yaml_beside_a_bag_is_said_and_made_good(name, tmp_path, clean):
    folder = write_bag(tmp_path / "bag", stage_contents(3))
    text = WRONG_YAML[name].format(top="rosbag2_bagfile_information")
    (folder / "metadata.yaml").write_text(text, encoding="utf-8", errors="surrogateescape")
    found = clean("replay", folder, "--twin", STAGE, "-o", tmp_path / "out")
    assert found.code == 0 and "read without it were bag_0.mcap" in found.said
    assert clean("recover", folder).code == 0
    found = clean("replay", folder, "--twin", STAGE, "-o", tmp_path / "out")
    assert found.code == 0 and "read without it" not in found.said


def test_joint_states_with_too_few_numbers_are_refused(tmp_path, clean):
    contents = pose_contents()
    states = contents["/machine/joint_states"]
    for name, value in (("position", np.zeros(2)), ("velocity", np.zeros(3)), ("position", np.zeros(0))):
        broken = replace(states[3], **{name: value})
        folder = write_bag(tmp_path / f"{name}{len(value)}", contents | {"/machine/joint_states": [*states, broken]})
        for command in (
            ["diagnose", folder, "--twin", MACHINE, "-o", tmp_path / "diagnosed", "--no-report"],
            ["calibrate", "machine", folder, "--machine", MACHINE, "-o", tmp_path / "out"],
            ["replay", folder, "--machine", ROOT / "config/machines/grinder_zhou2023.yaml", "-o", tmp_path / "out"],
        ):
            run = clean(*command)
            # a replay goes on without the message, as the nodes do, and says so
            assert run.code == (0 if command[0] == "replay" else 2)
            assert "a joint state of 5 names" in run.said
