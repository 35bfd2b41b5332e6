"""Recordings of the mock cell's signals, made without starting it."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path

import numpy as np

from rotary_error_monitor.analysis.trend import DAY_NS
from rotary_error_monitor.bags.writer import write_messages
from rotary_error_monitor.codec.contents import JointState
from rotary_error_monitor.description.harmonics import PlanarHarmonic
from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.description.topics import samples_topic
from rotary_error_monitor.description.wire import load_wire
from rotary_error_monitor.sources.mock import MockSettings, mock_stage
from rotary_error_monitor.sources.mock_machine import MachineMotion

EPOCH_NS = 1_763_700_000_000_000_000
STREAMS = (*(f"head_{head}" for head in "abcd"), "autocollimator", "command", "lvdt", "temperature")


def record(folder, plant, streams, seconds):
    """Record streams of the true stage from its epoch on, four blocks a second."""
    contents = {}
    for stream in streams:
        edges = [plant.index_at(stream, plant.epoch_ns + k * 250_000_000) for k in range(int(4 * seconds) + 1)]
        contents[samples_topic(stream)] = [
            plant.samples(stream, first, last - first) for first, last in itertools.pairwise(edges) if last > first
        ]
    write_messages(folder, contents)
    return folder


def write_stage_bag(folder, seconds, streams=STREAMS, stage=None, seed=5, begin_ns=EPOCH_NS):
    """Record a stage alone that turns at 4 rad/s; what the mock cell draws is by the seed."""
    plant = mock_stage(stage or load_stage(), MockSettings(seed, begin_ns, (4.0,), forces=False, rate=500.0))
    return record(folder, plant, streams, seconds)


def leaning(amplitude):
    """Stage of which the residual synchronous tilt about x is twice the amplitude (rad), largest less smallest."""
    stage = load_stage()
    tilt = (PlanarHarmonic(3, (amplitude, 0.0), (0.0, 0.0)),)
    return replace(stage, spindle=replace(stage.spindle, tilt=tilt, radial=()))


def write_day(folder, day, amplitude, seed=None, seconds=4):
    """Record a leaning stage on a day, with noise of that day's own."""
    begin_ns = EPOCH_NS + day * DAY_NS
    return write_stage_bag(folder, seconds, stage=leaning(amplitude), seed=seed or day + 1, begin_ns=begin_ns)


def write_mock_bag(folder: Path, samples: int) -> Path:
    """Record a stage that turns at 3 rad/s, and the machine `xyzac_trt` that carries it, in `folder`.

    Args:
        folder: of the bag to be made; it is given back.
        samples: of each stream of the stage, 2,000 a second.
    """
    wire = load_wire()
    plant = mock_stage(load_stage(), MockSettings(1, EPOCH_NS, (3.0,), True, 2_000.0))
    topics = {wire.topic("head_samples", name).name: f"head_{name}" for name in "abcd"}
    topics |= {wire.topic(f"{name}_samples").name: name for name in ("autocollimator", "command")}
    contents = {
        topic: [plant.samples(stream, first, 200) for first in range(0, samples, 200)]
        for topic, stream in topics.items()
    }
    motion = MachineMotion(load_machine("xyzac_trt"), plant)
    states = [(EPOCH_NS + k * 10_000_000, motion.at(EPOCH_NS + k * 10_000_000)) for k in range(samples // 20)]
    contents[wire.topic("machine_joint_states").name] = [
        JointState(
            stamp,
            tuple(axis.letter for axis in state),
            np.array([axis.position for axis in state]),
            np.array([axis.velocity for axis in state]),
            np.zeros(len(state)),
        )
        for stamp, state in states
    ]
    write_messages(folder, contents, wire)
    return folder
