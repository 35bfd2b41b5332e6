"""The recorder as a node: a bag of what was published that can be read again whatever happens."""

from __future__ import annotations

import gc
import itertools
import resource
import shutil
import signal
import threading
import time
import tracemalloc

import numpy as np
import pytest
from faults.documenting import Row, shows
from faults.live.other_programs import check, lost_time, stated
from mcap.reader import make_reader
from mcap.records import Message
from mcap.stream_reader import StreamReader
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message, serialize_message
from received_blocks import block_of
from rosbags.highlevel import AnyReader
from sensor_msgs.msg import JointState, Temperature
from std_msgs.msg import Float64

from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.bags.recovery import recover
from rotary_error_monitor.bags.storage import RecordFile
from rotary_error_monitor.codec.cdr_blocks import BlockDecoder
from rotary_error_monitor.codec.messages import stamp_of
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.nodes import messages
from rotary_error_monitor.nodes.encoder_head import EncoderHead
from rotary_error_monitor.nodes.mock_controller import MockController
from rotary_error_monitor.nodes.qos import profile
from rotary_error_monitor.nodes.recorder import Recorder

REPEATED = 4.0
"""Time, s, after which the middleware has sent again what did not fit into its buffers: its heartbeat period is 3 s."""


def recorded(bag, topic):
    """Bytes of each message of a topic, by rosbags."""
    with AnyReader([bag]) as reader:
        connections = [each for each in reader.connections if each.topic == topic]
        return [bytes(data) for _, _, data in reader.messages(connections=connections)]


def test_a_bag_holds_what_was_published(cell, tmp_path):
    bag = tmp_path / "bag"
    topic = cell.wire.topic("head_samples", "a")
    recorder = cell.run(Recorder, "recorder", folder=str(bag))
    received = cell.collect(topic)
    cell.run(EncoderHead, "encoder_head_a", source="mock")
    cell.run(MockController, "mock_controller", machine="xyzac_trt")
    axes = cell.collect(cell.wire.topic("machine_joint_states"))
    cell.wait_until(lambda: len(received) > 10 and len(axes) > 30, "messages")
    cell.wait_for_status("recorder: recording", "recording")
    assert cell.figures("recorder: recording").keys() >= {"bag", "messages", "rate_hz", "silent_topics"}
    cell.remove(recorder)
    with AnyReader([bag]) as reader:
        names = {each.topic for each in reader.connections}
        wanted = {topic.name for topic in cell.wire.read_by("recorder")}
        assert names == wanted, "every topic that it listens to is declared, also a silent one"
        counts = {name: info.msgcount for name, info in reader.topics.items()}
    assert counts["/machine/joint_states"] > 10
    found = {block.stamp_ns: block for block in map(BlockDecoder().decode, recorded(bag, topic.name))}
    # the latest were perhaps on their way to the recorder when it ended
    wanted = [block for block in map(block_of, received) if block.stamp_ns <= max(found)]
    assert len(wanted) > 5
    for block in wanted:
        assert found[block.stamp_ns].rows.tobytes() == block.rows.tobytes()
    with next(bag.glob("*.mcap")).open("rb") as file:
        assert sum(1 for _ in make_reader(file).iter_messages()) == sum(counts.values())


@shows(
    Row(
        "files",
        "The recorder is killed",
        "`recover` and every reader say what is readable",
        "what came up to `flush_period` before is on the disk",
        "everything else goes on",
        "`rotary_error_monitor recover`",
    ),
)
def test_what_came_before_a_kill_can_be_read(cell, tmp_path):
    bag = tmp_path / "bag"
    topic = cell.wire.topic("head_samples", "a")
    process = cell.start("recorder", folder=str(bag))
    cell.wait_for_status("recorder: state", "active")
    received = cell.collect(topic)
    cell.run(EncoderHead, "encoder_head_a", source="mock")
    with lost_time(lambda: [process.pid]) as lost:
        cell.wait_until(lambda: len(received) > 40, "messages")
        killed_ns = time.time_ns()
        process.send(signal.SIGKILL)
        process.wait()
    readable = []
    with next(bag.glob("*.mcap")).open("rb") as file:
        try:
            for record in StreamReader(file).records:
                if isinstance(record, Message):
                    readable.append(record.log_time)
        except Exception as error:  # the end is torn; what matters is what could be read before it
            assert readable, error
    assert (bag / "metadata.yaml").is_file()
    check("the last message", killed_ns - max(readable), 1.0, lost())


