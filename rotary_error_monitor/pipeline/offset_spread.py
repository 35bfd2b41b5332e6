"""How uncertain an offset is: by what is measured, what the description stands in for, warmth and unseen travel."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.description.stage_limits import StageLimits
from rotary_error_monitor.machine.error_model import described_components, predict_tool_offset, propagate_covariance
from rotary_error_monitor.machine.kinematics import MachineModel, arrange_machine
from rotary_error_monitor.machine.uncertainty import shifts_at_a_pose
from rotary_error_monitor.pipeline.description_spread import DescriptionSpread
from rotary_error_monitor.pipeline.poses import TimedPoses

_STATED_PERIOD_NS = 1_000_000_000
"""Time, ns, for which what the description states counts for all poses: each number in it takes a pass over the
machine, and it changes little while an axis goes some centimetres."""


class Spread(NamedTuple):
    """Covariance of the offsets at n poses.

    Attributes:
        lasting: (n, 6, 6) of what lasts, as far as it is known: a reason to hold corrections where it is large.
        reported: (n, 6, 6) that, and axes that may have turned back since their joint state. It is over as soon as the
            next joint state tells the direction, and no reason to hold. NaN where the offset rests on a description
            that states no uncertainty.
    """

    lasting: Array
    reported: Array


class OffsetSpread:
    """Covariance of a machine's offsets, pose after pose (JCGM 102:2011, 6.2: the law of propagation)."""

    def __init__(self, machine: MachineDescription, model: MachineModel, limits: StageLimits) -> None:
        """Covariance for `machine`, arranged as `model`, whose monitored axis is a stage with these limits."""
        self._model = model
        self._description = DescriptionSpread(model, limits)
        measured = [axis.letter == machine.monitored for axis in machine.axes]  # its encoder tells where it is
        self._fastest = np.where(measured, 0.0, [axis.fastest for axis in machine.axes])
        self._quickest = np.where(measured, 0.0, [axis.quickest for axis in machine.axes])
        self._reversal = np.array([axis.reversal for axis in machine.axes])
        self._stated = None if machine.monitored else _Stated(machine)
        self._warms = any(axis.expansion != 0.0 for axis in machine.axes)

    def at(self, poses: TimedPoses, offset: Array) -> Spread:
        """Covariance of the (n, 6) offset of poses."""
        if len(poses.stamps) == 0:  # as for most blocks: reports are rarer
            return Spread(np.zeros((0, 6, 6)), np.zeros((0, 6, 6)))
        covariance = poses.covariance(np.arange(len(poses.stamps)))
        known = True
        if self._stated is None:
            covariance = self._of_components(poses, covariance)
        else:
            known, covariance = self._stated.is_known, self._stated.at(poses, offset)
        lasting = [*self._warmed(poses), *self._moved_since(poses)]
        passing = list(self._turned_since(poses))
        effects = self._effects(poses, offset, lasting + passing)
        squares = effects[..., :, None] * effects[..., None, :]
        covariance = covariance + squares[: len(lasting)].sum(axis=0)
        reported = covariance + squares[len(lasting) :].sum(axis=0)
        return Spread(covariance, reported if known else np.full_like(reported, np.nan))

    def _of_components(self, poses: TimedPoses, covariance: Array) -> Array:
        """(n, 6, 6) from the live components, and from the described ones that stand in where none is observable."""
        described = described_components(
            self._model, poses.positions, direction=poses.directions, temperature=poses.temperature
        )
        if poses.live is not None:
            for time, live, said in zip(poses.stamps.tolist(), poses.live, described, strict=True):
                self._description.learn(time, live, said)
        return propagate_covariance(self._model, poses.positions, covariance, self._description.deviations)

    def _effects(self, poses: TimedPoses, offset: Array, changed: list[_Changed]) -> Array:
        """(k, n, 6) what each change of the poses makes of the offset, times its scale."""
        if not changed:
            return np.zeros((0, *offset.shape))
        # One pass over the machine for all of them: a pass costs its calls, hardly its poses.
        k = len(changed)
        offsets = predict_tool_offset(
            self._model,
            np.concatenate([each.poses.positions for each in changed]),
            direction=np.concatenate([each.poses.directions for each in changed]),
            temperature=np.concatenate([each.poses.temperature for each in changed]),
            monitored=None if poses.live is None else np.tile(poses.live, (k, 1)),
        )
        scales = np.array([each.scale for each in changed])
        return np.asarray((offsets.reshape(k, *offset.shape) - offset) * scales[:, :, None])

    def _warmed(self, poses: TimedPoses) -> Iterator[_Changed]:
        if self._warms and (poses.temperature_deviation > 0.0).any():
            yield _Changed(replace(poses, temperature=poses.temperature + 1.0), poses.temperature_deviation)

    def _moved_since(self, poses: TimedPoses) -> Iterator[_Changed]:
        """For each axis that may have accelerated since its joint state.

        What it has gone unseen is rectangular, as an unknown within bounds is (JCGM 100:2008, 4.3.7).
        """
        farthest = np.minimum(0.5 * self._quickest * poses.age[:, None] ** 2, self._fastest * poses.age[:, None])
        for axis in np.flatnonzero(farthest.any(axis=0)):
            moved = poses.positions.copy()
            moved[:, axis] += farthest[:, axis] / math.sqrt(3.0)
            yield _Changed(replace(poses, positions=moved), np.ones(len(moved)))

    def _turned_since(self, poses: TimedPoses) -> Iterator[_Changed]:
        """For each axis that may have turned back since its joint state."""
        for axis in np.flatnonzero((poses.turned * self._reversal).any(axis=0)):
            directions = poses.directions.copy()
            directions[:, axis] *= -1.0
            yield _Changed(replace(poses, directions=directions), np.sqrt(poses.turned[:, axis]))


class _Stated:
    """What the stated uncertainty of a description makes of offsets that rest on it alone.

    Attributes:
        is_known: whether it states any.
    """

    def __init__(self, machine: MachineDescription) -> None:
        self._models = [arrange_machine(shift.machine) for shift in shifts_at_a_pose(machine)]
        self._period = -1
        self._covariance = np.zeros((6, 6))
        self.is_known = bool(self._models)

    def at(self, poses: TimedPoses, offset: Array) -> Array:
        """(n, 6, 6) for poses with the (n, 6) offset; zero where nothing is stated."""
        found = np.zeros((len(offset), 6, 6))
        for i, period in enumerate((poses.stamps // _STATED_PERIOD_NS).tolist() if self.is_known else ()):
            if period != self._period:
                self._period, self._covariance = period, self._of(poses.at(np.array([i])), offset[i])
            found[i] = self._covariance
        return found

    def _of(self, pose: TimedPoses, offset: Array) -> Array:
        effects = np.concatenate([pose.offsets(model) for model in self._models]) - offset
        return np.asarray(effects.T @ effects)


class _Changed(NamedTuple):
    """Poses with one input changed, and the (n,) standard uncertainties of that input in units of the change."""

    poses: TimedPoses
    scale: Array
