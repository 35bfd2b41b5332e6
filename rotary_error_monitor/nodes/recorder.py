"""The recorder: a rosbag2 bag of all topics of the wire contract that can be read again whatever happens.

ros2 run rotary_error_monitor recorder --ros-args -p folder:=bags/monday
"""

from __future__ import annotations

import contextlib
import shutil
import threading
import time
from collections.abc import Callable, Hashable
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn

from rotary_error_monitor.bags.extra_topics import extra_topics
from rotary_error_monitor.bags.metadata import SIMULATED
from rotary_error_monitor.bags.part import Recordable
from rotary_error_monitor.bags.writer import BagTopic, BagWriter, RecordingStoppedError
from rotary_error_monitor.description.settings import Setting
from rotary_error_monitor.description.wire import Topic
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.nodes import messages
from rotary_error_monitor.nodes.diagnostics import Condition, Level, RateMeter, simulated_topics
from rotary_error_monitor.nodes.managed import ManagedNode
from rotary_error_monitor.nodes.process import program
from rotary_error_monitor.signals.blocks import NANOSECONDS
from rotary_error_monitor.signals.numbering import MessageCount

NAME = "recorder"
LOST = "messages that never came"
"""What the bag calls the messages that were lost on the way to its recorder."""

_GATHER = 0.02  # s; nothing waits for the recorder, and the middleware knows when each message was received
_HISTORY = 5000
"""Messages of each topic that may wait for the recorder: 25 s of 200 blocks a second, 2.5 s of the shortest blocks."""

_SLOW = 0.5
"""Time, s, that messages may wait for the disk before it is said: a tenth of what publishers keep."""

_MEGA = 1e6
_LOOK_PERIOD = 1.0
"""Time, s, between two looks at the room that the disk has."""

_PATIENCE = 0.3
"""Time, s, that a diagnostic waits for the disk before it says that this hangs."""


