"""Who publishes a topic: whether one alone feeds it, for two make one signal of two, and whether it can be heard."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Iterator, Sequence
from itertools import pairwise

from rclpy.node import Node
from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo

from rotary_error_monitor.errors import excerpt
from rotary_error_monitor.nodes import messages

MEMORY = 1.0
"""Time, s, after the last sign of a second publisher in which a topic counts as shared, if messages come often."""

_PAUSES = 2.5
"""The same in pauses between messages, where these are long: two that speak in turn give a sign once a pause."""


class SoleSource:
    """Watches the sequence numbers of one topic: each publisher counts its own one by one.

    Where a number does not go on, another publisher speaks, or the only one began anew or lost some. Where the next
    number of the one before then comes after all, that one is still there, and there are two, however seldom one of
    them speaks. The graph would tell as well, but it keeps a publisher that was killed for some twenty seconds.
    """

    def __init__(self) -> None:
        self._last: int | None = None
        self._before: int | None = None
        self._seen: float | None = None
        self._times: deque[float] = deque(maxlen=4)  # two that speak at once, twice

    def note(self, number: int | None, now: float) -> None:
        """Take note of a message's publication sequence number at a time (s) that never steps.

        The number is None where the middleware tells none.
        """
        if number is None:
            return
        self._times.append(now)
        if self._last is not None and number != self._last + 1:
            if self._before is not None and number == self._before + 1:
                self._seen = now
            self._before = self._last
        self._last = number

    def is_shared(self, now: float) -> bool:
        """Whether several publishers speak, as of the time `now`, s."""
        if self._seen is None:
            return False
        pause = max((after - before for before, after in pairwise(self._times)), default=0.0)
        return now - self._seen <= max(MEMORY, _PAUSES * pause)


NAMELESS = "(a node of unknown name)"
_UNKNOWN = "_UNKNOWN_"


def name_of(publisher: TopicEndpointInfo) -> str:
    """Name of the node that a publisher belongs to."""
    name = f"{publisher.node_namespace.rstrip('/')}/{publisher.node_name}"
    return NAMELESS if _UNKNOWN in name else name


class Names:
    """Names of publishers, as the graph told them at any time while they are there.

    It may forget whose one is while it goes on, such as when another node of that name has ended.
    """

    def __init__(self) -> None:
        self._known: dict[tuple[int, ...], str] = {}

    def of(self, publishers: Sequence[TopicEndpointInfo]) -> list[str]:
        """Name of the node that each of all publishers of a topic belongs to."""
        there = [tuple(each.endpoint_gid) for each in publishers]
        told = [name_of(each) for each in publishers]
        known = {
            gid: self._known.get(gid, name) if name == NAMELESS else name for gid, name in zip(there, told, strict=True)
        }
        self._known = {gid: name for gid, name in known.items() if name != NAMELESS}
        return [known[gid] for gid in there]


def deafness(publisher: TopicEndpointInfo, kind: str, qos: QoSProfile) -> str:
    """Why a subscription of type `kind` (`sensor_msgs/msg/JointState`) does not hear a publisher; empty if it does."""
    if publisher.topic_type != kind:
        return f"of type {excerpt(publisher.topic_type)}, which is not heard"
    compatibility, reason = qos_check_compatible(publisher.qos_profile, qos)
    return f"not heard: {reason}" if compatibility == QoSCompatibility.ERROR else ""


class Listening:
    """The topics that a node listens to, and who speaks there."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._sources: dict[str, SoleSource] = {}
        self._subscriptions: dict[str, Subscription] = {}

    def source(self, topic: str) -> SoleSource:
        """To be told the number of each message of a topic."""
        return self._sources.setdefault(topic, SoleSource())

    def subscribed(self, topic: str, subscription: Subscription) -> None:
        """Take note of what hears a topic."""
        self._subscriptions[topic] = subscription

    def clear(self) -> None:
        """The node listens to nothing any longer."""
        self._sources.clear()
        self._subscriptions.clear()

    def is_shared(self, topic: str) -> bool:
        """Whether several publishers speak on a topic."""
        return topic in self._sources and self._sources[topic].is_shared(time.monotonic())

    def publishers_of(self, topic: str) -> str:
        """Who publishes a topic that several publish, in words."""
        names = sorted(map(name_of, self._node.get_publishers_info_by_topic(topic)))
        return f"several publishers share {topic}: {', '.join(names) or 'unknown'}; only one of them may speak"

    def wrong(self) -> Iterator[tuple[str, list[str]]]:
        """Topics on which several speak, or somebody who cannot be heard, with what is wrong there."""
        for topic, subscription in self._subscriptions.items():
            kind = messages.type_name(subscription.msg_type)
            reasons = [self.publishers_of(topic)] if self.is_shared(topic) else []
            for publisher in self._node.get_publishers_info_by_topic(topic):
                if why := deafness(publisher, kind, subscription.qos_profile):
                    reasons.append(f"{name_of(publisher)} on {topic} ({why})")
            if reasons:
                yield topic, reasons