@shows(
    Row(
        "files",
        "The disk is full",
        "`recording`: ERROR, and in the log",
        "a reserve on the disk makes room for the index; the bag is closed whole",
        "everything else goes on",
        "a new recording",
    ),
)
def test_a_full_disk_is_told_and_nothing_is_lost(cell, tmp_path):
    """A limit on the size of files, as a full disk does, ends the recording but not the node."""
    bag = tmp_path / "bag"
    limit = 4_000_000
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, hard))
    try:
        recorder = cell.run(Recorder, "recorder", folder=str(bag))
        cell.run(EncoderHead, "encoder_head_a", rate=50_000.0, source="mock")
        status = cell.wait_for_status("recorder: recording", "recording stopped")
        assert status.level == b"\x02"
        cell.wait_for_status("recorder: state", "active")
        cell.remove(recorder)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    figures = {each.key: each.value for each in status.values}
    kept = list(BagReader(bag).messages())
    assert 0 <= int(figures["messages"]) - len(kept) <= 30, "all but the last fifth of a second"
    blocks = [BlockDecoder().decode(each.data) for each in kept if each.topic == "/stage/head_a/samples"]
    assert sum(block.rows.nbytes for block in blocks) > 0.5 * limit, "half of the room holds samples of the head"
    steps = np.diff(np.concatenate([block.times_ns for block in blocks]))
    assert (steps == 20_000).all(), "without a gap"


@shows(
    Row(
        "files",
        "The folder of a recording cannot be written",
        "exit code 2 with the reason",
        "nothing is begun",
        "everything else goes on",
        "another folder",
    ),
)
def test_a_folder_that_cannot_be_written(cell, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match=r"parameter 'folder': .*cannot be written"):
        cell.run(Recorder, "recorder", folder=str(tmp_path / "file" / "bag"))
    (tmp_path / "bag").mkdir()
    with pytest.raises(InputError, match="exists already"):
        cell.run(Recorder, "recorder", folder=str(tmp_path / "bag"))


