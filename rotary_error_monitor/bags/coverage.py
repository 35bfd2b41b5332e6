"""What the streams of a bag cover, as its messages are gone through."""

from __future__ import annotations

from rotary_error_monitor.codec.contents import SAMPLE_BLOCK, TYPES, JointState
from rotary_error_monitor.codec.messages import Decoder, stamp_of
from rotary_error_monitor.errors import InputError, one_line
from rotary_error_monitor.signals.blocks import SampleBlock
from rotary_error_monitor.signals.coverage import MessageSpans, coverage_remarks


class BagCoverage:
    """Takes note of the messages that come at a rate: sample blocks and joint states; of others nobody expects one."""

    def __init__(self) -> None:
        self._spans: dict[str, MessageSpans] = {}
        self._decoder = Decoder(SAMPLE_BLOCK)

    def note(self, topic: str, msgtype: str, data: bytes) -> None:
        """Take note of a message; of one that is none of its type there is nothing to note."""
        if msgtype not in (SAMPLE_BLOCK, TYPES[JointState]):
            return
        spans = self._spans.setdefault(topic, MessageSpans())
        try:
            content = self._decoder.decode(data) if msgtype == SAMPLE_BLOCK else stamp_of(data)
        except InputError:
            return
        if isinstance(content, SampleBlock):
            spans.add_block(content)
        elif isinstance(content, int):
            spans.add_stamp(content)

    def remarks(self) -> tuple[str, ...]:
        """What the streams lack, by their own rates and beside one another."""
        found = {one_line(topic): spans.coverage() for topic, spans in self._spans.items()}
        return coverage_remarks({topic: each for topic, each in found.items() if each is not None})
