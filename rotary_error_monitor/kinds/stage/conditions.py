"""A stage's recording cut into blocks, each under one condition: what is held out together."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.streams import COMMAND
from rotary_error_monitor.gap.problem import Conditions
from rotary_error_monitor.twin.recording import StageRecording

SHORTEST_BLOCK = 1.0
"""Blocks are at least this long, s: many correlation times of jitter and turbulence, so that they are independent."""

MOST_BLOCKS = 64


@dataclass(frozen=True)
class _Span:
    start: float
    stop: float
    speed: float


def stage_conditions(recording: StageRecording) -> Conditions:
    """Blocks of constant commanded speed; blocks of one speed and direction are held out together.

    Where fewer than three conditions exist, whole stretches of time take their place.
    """
    command = recording.streams[COMMAND]
    spans = _constant_speed(command.time, command.values[:, 1])
    total = recording.duration
    longest = max(SHORTEST_BLOCK, total / MOST_BLOCKS)
    edges, labels, speeds = [0.0], [], []
    for span in spans:
        pieces = max(1, int((span.stop - span.start) / longest))
        edges += np.linspace(span.start, span.stop, pieces + 1)[1:].tolist()
        speeds += [span.speed] * pieces
    names: list[str] = []
    for speed in speeds:
        name = "at rest" if speed == 0 else f"{speed:+.3g} rad/s"
        if name not in names:
            names.append(name)
        labels.append(names.index(name))
    edges[-1] = np.inf
    edges[0] = -np.inf
    if len([name for name in names if name != "at rest"]) < 3:
        thirds = np.minimum(np.arange(len(labels)) * 4 // max(len(labels), 1), 3)
        return Conditions(np.asarray(edges), thirds.astype(np.intp), tuple(f"quarter {i + 1}" for i in range(4)))
    return Conditions(np.asarray(edges), np.asarray(labels, np.intp), tuple(names))


def _constant_speed(time: Array, speed: Array) -> list[_Span]:
    """Stretches of constant speed; each change of speed belongs to the stretch that it ends."""
    top = float(np.max(np.abs(speed))) or 1.0
    steady: NDArray[np.bool_] = np.abs(np.gradient(speed)) < 1e-4 * top
    level = np.round(speed / top, 3) * top
    starts = [0]
    for i in np.flatnonzero(steady[1:] & ~steady[:-1]) + 1:
        if time[i] - time[starts[-1]] > 0.5 * SHORTEST_BLOCK and abs(level[i] - level[starts[-1]]) > 1e-3 * top:
            starts.append(int(i))
    bounds = [*starts, len(time) - 1]
    spans = []
    for a, b in itertools.pairwise(bounds):
        middle = level[a:b][steady[a:b]]
        spans.append(_Span(float(time[a]), float(time[b]), float(np.median(middle)) if len(middle) else 0.0))
    return spans
