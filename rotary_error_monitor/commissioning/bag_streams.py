"""The raw streams of a bag, as commissioning takes them."""

from __future__ import annotations

from pathlib import Path

from rotary_error_monitor.bags.naming import THE_ONLY_CELL, Naming
from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.commissioning.command import COMMAND
from rotary_error_monitor.commissioning.commission import AUTOCOLLIMATOR, FORCE
from rotary_error_monitor.commissioning.streams import Recorded, join_blocks
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.wire import wire_of

LVDT = "lvdt"


def read_streams(path: Path | str, stage: StageDescription, naming: Naming = THE_ONLY_CELL) -> Recorded:
    """Raw streams of all instruments that a stage describes, and of command and force where they are there.

    Raises:
        InputError: the bag cannot be read, or a head has no samples in it.
    """
    wire = wire_of(stage)
    reader = BagReader(path, naming)
    heads = [f"head_{letter}" for letter in stage.azimuths]
    described = [
        *([AUTOCOLLIMATOR] if stage.autocollimator is not None else []),
        *([LVDT] if stage.lvdt is not None else []),
        *stage.listed,
    ]
    topics = {name: wire.of_stream(name) for name in (*heads, *described, COMMAND, FORCE)}
    reader.check_topics(topics[name].name for name in heads)
    there = [name for name, topic in topics.items() if topic.name in reader.topics and reader.topics[topic.name].count]
    window = reader.window([topics[name].name for name in there])
    blocks = reader.read_blocks([topics[name].name for name in there], window)
    joined = {name: join_blocks(blocks[topics[name].name], topics[name].columns) for name in there}
    streams = {name: stream for name, stream in joined.items() if len(stream.times_ns)}
    reader.check_topics(topics[name].name for name in heads if name not in streams)
    remarks = [remark for remark in (*reader.remarks, window and window.remark) if remark]
    if COMMAND not in streams:
        remarks.append("no samples of the command: the rotation is counted from the first head, and nothing tells lags")
    return Recorded(streams, tuple(name for name in described if name not in streams), tuple(remarks))
