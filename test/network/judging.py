"""What was published over a network, held against the true stage and machine of the mock sources."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.codec.error_motion_blocks import error_motion_from_block
from rotary_error_monitor.codec.messages import Decoder
from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.description.wire import Wire
from rotary_error_monitor.plant.machine import MachinePlant, make_poses
from rotary_error_monitor.sources.mock import MockSettings, mock_stage
from rotary_error_monitor.sources.mock_machine import MachineMotion

ALL_STREAMS = 0b111111
"""Four heads, autocollimator and command."""


@dataclass(frozen=True)
class Estimates:
    """Published estimates.

    Attributes:
        stamp_ns, arrived_ns: (n,) of the tick, and when the recorder had it, timestamps (ns).
        complete: (n,) whether all streams are in it.
        wrong: (n,) whether a component that is said to be observable is off by more than six of its stated standard
            deviations.
    """

    stamp_ns: NDArray[np.int64]
    arrived_ns: NDArray[np.int64]
    complete: NDArray[np.bool_]
    wrong: NDArray[np.bool_]


@dataclass(frozen=True)
class Corrections:
    """Corrections of one topic.

    Attributes:
        stamp_ns, arrived_ns: (n,) of the correction, and when the recorder had it, timestamps (ns).
        values: (n, axes) m and rad.
        before, after: (n,) true distance of the tool tip from where it should be without correction and with it, m.
    """

    stamp_ns: NDArray[np.int64]
    arrived_ns: NDArray[np.int64]
    values: NDArray[np.float64]
    before: NDArray[np.float64]
    after: NDArray[np.float64]

    def between(self, begin_ns: int, end_ns: int) -> Corrections:
        """Those stamped from `begin_ns` to before `end_ns`."""
        part = (self.stamp_ns >= begin_ns) & (self.stamp_ns < end_ns)
        return Corrections(*(each[part] for each in vars(self).values()))


class Judge:
    """Holds a recording against the stage and machine that the mock sources made it of."""

    def __init__(self, bag: Path, wire: Wire, machine: str, settings: MockSettings) -> None:
        """Judge of a bag by the settings of its mock sources."""
        self._reader, self._wire = BagReader(bag), wire
        self._machine = load_machine(machine)
        self._epoch_ns = settings.epoch_ns
        self._plant = mock_stage(load_stage(), settings)

    def estimates(self) -> Estimates:
        """All estimates."""
        blocks, arrived = self._read("error_motion_samples", lambda block: len(block.rows))
        times = np.concatenate([block.times_ns for block in blocks])
        motions = [error_motion_from_block(block) for block in blocks]
        true = self._plant.scene(self._seconds(times)).error_motion
        off = np.concatenate([motion.components for motion in motions]) - true
        off[:, 5] -= 2 * np.pi * np.rint(off[:, 5] / (2 * np.pi))
        deviation = np.sqrt(np.concatenate([np.diagonal(motion.covariance, axis1=1, axis2=2) for motion in motions]))
        said = np.concatenate([motion.observable for motion in motions])
        complete = np.concatenate([block.column("streams") for block in blocks]) == ALL_STREAMS
        return Estimates(times, arrived, complete, (said & ~(np.abs(off) <= 6.0 * deviation)).any(axis=1))

    def corrections(self, key: str) -> Corrections:
        """Corrections that were published (`axis_corrections`) or are in effect (`applied_corrections`)."""
        messages, arrived = self._read(key, lambda _: 1)
        stamps = np.array([message.stamp_ns for message in messages])
        letters = self._machine.letters
        told = [dict(zip(each.names, each.position.tolist(), strict=True)) for each in messages]
        values = np.array([[each.get(letter, 0.0) for letter in letters] for each in told])
        motion = MachineMotion(self._machine, self._plant)
        states = [motion.at(int(stamp)) for stamp in stamps]
        positions = np.array([[axis.position for axis in state] for state in states])
        directions = np.sign([[axis.velocity for axis in state] for state in states])
        scene = self._plant.scene(self._seconds(stamps))
        live = scene.error_motion.copy()
        live[:, 2] = np.nan  # no sensor sees axial motion: true is what the description says
        poses = make_poses(self._machine, positions, directions, scene.warming + self._machine.reference_temperature)
        before, after = (
            np.linalg.norm(MachinePlant(self._machine).tool_offset(poses, each, live)[:, :3], axis=1)
            for each in (None, values)
        )
        return Corrections(stamps, arrived, values, before, after)

    def _read(self, key: str, count: Callable[[Any], int]) -> tuple[list[Any], NDArray[np.int64]]:
        """Messages of a topic, and when each of their `count` items arrived."""
        topic = self._wire.topic(key)
        decoder = Decoder(topic.type)
        found, arrived = [], []
        for message in self._reader.messages([topic.name]):
            content = decoder.decode(message.data)
            found.append(content)
            arrived += [message.log_time_ns] * count(content)
        return found, np.array(arrived)

    def _seconds(self, stamps: NDArray[np.int64]) -> NDArray[np.float64]:
        return np.asarray((stamps - self._epoch_ns) * 1e-9)
