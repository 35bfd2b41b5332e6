"""Messages as they lie in a bag: CDR bytes, and what they hold."""

from __future__ import annotations

import struct

from rotary_error_monitor.codec.cdr_blocks import BlockDecoder
from rotary_error_monitor.codec.contents import SAMPLE_BLOCK, TYPES, Content
from rotary_error_monitor.errors import InputError, excerpt
from rotary_error_monitor.signals.blocks import NANOSECONDS


def stamp_of(data: bytes | memoryview) -> int:
    """Timestamp (ns) of the header that a message of the contract starts with.

    Raises:
        InputError: the bytes are too short for a header.
    """
    try:
        seconds, nanoseconds = struct.unpack_from("<iI" if data[1] & 1 else ">iI", data, 4)
    except (IndexError, struct.error):
        raise InputError(f"a message of {len(data)} bytes holds no header") from None
    return int(seconds) * NANOSECONDS + int(nanoseconds)


def check_type(msgtype: str) -> None:
    """Refuse a type of messages that is none of those that can be read.

    Raises:
        InputError: so it is; the message names those that can.
    """
    if msgtype not in TYPES.values():
        raise InputError(
            f"cannot read messages of type {excerpt(msgtype)}; readable are {', '.join(sorted(TYPES.values()))}"
        )


class Decoder:
    """Turns the messages of one topic into dataclasses.

    Args:
        msgtype: their type.
        definition: of that type, as the bag holds it; none: that of ROS 2 Jazzy.
        finite: whether a sample block with numbers that are not finite is refused.

    Raises:
        InputError: the type is none of those that can be read, nor is it by its definition.
    """

    def __init__(self, msgtype: str, definition: str = "", *, finite: bool = True) -> None:
        check_type(msgtype)
        self._msgtype, self._definition = msgtype, definition
        self._blocks = BlockDecoder(finite=finite)
        if msgtype != SAMPLE_BLOCK:
            # What reads definitions takes time to load; a bag of sample blocks alone needs none.
            from rotary_error_monitor.codec.definitions import known_typestore

            known_typestore(msgtype, definition)

    def decode(self, data: bytes) -> Content:
        """Content of one message.

        Raises:
            InputError: the bytes are no such message, or a number in a sample block is not finite.
        """
        if self._msgtype == SAMPLE_BLOCK:
            return self._blocks.decode(data)
        from rotary_error_monitor.codec.decoding import content_from_cdr

        return content_from_cdr(data, self._msgtype, self._definition)


def encode(content: Content, frame: str = "") -> bytes:
    """CDR bytes of a message; `frame` is the frame_id of a sample block, which knows none of its own."""
    from rotary_error_monitor.codec.encoding import cdr_from_content

    return cdr_from_content(content, frame)
