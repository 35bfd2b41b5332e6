"""Reading a rosbag2 bag: whole ones, and what is readable of those whose recorder was killed."""

from __future__ import annotations

import heapq
import os
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from rotary_error_monitor.bags.bag_files import ENCODING, BagFiles, TopicContent
from rotary_error_monitor.bags.listing import count_remarks
from rotary_error_monitor.bags.naming import ROOT, THE_ONLY_CELL, NamedFiles, Naming
from rotary_error_monitor.bags.order import GROUP, Order, Ordering
from rotary_error_monitor.bags.recorded_files import RawMessage
from rotary_error_monitor.bags.window import Window
from rotary_error_monitor.codec.cdr_blocks import BlockDecoder
from rotary_error_monitor.codec.contents import SAMPLE_BLOCK, TYPES, Content, complete_ns
from rotary_error_monitor.codec.messages import Decoder, check_type, stamp_of
from rotary_error_monitor.errors import InputError, excerpt, one_line, told_of
from rotary_error_monitor.files import exists
from rotary_error_monitor.signals.blocks import SampleBlock


class BagReader:
    """One bag: a folder with `metadata.yaml` and mcap (or sqlite3) files, the same without its end, or one mcap file.

    Attributes:
        path: the bag.
        topics: type and number of messages by topic, those of its cell by their names in the wire contract.
        damage: None for a bag that is whole, else what is wrong with it and how much of it can be read.
        notes: what else its recorder noted, texts by name, such as `SIMULATED`.
        remarks: what a reader of the bag should be told: the damage, what `metadata.yaml` says that is not so, and
            what its recorder noted.

    Raises:
        InputError: there is no bag, nothing in it can be read, or it holds several cells and `naming` names none.
    """

    def __init__(self, path: Path | str, naming: Naming = THE_ONLY_CELL) -> None:
        self.path = Path(path)
        if not exists(self.path):
            raise InputError(f"{excerpt(self.path)}: no such bag; give the folder of a rosbag2 bag, or an mcap file")
        self._files = BagFiles(self.path)
        self._source = NamedFiles(self._files, naming, self.path)
        self.topics: Mapping[str, TopicContent] = self._source.topics
        self.damage = self._files.damage and one_line(self._files.damage)
        self.notes: Mapping[str, str] = self._files.metadata.notes
        self.remarks = tuple(self._remarks())
        self._ordered: tuple[tuple[str, ...], Order] | None = None

    def _remarks(self) -> Iterator[str]:
        if self.damage:
            yield self.damage
        metadata = self._files.metadata
        if metadata.counts and not self.damage:  # else nobody expects that the counts fit
            for remark in count_remarks(metadata, {name: topic.count for name, topic in self._files.topics.items()}):
                yield f"{self.path}: {one_line(remark)}"
        yield from map(one_line, self._files.remarks)
        for name, text in metadata.notes.items():
            yield f"{self.path}: {excerpt(name)}: {excerpt(text)}"

    def check_topics(self, names: Iterable[str]) -> None:
        """Hold the bag against the topics that somebody needs.

        Raises:
            InputError: some are missing or without a message; the message names them and what the bag has.
        """
        missing = [name for name in names if name not in self.topics or not self.topics[name].count]
        if missing:
            have = ", ".join(name for name, topic in self.topics.items() if topic.count) or "no message at all"
            damage = f"; {self.damage}" if self.damage else ""
            cell = "" if self._source.cell == ROOT else f" in cell {one_line(self._source.cell)}"
            raise InputError(
                f"{self.path}: no message on {', '.join(missing)}{cell}; the bag has {one_line(have)}{damage}"
            )

    def messages(self, names: Collection[str] | None = None) -> Iterator[RawMessage]:
        """Messages of some topics, by default all, as bytes in the order of their recording.

        Raises:
            InputError: a message cannot be unpacked, or the file changed meanwhile.
        """
        return self._source.messages(set(self.topics if names is None else names))

    def window(self, names: Collection[str]) -> Window | None:
        """The time of the recording that these topics make together; None where they have no message.

        Messages that are damaged count by their stamps: reading them says what is wrong with them.

        Raises:
            InputError: a topic or its type cannot be read, or a message is too short for a stamp.
        """
        span_ns = self._order(self._chosen(names)).span_ns
        return None if span_ns is None else Window(*span_ns)

    def replay(
        self,
        names: Collection[str] | None = None,
        window: Window | None = None,
        refuse: Callable[[str, InputError], None] | None = None,
    ) -> Iterator[tuple[str, Content]]:
        """Contents in the order of their stamps, whatever the order in which they arrived.

        The bag is gone through twice, first for the stamps; in memory is only what waits for its turn, so that bags of
        any size can be replayed. Equal stamps come in the order of the topics' names, then of their recording.

        Args:
            names: topics, by default all whose type can be read.
            window: what lies outside of it is left out.
            refuse: takes the topic of a broken message and what is wrong with it, and the replay goes on, as a node
                does; samples that are not finite come as they are then. Without it broken messages are errors.

        Raises:
            InputError: a topic or its type cannot be read, or a message is broken; the message says topic and stamp.
        """
        for topic, content, _ in self.replay_arrivals(names, window, refuse):
            yield topic, content

    def replay_arrivals(
        self,
        names: Collection[str] | None = None,
        window: Window | None = None,
        refuse: Callable[[str, InputError], None] | None = None,
    ) -> Iterator[tuple[str, Content, int]]:
        """The same with the time at which each was recorded, timestamp (ns), by the clock that made the stamps.

        Where a recorder's own clock was behind those of the instruments, so that ordinary samples seem to be in the
        future, it is set right by the median of them. Where most messages were written at another time than they came
        (converted bags), nothing is taken for the future.
        """
        chosen = self._chosen(names)
        decoders = {name: self._decoder(name, finite=refuse is None) for name in chosen}
        order = self._order(chosen)
        for ready in self._by_stamp(chosen, order):
            try:
                content = self._decode(decoders[ready.topic], ready)
            except InputError as error:
                if refuse is None:
                    raise
                refuse(ready.topic, error)
                continue
            kept = content if window is None else window.cut(ready.topic, content)
            if kept is not None:
                arrival_ns = ready.log_time_ns + order.behind_ns
                yield ready.topic, kept, arrival_ns if order.timely else max(arrival_ns, complete_ns(kept))

    def _by_stamp(self, names: Collection[str], order: Order) -> Iterator[RawMessage]:
        """Messages by stamp, topic, and when they were recorded: what waits is what later ones may come before.

        Raises:
            InputError: they are not those that the first pass has found.
        """
        places = {name: place for place, name in enumerate(sorted(names))}
        waiting: list[tuple[int, int, int, RawMessage]] = []
        count = 0
        for message in self.messages(names):
            heapq.heappush(waiting, (self._stamp(message), places[message.topic], count, message))
            count += 1
            if count % GROUP == 0 and count < order.count:
                earliest = order.earliest[count // GROUP]
                while waiting and waiting[0][0] < earliest:
                    yield heapq.heappop(waiting)[-1]
        if count != order.count:
            raise InputError(f"{self.path}: the bag changed while it was read; read it again")
        while waiting:
            yield heapq.heappop(waiting)[-1]

    def read(self, names: Collection[str] | None = None, window: Window | None = None) -> dict[str, list[Content]]:
        """All contents by topic, each topic in the order of its stamps; what is asked for and empty is an empty list.

        Args and errors as in `replay`.

        Raises:
            InputError: as `replay`, or the contents are larger than the memory of this computer.
        """
        chosen = self._chosen(names)
        self._check_memory(chosen)
        decoders = {name: self._decoder(name) for name in chosen}
        contents: dict[str, list[Content]] = {name: [] for name in chosen}
        for message in self.messages(chosen):
            content = self._decode(decoders[message.topic], message)
            kept = content if window is None else window.cut(message.topic, content)
            if kept is not None:
                contents[message.topic].append(kept)
        for found in contents.values():
            found.sort(key=lambda content: content.stamp_ns)
        return contents

    def read_blocks(
        self, names: Collection[str] | None = None, window: Window | None = None
    ) -> dict[str, list[SampleBlock]]:
        """Sample blocks by topic in the order of their stamps, by default of every topic that carries blocks.

        Args as in `replay`.

        Raises:
            InputError: a topic is missing or carries something else, or a block is broken or not finite; the message
                says topic and stamp.
        """
        if names is None:
            names = [name for name, topic in self.topics.items() if topic.type == SAMPLE_BLOCK]
        for name in self._chosen(names):
            if self.topics[name].type != SAMPLE_BLOCK:
                raise InputError(
                    f"{self.path}: {one_line(name)} is a {excerpt(self.topics[name].type)}; "
                    f"sample blocks are {SAMPLE_BLOCK}"
                )
        return {
            name: [content for content in contents if isinstance(content, SampleBlock)]
            for name, contents in self.read(names, window).items()
        }

    def _decoder(self, name: str, *, finite: bool = True) -> Decoder:
        topic = self.topics[name]
        with told_of(f"{self.path}: {one_line(name)}"):
            return Decoder(topic.type, topic.definition, finite=finite)

    def _chosen(self, names: Collection[str] | None) -> list[str]:
        if names is None:
            names = [name for name, topic in self.topics.items() if topic.type in TYPES.values()]
        missing = [name for name in names if name not in self.topics]
        if missing:
            raise InputError(
                f"{self.path}: no topic {one_line(', '.join(missing))}; the bag has "
                f"{one_line(', '.join(self.topics)) or 'none'}"
            )
        for name in names:
            self._check_readable(name)
        return list(names)

    def _check_readable(self, name: str) -> None:
        """Refuse a topic before the bytes of its messages are taken for what they are not."""
        topic = self.topics[name]
        if topic.encoding != ENCODING:
            raise InputError(
                f"{self.path}: {one_line(name)} is encoded as '{excerpt(topic.encoding)}'; readable is {ENCODING}"
            )
        with told_of(f"{self.path}: {one_line(name)}"):
            check_type(topic.type)

    def _order(self, names: Sequence[str]) -> Order:
        """When the messages of these topics are; the answer to the last question is kept."""
        if self._ordered is None or self._ordered[0] != tuple(names):
            blocks = {name: BlockDecoder() for name in names if self.topics[name].type == SAMPLE_BLOCK}
            found = Ordering(names)
            for message in self.messages(names):
                found.note(message, self._stamp(message), blocks.get(message.topic))
            self._ordered = tuple(names), found.result()
        return self._ordered[1]

    def _check_memory(self, names: Iterable[str]) -> None:
        size = sum(self._source.sizes[name] for name in set(names))
        memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
        if size > memory:
            raise InputError(
                f"{self.path}: the messages to be read at once have {size / 1e9:.1f} GB, this computer has "
                f"{memory / 1e9:.1f} GB of memory; give a shorter recording"
            )

    def _stamp(self, message: RawMessage) -> int:
        try:
            return stamp_of(message.data)
        except InputError as error:
            raise InputError(
                f"{self.path}: {one_line(message.topic)}, recorded at {message.log_time_ns} ns: {error}"
            ) from error

    def _decode(self, decoder: Decoder, message: RawMessage) -> Content:
        expected = self.topics[message.topic].type
        if message.type != expected:
            names = f"{expected} and {excerpt(message.type)}"
            raise InputError(f"{self.path}: {one_line(message.topic)} carries {names}; expected one")
        try:
            return decoder.decode(message.data)
        except InputError as error:
            stamp = self._stamp(message)
            raise InputError(
                f"{self.path}: {one_line(message.topic)}, message with stamp {stamp} ns: {error}"
            ) from error
