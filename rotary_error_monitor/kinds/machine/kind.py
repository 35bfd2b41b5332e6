"""Machine tools as a kind of thing to be diagnosed: bags of static poses with what a probe shows at each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rotary_error_monitor.codec.contents import Content, JointState, PointStamped, Temperature
from rotary_error_monitor.description.machine import MachineDescription, load_machine, machine_mapping
from rotary_error_monitor.description.topics import pose_topics
from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.effects.machine_effect import MachineEffect
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.gap.kind import Kind, TwinFile, check_amended, opened_bag
from rotary_error_monitor.kinds.machine.problem import MachineProblem
from rotary_error_monitor.twin.machine import FEWEST_POSES, MachineRecording


class MachineKind(Kind[MachineDescription, MachineEffect, MachineProblem]):
    """Machine tools."""

    effect = MachineEffect

    def describe(self, path: Path) -> MachineDescription:
        """Section `machine`."""
        return load_machine(path)

    def problem(
        self, recording: Path, twin: TwinFile[MachineDescription, MachineEffect], most_rate: float
    ) -> MachineProblem:
        """A bag of joint states and the tool's probe, with temperature where it is recorded."""
        with opened_bag(recording, twin.naming) as reader:
            needed = pose_topics()
            reader.check_topics(needed[:2])
            names = [name for name in needed if name in reader.topics]
            poses = record_poses(reader.read(names), twin.description, str(reader.path))
            machine = twin.description
            for cause in twin.known:
                machine = self.amended(machine, cause)
            return MachineProblem(machine, replace(poses, remarks=(*reader.remarks, *poses.remarks)), twin.effects)

    def attempt(self, problem: MachineProblem, cause: Cause) -> None:
        """The effect gives a description."""
        check_amended(self.amended(problem.machine, cause))

    def amended(self, description: MachineDescription, cause: Cause) -> MachineDescription:
        """The description with the effect in it."""
        assert isinstance(cause.effect, MachineEffect)
        return cause.effect.amend(description, cause.values, cause.location)

    def mapping(self, description: MachineDescription) -> dict[str, Any]:
        """Content of section `machine`."""
        return machine_mapping(description)


def record_poses(topics: Mapping[str, Sequence[Content]], machine: MachineDescription, origin: str) -> MachineRecording:
    """Poses of a machine: joint states, probe and temperature that share a stamp.

    Raises:
        InputError: an axis is missing, a value is not finite, or fewer than 12 poses are complete.
    """
    pose, probe, thermometer = pose_topics()
    probes = {item.stamp_ns: item.point for item in topics[probe] if isinstance(item, PointStamped)}
    warmth = {item.stamp_ns: item.temperature for item in topics.get(thermometer, ()) if isinstance(item, Temperature)}
    states = [item for item in topics[pose] if isinstance(item, JointState) and item.stamp_ns in probes]
    if len(states) < FEWEST_POSES:
        raise InputError(f"{origin}: {len(states)} poses with a probe of the same stamp; {FEWEST_POSES} are needed")
    positions, directions = [], []
    for state in states:
        missing = [letter for letter in machine.letters if letter not in state.names]
        if missing:
            raise InputError(f"{origin}: {pose} at {state.stamp_ns} ns has {state.names}, but no {', '.join(missing)}")
        order = [state.names.index(letter) for letter in machine.letters]
        positions.append(state.position[order])
        directions.append(np.sign(state.velocity[order]) if len(state.velocity) else np.zeros(len(order)))
    temperature = [warmth.get(state.stamp_ns, np.nan) for state in states]
    recording = MachineRecording(
        np.asarray(positions),
        np.asarray(directions),
        np.asarray(temperature, np.float64),
        np.asarray([probes[state.stamp_ns] for state in states]),
        _lost_poses(len(topics[pose]), len(states)),
    )
    for name, values in (("position", recording.positions), ("probe", recording.probe)):
        bad = np.flatnonzero(~np.isfinite(values).all(axis=1))
        if len(bad):
            raise InputError(
                f"{origin}: {name} at {states[int(bad[0])].stamp_ns} ns is {values[bad[0]]}; expected finite numbers"
            )
    return recording


def _lost_poses(all_poses: int, used: int) -> tuple[str, ...]:
    return (f"{all_poses - used} of {all_poses} poses have no probe and were left out",) if used < all_poses else ()
