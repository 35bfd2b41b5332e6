"""The wire contract: what it says fits the standard messages, and wrong definitions are refused with their place."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from rotary_error_monitor.description.wire import load_wire, markdown_table
from rotary_error_monitor.description.wire_section import SAMPLE_BLOCK, Field
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.resources import share

TOPIC = """\
topics:
  probe:
    name: /stage/probe
    type: geometry_msgs/msg/PointStamped
    frame: stage
    publishers: [external]
    rate: 1 Hz
    qos: {reliability: reliable, durability: volatile, history: keep_last, depth: 10}
    meaning: A point.
    fields:
      - {name: point, unit: m, meaning: the point}
"""


@pytest.fixture(scope="module")
def typestore() -> Typestore:
    return get_typestore(Stores.ROS2_JAZZY)


def _type_of(typestore: Typestore, msgtype: str, dotted: str) -> str:
    """Type name of a nested field; KeyError where the message has none."""
    for part in dotted.split("."):
        description = dict(typestore.get_msgdef(msgtype).fields)[part]
        while description[0] in (Nodetype.ARRAY, Nodetype.SEQUENCE):
            description = description[1][0]
        msgtype = description[1] if description[0] == Nodetype.NAME else description[1][0]
    return msgtype


def test_every_type_exists_and_has_the_fields_that_the_contract_names(typestore: Typestore) -> None:
    for topic in load_wire():
        assert topic.type in typestore.types, topic.name
        if not topic.is_sample_block:
            for field in topic.fields:
                assert _type_of(typestore, topic.type, field.name), (topic.name, field.name)


def test_every_message_starts_with_a_header(typestore: Typestore) -> None:
    # The reader orders by header.stamp, which it takes from the first bytes of what was recorded.
    for topic in load_wire().read_by("recorder"):
        name, (_, info) = typestore.get_msgdef(topic.type).fields[0]
        assert (name, info) == ("header", "std_msgs/msg/Header"), topic.name


def test_publishers_are_the_nodes_that_the_package_installs() -> None:
    block = re.search(r"NODES = \[(.*?)\]", (share() / "setup.py").read_text(), re.DOTALL)
    assert block is not None
    nodes = set(re.findall(r'"(\w+)"', block[1]))
    assert {node for topic in load_wire() for node in topic.publishers} - {"external"} <= nodes


def test_one_topic_per_head_and_one_bit_per_head() -> None:
    wire = load_wire(("a", "b2"))
    assert wire.topic("head_samples", "b2").name == "/stage/head_b2/samples"
    assert wire.topic("head_samples", "b2").frame == "head_b2"
    assert wire.named("/stage/head_a/joint_states").key == "head_joint_states"
    streams = wire.topic("error_motion_samples").field("streams")
    assert streams.bits == ("head_a", "head_b2", "autocollimator", "command")
    assert streams.mask(["head_b2", "command", "command"]) == 0b1010


def test_observable_bits_are_the_house_order() -> None:
    observable = load_wire().topic("error_motion_samples").field("observable")
    assert [observable.mask([name]) for name in ("exc", "eyc", "ezc", "eac", "ebc", "ecc")] == [1, 2, 4, 8, 16, 32]


def test_columns_are_those_of_sample_blocks_alone() -> None:
    wire = load_wire()
    assert wire.topic("autocollimator_samples").columns == ("tilt_x", "tilt_y")
    assert wire.topic("tool_probe").columns == ()
    assert all(topic.columns for topic in wire if topic.type == SAMPLE_BLOCK)


def test_topics_by_their_publisher() -> None:
    keys = {topic.key for topic in load_wire().published_by("compensation")}
    assert keys >= {
        "tool_offset_samples",
        "tool_offset_pose",
        "corrected_offset_pose",
        "axis_corrections",
        "diagnostics",
    }
    assert "head_samples" not in keys


def test_table_has_a_row_for_each_topic_and_keeps_the_placeholder() -> None:
    wire = load_wire(None)
    lines = markdown_table(wire).splitlines()
    assert len(lines) == 2 + len(wire.topics)
    assert {line.count(" | ") for line in lines if "---" not in line} == {6}
    row = next(line for line in lines if line.startswith("| `/stage/head_{head}/samples` |"))
    assert "`t` s, `angle` rad" in row and "encoder_head" in row and "reliable, volatile, last 1000" in row


def test_unknown_names_are_answered_with_what_there_is() -> None:
    wire = load_wire()
    with pytest.raises(InputError, match=r"no topic 'head_samples' for head 'e'.*'a', 'b', 'c', 'd'"):
        wire.topic("head_samples", "e")
    with pytest.raises(InputError, match=r"no topic 'probe'.*tool_probe"):
        wire.topic("probe")
    with pytest.raises(InputError, match=r"no topic '/stage/head_e/samples'"):
        wire.named("/stage/head_e/samples")
    with pytest.raises(InputError, match=r"/machine/tool_probe holds point, but no 'position'"):
        wire.topic("tool_probe").field("position")
    with pytest.raises(InputError, match=r"bits exc, eyc.* but no 'exx'"):
        wire.topic("error_motion_samples").field("observable").mask(["exx"])
    with pytest.raises(InputError, match=r"'point' has the bits \(none\)"):
        Field("point", "m", "a point").mask(["x"])


@pytest.mark.parametrize(("heads", "why"), [(("A",), "head 'A'"), (("a", "a"), "stands twice"), (("",), "head ''")])
def test_heads_that_make_no_topic_names_are_refused(heads: tuple[str, ...], why: str) -> None:
    with pytest.raises(InputError, match=why):
        load_wire(heads)


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ("reliability: reliable", "reliability: relaible", r"one\.yaml:8: topics\.probe\.qos\.reliability: 'relaible'"),
        ("depth: 10", "depth: 0", r"one\.yaml:8: .*depth.* a whole number from 1"),
        ("unit: m,", "unit: mm,", r"one\.yaml:11: .*unit.*an SI unit"),
        ("name: /stage/probe", "name: stage/probe", r"one\.yaml:3: topics\.probe\.name.*an absolute topic name"),
        ("    rate: 1 Hz\n", "", r"topics\.probe: 'rate' is a required property"),
        ("fields:", "columns:", r"topics\.probe: 'fields' is a required property"),
        ("type: geometry_msgs/msg/PointStamped", f"type: {SAMPLE_BLOCK}", r"'columns' is a required property"),
        ("publishers: [external]", "publisher: external", r"topics\.probe.*'publisher'"),
    ],
)
def test_a_broken_definition_is_refused_with_its_place(tmp_path: Path, old: str, new: str, why: str) -> None:
    assert old in TOPIC
    (tmp_path / "one.yaml").write_text(TOPIC)
    assert load_wire(folder=tmp_path).names == ("/stage/probe",)
    (tmp_path / "one.yaml").write_text(TOPIC.replace(old, new))
    with pytest.raises(InputError, match=why):
        load_wire(folder=tmp_path)


def test_a_key_or_a_name_defined_twice_is_refused(tmp_path: Path) -> None:
    (tmp_path / "one.yaml").write_text(TOPIC)
    (tmp_path / "two.yaml").write_text(TOPIC)
    with pytest.raises(InputError, match=r"two\.yaml: topic 'probe' is already defined in one\.yaml"):
        load_wire(folder=tmp_path)
    (tmp_path / "two.yaml").write_text(TOPIC.replace("  probe:", "  other:"))
    with pytest.raises(InputError, match=r"several topics have the name /stage/probe"):
        load_wire(folder=tmp_path)


def test_a_folder_without_definitions_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no wire contract"):
        load_wire(folder=tmp_path)


def test_publishers_keep_five_seconds_for_a_reader_that_stopped():
    """A recorder that was stopped for some seconds asks again for what it missed, and finds it there."""
    rates = {}
    for topic in load_wire().read_by("recorder"):
        stated = re.match(r"(\d+) (?:Hz|blocks? a second)", topic.rate)
        if stated:
            rates[topic.key] = int(stated[1])
            assert topic.qos.reliability == "reliable"
            assert topic.qos.depth >= 5 * rates[topic.key], topic.name
    assert {"head_samples", "axis_corrections", "machine_joint_states", "diagnostics"} <= rates.keys()
