"""Topics that are recorded beside those of the wire contract, as a user names them."""

from __future__ import annotations

from rotary_error_monitor.bags.writer import BagTopic
from rotary_error_monitor.description.wire_section import Qos
from rotary_error_monitor.errors import InputError, excerpt

ANY_PUBLISHER = Qos("best_effort", "volatile", "keep_last", 1000)
"""Quality of service that fits the publisher of any driver: best effort listens to reliable ones as well."""


def extra_topics(text: str) -> tuple[BagTopic, ...]:
    """Topics from a text such as `/spindle/current std_msgs/msg/Float64, coolant sensor_msgs/msg/Temperature`.

    Raises:
        InputError: it is no such list, or names a topic twice.
    """
    found: dict[str, BagTopic] = {}
    for entry in filter(None, map(str.strip, text.split(","))):
        name, _, kind = entry.partition(" ")
        if not kind.strip():
            raise InputError(
                f"'{excerpt(entry)}': expected name and type of a topic, such as /spindle/current std_msgs/msg/Float64 "
                "(a comma between two of them)"
            )
        if name in found:
            raise InputError(f"{excerpt(name)} stands twice; name each topic once")
        found[name] = BagTopic(name, kind.strip(), ANY_PUBLISHER)
    return tuple(found.values())
