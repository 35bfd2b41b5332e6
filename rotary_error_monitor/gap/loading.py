"""A recording and a twin from files, joined to a problem of diagnosis."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rotary_error_monitor.bags.contents import Content, JointState, PointStamped, Temperature
from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.description.machine import MachineDescription, load_machine
from rotary_error_monitor.description.mount import MountDescription, load_mount
from rotary_error_monitor.description.quadrature import QuadratureDescription, load_quadrature
from rotary_error_monitor.description.stage import StageDescription, load_stage
from rotary_error_monitor.description.yaml_files import read_yaml
from rotary_error_monitor.effects.effect import AnyEffect, Cause
from rotary_error_monitor.effects.library import load_effects
from rotary_error_monitor.effects.machine_effect import MachineEffect
from rotary_error_monitor.effects.mount_effect import MountEffect
from rotary_error_monitor.effects.quadrature_effect import QuadratureEffect
from rotary_error_monitor.effects.rotor import StageEffect
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.gap.problem import DiagnosableProblem
from rotary_error_monitor.gap.trial import (
    try_machine_effects,
    try_mount_effects,
    try_quadrature_effects,
    try_stage_effects,
)
from rotary_error_monitor.twin.document import causes_from_rows, effect_rows, machine_mapping, stage_mapping
from rotary_error_monitor.twin.machine import FEWEST_POSES, MachineRecording
from rotary_error_monitor.twin.rates import MOST_RATE
from rotary_error_monitor.twin.recording import StageRecording, record_stage, stage_topic

if TYPE_CHECKING:
    from rotary_error_monitor.gap.machine.problem import MachineProblem
    from rotary_error_monitor.gap.stage.problem import StageProblem

POSE = "/machine/joint_states"
PROBE = "/machine/tool_probe"
WARMTH = "/machine/temperature"


Description = StageDescription | MachineDescription | MountDescription | QuadratureDescription

_KINDS: Mapping[str, tuple[type[AnyEffect], Callable[[Path], Description]]] = {
    "stage": (StageEffect, load_stage),
    "machine": (MachineEffect, load_machine),
    "mount": (MountEffect, load_mount),
    "quadrature": (QuadratureEffect, load_quadrature),
}
"""For each section that makes a file a twin: the base of its effects, and what reads it."""

_SECTIONS = " or ".join(f"'{name}'" for name in _KINDS)


@dataclass(frozen=True)
class TwinFile:
    """A twin as read from a file.

    Attributes:
        description: of a stage, a machine, a mount, or sine and cosine signals.
        effects: the effects known in this run, of its kind.
        known: effects that the twin already has besides its parameters.
    """

    path: Path
    description: Description
    effects: tuple[AnyEffect, ...]
    known: tuple[Cause, ...] = ()


def load_twin(path: Path, effect_files: Sequence[Path] = ()) -> TwinFile:
    """Twin of a stage, a machine, a mount or a pair of signals, by the section that its file has.

    Raises:
        InputError: the file is missing, holds none of these sections, or breaks its schema.
    """
    content = _content(path)
    for section, (kind, load) in _KINDS.items():
        if section in content:
            effects = load_effects(kind, effect_files)
            known = causes_from_rows(content.get("effects", []), effects, str(path))
            return TwinFile(path, load(path), effects, known)
    raise InputError(f"{path}: no section {_SECTIONS}; it has {sorted(map(str, content)) or 'nothing'}")


def load_problem(recording: Path, twin: TwinFile, most_rate: float = MOST_RATE) -> DiagnosableProblem:
    """A recording beside a twin: a bag for a stage or a machine, a text file for a mount or a pair of signals.

    A bag whose end or one of whose files is missing gives what is readable, and the problem's remarks say how much that
    is and what its streams lack.

    Args:
        recording: its bag or file.
        twin: that is held against it.
        most_rate: samples a second (Hz) that are used of one sensor of a stage.

    Raises:
        InputError: the file does not hold what the twin needs, values are not finite, or the recording is too short.
    """
    if isinstance(twin.description, MountDescription):
        return _mount_problem(recording, twin, twin.description)
    if isinstance(twin.description, QuadratureDescription):
        return _quadrature_problem(recording, twin, twin.description)
    reader = BagReader(recording)
    remarks = reader.remarks
    try:
        if isinstance(twin.description, StageDescription):
            return _stage_problem(reader, twin, twin.description, remarks, most_rate)
        return _machine_problem(reader, twin, twin.description, remarks)
    except InputError as error:
        raise InputError("; ".join([str(error), *(each for each in remarks if each not in str(error))])) from error


def improved_twin(twin: TwinFile, causes: Sequence[Cause]) -> dict[str, Any]:
    """Content of a twin file with the causes in it: in its parameters where they have a place there, or as effects."""
    content = _content(twin.path)
    description, others = twin.description, list(twin.known)
    for cause in causes:
        effect = cause.effect
        if isinstance(description, StageDescription) and isinstance(effect, StageEffect):
            amended = effect.amend(description, cause.values, cause.location)
            if amended is description or amended == description:
                others.append(cause)
            description = amended
        elif isinstance(description, MachineDescription) and isinstance(effect, MachineEffect):
            description = effect.amend(description, cause.values, cause.location)
        else:
            others.append(cause)
    if isinstance(description, StageDescription):
        content["stage"] = stage_mapping(description)
    elif isinstance(description, MachineDescription):
        content["machine"] = machine_mapping(description)
    content.pop("effects", None)
    if others:
        content["effects"] = effect_rows(others)
    return content


def _content(path: Path) -> dict[str, Any]:
    content = read_yaml(path, "a twin's YAML file").content
    if not isinstance(content, dict):
        raise InputError(f"{path}: no twin; expected a mapping with a section {_SECTIONS}")
    return content


def _stage_problem(
    reader: BagReader, twin: TwinFile, stage: StageDescription, remarks: tuple[str, ...], most_rate: float
) -> StageProblem:
    # The libraries of a stage's signals take a second to load, which a machine need not wait for.
    from rotary_error_monitor.gap.stage.stretches import stage_problem

    letters = sorted(stage.encoder.azimuths)
    needed = [
        *(stage_topic(f"head_{letter}") for letter in letters),
        stage_topic("autocollimator"),
        stage_topic("command"),
    ]
    reader.check_topics(needed)
    optional = [stage_topic(name) for name in ("lvdt", "force", "temperature")]
    names = [*needed, *(name for name in optional if name in reader.topics and reader.topics[name].count)]
    window = reader.window(names)
    blocks = reader.read_blocks(names, window)
    elsewhere = [name for name in needed if not blocks[name]]
    if elsewhere and window is not None:
        raise InputError(
            f"{reader.path}: {', '.join(elsewhere)} and the others do not overlap in time: {window.remark}"
        )
    recording = record_stage(blocks, letters, most_rate)
    if window is not None and window.remark:
        remarks = (*remarks, window.remark)
    recording = StageRecording(recording.start_ns, recording.streams, (*remarks, *recording.remarks))
    effects = tuple(effect for effect in twin.effects if isinstance(effect, StageEffect))
    problem = stage_problem(stage, recording, effects, twin.known)
    try_stage_effects(effects, problem.twin)
    return problem


def _machine_problem(
    reader: BagReader, twin: TwinFile, machine: MachineDescription, remarks: tuple[str, ...]
) -> MachineProblem:
    from rotary_error_monitor.gap.machine.problem import MachineProblem

    reader.check_topics([POSE, PROBE])
    names = [name for name in (POSE, PROBE, WARMTH) if name in reader.topics]
    recording = record_poses(reader.read(names), machine, str(reader.path))
    recording = MachineRecording(
        recording.positions, recording.direction, recording.temperature, recording.probe, (*remarks, *recording.remarks)
    )
    effects = tuple(effect for effect in twin.effects if isinstance(effect, MachineEffect))
    try_machine_effects(effects, machine)
    for cause in twin.known:
        assert isinstance(cause.effect, MachineEffect)
        machine = cause.effect.amend(machine, cause.values, cause.location)
    return MachineProblem(machine, recording, effects)


def _mount_problem(path: Path, twin: TwinFile, mount: MountDescription) -> DiagnosableProblem:
    from rotary_error_monitor.gap.mount.pointings import read_pointings
    from rotary_error_monitor.gap.mount.problem import MountProblem

    effects = tuple(effect for effect in twin.effects if isinstance(effect, MountEffect))
    problem = MountProblem(mount, read_pointings(path), effects, twin.known)
    try_mount_effects(effects, problem.twin)
    return problem


def _quadrature_problem(path: Path, twin: TwinFile, description: QuadratureDescription) -> DiagnosableProblem:
    from rotary_error_monitor.gap.quadrature.problem import QuadratureProblem
    from rotary_error_monitor.gap.quadrature.signals import read_quadrature

    effects = tuple(effect for effect in twin.effects if isinstance(effect, QuadratureEffect))
    problem = QuadratureProblem(description, read_quadrature(path), effects, twin.known)
    try_quadrature_effects(effects, description, problem.phase, problem.amplitude(()))
    return problem


def record_poses(topics: Mapping[str, Sequence[Content]], machine: MachineDescription, origin: str) -> MachineRecording:
    """Poses of a machine: joint states, probe and temperature that share a stamp.

    Raises:
        InputError: an axis is missing, a value is not finite, or fewer than 12 poses are complete.
    """
    probes = {item.stamp_ns: item.point for item in topics[PROBE] if isinstance(item, PointStamped)}
    warmth = {item.stamp_ns: item.temperature for item in topics.get(WARMTH, ()) if isinstance(item, Temperature)}
    states = [item for item in topics[POSE] if isinstance(item, JointState) and item.stamp_ns in probes]
    if len(states) < FEWEST_POSES:
        raise InputError(f"{origin}: {len(states)} poses with a probe of the same stamp; {FEWEST_POSES} are needed")
    positions, directions = [], []
    for state in states:
        missing = [letter for letter in machine.letters if letter not in state.names]
        if missing:
            raise InputError(f"{origin}: {POSE} at {state.stamp_ns} ns has {state.names}, but no {', '.join(missing)}")
        order = [state.names.index(letter) for letter in machine.letters]
        positions.append(state.position[order])
        directions.append(np.sign(state.velocity[order]) if len(state.velocity) else np.zeros(len(order)))
    temperature = [warmth.get(state.stamp_ns, machine.reference_temperature) for state in states]
    recording = MachineRecording(
        np.asarray(positions),
        np.asarray(directions),
        np.asarray(temperature, np.float64),
        np.asarray([probes[state.stamp_ns] for state in states]),
        _lost_poses(len(topics[POSE]), len(states)),
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
