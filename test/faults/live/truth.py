"""What is true in a mock cell at any time, and how what was published stands to it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from rotary_error_monitor.codec.error_motion_blocks import error_motion_from_block
from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.metrology.error_motion import COMPONENTS
from rotary_error_monitor.plant.machine import MachinePlant, make_poses
from rotary_error_monitor.plant.stage import StagePlant
from rotary_error_monitor.signals.blocks import SampleBlock
from rotary_error_monitor.sources.mock_machine import MachineMotion

SIGMAS = 6.0
"""Stated standard deviations within which what is published is right."""

LAST_DIGIT = 1e-12
"""What rounding makes of a number that is right, m and rad."""


@dataclass(frozen=True)
class Judged:
    """What became of n published values.

    Attributes:
        stamps: (n,) timestamp (ns).
        off: (n,) largest error over its standard deviation.
        what: what they are, for messages.
    """

    stamps: NDArray[np.int64]
    off: NDArray[np.float64]
    what: str

    @property
    def wrong(self) -> NDArray[np.int64]:
        """Stamps of those that are not right."""
        return self.stamps[~(self.off <= SIGMAS)]


class Truth:
    """The mock stage and machine, exactly."""

    def __init__(self, plant: StagePlant, machine: MachineDescription) -> None:
        self._plant = plant
        self._machine = machine
        self._motion = MachineMotion(machine, plant)
        self._true = MachinePlant(machine)

    def of_motion(self, block: SampleBlock) -> Judged:
        """Every component of error motion that is said to be observable."""
        motion = error_motion_from_block(block)
        true = self._scene(block.times_ns).error_motion
        off = motion.components - true
        off[:, 5] -= 2 * np.pi * np.rint(off[:, 5] / (2 * np.pi))
        deviation = np.sqrt(np.diagonal(motion.covariance, axis1=1, axis2=2))
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = np.where(motion.observable, np.abs(off) / deviation, 0.0)
        return Judged(block.times_ns, ratio.max(axis=1), f"error motion ({', '.join(COMPONENTS)})")

    def offset(self, stamps: NDArray[np.int64], corrections: NDArray[np.float64] | None = None) -> NDArray[np.float64]:
        """(n, 6) tool offset of the true machine at these stamps (ns), with these corrections of its axes."""
        states = [self._motion.at(int(stamp)) for stamp in stamps]
        positions = np.array([[axis.position for axis in state] for state in states])
        directions = np.sign([[axis.velocity for axis in state] for state in states])
        scene = self._scene(stamps)
        live = scene.error_motion.copy()
        live[:, 2] = np.nan  # the machine as described has that axial motion: nothing measures it
        poses = make_poses(self._machine, positions, directions, scene.warming + self._machine.reference_temperature)
        return self._true.tool_offset(poses, corrections, live)

    def of_offset(self, stamp_ns: int, pose: object, correction: dict[str, float] | None = None) -> Judged:
        """A published pose of the tool's offset, with the correction that it speaks of."""
        applied = None if correction is None else np.array([[correction[a] for a in self._machine.letters]])
        stamps = np.array([stamp_ns])
        true = self.offset(stamps, applied)
        position, turn = pose.pose.position, pose.pose.orientation
        found = np.array([position.x, position.y, position.z, *_rotation(turn)])
        variance = np.diag(np.reshape(pose.covariance, (6, 6)))
        off = np.abs(found - true) - LAST_DIGIT
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = np.where(variance >= 0.0, np.maximum(off, 0.0) / np.sqrt(np.maximum(variance, 1e-30)), 0.0)
        what = "tool offset" if correction is None else "what corrections leave"
        return Judged(stamps, ratio.max(axis=1), what)

    def _scene(self, stamps: NDArray[np.int64]):
        return self._plant.scene((stamps - self._plant.epoch_ns) * 1e-9)


def _rotation(turn: object) -> NDArray[np.float64]:
    return Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_rotvec()
