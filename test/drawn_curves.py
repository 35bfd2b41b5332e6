"""A ring and a mirror of random orders, as harmonics and as the measured curve of the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rotary_error_monitor.description.harmonics import AngularHarmonic, PlanarHarmonic
from rotary_error_monitor.description.periodic_tables import AngularTable, PlanarTable
from rotary_error_monitor.description.stage import StageDescription, load_stage
from rotary_error_monitor.description.stage_section import Mirror
from rotary_error_monitor.metrology.periodic_curves import interpolation_bound

ANGLES = 180


class DrawnCurves:
    """A ring and a mirror of random orders, as harmonics and as tables, and how far apart these may be."""

    def __init__(self, seed: int, even: bool = True, u: float = 0.0) -> None:
        rng = np.random.default_rng(seed)
        self.orders = [int(k) for k in rng.choice(np.arange(2, 21), 5, replace=False)]
        self.ring = tuple(AngularHarmonic(k, *(2e-6 * rng.normal(size=2)).tolist()) for k in self.orders)
        self.mirror = tuple(
            PlanarHarmonic(k, *(tuple((4e-6 * rng.normal(size=2)).tolist()) for _ in "xy")) for k in self.orders
        )
        step = 2 * np.pi / ANGLES
        off = 0.0 if even else rng.uniform(-0.35, 0.35, ANGLES)
        self.angles = rng.uniform(-3, 0) + step * (np.arange(ANGLES) + off)
        gap = float(np.diff(np.append(self.angles, self.angles[0] + 2 * np.pi)).max())
        doubts = (u,) * ANGLES if u else ()
        angles = tuple(self.angles.tolist())
        self.ring_table = AngularTable(
            angles=angles, values=tuple(self.graduation(self.angles).tolist()), uncertainties=doubts
        )
        x, y = self.flatness(self.angles).T.tolist()
        self.mirror_table = PlanarTable(angles=angles, x=tuple(x), y=tuple(y), uncertainties=doubts)
        self.ring_bound = interpolation_bound(self.orders, [np.hypot(row.cos, row.sin) for row in self.ring], gap)
        sizes = [np.hypot(np.hypot(*row.x), np.hypot(*row.y)) for row in self.mirror]
        self.mirror_bound = interpolation_bound(self.orders, sizes, gap)

    def graduation(self, psi: np.ndarray) -> np.ndarray:
        return np.sum([r.cos * np.cos(r.order * psi) + r.sin * np.sin(r.order * psi) for r in self.ring], axis=0)

    def flatness(self, theta: np.ndarray) -> np.ndarray:
        waves = [np.stack([np.cos(r.order * theta), np.sin(r.order * theta)]) for r in self.mirror]
        return np.sum([(np.array([r.x, r.y]) @ w).T for r, w in zip(self.mirror, waves, strict=True)], axis=0)

    def stages(self) -> tuple[StageDescription, StageDescription]:
        """By harmonics and by tables."""
        stage = load_stage()
        tilt = stage.mirror.tilt
        orders = replace(
            stage, encoder=replace(stage.ring, graduation=self.ring), mirror=Mirror(tilt, flatness=self.mirror)
        )
        tables = replace(
            stage,
            encoder=replace(stage.ring, graduation=(), graduation_table=self.ring_table),
            mirror=Mirror(tilt, flatness_table=self.mirror_table),
        )
        return orders, tables
