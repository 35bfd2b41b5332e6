"""What a run of the mock cell recorded, gone through once: figures ask for the same topics again and again."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.codec.contents import Content
from rotary_error_monitor.description.response import Response
from rotary_error_monitor.description.wire import Topic
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.responses import correct_block
from rotary_error_monitor.signals.blocks import SampleBlock


class RecordedTopics:
    """Contents of a bag by topic."""

    def __init__(self, bag: Path, topics: Iterable[Topic]) -> None:
        """Read those of the topics that have a message.

        Raises:
            InputError: a message is broken.
        """
        self._reader = BagReader(bag)
        have = self._reader.topics
        wanted = list(dict.fromkeys(each.name for each in topics if each.name in have and have[each.name].count))
        self._arrivals: dict[str, list[tuple[Content, int]]] = {name: [] for name in wanted}
        for name, content, arrival_ns in self._reader.replay_arrivals(wanted):
            self._arrivals[name].append((content, arrival_ns))

    def __contains__(self, topic: Topic) -> bool:
        """Whether the topic has a message."""
        return topic.name in self._arrivals

    def arrivals(self, topic: Topic) -> list[tuple[Content, int]]:
        """Contents of a topic in the order of their stamps, with when each was recorded, timestamp (ns).

        Raises:
            InputError: the topic has no message.
        """
        self._reader.check_topics([topic.name])
        return self._arrivals[topic.name]

    def samples(
        self, topic: Topic, columns: tuple[str, ...] | None = None, response: Response | None = None
    ) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """Times (n,) of the samples of a topic, timestamps (ns), and their values (n, k) by columns.

        Args:
            topic: which.
            columns: the fields, by default all.
            response: of the instrument, which is taken off.

        Raises:
            InputError: the topic has no message, or carries something else than samples.
        """
        names = columns or topic.columns
        times, values = [], []
        for content, _ in self.arrivals(topic):
            if not isinstance(content, SampleBlock):
                raise InputError(f"{self._reader.path}: {topic.name} carries something else than samples")
            block = correct_block(content, names, response)
            times.append(block.times_ns)
            values.append(block.columns(names))
        return np.concatenate(times), np.concatenate(values)
