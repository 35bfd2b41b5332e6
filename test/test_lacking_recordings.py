"""Bags that lack something: replay, diagnosis and recovery say what, and go on with what the bag has."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from faults.documenting import Row, shows

from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.bags.writer import BagWriter, write_messages
from rotary_error_monitor.cli import main
from rotary_error_monitor.codec.contents import Content, JointState, Temperature
from rotary_error_monitor.codec.error_motion_blocks import block_from_error_motion
from rotary_error_monitor.codec.messages import encode
from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.description.wire import load_wire
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.error_motion import ErrorMotion
from rotary_error_monitor.pipeline.compensation import Compensator
from rotary_error_monitor.pipeline.estimation import Estimator
from rotary_error_monitor.recordings.replay import replay_bag
from rotary_error_monitor.resources import config
from rotary_error_monitor.signals.blocks import NANOSECONDS, SampleBlock
from rotary_error_monitor.sources.mock import MockSettings, MockSource, mock_stage
from rotary_error_monitor.sources.mock_machine import MachineMotion

START = 1_763_700_000 * NANOSECONDS
DURATION = 24
BLOCK = 20_000_000
JOINTS = 10_000_000
WIRE = load_wire()
STAGE, MACHINE = load_stage(), load_machine("xyzac_trt")
TOPICS = {f"head_{head}": WIRE.topic("head_samples", head).name for head in "abcd"} | {
    name: WIRE.topic(f"{name}_samples").name for name in ("autocollimator", "command")
}
HEAD_C, HEAD_D = TOPICS["head_c"], TOPICS["head_d"]
MOTION_COLUMNS = WIRE.topic("error_motion_samples").columns
MOTION, OFFSET = WIRE.topic("error_motion_samples").name, WIRE.topic("tool_offset_samples").name
JOINT_STATES = WIRE.topic("machine_joint_states").name

Recording = Mapping[str, Sequence[Content]]


@pytest.fixture(scope="module")
def recording() -> Recording:
    """What a cell published: four heads, autocollimator, command, joint states, error motion and tool offset."""
    plant = mock_stage(STAGE, MockSettings(3, START - 60 * NANOSECONDS, (1.5, 3.0), False, 1000.0))
    sources = {name: MockSource(plant, name) for name in TOPICS}
    motion = MachineMotion(MACHINE, plant)
    estimator, compensator = Estimator(STAGE), Compensator(MACHINE)
    found: dict[str, list[Content]] = {name: [] for name in (*TOPICS.values(), JOINT_STATES, MOTION, OFFSET)}
    for since in range(START, START + DURATION * NANOSECONDS, BLOCK):
        for stamp in range(since, since + BLOCK, JOINTS):
            axes = motion.at(stamp)
            positions, velocities = ([getattr(axis, key) for axis in axes] for key in ("position", "velocity"))
            state = JointState(stamp, MACHINE.letters, np.array(positions), np.array(velocities), np.empty(0))
            found[JOINT_STATES].append(state)
            compensator.accept_joint_state(
                stamp,
                dict(zip(MACHINE.letters, positions, strict=True)),
                dict(zip(MACHINE.letters, velocities, strict=True)),
            )
        for name, source in sources.items():
            block = source.take(since, since + BLOCK)
            assert block is not None
            found[TOPICS[name]].append(block)
            estimator.accept(name, block)
        for made in estimator.advance():
            found[MOTION].append(block_from_error_motion(made, MOTION_COLUMNS))
            compensator.accept_error_motion(made)
        found[OFFSET] += compensator.advance().offsets
    return found


def without(recording: Recording, topic: str, since: float = 0.0, until: float = DURATION) -> Recording:
    """The recording without what a topic said from one time to another, s."""
    gone = range(START + round(since * NANOSECONDS), START + round(until * NANOSECONDS))
    return dict(recording) | {topic: [content for content in recording[topic] if content.stamp_ns not in gone]}


def seconds(stamps: np.ndarray) -> np.ndarray:
    return (stamps - START) / NANOSECONDS


def live(recording: Recording, topic: str, columns: Sequence[str]) -> tuple[np.ndarray, np.ndarray]:
    blocks = recording[topic]
    return np.concatenate([b.times_ns for b in blocks]), np.concatenate([b.columns(columns) for b in blocks])


def test_a_whole_bag_is_repeated_without_a_remark(recording, tmp_path):
    write_messages(tmp_path / "bag", recording, WIRE)
    result = replay_bag(tmp_path / "bag", STAGE, MACHINE)
    assert result.remarks == () and not result.unrepeated.any() and result.repeated and not len(result.lost_ns)
    stamps, theta = live(recording, MOTION, ["theta"])
    again = np.isin(result.stamp_ns, stamps)
    assert np.count_nonzero(again) == len(stamps) > 1000 * (DURATION - 1)
    np.testing.assert_array_equal(result.theta[again], theta[:, 0])


@shows(
    Row(
        "files",
        "A bag lacks a stream, a part of it, or a file",
        "notes on standard error; exit code 10 where live numbers cannot be repeated",
        "the replay goes on with what there is",
        "array `unrepeated` tells which numbers are not those of the live run",
        "not needed",
    ),
)
def test_a_stream_that_the_live_run_used_and_the_bag_lacks(recording, tmp_path, capsys):
    """The estimate goes on from three heads, and says which ticks are not those of the live run."""
    write_messages(tmp_path / "bag", without(recording, HEAD_C), WIRE)
    out = tmp_path / "out.npz"
    assert main(["replay", str(tmp_path / "bag"), "--machine", "xyzac_trt", "-o", str(out)]) == 10
    said = capsys.readouterr()
    assert f"no sample at all of {HEAD_C}" in said.err
    assert "cannot be repeated: the live run used samples of head_c that the bag lacks" in said.err
    with np.load(out) as found:
        stamps, published = live(recording, MOTION, ["theta", "exc", "eyc"])
        assert len(found["stamp_ns"]) > 0.95 * len(stamps)
        assert found["unrepeated"].all()
        order = np.searchsorted(stamps, found["stamp_ns"])
        inside = order < len(stamps)
        order = order[inside]
        np.testing.assert_array_equal(stamps[order], found["stamp_ns"][inside])
        assert np.abs(found["theta"][inside] - published[order, 0]).max() < 2e-6
        seen = np.isfinite(found["error_motion"][inside, 0])
        assert np.abs(found["error_motion"][inside, 0] - published[order, 1])[seen].max() < 2e-6
        offsets = sum(len(block.rows) for block in recording[OFFSET])  # none before a turn verified the stage
        assert np.isfinite(found["tool_offset"][:, 0]).sum() > 0.95 * offsets


@pytest.mark.few(1)
@pytest.mark.parametrize(("since", "until"), [(6.0, DURATION), (3.0, 5.0)])
def test_a_head_that_falls_silent_in_the_recording_alone(recording, tmp_path, since, until):
    write_messages(tmp_path / "bag", without(recording, HEAD_D, since, until), WIRE)
    result = replay_bag(tmp_path / "bag", STAGE)
    when = seconds(result.stamp_ns)
    assert np.diff(result.stamp_ns).max() == 1_000_000, "no tick is left out"
    np.testing.assert_array_equal(result.unrepeated[when < since - 0.05], False)
    np.testing.assert_array_equal(result.unrepeated[(when > since + 0.05) & (when < until - 0.05)], True)
    np.testing.assert_array_equal(result.unrepeated[when > until + 0.05], False)
    stamps, published = live(recording, MOTION, ["theta"])
    same = np.isin(stamps, result.stamp_ns[~result.unrepeated])
    np.testing.assert_array_equal(
        result.theta[np.isin(result.stamp_ns, stamps) & ~result.unrepeated], published[same, 0]
    )
    text = " ".join(result.remarks)
    assert "the live run used samples of head_d that the bag lacks" in text
    assert (f"{HEAD_D}: no sample in the last" if until == DURATION else f"{HEAD_D}: 2000 samples") in text


@pytest.mark.few(1)
@pytest.mark.parametrize("gone", ["heads", "all sensors"])
@pytest.mark.parametrize(("since", "until"), [(14.0, DURATION), (9.0, 12.0)])
def test_estimates_that_are_not_given_at_all(recording, tmp_path, capsys, gone, since, until):
    """Where no head is left the replay has no estimate to mark: what was published live and is not given counts."""
    left = recording
    for name, topic in TOPICS.items():
        if gone == "all sensors" or name.startswith("head_"):
            left = without(left, topic, since, until)
    write_messages(tmp_path / "bag", left, WIRE)
    out = tmp_path / "out.npz"
    assert main(["replay", str(tmp_path / "bag"), "-o", str(out)]) == 10
    assert "estimates that were published live, from" in capsys.readouterr().err
    stamps, _ = live(recording, MOTION, ["theta"])
    with np.load(out) as found:
        lost = found["lost_stamp_ns"]
        np.testing.assert_array_equal(np.isin(lost, stamps), True)
        assert not np.isin(lost, found["stamp_ns"]).any()
        gone_live = np.count_nonzero((seconds(stamps) > since + 0.05) & (seconds(stamps) < until - 0.6))
        assert 0 <= len(lost) - gone_live < 800


def test_joint_states_that_the_bag_lacks(recording, tmp_path):
    """Where no others are near, corrections are held as they were live; where they are, these count."""
    few = [content for number, content in enumerate(recording[JOINT_STATES]) if number % 3]
    write_messages(tmp_path / "bag", dict(recording) | {JOINT_STATES: few}, WIRE)
    result = replay_bag(tmp_path / "bag", STAGE, MACHINE)
    stamps, published = live(recording, OFFSET, ["x", "y", "z"])
    places = np.searchsorted(result.stamp_ns, stamps)
    again = result.tool_offset[places, :3]
    settled = (seconds(stamps) > 0.3) & np.isfinite(again).all(axis=1)  # a reversal may be told too late to agree
    assert settled.mean() > 0.95
    assert np.abs(again - published)[settled].max() < 2e-6
    exact = ~result.unrepeated[places]
    assert 0.2 < exact[settled].mean() < 0.8
    assert "the live run used joint states that the bag lacks" in " ".join(result.remarks)


@pytest.mark.long
def test_a_recording_that_begins_in_mid_run(recording, tmp_path):
    """Its first ticks rest on samples from before it: they are left out, and that is no remark."""
    late = {
        topic: [content for content in contents if content.stamp_ns >= START + 4 * NANOSECONDS]
        for topic, contents in recording.items()
    }
    write_messages(tmp_path / "bag", late, WIRE)
    result = replay_bag(tmp_path / "bag", STAGE, MACHINE)
    assert result.remarks == () and not result.unrepeated.any() and not len(result.lost_ns)
    assert seconds(result.stamp_ns)[0] < 4.2
    stamps, published = live(recording, MOTION, ["theta"])
    again = np.isin(result.stamp_ns, stamps)
    np.testing.assert_array_equal(result.theta[again], published[np.isin(stamps, result.stamp_ns), 0])


@pytest.mark.long
def test_a_file_of_a_split_bag_is_missing(recording, tmp_path, capsys):
    write_messages(tmp_path / "whole", recording, WIRE)
    bag = tmp_path / "bag"
    reader = BagReader(tmp_path / "whole")
    with BagWriter(bag, list(WIRE), max_file_duration=8.0) as writer:
        for message in reader.messages():
            writer.write(message.topic, message.data, message.log_time_ns)
    np.testing.assert_array_equal(replay_bag(bag, STAGE).theta, replay_bag(tmp_path / "whole", STAGE).theta)
    for name, expected in (("bag_1.mcap", "are missing in"), ("bag_2.mcap", "bag_2.mcap")):
        broken = tmp_path / name
        shutil.copytree(bag, broken)
        (broken / name).unlink()
        assert main(["replay", str(broken), "-o", str(tmp_path / "out.npz")]) == 0, "what is there is repeated"
        said = capsys.readouterr().err
        assert f"metadata.yaml tells of {name}, which is not there" in said
        assert expected in said


def test_a_bag_without_what_was_published(recording, tmp_path):
    """Nothing to repeat: the rules decide, and a stream that is absent is named."""
    rest = {topic: contents for topic, contents in recording.items() if topic not in (MOTION, OFFSET, HEAD_C)}
    write_messages(tmp_path / "bag", rest, WIRE)
    result = replay_bag(tmp_path / "bag", STAGE)
    assert not result.repeated and not result.unrepeated.any()
    assert result.remarks == (f"no sample at all of {HEAD_C}",)


def test_counts_that_do_not_fit_are_said(recording, tmp_path):
    bag = Path(tmp_path / "bag")
    write_messages(bag, recording, WIRE)
    count = len(recording[HEAD_C])
    path = bag / "metadata.yaml"
    path.write_text(path.read_text().replace(f"message_count: {count}", f"message_count: {count - 1}"))
    (remark,) = replay_bag(bag, STAGE).remarks
    assert "another number of messages than metadata.yaml says" in remark


@pytest.mark.few(2)
@pytest.mark.parametrize("lack", ["nothing", "half a head", "a file"])
def test_a_diagnosis_says_what_the_recording_lacks(recording, tmp_path, capsys, lack):
    bag = tmp_path / "bag"
    write_messages(
        tmp_path / "whole", without(recording, HEAD_D, DURATION / 2) if lack == "half a head" else recording, WIRE
    )
    with BagWriter(bag, list(WIRE), max_file_duration=8.0) as writer:
        for message in BagReader(tmp_path / "whole").messages():
            writer.write(message.topic, message.data, message.log_time_ns)
    if lack == "a file":
        (bag / "bag_1.mcap").unlink()
    code = main(["diagnose", str(bag), "--twin", str(config("stage.yaml")), "-o", str(tmp_path / "out"), "--no-report"])
    said = capsys.readouterr()
    content = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert code == 0 and content["verdict"] == "no_gap", said
    wanted = {
        "nothing": [],
        "half a head": [f"{HEAD_D}: no sample in the last 12.0 s of 24.0 s"],
        "a file": ["metadata.yaml tells of bag_1.mcap, which is not there", "(33 %) are missing in 1 silence"],
    }[lack]
    for text in wanted:
        assert text in said.err
        assert any(text in remark for remark in content["remarks"])
    if lack == "nothing":
        assert not any("missing" in remark or "no sample" in remark for remark in content["remarks"])


def test_a_recovery_says_what_the_recording_lacks(recording, tmp_path, capsys):
    write_messages(tmp_path / "bag", without(recording, HEAD_D, DURATION / 2), WIRE)
    assert main(["recover", str(tmp_path / "bag")]) == 0
    assert f"{HEAD_D}: no sample in the last 12.0 s of 24.0 s" in capsys.readouterr().err


@pytest.mark.few(4)
@pytest.mark.parametrize("published", [False, True], ids=["samples alone", "with what was published"])
@pytest.mark.parametrize("behind", [0, 3600], ids=["one clock", "recorder an hour behind"])
@pytest.mark.parametrize("place", ["middle", "last", "all"])
def test_stamps_of_the_future_are_refused_in_a_replay_as_live(recording, tmp_path, place, behind, published):
    """A bag holds when each message came; one from the future would make late all that follows it."""
    messages = [
        (int(block.times_ns[-1]) + 3_000_000, topic, name, block)
        for name, topic in TOPICS.items()
        for block in recording[topic][:150]
    ]
    messages.sort(key=lambda message: message[0])
    estimator, motion = Estimator(STAGE), list[tuple[int, ErrorMotion]]()
    with BagWriter(tmp_path / "bag", list(WIRE)) as writer:
        for number, (arrival, topic, name, block) in enumerate(messages):
            if name == "head_a" and number % 240 > 180:
                rows = block.rows.copy()
                rows[{"middle": len(rows) // 2, "last": -1, "all": slice(None)}[place], 0] += 1.5
                block = SampleBlock(block.stamp_ns, block.names, rows)
            writer.write(topic, encode(block, ""), arrival - behind * NANOSECONDS)
            with suppress(InputError):
                estimator.accept(name, block, arrival)
            motion += [(arrival, made) for made in estimator.advance()]
        for arrival, made in motion if published else ():
            block = block_from_error_motion(made, MOTION_COLUMNS)
            writer.write(MOTION, encode(block, ""), arrival - behind * NANOSECONDS)
    result = replay_bag(tmp_path / "bag", STAGE)
    live = ErrorMotion.joined([made for _, made in motion])
    again = result.motion.at(np.isin(result.stamp_ns, live.times_ns))
    assert len(again.theta) == len(live.theta) > 2900
    differ = (again.theta != live.theta) | (again.streams != live.streams)
    # where all of a block is lost, the last tick before it was reckoned live before that showed
    assert np.count_nonzero(differ) <= (4 if place == "all" else 0)
    assert any("in the future" in remark for remark in result.remarks)
    assert result.status.restarts == estimator.status.restarts == 0


def changed_joints(
    recording: Recording, folder: Path, change: Callable[[JointState], JointState], since: float, until: float
) -> Path:
    """A bag whose joint states are changed from one time to another, s; they arrive 1 ms after their true stamps."""
    messages = [
        (content.stamp_ns + 60_000_000 * (topic != JOINT_STATES), topic, content)
        for topic in (*TOPICS.values(), JOINT_STATES)
        for content in recording[topic][: 400 if topic != JOINT_STATES else 800]
    ]
    with BagWriter(folder, list(WIRE)) as writer:
        for arrival, topic, content in sorted(messages, key=lambda message: message[0]):
            if topic == JOINT_STATES and since <= (arrival - START) / NANOSECONDS < until:
                content = change(content)
            writer.write(topic, encode(content, ""), arrival + 1_000_000)
    return folder


@pytest.mark.parametrize("ahead", [0.2, 0.9, 5.0])
def test_a_joint_state_of_the_future_is_refused_in_a_replay_as_live(recording, tmp_path, ahead):
    def early(state: JointState) -> JointState:
        return replace(state, stamp_ns=state.stamp_ns + round(ahead * NANOSECONDS))

    bag = changed_joints(recording, tmp_path / "bag", early, 5.0, 5.005)
    result = replay_bag(bag, STAGE, MACHINE)
    assert result.tool_offset is not None
    given = np.isfinite(result.tool_offset[:, 0])
    assert given[(seconds(result.stamp_ns) > 4.0) & (seconds(result.stamp_ns) < 7.0)].mean() > 0.98
    assert any(JOINT_STATES in remark and "in the future" in remark for remark in result.remarks)


@pytest.mark.parametrize("scale", [1000.0, 180.0 / np.pi], ids=["mm", "degrees"])
def test_a_replay_says_which_joint_states_and_temperatures_it_did_not_believe(recording, tmp_path, scale):
    def other_unit(state: JointState) -> JointState:
        return replace(state, position=scale * state.position)

    bag = changed_joints(recording, tmp_path / "bag", other_unit, 5.0, 6.0)
    result = replay_bag(bag, STAGE, MACHINE)
    (told,) = (remark for remark in result.remarks if JOINT_STATES in remark)
    assert "not believed" in told and "axis" in told
    assert any("offsets" in remark and "held" in remark for remark in result.remarks)


TEMPERATURE = WIRE.topic("machine_temperature").name
TOLD = {"none": None, "all in K": 293.7, "as it is": 21.5}
"""What the bag has for the machine's temperature."""


