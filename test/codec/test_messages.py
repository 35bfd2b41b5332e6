"""Messages as bytes: against rosbags, against ROS itself, and wrong bytes."""

from __future__ import annotations

import struct
from array import array
from dataclasses import replace

import numpy as np
import pytest
from bags.conftest import START, assert_same
from faults.documenting import Row, shows
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.stores import ros2_jazzy as ros

from rotary_error_monitor.codec.cdr_blocks import BlockDecoder
from rotary_error_monitor.codec.contents import TYPES, Content, JointState
from rotary_error_monitor.codec.messages import Decoder, encode, stamp_of
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.signals.blocks import SampleBlock, block_from_samples

TYPESTORE = get_typestore(Stores.ROS2_JAZZY)


def _block(count: int = 5) -> SampleBlock:
    times = START + np.arange(count) * 1000
    return block_from_samples(times, ["angle", "velocity"], np.arange(2.0 * count).reshape(count, 2))


def _cloud(block: SampleBlock, **changes: object) -> bytes:
    """Bytes of a point cloud as rosbags writes it, with some of its fields replaced."""
    message = TYPESTORE.deserialize_cdr(encode(block, "head_a"), TYPES[SampleBlock])
    values = {name: getattr(message, name) for name in ("header", "height", "width", "fields", "is_bigendian")}
    values |= {name: getattr(message, name) for name in ("point_step", "row_step", "data", "is_dense")}
    return bytes(TYPESTORE.serialize_cdr(ros.sensor_msgs__msg__PointCloud2(**(values | changes)), TYPES[SampleBlock]))


def test_every_kind_survives_the_way_through_bytes(contents: dict[str, list[Content]]) -> None:
    assert {type(values[0]) for values in contents.values()} == set(TYPES)
    for values in contents.values():
        decoder = Decoder(TYPES[type(values[0])])
        for value in values:
            data = encode(value)
            assert_same(decoder.decode(data), value)
            assert stamp_of(data) == value.stamp_ns


DEFINITION = TYPESTORE.generate_msgdef(TYPES[JointState], ros_version=2)[0]
STATE = JointState(START, ("X", "C"), np.array([0.1, 2.0]), np.array([1.0, -1.0]), np.array([]), "machine")


@pytest.mark.parametrize(
    "definition",
    [DEFINITION, DEFINITION.partition("=====")[0], "no definition @ all", ""],
    ids=["whole", "without its parts", "unreadable", "none"],
)
def test_messages_are_read_with_the_definition_of_their_bag_or_without(definition: str) -> None:
    assert_same(Decoder(TYPES[JointState], definition).decode(encode(STATE)), STATE)


def test_the_definition_of_the_bag_counts() -> None:
    # As another version of the message might order its fields.
    moved = DEFINITION.replace("float64[] position\n", "").replace("[] effort\n", "[] effort\nfloat64[] position\n")
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg(moved, TYPES[JointState]))
    plain = TYPESTORE.deserialize_cdr(encode(STATE), TYPES[JointState])
    data = bytes(store.serialize_cdr(plain, TYPES[JointState]))
    assert data != encode(STATE)
    assert_same(Decoder(TYPES[JointState], moved).decode(data), STATE)


def test_a_definition_without_a_field_is_said() -> None:
    other = DEFINITION.replace("float64[] effort", "float64[] torque")
    with pytest.raises(
        InputError, match="JointState as the bag defines it is not that of ROS 2 Jazzy: it has no effort"
    ):
        Decoder(TYPES[JointState], other).decode(encode(STATE))


PART = "\n" + "=" * 80 + "\nMSG: sensor_msgs/"
UNBOUNDED = {
    "an array of empty messages": "E[2000000000] name\n" + PART + "E\nuint8 X=1\n",
    "an array of texts": "string[2000000000] name\n",
    "arrays in arrays": "A[9] a\n" + PART + "A\nB[9] b\n" + PART + "B\nE[9] e\n" + PART + "E\nuint8 X=1\n",
    "messages twice in each": "A0 a\n" + "".join(f"{PART}A{i}\nA{i + 1} a\nA{i + 1} b\n" for i in range(30))
    + PART + "A30\nfloat64 x\n",
    "itself": "sensor_msgs/JointState x\n",
    "one another": "A a\n" + PART + "A\nB[0] b\n" + PART + "B\nA[0] a\n",
    "a sequence of empty messages": "E[] name\n" + PART + "E\nuint8 X=1\n",
    "a bounded sequence": "E[<=2000000000] name\n" + PART + "E\nfloat64[0] x\n",
    "many fields": "".join(f"float64 x{i}\n" for i in range(101)),
}  # fmt: skip


@pytest.mark.parametrize("definition", UNBOUNDED.values(), ids=UNBOUNDED)
def test_a_definition_whose_messages_have_no_bounds_is_refused(definition: str) -> None:
    with pytest.raises(InputError, match=r"JointState as the bag defines it cannot be read: (with )?field '\w+' "):
        Decoder(TYPES[JointState], definition)


@pytest.mark.parametrize("count", [7, 1000, 2_000_000_000])
def test_an_array_of_numbers_has_the_bytes_of_its_message_at_most(count: int) -> None:
    decoder = Decoder(TYPES[JointState], DEFINITION.replace("float64[] effort", f"float64[{count}] effort"))
    with pytest.raises(InputError, match="bytes are no sensor_msgs/msg/JointState"):
        decoder.decode(encode(STATE)[:-4])


def test_a_joint_state_of_megabytes_is_refused() -> None:
    with pytest.raises(InputError, match=r"JointState of 1\d{6} bytes; at most 1048576 are read"):
        Decoder(TYPES[JointState]).decode(encode(replace(STATE, frame="x" * (1 << 20))))


