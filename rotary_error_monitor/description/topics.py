"""Names of topics as the wire contract has them, by key or by the stream that their sample blocks carry."""

from __future__ import annotations

from functools import cache

from rotary_error_monitor.description.wire import HEAD, SENSOR, Wire, load_wire
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
    names = {topic.frame: topic.name for topic in _contract() if topic.is_sample_block}
    if stream in names:
        return names[stream]
    for frame, name in names.items():
        for several in (HEAD, SENSOR):
            beginning, found, _ = frame.partition(several)
            if found and stream.startswith(beginning):
                return name.replace(several, stream.removeprefix(beginning))
    raise InputError(f"the wire contract has no samples of '{stream}'; it has those of {', '.join(sorted(names))}")


@cache
def _contract() -> Wire:
    """The contract as in a table, with `{head}` and `{sensor}` in the names."""
    return load_wire(None)