@shows(
    Row(
        "files",
        "A bag without the machine's temperature, or with none that can be",
        "a note on standard error: so many tool offsets for which the reference temperature stands in",
        "the reference temperature stands in after `temperature_patience`, as live",
        "offsets and corrections, as uncertain as the machine expands within its range of temperatures",
        "not needed",
    ),
)
@pytest.mark.parametrize("temperature", TOLD.values(), ids=TOLD)
def test_a_replay_says_that_the_reference_temperature_stands_in(recording, tmp_path, temperature):
    contents: dict[str, Sequence[Content]] = dict(without(recording, OFFSET))  # what a live run took repeats itself
    if temperature is not None:
        stamps = range(START, START + DURATION * NANOSECONDS, NANOSECONDS)
        contents[TEMPERATURE] = [Temperature(stamp, temperature, 0.0) for stamp in stamps]
    write_messages(tmp_path / "bag", contents, WIRE)
    result = replay_bag(tmp_path / "bag", STAGE, MACHINE)
    said = [remark for remark in result.remarks if "reference" in remark]
    assert result.tool_offset is not None
    if temperature == TOLD["as it is"]:
        assert said == []
    else:
        (told,) = said
        assert told.startswith(f"{np.count_nonzero(np.isfinite(result.tool_offset[:, 0]))} tool offsets ")


