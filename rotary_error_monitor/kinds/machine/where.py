"""Where the gap of a machine lies, in components and in words, and the poses that would tell effects apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.topics import topic_named
from rotary_error_monitor.effects.effect import Cause, Role
from rotary_error_monitor.gap.dependence import explained_by, explained_by_constant, name_dependences
from rotary_error_monitor.gap.problem import Rows, Share
from rotary_error_monitor.gap.telling_apart import advise_best, distance
from rotary_error_monitor.kinds.machine.table import MachineTable
from rotary_error_monitor.twin.machine import MachineRecording, predict_probe

TELLING = 0.1
POSES = 120


def machine_where(problem: MachineTable, causes: Sequence[Cause], rest: Rows, explained: bool) -> list[Share]:
    """Shares of x, y and z, largest first; empty if nothing exceeds the noise."""
    noise = problem.std
    if explained:
        machine, recording = problem.machine, problem.recording
        signals = predict_probe(machine, recording, causes) - predict_probe(machine, recording)
        powers = np.mean(np.square(signals), axis=0)
    else:
        kept = problem.kept
        signals = np.stack([rest[channel][:, 0] for channel in problem.channels], axis=1) * noise
        powers = np.maximum(0.0, np.sum(np.square(signals), axis=0) / max(int(kept.sum()), 1) - noise**2)
    total = float(powers.sum())
    if total <= 0:
        return []
    return [
        Share(
            f"{topic_named('tool_probe')}.{problem.channels[i]}",
            float(powers[i]) / total,
            float(np.sqrt(powers[i])),
            float(noise[i]),
            _describe(problem, signals[:, i], float(powers[i])),
            problem.unit,
        )
        for i in np.argsort(-powers)
    ]


def _describe(problem: MachineTable, values: Array, power: float) -> str:
    """Axes, directions and temperature on which a component of the gap depends, with what each explains alone."""
    if power <= 0:
        return "noise"
    excess, parts = power * len(values), []
    for column, letter in enumerate(problem.machine.letters):
        axis = problem.machine.axis(letter)
        position = problem.recording.positions[:, column]
        if axis.kind == "linear":
            scaled = (2 * position - sum(axis.travel)) / np.ptp(axis.travel)
            table = np.stack([scaled, scaled**2, scaled**3], axis=1)
        else:
            table = np.stack([wave(k * position) for k in (1, 2) for wave in (np.cos, np.sin)], axis=1)
        parts.append((explained_by(table, values) / excess, f"pose, axis {letter}"))
        direction = problem.recording.direction[:, column : column + 1]
        parts.append((explained_by(direction, values) / excess, f"direction of {letter}"))
    warming = problem.recording.temperature - problem.machine.reference_temperature
    if np.ptp(warming) > 0:
        linear = [i for i, axis in enumerate(problem.machine.axes) if axis.kind == "linear"]
        parts.append(
            (
                explained_by(warming[:, None] * problem.recording.positions[:, linear], values) / excess,
                "temperature x position",
            )
        )
    parts.append((explained_by_constant(values) / excess, "constant"))
    return name_dependences(parts, TELLING)


def machine_advice(problem: MachineTable, keys: Sequence[tuple[str, str]], causes: Sequence[Cause]) -> str:
    """Words for the set of poses that tells the first of these effects apart from the others best."""
    first = next(cause for cause in causes if cause.key == tuple(keys[0]))
    rivals = [problem.at_zero(key) for key in keys[1:]]
    scored = [
        (min(_distance(problem, first, rival, planned) for rival in rivals), words)
        for words, planned in _experiments(problem)
    ]
    return advise_best(scored, "no poses that were tried tell them apart: the best ones")


def _experiments(problem: MachineTable) -> list[tuple[str, MachineRecording]]:
    """Sets of poses that a person can run: one axis at a time over its travel, warm, with another tool, both ways."""
    machine, recording = problem.machine, problem.recording
    middle = np.array([sum(axis.travel) / 2 for axis in machine.axes])
    rng = np.random.default_rng(0)
    low, high = np.array([axis.travel for axis in machine.axes]).T
    spread = rng.uniform(low, high, (POSES, len(middle)))
    direction = rng.choice([-1.0, 1.0], spread.shape)
    calm = np.full(POSES, machine.reference_temperature)
    found = [
        ("probe more poses over the whole travel", _poses(recording, spread, direction, calm)),
        ("probe the poses again 10 K warmer", _poses(recording, spread, direction, calm + 10.0)),
    ]
    for column, axis in enumerate(machine.axes):
        alone = np.tile(middle, (POSES, 1))
        alone[:, column] = np.linspace(*axis.travel, POSES)
        ways = np.ones_like(alone)
        ways[::2] = -1.0
        found.append((f"probe along {axis.letter} alone, both ways", _poses(recording, alone, ways, calm)))
    return found


def _poses(recording: MachineRecording, positions: Array, direction: Array, temperature: Array) -> MachineRecording:
    return replace(
        recording,
        positions=np.concatenate([recording.positions, positions]),
        direction=np.concatenate([recording.direction, direction]),
        temperature=np.concatenate([recording.temperature, temperature]),
    )


def _distance(problem: MachineTable, first: Cause, rival: Cause, planned: MachineRecording) -> float:
    """Standard deviations between the first cause as fitted and the nearest that a rival can do, old and new poses."""
    base = predict_probe(problem.machine, planned)

    def shown(cause: Cause) -> Array:
        return (predict_probe(problem.machine, planned, (cause,)) - base).ravel() / np.tile(problem.std, len(base))

    columns = []
    for index in rival.effect.indices(Role.LINEAR):
        values = rival.values.copy()
        values[index] += rival.effect.scales()[index]
        columns.append(shown(rival.with_values(values)))
    return distance(shown(first), np.stack(columns, axis=1))