def test_nothing_to_record_is_told(cell, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    recorder = cell.run(Recorder, "recorder")
    (bag,) = tmp_path.glob("bag_*")
    recorder.trigger_deactivate()
    cell.wait_for_status("recorder: recording", "nothing arrived")
    recorder.trigger_cleanup()
    assert recorded(bag, "/stage/head_a/samples") == []


def remarks(bag):
    """All but that samples are simulated, which this recorder may or may not have heard in the short time of a test."""
    return [remark for remark in BagReader(bag).remarks if ": simulated: " not in remark]


def stamps(bag, topic):
    return sorted(stamp_of(data) for data in recorded(bag, topic))


@shows(
    Row(
        "files",
        "The recorder is stopped for 2 s (SIGSTOP) and goes on",
        "not a fault: `lost_messages` stays 0",
        "what waits at its publishers is asked for",
        "everything else goes on",
        "at once; nothing that publishers keep is lost",
    )
)
def test_a_recorder_that_was_stopped_loses_nothing_that_publishers_keep(cell, tmp_path):
    """Two seconds without the process: what waits at its publishers is asked for and comes."""
    bag = tmp_path / "bag"
    recorder = cell.start("recorder", folder=str(bag))
    cell.wait_for_status("recorder: state", "active")
    topics = [
        *(cell.wire.topic(key) for key in ("machine_joint_states", "command_samples", "command_joint_states")),
        cell.wire.topic("axis_corrections"),
        *(cell.wire.topic(key, "a") for key in ("head_samples", "head_joint_states")),
    ]
    heard = {topic.name: cell.collect(topic) for topic in topics}
    cell.start("mock_controller", machine="grinder_zhou2023", block_period=0.005)
    cell.start("compensation", machine="grinder_zhou2023", age_limit=1.0)
    cell.start("encoder_head", "encoder_head_a", block_period=0.005, source="mock")
    cell.wait_until(lambda: all(len(each) > 5 for each in heard.values()), "messages of all")
    cell.wait_until(lambda: cell.recorder_hears(heard.keys()), "the recorder to hear them too")
    before = cell.figures("recorder: recording")["lost_of"]
    began_ns = time.time_ns()
    recorder.pause()
    cell.spin_for(2.0)
    recorder.go_on()
    cell.spin_for(2.0)
    ended_ns = time.time_ns()
    cell.spin_for(REPEATED)
    figures = cell.figures("recorder: recording")
    assert figures["lost_messages"] == "0", f"{figures['lost_of']}; before the stop: {before}"
    assert recorder.stop() == 0
    for name, received in heard.items():
        wanted = {messages.measured_ns(each.header) for each in received}
        wanted = {stamp for stamp in wanted if began_ns <= stamp < ended_ns}
        assert len(wanted) > 50
        assert wanted <= {*stamps(bag, name)}, name
    assert remarks(bag) == []


def test_what_is_lost_is_counted_and_said(cell, tmp_path):
    """A publisher that keeps little, and a recorder that is stopped for longer."""
    bag = tmp_path / "bag"
    recorder = cell.start("recorder", folder=str(bag))
    cell.wait_for_status("recorder: state", "active")
    topic = cell.wire.topic("machine_joint_states")
    shallow = profile(topic)
    shallow.depth = 5
    publisher = cell.node.create_publisher(messages.message_class(topic.type), topic.name, shallow)
    cell.wait_until(lambda: publisher.get_subscription_count() > 0, "the recorder to listen")

    numbers = itertools.count()

    def publish(count):
        for number in itertools.islice(numbers, count):
            publisher.publish(messages.joint_state_message(time.time_ns(), "base", ("X",), [float(number)], [0.0]))
            time.sleep(0.0005)  # a rate; nothing of the harness need run meanwhile

    publish(20)
    cell.wait_until(lambda: int(cell.figures("recorder: recording")["messages"]) >= 20, "twenty messages")
    recorder.pause()
    publish(3000)  # more than waits on the way to a process
    recorder.go_on()
    publish(20)
    status = cell.wait_for_status("recorder: recording", "messages lost since the last report")
    assert status.level == b"\x01"
    assert f"of {topic.name}" in status.message
    assert int(cell.figures("recorder: recording")["lost_messages"]) > 0
    assert recorder.stop() == 0
    heard = [deserialize_message(data, JointState).position[0] for data in recorded(bag, topic.name)]
    lost = round(heard[-1] - heard[0]) + 1 - len(heard)  # what went before the first and after the last nobody can know
    assert lost > 1000
    assert f"messages that never came: {lost} of {topic.name}" in recorder.output
    assert remarks(bag) == [f"{bag}: messages that never came: {lost} of {topic.name}"]


def test_a_recorder_is_killed_and_started_again(cell, tmp_path):
    """The old bag is refused until somebody gives a new one, and can be recovered; the new one goes on."""
    bag, topic = tmp_path / "bag", cell.wire.topic("head_samples", "a")
    cell.run(EncoderHead, "encoder_head_a", source="mock")

    def has(folder):
        return bool(list(folder.glob("*.mcap"))) and len(list(BagReader(folder).messages([topic.name]))) > 5

    first = cell.start("recorder", folder=str(bag))
    cell.wait_until(lambda: has(bag), "messages")
    first.send(signal.SIGKILL)
    first.wait()
    second = cell.start("recorder", folder=str(bag))
    second.expected = True
    cell.wait_until(lambda: second.exit_code is not None, "the second to end")
    assert second.wait() == 2
    assert "exists already; give the path of a new bag" in second.output
    third = cell.start("recorder", folder=str(tmp_path / "next"))
    cell.wait_until(lambda: has(tmp_path / "next"), "the third to record")
    assert recover(bag).counts[topic.name] == len(recorded(bag, topic.name)) > 5
    assert third.stop() == 0
    blocks = [BlockDecoder().decode(data) for data in recorded(tmp_path / "next", topic.name)]
    assert len(blocks) > 0


@shows(
    Row(
        "files",
        "The folder of a recording is renamed or removed",
        "`recording`: where it is now, or ERROR",
        "a renamed folder is followed; of a removed one the recording ends",
        "everything else goes on",
        "a new recording",
    ),
)
@pytest.mark.parametrize("renamed", [True, False])
def test_a_folder_that_is_taken_away_is_told(cell, tmp_path, renamed):
    bag, later = tmp_path / "bag", tmp_path / "later"
    recorder = cell.run(Recorder, "recorder", folder=str(bag))
    cell.run(EncoderHead, "encoder_head_a", source="mock")
    cell.wait_for_status("recorder: recording", "recording")
    with stated("a word of it", 2.0):
        if renamed:
            bag.rename(later)
            words = f"renamed to {later}; recording goes on there"
        else:
            with recorder.busy:  # as one step for the recorder: else it may find its file gone and the folder there
                shutil.rmtree(bag)
            words = "the folder was removed; what was recorded is gone with it"
        status = cell.wait_for_status("recorder: recording", words)
    assert status.level == (b"\x01" if renamed else b"\x02")
    count = int({each.key: each.value for each in status.values}["messages"])
    cell.spin_for(0.5)
    cell.remove(recorder)
    if renamed:
        assert sum(1 for _ in BagReader(later).messages()) > count
    assert not bag.exists()


@shows(
    Row(
        "files",
        "The disk takes nothing for some time",
        "`recording`: ERROR, for how long",
        "messages wait; publishers keep five seconds",
        "everything else goes on",
        "at once; what was lost is counted and noted in the bag",
    ),
)
def test_a_disk_that_hangs_is_told(cell, tmp_path, monkeypatch):
    """The write does not come back; who listens hears of it all the same, and nothing is lost."""
    hanging, entered = threading.Event(), threading.Event()
    append = RecordFile._append

    def hang(file, data):
        if hanging.is_set():
            entered.set()
            while hanging.is_set():
                time.sleep(0.01)
        append(file, data)

    monkeypatch.setattr(RecordFile, "_append", hang)
    recorder = cell.run(Recorder, "recorder", folder=str(tmp_path / "bag"))
    cell.run(EncoderHead, "encoder_head_a", source="mock")
    cell.wait_for_status("recorder: recording", "recording")
    hanging.set()
    try:
        cell.wait_until(entered.is_set, "the disk to hang")
        with stated("a word of it", 2.5):
            status = cell.wait_for_status("recorder: recording", "the disk has taken nothing for")
        assert status.level == b"\x02"
        cell.wait_until(lambda: float(cell.figures("recorder: recording")["waiting_s"]) > 1.0, "a second to pass")
    finally:
        hanging.clear()
    cell.wait_for_status("recorder: recording", "messages waited up to")
    assert cell.figures("recorder: recording")["lost_messages"] == "0"
    cell.remove(recorder)
    blocks = [BlockDecoder().decode(data) for data in recorded(tmp_path / "bag", "/stage/head_a/samples")]
    times = np.concatenate([block.times_ns for block in blocks])
    assert (np.diff(times) == np.diff(times)[0]).all()


def test_a_long_recording_is_split(cell, tmp_path):
    bag = tmp_path / "bag"
    recorder = cell.run(Recorder, "recorder", folder=str(bag), max_file_duration=0.5)
    cell.run(EncoderHead, "encoder_head_a", source="mock")
    cell.wait_until(lambda: len(list(bag.glob("bag_*.mcap"))) > 3, "four files")
    cell.remove(recorder)
    with (bag / "bag_0.mcap").open("rb") as file:
        chunks = make_reader(file).get_summary().chunk_indexes
    assert {chunk.compression for chunk in chunks} == {"zstd"}
    blocks = [BlockDecoder().decode(data) for data in recorded(bag, "/stage/head_a/samples")]
    times = np.concatenate([block.times_ns for block in blocks])
    assert (np.diff(times) == np.diff(times)[0]).all()
    assert remarks(bag) == []


def test_topics_of_ones_own_are_recorded(cell, tmp_path):
    bag = tmp_path / "bag"
    names = "/spindle/current std_msgs/msg/Float64, coolant sensor_msgs/msg/Temperature"
    recorder = cell.run(Recorder, "recorder", folder=str(bag), extra_topics=names, ros_args=["-r", "__ns:=/left"])
    current = cell.node.create_publisher(Float64, "/spindle/current", QoSProfile(depth=10))
    sensor = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
    coolant = cell.node.create_publisher(Temperature, "/left/coolant", sensor)
    cell.wait_until(lambda: current.get_subscription_count() and coolant.get_subscription_count(), "the recorder")
    sent = np.arange(20.0)
    for value in sent:
        current.publish(Float64(data=value))
        coolant.publish(Temperature(temperature=value))
        cell.spin_for(0.01)
    assert current.wait_for_all_acked()  # the last may still be on its way, and comes before the next word
    cell.forget_status("left/recorder: recording")
    cell.wait_until(lambda: cell.recorder_hears({"/spindle/current", "/left/coolant"}, "left/recorder"), "its word")
    cell.remove(recorder)
    with AnyReader([bag]) as reader:
        found = {connection.topic: [] for connection in reader.connections}
        for connection, _, data in reader.messages():
            found[connection.topic].append(reader.deserialize(data, connection.msgtype))
    assert [message.data for message in found["/spindle/current"]] == sent.tolist()
    assert len(found["/left/coolant"]) > 10 and remarks(bag) == []


@pytest.mark.parametrize(
    ("names", "said"),
    [
        ("/spindle/current", "'/spindle/current': expected name and type of a topic, such as"),
        ("/a std_msgs/msg/Float64, /a std_msgs/msg/Int8", "/a stands twice"),
        ("/diagnostics std_msgs/msg/Float64", "/diagnostics is recorded anyway"),
        ("/a no_such/msg/Thing", "message type 'no_such/msg/Thing' is not installed"),
    ],
)
def test_wrong_topics_of_ones_own(cell, tmp_path, names, said):
    with pytest.raises(InputError, match=rf"parameter 'extra_topics': {said}"):
        cell.run(Recorder, "recorder", folder=str(tmp_path / "bag"), extra_topics=names)
    assert not (tmp_path / "bag").exists()


def test_a_recording_for_months_keeps_its_last_files(cell, tmp_path):
    bag = tmp_path / "bag"
    limits = {"max_file_duration": 0.5, "keep_duration": 1.0}
    recorder = cell.run(Recorder, "recorder", folder=str(bag), **limits)
    cell.run(EncoderHead, "encoder_head_a", source="mock")
    cell.wait_until(lambda: (bag / "bag_6.mcap").exists(), "seven files")
    assert not (bag / "bag_0.mcap").exists()
    cell.wait_until(lambda: len(list(bag.glob("bag_*.mcap"))) <= 4, "the older ones to go once the next has begun")
    cell.remove(recorder)
    blocks = [BlockDecoder().decode(data) for data in recorded(bag, "/stage/head_a/samples")]
    times = np.concatenate([block.times_ns for block in blocks])
    assert (np.diff(times) == np.diff(times)[0]).all() and times[-1] - times[0] > 900_000_000
    assert any("files removed for what shall be kept at most" in remark for remark in BagReader(bag).remarks)


def test_memory_does_not_grow_with_the_messages(cell, tmp_path):
    """Counted: what is held after each 1,000 messages, each file at the same place and all of it written."""
    recorder = cell.run(Recorder, "recorder", folder=str(tmp_path / "bag"), max_file_duration=10.0)
    topic = cell.wire.topic("machine_joint_states")
    data = serialize_message(messages.joint_state_message(1, "base", ("X",), [0.0], [0.0]))
    receive, held = recorder._receiver(topic.name), []
    tracemalloc.start()
    try:
        for number in range(1, 25_001):
            with recorder.busy:
                receive(data, number * 10_000_000, number)
                if number % 1_000 == 0:
                    held.append(held_when_written(recorder))
    finally:
        tracemalloc.stop()
    cell.remove(recorder)
    assert len(recorded(tmp_path / "bag", topic.name)) == 25_000
    assert len(list((tmp_path / "bag").glob("*.mcap"))) == 25
    assert max(held[15:]) - min(held[2:10]) < 15_000 * 4, "bytes for each message"


def held_when_written(recorder: Recorder) -> int:
    """Bytes that Python holds once the disk has everything that was recorded."""
    while recorder._bag._ending:
        recorder._bag.flush()
        time.sleep(0.001)
    recorder._bag.flush()
    gc.collect()
    return tracemalloc.get_traced_memory()[0]


def test_a_time_without_recording_is_no_loss(cell, tmp_path):
    recorder = cell.run(Recorder, "recorder", folder=str(tmp_path / "bag"))
    cell.run(EncoderHead, "encoder_head_a", source="mock")
    cell.wait_for_status("recorder: recording", "recording")
    recorder.trigger_deactivate()
    cell.wait_for_status("recorder: recording", "nothing arrived")
    recorder.trigger_activate()
    cell.forget_status("recorder: recording")
    cell.wait_for_status("recorder: recording", "recording")
    assert cell.figures("recorder: recording")["lost_messages"] == "0"