@pytest.mark.parametrize("scale", [1000.0, 180.0 / np.pi], ids=["mm", "degrees"])
def test_a_replay_that_gives_no_offset_says_why_and_ends_with_code_10(recording, tmp_path, capsys, scale):
    def other_unit(state: JointState) -> JointState:
        return replace(state, position=scale * state.position)

    bag = changed_joints(recording, tmp_path / "bag", other_unit, 0.0, DURATION)
    assert main(["replay", str(bag), "--machine", "xyzac_trt", "-o", str(tmp_path / "out.npz")]) == 10
    said = capsys.readouterr()
    assert "note: no tool offset: axis " in said.err and "beyond its travel" in said.err.split("no tool offset")[1]
    assert "0 tool offsets" in said.out


def test_a_bag_that_was_converted_tells_nothing_of_when_its_messages_came(recording, tmp_path):
    """Written all at once, in the order of the stamps: nothing in it is from the future."""
    first = sorted(
        (
            (content.stamp_ns, topic, content)
            for topic in (*TOPICS.values(), JOINT_STATES)
            for content in recording[topic]
        ),
        key=lambda row: row[:2],
    )[:3000]
    with BagWriter(tmp_path / "bag", list(WIRE)) as writer:
        for number, (_, topic, content) in enumerate(first):
            writer.write(topic, encode(content, ""), START + number)
    result = replay_bag(tmp_path / "bag", STAGE, MACHINE)
    assert not any("in the future" in remark for remark in result.remarks)
    assert seconds(result.stamp_ns).max() > 5.0