class Recorder(ManagedNode):
    """Writes every message of the contract, byte for byte as it came; in a namespace, of the cell there.

    What arrived is out of the process within `flush_period` and survives `kill -9`. While the node is paused or the
    disk is slow, messages wait; what is lost all the same is counted and said. A full disk ends the recording, and so
    does a folder that somebody removes: it is said in the log and in the diagnostics, the bag keeps what it has, and
    the node goes on saying so. No other recorder and no recovery takes the bag meanwhile.
    """

    settings = (
        Setting("folder", "", "folder of the new bag; empty for bag_<date>_<time> in the working directory"),
        Setting("flush_period", 0.2, "longest time that a message stays in the process, s", (0.01, 10.0)),
        Setting(
            "max_file_size",
            1 << 30,
            "size from which the recording goes on in a new file of the bag, bytes; 0 for one file however long",
            (0, 1 << 62),
        ),
        Setting(
            "max_file_duration",
            900.0,
            "time after which the recording goes on in a new file of the bag, s; 0 for one file however long",
            (0.0, 1e9),
        ),
        Setting(
            "keep_size",
            0,
            "size of all files of the bag: when one ends, the oldest go until the next has room, bytes; 0 for all",
            (0, 1 << 62),
        ),
        Setting(
            "keep_duration",
            0.0,
            "age from which a file of the bag goes, when another one ends, s; 0 for never",
            (0.0, 1e10),
        ),
        Setting(
            "extra_topics",
            "",
            "topics of standard messages beside those of the contract: NAME TYPE, NAME TYPE; a name may be relative",
        ),
        Setting("compression", "zstd", "of the bag; each reader of mcap knows these", choices=("zstd", "lz4", "none")),
    )

    def open(self) -> None:
        """Create the bag and listen to every topic."""
        folder = self.setting("folder") or datetime.now(UTC).strftime("bag_%Y%m%d_%H%M%S")
        heard = self._heard()
        topics = [BagTopic(name, topic.type, topic.qos) for name, topic in heard.items()]
        period = self.setting("flush_period")
        try:
            self._bag: BagWriter | None = BagWriter(
                Path(folder),
                topics,
                flush_period=period,
                max_file_size=self.setting("max_file_size"),
                max_file_duration=self.setting("max_file_duration"),
                keep_size=self.setting("keep_size"),
                keep_duration=self.setting("keep_duration"),
                compression=self.setting("compression"),
            )
        except OSError as error:
            raise InputError(f"parameter 'folder': {folder} cannot be written ({error}); give another path") from error
        self._reported, self._rate = 0, RateMeter(self.now_ns())
        self._counts = {name: MessageCount(partial(self.count_publishers, topic.name)) for name, topic in heard.items()}
        self._lost: dict[str, int] = {}
        self._names = {topic.name: name for name, topic in heard.items()}
        self._simulated_topics: set[str] = set()
        self._said = 0
        self._begun: float | None = None
        self._waited = 0.0
        for name, topic in heard.items():
            self.listen_to_numbered(topic, self._receiver(name), _HISTORY)
        self.gather(_GATHER)
        self._free: int | None = None
        self._ending = threading.Event()
        self._flusher = threading.Thread(target=self._flush_regularly, args=(period, self._ending), name="flush")
        self._flusher.start()
        self.get_logger().info(f"recording {len(topics)} topics to {folder}")
        if not self._bag.locked:
            self.get_logger().warning(
                f"the file system of {folder} knows no locks: let nobody recover the bag while it is recorded"
            )

    def _heard(self) -> dict[str, Recordable]:
        """Each topic by its name in the bag: a bag of one machine is the same in any namespace.

        Raises:
            InputError: the parameter names a topic that is recorded anyway, or is no list of topics.
        """
        pairs = zip(self.contract.read_by(NAME), self.wire.read_by(NAME), strict=True)
        heard: dict[str, Recordable] = {topic.name: here for topic, here in pairs if self.is_wanted(topic)}
        try:
            for topic in extra_topics(self.setting("extra_topics")):
                name = self.resolve_topic_name(topic.name)
                if name in {other.name for other in heard.values()}:
                    raise InputError(f"{name} is recorded anyway; leave it out")
                messages.message_class(topic.type)  # before a bag is begun
                heard[name] = replace(topic, name=name)
        except InputError as error:
            raise InputError(f"parameter 'extra_topics': {error}") from None
        return heard

    def is_wanted(self, topic: Topic) -> bool:
        """Whether a topic of the contract is recorded."""
        return True

    def note(self, topic: str, data: bytes) -> None:
        """Take note of a message that was recorded, by the topic's name in the bag."""

    @property
    def stopped(self) -> str | None:
        """Why recording ended by itself; None while it goes on."""
        return None if self._bag is None else self._bag.stopped

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Begin to record; what was published while the node was inactive is not lost but not wanted."""
        for count in self._counts.values():
            count.forget()
        return super().on_activate(state)

    def release(self) -> None:
        """Close the bag with its index."""
        bag = getattr(self, "_bag", None)
        self._bag = None
        if bag is None:
            return
        self._ending.set()
        self._flusher.join()
        for topic, count in self._counts.items():
            self._note_lost(topic, count.finish())
        if bag.stopped is None:
            self._say_lost(bag)
            self._say_simulated(bag)
            self._guard(bag.close)

    def diagnose(self) -> messages.Message:
        """The message for `/diagnostics`, also while the disk takes nothing and everything else waits for it."""
        if self.busy.acquire(timeout=_PATIENCE):
            try:
                return super().diagnose()
            finally:
                self.busy.release()
        begun = self._begun
        waiting = time.monotonic() - begun if begun is not None else _PATIENCE
        text = (
            f"the disk has taken nothing for {waiting:.1f} s; messages wait, and are lost once publishers forget them"
        )
        return self.report(self.now_ns(), [Condition("recording", Level.ERROR, text, {"waiting_s": waiting})])

    def conditions(self, now_ns: int) -> list[Condition]:
        """How the recording goes."""
        bag = self._bag
        if bag is None:
            return []
        count, before = bag.counts.total(), self._reported
        lost, waited = sum(self._lost.values()), self._waited
        self._reported, self._waited = count, 0.0
        self._rate.add(count - before)
        silent = [name for name in self._counts if not bag.counts[name]]
        figures = {
            "bag": bag.moved or bag.folder,
            "messages": count,
            "rate_hz": self._rate.rate(now_ns),
            "lost_messages": lost,
            "lost_of": _listed(self._lost) or "none",
            "longest_wait_ms": waited * 1e3,
            "silent_topics": ", ".join(silent) or "none",
            "size_mb": bag.size / _MEGA,
            "free_mb": "unknown" if self._free is None else self._free / _MEGA,
        }
        if bag.stopped is not None:
            return [Condition("recording", Level.ERROR, bag.stopped, figures)]
        reasons = []
        if lost > self._said:
            reasons.append(f"{lost - self._said} messages lost since the last report; of all: {_listed(self._lost)}")
            self._said = lost
        if count == before:
            reasons.append("nothing arrived since the last report")
        if waited > _SLOW:
            reasons.append(f"messages waited up to {waited:.1f} s to be written")
        if bag.moved is not None:
            reasons.append(f"the folder was renamed to {bag.moved}; recording goes on there")
        return [Condition("recording", Level.WARN if reasons else Level.OK, "; ".join(reasons) or "recording", figures)]

    def news(self, now_ns: int) -> Hashable:
        """Whether recording has stopped, or its folder is another one."""
        return None if self._bag is None else (self._bag.stopped, self._bag.moved)

    def _receiver(self, topic: str) -> Callable[[bytes, int, int | None], None]:
        count, tells_origin = self._counts[topic], topic == self.contract.topic("diagnostics").name

        def receive(data: bytes, received_ns: int, number: int | None) -> None:
            bag = self._bag
            if bag is None or bag.stopped is not None:
                return
            if number is not None:
                self._note_lost(topic, count.observe(number))
            self._guard(lambda: bag.write(topic, data, received_ns, sequence=number or 0))
            self._waited = max(self._waited, (self.now_ns() - received_ns) / NANOSECONDS)
            self.note(topic, data)
            if tells_origin:
                self._note_simulated(data)

        return receive

    def _note_lost(self, topic: str, messages: int) -> None:
        if messages:
            self._lost[topic] = self._lost.get(topic, 0) + messages

    def _note_simulated(self, data: bytes) -> None:
        """Take note of the topics that a node's diagnostics call simulated."""
        self._simulated_topics |= {self._names[topic] for topic in simulated_topics(data) if topic in self._names}

    def _flush_regularly(self, period: float, ending: threading.Event) -> None:
        """Also where nothing more arrives, and not on the executor: what speaks there must not wait for the disk."""
        looked = -_LOOK_PERIOD
        while not ending.wait(period):
            if time.monotonic() - looked >= _LOOK_PERIOD:
                looked = time.monotonic()
                self._look_at_disk()
            with self.busy:
                bag = self._bag
                if bag is not None and bag.stopped is None:
                    self._say_lost(bag)
                    self._guard(bag.flush)
                    if self._say_simulated(bag) and bag.stopped is None:
                        self._guard(bag.write_notes)

    def _look_at_disk(self) -> None:
        """How much room it has; a disk that hangs may keep whoever asks, so that nobody else may wait for this."""
        bag = self._bag
        if bag is not None:
            with contextlib.suppress(OSError):
                self._free = shutil.disk_usage(bag.moved or bag.folder).free

    def _say_lost(self, bag: BagWriter) -> None:
        """In the log as soon as it is known, and in the bag for whoever reads it later."""
        text = _listed(self._lost)
        if text and bag.notes.get(LOST) != text:
            bag.notes[LOST] = text
            self.get_logger().warning(f"{LOST}: {text}")

    def _say_simulated(self, bag: BagWriter) -> bool:
        """In the bag; whether there is something new, which is written at once.

        What a recorder that is killed leaves shall not pass for a recording of a real cell.
        """
        text = ", ".join(sorted(self._simulated_topics))
        is_new = bool(text) and bag.notes.get(SIMULATED) != text
        if is_new:
            bag.notes[SIMULATED] = text
        return is_new

    def _guard(self, action: Callable[[], None]) -> None:
        """Do something to the bag; that the recording had to stop is said once here, and in each diagnostic."""
        self._begun = time.monotonic()
        try:
            action()
        except RecordingStoppedError as error:
            self.get_logger().fatal(str(error))
        self._begun = None


def _listed(lost: dict[str, int]) -> str:
    return ", ".join(f"{count} of {topic}" for topic, count in sorted(lost.items()))


main = program(Recorder, NAME)

if __name__ == "__main__":
    raise SystemExit(main())
