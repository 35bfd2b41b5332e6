"""Calibrations of drawn rings and mirrors as measured curves, and how often their bounds hold the truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import simulated_shaft

from rotary_error_monitor.calibration.assembly_tables import MeasuredCurve, mirror_curve, ring_curve
from rotary_error_monitor.description.periodic_tables import AngularTable, PlanarTable
from rotary_error_monitor.description.stage import StageDescription, load_stage
from rotary_error_monitor.metrology.encoder_heads import HeadLayout, estimate_ring_pose
from rotary_error_monitor.metrology.error_motion import remove_graduation, remove_mirror
from rotary_error_monitor.metrology.mirror_assembly import estimate_mirror_assembly
from rotary_error_monitor.metrology.ring_assembly import estimate_ring_assembly
from rotary_error_monitor.metrology.shaft_recording import record_shaft
from rotary_error_monitor.pipeline.publication import AssemblyVariance

BOTH_WAYS = simulated_shaft.reversing((np.pi / 2, np.pi), 5.0)


def true_graduation(orders: Any, psi: np.ndarray) -> np.ndarray:
    return np.sum([c * np.cos(k * psi) + s * np.sin(k * psi) for k, (c, s) in orders.items()], axis=0)


def true_flatness(orders: Any, theta: np.ndarray) -> np.ndarray:
    waves = [np.array(row).reshape(2, 2) @ [np.cos(k * theta), np.sin(k * theta)] for k, row in orders.items()]
    return np.sum(waves, axis=0).T


class Rates:
    """Errors of curves, and of error motion that is free of them, over their standard uncertainties."""

    def __init__(self) -> None:
        self.ring: list[np.ndarray] = []
        self.mirror: list[np.ndarray] = []
        self.radial: list[np.ndarray] = []
        self.tilt: list[np.ndarray] = []

    def add(self, seed: int) -> None:
        """One calibration of a ring and a mirror whose orders fall off, from well above the noise to far below it."""
        rng = np.random.default_rng(seed)
        orders = [k for k in range(2, 31) if k % 4]
        graduation = {k: tuple(4e-6 / k**2 * rng.normal(size=2)) for k in orders}
        flatness = {k: tuple(8e-6 / k**2 * rng.normal(size=4)) for k in orders}
        shaft = simulated_shaft.Shaft(graduation=graduation, flatness=flatness)
        stage = replace(load_stage(), uncertainty={})
        recording = record_shaft(stage, *simulated_shaft.record(shaft, *BOTH_WAYS, seed))
        ring = ring_curve(estimate_ring_assembly(stage, recording, 39, every=True))
        mirror = mirror_curve(estimate_mirror_assembly(stage, recording, highest=39, every=True))
        self.ring.append((ring.values[:, 0] - true_graduation(graduation, ring.angles)) / ring.std)
        self.mirror.append((mirror.values - true_flatness(flatness, mirror.angles)) / mirror.std[:, None])
        self._add_motion(with_curves(stage, ring, mirror), graduation, flatness)

    def _add_motion(self, stage: StageDescription, graduation: Any, flatness: Any) -> None:
        theta = np.linspace(0, 2 * np.pi, 91)[:-1]
        layout = HeadLayout(tuple(stage.azimuths.values()))
        azimuths = np.array(layout.azimuths)
        read = theta[:, None] + true_graduation(graduation, azimuths - theta[:, None])
        free = remove_graduation(read, azimuths, stage.ring)
        pose = estimate_ring_pose(layout, stage.ring.disc_radius, free, np.ones_like(free))
        variance = AssemblyVariance.of(stage)
        self.radial.append(pose.centre / np.sqrt(variance.radial))
        left = remove_mirror(true_flatness(flatness, theta), theta, replace(stage.mirror, tilt=(0.0, 0.0)))
        self.tilt.append(left / np.sqrt(variance.tilt))

    def shares(self) -> dict[str, float]:
        """Part of the errors that a 95 % bound holds."""
        return {name: float(np.mean(np.abs(np.stack(rows)) < 1.96)) for name, rows in vars(self).items()}


def angular_table(curve: MeasuredCurve) -> AngularTable:
    """The curve as a stage has it."""
    return AngularTable(
        angles=tuple(curve.angles.tolist()),
        values=tuple(curve.values[:, 0].tolist()),
        uncertainties=tuple(curve.std.tolist()),
    )


def planar_table(curve: MeasuredCurve) -> PlanarTable:
    """The curve of a vector as a stage has it."""
    x, y = curve.values.T.tolist()
    return PlanarTable(
        angles=tuple(curve.angles.tolist()), x=tuple(x), y=tuple(y), uncertainties=tuple(curve.std.tolist())
    )


def with_curves(stage: StageDescription, ring: Any, mirror: Any) -> StageDescription:
    encoder = replace(stage.ring, graduation=(), graduation_table=angular_table(ring))
    flat = replace(stage.mirror, flatness=(), flatness_table=planar_table(mirror))
    return replace(stage, encoder=encoder, mirror=flat)


def rates(seeds: Sequence[int]) -> dict[str, float]:
    found = Rates()
    for seed in seeds:
        found.add(seed)
    return found.shares()
