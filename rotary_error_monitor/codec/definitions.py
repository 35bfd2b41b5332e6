"""Definitions of message types as a bag holds them: what of them is read, and with what it is read."""

from __future__ import annotations

import functools
from collections.abc import Iterator

from rosbags.interfaces import Nodetype
from rosbags.interfaces.typing import Fielddefs, Typesdict
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from rotary_error_monitor.errors import InputError, excerpt

LONGEST_DEFINITION = 1 << 16
"""Characters of a message's definition: those of ROS 2 have ten thousand at most. Of a longer one nothing is read."""

MOST_FIELDS = 100
"""Fields of a message with those of its parts, each element of an array that is no number counted: code is written for
each of them, and a message of few bytes may have billions. Those that are read have nine to twenty."""


def known_typestore(msgtype: str, definition: str) -> Typestore:
    """What reads messages of a type: the definition of the bag, which takes a tenth of loading all of ROS 2 Jazzy.

    Where the bag has none, half of one or none that can be parsed, that of ROS 2 Jazzy.

    Raises:
        InputError: by the definition of the bag, what is read would have no relation to the bytes that are there.
    """
    found = _typestore(msgtype, definition)
    if isinstance(found, str):
        raise InputError(f"{msgtype} as the bag defines it cannot be read: {found}")
    return found


@functools.cache
def _typestore(msgtype: str, definition: str) -> Typestore | str:
    """The same, or why not: parsing a definition takes as long when it is refused, which is once enough."""
    if definition and len(definition) <= LONGEST_DEFINITION:
        store = get_typestore(Stores.EMPTY)
        try:
            store.register(_needed(get_types_from_msg(definition, msgtype), msgtype))
            store.get_msgdef(msgtype)
        except InputError as error:
            return str(error)
        except Exception:
            pass  # half a definition, or whatever else it is, is no reason not to read the messages
        else:
            return store
    return get_typestore(Stores.ROS2_JAZZY)


def _needed(types: Typesdict, msgtype: str) -> Typesdict:
    """The type and its parts.

    Raises:
        InputError: they are larger than any message, as those are that hold themselves.
        KeyError: a part is not there.
    """
    found: Typesdict = {}
    waiting, count = [msgtype], 0
    while waiting:
        name = waiting.pop()
        found[name] = types[name]
        for field, parts, part in _parts(types[name][1]):
            count += parts
            if count > MOST_FIELDS:
                raise InputError(
                    f"with field '{excerpt(field, 60)}' of {excerpt(name, 60)} it has {count} fields or more, "
                    f"elements of arrays counted; at most {MOST_FIELDS} are read"
                )
            if part:
                waiting += [part] * parts
    return found


def _parts(fields: Fielddefs) -> Iterator[tuple[str, int, str]]:
    """Of each field its name, as how many it counts, and the type of these where it is a message.

    Raises:
        InputError: it is a sequence of messages, which may be as many as the message has bytes.
    """
    for name, desc in fields:
        if desc[0] == Nodetype.ARRAY or desc[0] == Nodetype.SEQUENCE:
            element, length = desc[1]
        else:
            element, length = desc, 1
        part = element[1] if element[0] == Nodetype.NAME else ""
        if desc[0] == Nodetype.SEQUENCE and part:
            raise InputError(f"field '{excerpt(name, 60)}' is a sequence of messages")
        is_number = not part and element[1][0] != "string"
        yield name, 1 if is_number or desc[0] == Nodetype.SEQUENCE else max(length, 1), part
