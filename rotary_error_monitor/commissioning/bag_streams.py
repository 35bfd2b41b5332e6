"""The raw streams of a bag, as commissioning takes them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from rotary_error_monitor.bags.naming import THE_ONLY_CELL, Naming
from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.commissioning.streams import CommissioningRecording, RawStream, join_blocks
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.description.streams import COMMAND, FORCE
from rotary_error_monitor.description.wire import wire_of
from rotary_error_monitor.metrology.forces import joined_force, load_cell


def read_streams(path: Path | str, stage: StageDescription, naming: Naming = THE_ONLY_CELL) -> CommissioningRecording:
    """Raw streams of all instruments that a stage describes, and of command and force where they are there.

    Raises:
        InputError: the bag cannot be read, or a head has no samples in it.
    """
    wire = wire_of(stage)
    reader = BagReader(path, naming)
    heads = [f"head_{letter}" for letter in stage.azimuths]
    described = [*stage.two_axis, *stage.listed]
    topics = {name: wire.of_stream(name) for name in (*heads, *described, COMMAND, FORCE)}
    reader.check_topics(topics[name].name for name in heads)
    there = [name for name, topic in topics.items() if topic.name in reader.topics and reader.topics[topic.name].count]
    names = [topics[name].name for name in there]
    window = reader.window(names)
    read = reader.read_blocks(names, window)
    blocks = {name: read[topics[name].name] for name in there}
    for name in there:
        for block in blocks[name]:
            block.check_fields(name, topics[name].columns)
    joined = {name: join_blocks(blocks[name], topics[name].columns) for name in there}
    streams = _with_shaft_force(stage, {name: each for name, each in joined.items() if len(each.times_ns)})
    reader.check_topics(topics[name].name for name in heads if name not in streams)
    remarks = [remark for remark in (*reader.remarks, window and window.remark) if remark]
    if COMMAND not in streams:
        remarks.append("no samples of the command: the rotation is counted from the first head, and nothing tells lags")
    return CommissioningRecording(streams, tuple(name for name in described if name not in streams), tuple(remarks))


def _with_shaft_force(stage: StageDescription, streams: dict[str, RawStream]) -> dict[str, RawStream]:
    """The streams with the force on the shaft by listed load cells, where there is no other or the stage names them."""
    names = [name for name in stage.shaft_forces if name in streams]
    if not names or (FORCE in streams and not stage.force):
        return streams
    begin = min(int(streams[name].times_ns[0]) for name in names)
    since = {name: (streams[name].times_ns - begin).astype(np.float64) for name in names}
    times = [1e-9 * since[name] - stage.response(name).latency for name in names]
    cells = [load_cell(stage.inputs[name]) for name in names]
    at, force = joined_force(cells, times, [streams[name].values for name in names])
    return {**streams, FORCE: RawStream(begin + np.rint(1e9 * at).astype(np.int64), force)}
