"""Names of topics by key and by stream are those of the contract."""

from __future__ import annotations

import pytest

from rotary_error_monitor.description.topics import pose_topics, samples_topic, topic_named
from rotary_error_monitor.description.wire import load_wire
from rotary_error_monitor.errors import InputError

WIRE = load_wire(("a", "b", "upper1"))


def test_the_samples_of_each_stream_are_on_the_topic_whose_frame_is_called_so():
    topics = [topic for topic in WIRE if topic.key.endswith("_samples") and topic.frame not in ("stage", "workpiece")]
    assert {topic.frame for topic in topics} >= {"head_a", "head_upper1", "autocollimator", "lvdt", "command", "force"}
    for topic in topics:
        assert samples_topic(topic.frame) == topic.name


def test_poses_have_their_topics_by_key():
    assert pose_topics() == tuple(
        WIRE.topic(key).name for key in ("machine_joint_states", "tool_probe", "machine_temperature")
    )
    assert topic_named("axis_corrections") == WIRE.topic("axis_corrections").name


@pytest.mark.parametrize("stream", ["hygrometer", "", "head"])
def test_what_the_contract_does_not_have_is_named(stream):
    with pytest.raises(InputError, match=f"no samples of '{stream}'; it has those of autocollimator, axial_probe_"):
        samples_topic(stream)
    with pytest.raises(InputError, match="no topic 'humidity'"):
        topic_named("humidity")
