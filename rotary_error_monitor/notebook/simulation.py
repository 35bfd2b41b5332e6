"""A recording of a simulated stage whose truth is known, made without ROS and without waiting: to try things out."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from rotary_error_monitor.bags.metadata import SIMULATED
from rotary_error_monitor.bags.writer import write_messages
from rotary_error_monitor.description.stage import StageDescription, load_stage
from rotary_error_monitor.description.wire import Wire, wire_of
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.plant.stage import StagePlant
from rotary_error_monitor.signals.blocks import NANOSECONDS
from rotary_error_monitor.sources.mock import MockSettings, mock_stage

EPOCH_NS = 1_763_700_000 * NANOSECONDS
"""When a simulated recording begins, timestamp (ns): the same each time, so that the bag is."""

_BLOCK_NS = NANOSECONDS // 4
"""Time of the samples of one message, ns."""

_SPEED = 4.0
"""Speed of the rotor, rad/s: six turns forward and six backward."""


def simulate_bag(
    folder: Path | str,
    stage: StageDescription | Path | str | None = None,
    *,
    seconds: float = 21.5,
    speeds: Sequence[float] = (_SPEED,),
    seed: int = 1,
    forces: bool = False,
) -> StagePlant:
    """Record a simulated stage as the mock cell has it; the bag says that it is simulated.

    The stage stands, turns at each speed for 9.25 s, as long backward at each, and stands. Its instruments are those of
    the description, each with its noise, resolution and clock.

    Args:
        folder: new folder of the bag.
        stage: the true stage, as a description or its YAML file; None for the one that the package ships.
        seconds: length of the recording, s.
        speeds: of the rotor, rad/s.
        seed: of noise and jitter.
        forces: whether something pushes at the shaft now and then.

    Returns:
        The truth, with `signal` and `scene` as functions of the time after `EPOCH_NS`, s.

    Raises:
        InputError: the folder exists, the description is wrong, or the length is no time.
    """
    if not (np.isfinite(seconds) and seconds > 0):
        raise InputError(f"seconds is {seconds}; it must be a time above 0")
    described = stage if isinstance(stage, StageDescription) else load_stage(stage)
    plant = mock_stage(described, MockSettings(seed, EPOCH_NS, tuple(speeds), forces))
    end_ns = EPOCH_NS + round(seconds * NANOSECONDS)
    write_plant(folder, plant, [*range(EPOCH_NS, end_ns, _BLOCK_NS), end_ns], wire_of(described))
    return plant


def write_plant(folder: Path | str, plant: StagePlant, edges_ns: Sequence[int], wire: Wire) -> None:
    """Write a bag of all streams of a true stage, a message each from one of the timestamps (ns) to the next."""
    contents = {}
    for stream in plant.streams:
        places = [plant.index_at(stream, edge) for edge in edges_ns]
        blocks = [plant.samples(stream, first, last - first) for first, last in pairwise(places) if last > first]
        contents[wire.of_stream(stream).name] = blocks
    write_messages(folder, contents, wire, {SIMULATED: ", ".join(contents)})
