"""Recordings of a simulated stage that leans more than its description says."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from rotary_error_monitor.description.stage import StageDescription, load_stage
from rotary_error_monitor.notebook.simulation import EPOCH_NS, simulate_bag
from rotary_error_monitor.plant.stage import StagePlant

ORDER, MORE = 3, 1.5e-6
"""Order of the tilt about x that the description lacks, and its cosine, rad."""


def leaning() -> StageDescription:
    """The stage that ships with more tilt."""
    stage = load_stage()
    rows = [replace(row, x=(row.x[0] + MORE, row.x[1])) if row.order == ORDER else row for row in stage.spindle.tilt]
    assert any(row.order == ORDER for row in rows)
    return replace(stage, spindle=replace(stage.spindle, tilt=tuple(rows)))


def write_bag(folder: Path, seed: int, seconds: float = 14.0) -> StagePlant:
    """Record it, as long as six turns forward and two backward take; gives the truth."""
    return simulate_bag(folder, leaning(), seed=seed, seconds=seconds)


def true_motion(plant: StagePlant, stamp_ns: np.ndarray) -> np.ndarray:
    """(n, 4) true exc eyc eac ebc at timestamps (n,), ns."""
    scene = plant.scene((stamp_ns - EPOCH_NS) * 1e-9)
    return np.column_stack([scene.radial.real, scene.radial.imag, scene.tilt.real, scene.tilt.imag])
