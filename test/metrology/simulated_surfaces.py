"""Workpieces of known form, their heights seen with noise that is up to a tenth other than stated; by plain numpy."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.metrology.repeated_points import combine_repeated
from rotary_error_monitor.metrology.surface_range import flatness_bounds

Array = NDArray[np.float64]

KINDS = ("waves", "waves, few points", "waves, scattered points", "bows and a twist", "corners", "waves across")
SIZES = ((7.54e-6, 60e-9), (3e-6, 60e-9), (3e-6, 0.2e-6))
"""Flatness before compensation and after it (Zhou et al. 2023), with the noise of a height, m."""


def levelled(x: Array, z: Array, heights: Array) -> Array:
    plane = np.column_stack([np.ones_like(x), x, z])
    return np.asarray(heights - plane @ np.linalg.lstsq(plane, heights, rcond=None)[0])


def places(rng: np.random.Generator, kind: str) -> tuple[Array, Array]:
    """Of a workpiece of 1400 mm x 500 mm, m."""
    if kind == "waves, scattered points":
        return rng.uniform(-1.4, 0, 300), rng.uniform(-0.65, -0.15, 300)
    counts = (15, 7) if kind == "waves, few points" else (29, 11)
    lines = np.linspace(-1.4, 0, counts[0]), np.linspace(-0.65, -0.15, counts[1])
    x, z = (axis.ravel() for axis in np.meshgrid(*lines))
    return x, z


def form(rng: np.random.Generator, kind: str, u: Array, v: Array) -> Array:
    """Of any size, over positions from 0 to 1."""
    if kind == "corners":
        (c, d), (a, b, twist) = rng.uniform(0.25, 0.75, 2), rng.normal(size=3)
        return np.asarray(a * np.abs(u - c) + b * np.abs(v - d) + 0.3 * twist * u * v)
    if kind == "bows and a twist":
        a, b, twist = rng.normal(size=3)
        return np.asarray(a * u**2 + b * v**2 + twist * u * v)
    heights = np.zeros_like(u)
    if kind == "waves across":
        for i, k in ((i, k) for i in range(4) for k in range(3) if i + k):
            wave = np.cos(np.pi * (i * u + k * v) + rng.uniform(0, 2 * np.pi))
            heights = heights + rng.normal() / (i + k) * wave
        return heights
    for along in (u, v):
        for k in range(1, 6):
            heights = heights + rng.normal() / k * np.cos(np.pi * k * along + rng.uniform(0, 2 * np.pi))
    return heights


def held(kind: str, size: float, noise: float, count: int, readings: int = 1) -> dict[str, float]:
    """Parts of so many surfaces whose interval holds the flatness, and that have none; width in standard deviations.

    With several readings at each point these alone tell the noise.
    """
    found, widths = [], []
    for seed in range(count):
        rng = np.random.default_rng([count, seed, KINDS.index(kind)])
        x, z = places(rng, kind)
        truth = levelled(x, z, form(rng, kind, x / 1.4 + 1, (z + 0.65) / 0.5))
        truth = truth * size / np.ptp(truth)
        seen = truth + noise * rng.uniform(0.9, 1.1) * rng.normal(size=(readings, x.size))
        points = combine_repeated(np.tile(x, readings), np.tile(z, readings), seen.ravel())
        stated = noise if readings == 1 else points.noise_of_means(points.scatter)
        bounds = flatness_bounds(x, z, levelled(x, z, points.heights), stated)
        if bounds is not None:
            found.append(bounds[0] < size < bounds[1])
            widths.append(bounds[1] - bounds[0])
    rate, width = float(np.mean(found)), float(np.mean(widths))
    return {"held": round(rate, 3), "none": 1 - len(found) / count, "width": round(width / noise, 2)}