@settings(max_examples=60, deadline=None)
@given(
    count=st.integers(1, 40),
    names=st.lists(st.from_regex(r"[a-z_]{1,9}", fullmatch=True).filter(lambda n: n != "t"), max_size=6, unique=True),
    frame=st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=9),
    stamp=st.integers(0, 2**31 * 1_000_000_000 - 1),
)
def test_blocks_are_read_as_rosbags_reads_them(count: int, names: list[str], frame: str, stamp: int) -> None:
    # Lengths of texts move every field behind them: the walk through the bytes must keep the alignment.
    rows = np.random.default_rng(count).normal(size=(count, 1 + len(names)))
    data = encode(SampleBlock(stamp, ("t", *names), rows), frame)
    message = TYPESTORE.deserialize_cdr(data, TYPES[SampleBlock])
    assert isinstance(message, ros.sensor_msgs__msg__PointCloud2)
    block = BlockDecoder().decode(data)
    assert block.names == tuple(field.name for field in message.fields)
    assert block.stamp_ns == message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == stamp
    assert block.rows.tobytes() == message.data.tobytes() == rows.tobytes()
    assert block.rows.flags.aligned and not np.shares_memory(block.rows, np.frombuffer(data, np.uint8))


def test_a_decoder_follows_a_topic_that_changes_its_layout() -> None:
    decoder = BlockDecoder()
    short, wide = _block(3), block_from_samples(START + np.arange(4), ["a", "b", "c"], np.ones((4, 3)))
    for block in (short, wide, _block(7), wide, short):
        assert_same(decoder.decode(encode(block, "frame")), block)


def test_bytes_from_ros_are_read() -> None:
    serialization = pytest.importorskip("rclpy.serialization")
    from sensor_msgs.msg import JointState as RosJointState
    from sensor_msgs.msg import PointCloud2, PointField

    block = _block(9)
    cloud = PointCloud2(height=1, width=9, point_step=24, row_step=216, is_dense=True)
    cloud.header.stamp.sec, cloud.header.stamp.nanosec = divmod(START, 10**9)
    cloud.header.frame_id = "head_c"
    cloud.fields = [PointField(name=n, offset=8 * i, datatype=8, count=1) for i, n in enumerate(block.names)]
    cloud.data = array("B", block.rows.tobytes())
    assert_same(BlockDecoder().decode(serialization.serialize_message(cloud)), block)
    state = RosJointState(name=["X"], position=array("d", [1.5]), velocity=array("d", [-1.0]), effort=array("d", [0.0]))
    read = Decoder(TYPES[JointState]).decode(serialization.serialize_message(state))
    assert_same(read, JointState(0, ("X",), np.array([1.5]), np.array([-1.0]), np.array([0.0])))


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_a_sample_that_is_not_finite_is_found(value: float) -> None:
    block = _block()
    block.rows[3, 2] = value
    with pytest.raises(InputError, match=rf"sample 3 of 'velocity' is {value}"):
        BlockDecoder().decode(encode(block))


@shows(
    Row(
        "messages",
        "A message of a stream has wrong types, byte order, sizes or encoding, no samples, or ends early",
        "`refused …` of each node that listens, at once: which field, what it says and what is needed",
        "the message is refused, the stream goes on",
        "everything",
        "with the next message",
    )
)
def test_wrong_layouts_are_refused() -> None:
    field = ros.sensor_msgs__msg__PointField
    float32 = [field("t", 0, 8, 1), field("angle", 8, 7, 1), field("velocity", 16, 8, 1)]
    wrong = {
        "height 2": _cloud(_block(), height=2),
        "width 0": _cloud(_block(), width=0, data=np.zeros(0, np.uint8)),
        "6 samples of 24 bytes need 144 bytes, but the message says 120": _cloud(_block(), width=6),
        "'angle', 8, 7, 1": _cloud(_block(), fields=float32),
        "'t' first": _cloud(_block(), fields=[]),
        "big-endian": _cloud(_block(), is_bigendian=True),
        "point_step 16": _cloud(_block(), point_step=16),
        "encoding 0000": b"\0\0" + _cloud(_block())[2:],
    }
    for why, data in wrong.items():
        with pytest.raises(InputError, match=why):
            BlockDecoder().decode(data)
        used = BlockDecoder()  # one that knows the right layout already
        used.decode(_cloud(_block()))
        with pytest.raises(InputError, match=why):
            used.decode(data)


def test_bytes_cut_anywhere_are_refused() -> None:
    data = encode(_block(), "head_a")
    whole = len(data) - 1  # is_dense, the last byte, is not needed
    for length in range(whole):
        with pytest.raises(InputError):
            BlockDecoder().decode(data[:length])
    state = encode(JointState(START, ("X",), np.ones(1), np.ones(1), np.ones(1)))
    for length in range(len(state)):
        with pytest.raises(InputError, match="JointState"):
            Decoder(TYPES[JointState]).decode(state[:length])


def test_the_stamp_is_read_in_both_byte_orders() -> None:
    assert stamp_of(b"\0\1\0\0" + struct.pack("<iI", 12, 34)) == 12_000_000_034
    assert stamp_of(b"\0\0\0\0" + struct.pack(">iI", 12, 34)) == 12_000_000_034
    with pytest.raises(InputError, match="11 bytes holds no header"):
        stamp_of(b"\0\1" + bytes(9))


def test_a_type_outside_the_contract_is_refused() -> None:
    with pytest.raises(InputError, match=r"std_msgs/msg/String; readable are geometry_msgs/msg/PointStamped"):
        Decoder("std_msgs/msg/String")
