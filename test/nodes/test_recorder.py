"""The recorder as a node: a bag of what was published that can be read again whatever happens."""

from __future__ import annotations

import resource
import signal
import time

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.records import Message
from mcap.stream_reader import StreamReader
from rosbags.highlevel import AnyReader

from rotary_error_monitor.bags.cdr_blocks import BlockDecoder
from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.nodes import messages
from rotary_error_monitor.nodes.encoder_head import EncoderHead
from rotary_error_monitor.nodes.mock_controller import MockController
from rotary_error_monitor.nodes.recorder import Recorder


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
    cell.run(EncoderHead, "encoder_head_a")
    cell.run(MockController, "mock_controller", machine="xyzac_trt")
    axes = cell.collect(cell.wire.topic("machine_joint_states"))
    cell.wait_until(lambda: len(received) > 10 and len(axes) > 30, "messages")
    cell.wait_for_status("recorder: recording", "recording")
    assert cell.figures("recorder: recording").keys() >= {"bag", "messages", "rate_hz", "silent_topics"}
    cell.remove(recorder)
    with AnyReader([bag]) as reader:
        names = {each.topic for each in reader.connections}
        assert names == set(cell.wire.names), "every topic of the contract is declared, also a silent one"
        counts = {name: info.msgcount for name, info in reader.topics.items()}
    assert counts["/machine/joint_states"] > 10
    blocks = {data[4:12]: data for data in recorded(bag, topic.name)}
    assert len(blocks) >= len(received) - 1
    wanted = messages.block_from_message(received[5])
    found = [BlockDecoder().decode(data) for data in blocks.values()]
    same = next(block for block in found if block.stamp_ns == wanted.stamp_ns)
    assert same.rows.tobytes() == wanted.rows.tobytes()
    with next(bag.glob("*.mcap")).open("rb") as file:
        assert sum(1 for _ in make_reader(file).iter_messages()) == sum(counts.values())


def test_what_came_before_a_kill_can_be_read(cell, tmp_path):
    bag = tmp_path / "bag"
    topic = cell.wire.topic("head_samples", "a")
    process = cell.start("recorder", folder=str(bag))
    cell.wait_for_status("recorder: state", "active", 60)
    received = cell.collect(topic)
    cell.run(EncoderHead, "encoder_head_a")
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
    assert killed_ns - max(readable) < 1_000_000_000


def test_a_full_disk_is_told_and_nothing_is_lost(cell, tmp_path):
    """A limit on the size of files, as a full disk does, ends the recording but not the node."""
    bag = tmp_path / "bag"
    limit = 1_000_000
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, hard))
    try:
        recorder = cell.run(Recorder, "recorder", folder=str(bag))
        cell.run(EncoderHead, "encoder_head_a", rate=50_000.0)
        status = cell.wait_for_status("recorder: recording", "recording stopped", 30)
        assert status.level == b"\x02"
        cell.wait_for_status("recorder: state", "active")
        cell.remove(recorder)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    figures = {each.key: each.value for each in status.values}
    kept = list(BagReader(bag).messages())
    assert 0 <= int(figures["messages"]) - len(kept) <= 5, "all but the chunk that found no room"
    blocks = [BlockDecoder().decode(each.data) for each in kept if each.topic == "/stage/head_a/samples"]
    assert sum(block.rows.nbytes for block in blocks) > 0.5 * limit, "half of the room holds samples of the head"
    steps = np.diff(np.concatenate([block.times_ns for block in blocks]))
    assert (steps == 20_000).all(), "without a gap"


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
