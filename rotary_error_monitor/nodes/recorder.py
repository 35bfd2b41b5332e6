"""The recorder: a rosbag2 bag of all topics of the wire contract that can be read again whatever happens.

ros2 run rotary_error_monitor recorder --ros-args -p folder:=bags/monday
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from pathlib import Path

from rotary_error_monitor.bags.writer import BagWriter, RecordingStoppedError
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.nodes.diagnostics import Condition, Level
from rotary_error_monitor.nodes.managed import ManagedNode
from rotary_error_monitor.nodes.parameters import Setting
from rotary_error_monitor.nodes.process import run
from rotary_error_monitor.signals.blocks import NANOSECONDS

NAME = "recorder"
_GATHER = 0.02  # s; nothing waits for the recorder, and the middleware knows when each message was received


class Recorder(ManagedNode):
    """Writes every message of the contract, byte for byte as it came.

    What arrived is out of the process within `flush_period` and survives `kill -9`. A full disk ends the recording: it
    is said in the log and in the diagnostics, the bag keeps what it has, and the node goes on saying so.
    """

    settings = (
        Setting("folder", "", "folder of the new bag; empty for bag_<date>_<time> in the working directory"),
        Setting("flush_period", 0.2, "longest time that a message stays in the process, s", (0.01, 10.0)),
    )

    def open(self) -> None:
        """Create the bag and listen to every topic."""
        folder = self.setting("folder") or datetime.now(UTC).strftime("bag_%Y%m%d_%H%M%S")
        topics = tuple(self.wire)
        period = self.setting("flush_period")
        try:
            self._bag: BagWriter | None = BagWriter(Path(folder), topics, flush_period=period)
        except OSError as error:
            raise InputError(f"parameter 'folder': {folder} cannot be written ({error}); give another path") from error
        self._reported = (0, self.now_ns())
        for topic in topics:
            self.listen_to_bytes(topic, self._receiver(topic.name))
        self.gather(_GATHER)
        self.every(period, self._flush)
        self.get_logger().info(f"recording {len(topics)} topics to {folder}")

    def release(self) -> None:
        """Close the bag with its index."""
        bag = getattr(self, "_bag", None)
        self._bag = None
        if bag is not None and bag.stopped is None:
            self._guard(bag.close)

    def conditions(self, now_ns: int) -> list[Condition]:
        """How the recording goes."""
        bag = self._bag
        if bag is None:
            return []
        count, (before, before_ns) = bag.counts.total(), self._reported
        self._reported = (count, now_ns)
        elapsed = (now_ns - before_ns) / NANOSECONDS
        silent = [topic.name for topic in self.wire if not bag.counts[topic.name]]
        figures = {
            "bag": bag.folder,
            "messages": count,
            "rate_hz": (count - before) / elapsed if elapsed > 0 else 0.0,
            "silent_topics": ", ".join(silent) or "none",
        }
        if bag.stopped is not None:
            return [Condition("recording", Level.ERROR, bag.stopped, figures)]
        if count == before:
            return [Condition("recording", Level.WARN, "nothing arrived since the last report", figures)]
        return [Condition("recording", Level.OK, "recording", figures)]

    def _receiver(self, topic: str) -> Callable[[bytes, int], None]:
        def receive(data: bytes, received_ns: int) -> None:
            bag = self._bag
            if bag is not None and bag.stopped is None:
                self._guard(lambda: bag.write(topic, data, received_ns))

        return receive

    def _flush(self) -> None:
        bag = self._bag
        if bag is not None and bag.stopped is None:
            self._guard(bag.flush)

    def _guard(self, action: Callable[[], None]) -> None:
        """Do something to the bag; that the recording had to stop is said once here, and in each diagnostic."""
        try:
            action()
        except RecordingStoppedError as error:
            self.get_logger().fatal(str(error))


def main(args: Sequence[str] | None = None) -> int:
    """Run the node until a signal; the exit code is 0 then, 2 after wrong input."""
    return run(lambda: Recorder(NAME), args)


if __name__ == "__main__":
    sys.exit(main())
