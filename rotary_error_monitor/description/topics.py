"""Names of topics and columns as the wire contract has them, by key or by the stream that their blocks carry."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cache

from rotary_error_monitor.description.definition_files import SENSOR
from rotary_error_monitor.description.wire import HEAD, Topic, Wire, load_wire
from rotary_error_monitor.errors import InputError


def topic_named(key: str) -> str:
    """Name of the topic with that key, which is not one of several heads or sensors.

    Raises:
        InputError: the contract has no such key.
    """
    return _contract().topic(key).name


def pose_topics() -> tuple[str, str, str]:
    """Names of the topics of static poses: joint states, the tool's probe, temperature."""
    return topic_named("machine_joint_states"), topic_named("tool_probe"), topic_named("machine_temperature")


@cache
def samples_topic(stream: str) -> str:
    """Name of the topic with the samples of a stream: of the sensor that its frame is called after, such as `head_a`.

    Raises:
        InputError: the contract has none.
    """
    topic, several, own = _samples(stream)
    return topic.name.replace(several, own) if several else topic.name


@cache
def samples_columns(stream: str) -> tuple[str, ...]:
    """Columns after `t` of the samples of a stream, in the order of the contract; the stream as of `samples_topic`.

    Raises:
        InputError: the contract has none.
    """
    return _samples(stream)[0].columns


@cache
def columns_named(key: str) -> tuple[str, ...]:
    """Columns after `t` of the topic with that key, as of a stage that lists sensors.

    Raises:
        InputError: the contract has no such key.
    """
    return _contract().topic(key).columns


def _samples(stream: str) -> tuple[Topic, str, str]:
    """Topic of the samples of a stream as in a table; where it is one of several its mark, and what that stands for.

    Raises:
        InputError: the contract has none.
    """
    topics = {topic.frame: topic for topic in _contract() if topic.is_sample_block}
    if stream in topics:
        return topics[stream], "", ""
    for frame, topic in topics.items():
        for several in (HEAD, SENSOR):
            beginning, found, _ = frame.partition(several)
            if found and stream.startswith(beginning):
                return topic, several, stream.removeprefix(beginning)
    raise InputError(f"the wire contract has no samples of '{stream}'; it has those of {', '.join(sorted(topics))}")


def stream_of_topic(name: str) -> str | None:
    """Stream whose sample blocks a topic carries, such as `head_a`; None where it carries none.

    What is reckoned from others, and so has no instrument with a frame, is called as in the contract: `error_motion`.
    """
    place = place_of(name)
    if place is None or not place.topic.is_sample_block:
        return None
    topic = place.topic
    if not topic.is_raw:
        return topic.key.removesuffix("_samples")
    for several in (HEAD, SENSOR):
        before, mark, after = topic.name.partition(several)
        if mark:
            return topic.frame.replace(several, place.name.removeprefix(before).removesuffix(after))
    return topic.frame


@dataclass(frozen=True)
class TopicPlace:
    """Where a topic stands.

    Attributes:
        topic: of the contract, as in a table, with `{head}` and `{sensor}` in its name.
        namespace: of its cell, such as `/left`; empty for none.
        name: in the contract, such as `/stage/head_a/samples`.
    """

    topic: Topic
    namespace: str
    name: str


def contract_topics() -> tuple[Topic, ...]:
    """All topics of the contract that belong to a cell, as in a table."""
    return tuple(topic for topic in _contract() if not topic.is_everyones)


def contract_topic(name: str) -> Topic | None:
    """The contract's topic of a name, of whatever head or sensor, as in a table; None where it is none of a cell."""
    place = place_of(name)
    return place.topic if place is not None and not place.namespace else None


def place_of(name: str) -> TopicPlace | None:
    """Namespace and topic of a name such as `/left/stage/head_a/samples`; None where it is no topic of a cell."""
    for topic, pattern in _patterns():
        found = pattern.fullmatch(name)
        if found is not None:
            return TopicPlace(topic, found[1], found[2])
    return None


@cache
def _patterns() -> tuple[tuple[Topic, re.Pattern[str]], ...]:
    """Of each topic of a cell what matches its names: namespace, and name in the contract."""
    made = []
    for topic in contract_topics():
        one = re.escape(topic.name).replace(re.escape(HEAD), "[a-z][a-z0-9]*").replace(re.escape(SENSOR), r"\w+")
        made.append((topic, re.compile(rf"((?:/\w+)*)({one})", re.ASCII)))
    return tuple(made)


@cache
def _contract() -> Wire:
    """The contract as in a table, with `{head}` and `{sensor}` in the names."""
    return load_wire(None)
