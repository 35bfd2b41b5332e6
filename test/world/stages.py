"""Random true stages: other rings, heads, mirrors, spindles and instruments than the default's."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .noise import drawn_log

Array = NDArray[np.float64]
ARCSECOND = np.pi / 180.0 / 3600.0
PITCHES = (8e-6, 1e-5, 2e-5, 4e-5)  # m, of a graduation
COUNTS = (10, 20, 40, 50, 80, 100, 200, 256, 400, 1024, 2000)


def random_stage(seed: int) -> dict[str, Any]:
    """A valid section `stage` that is drawn from the seed.

    Radius 20 to 200 mm; four heads at 90°, sometimes two, three, five or six at other azimuths; spindles from 0.05 to
    10 µm and 0.5 to 50 µrad (root mean square over a turn, per axis). Eccentricity and spindle are bounded so that
    terms of second order stay below one count, as the contract has it.
    """
    rng = np.random.default_rng([seed, 20240229])
    encoder, room = _encoder(rng)
    radial = drawn_log(rng, 5e-8, min(1e-5, max(0.3 * room, 5e-8)))
    tilt = drawn_log(rng, 5e-7, 5e-5)
    mirror_tilt = drawn_log(rng, 3e-6, 2e-4)
    mirror = {
        "tilt": _pair(rng, mirror_tilt),
        "flatness": _harmonics(rng, drawn_log(rng, 2e-7, 1e-5), (2, 3)),
    }
    stage: dict[str, Any] = {"encoder": encoder}
    if rng.uniform() < 0.9:
        stage["mirror"] = mirror
    stage["autocollimator"] = _autocollimator(rng, mirror_tilt + 4.0 * tilt + 3e-5)
    stage["spindle"] = {
        "radial": _harmonics(rng, radial, _orders(rng)),
        "tilt": _harmonics(rng, tilt, _orders(rng)),
        "radial_compliance": drawn_log(rng, 2e-9, 3e-8),
        "tilt_compliance": drawn_log(rng, 5e-9, 1e-7),
        "radial_thermal": _pair(rng, drawn_log(rng, 5e-8, 5e-7)),
    }
    if rng.uniform() < 0.7:
        stage["lvdt"] = {
            "height": round(float(rng.uniform(0.005, 0.1)), 4),
            "noise": drawn_log(rng, 1e-8, 2e-7),
            "artefact_eccentricity": _pair(rng, drawn_log(rng, 5e-7, 1.5e-5)),
        }
    stage["environment"] = {"reference_temperature": float(rng.choice((20.0, 20.0, 22.5, 25.0)))}
    return stage


def _encoder(rng: np.random.Generator) -> tuple[dict[str, Any], float]:
    """Section `encoder`, and the displacement in m at which terms of second order reach a quarter of a count."""
    radius = drawn_log(rng, 0.02, 0.2)
    lines = round(2.0 * np.pi * radius / float(rng.choice(PITCHES)))
    # Counts of 0.1 to 6 µrad: what such encoders have.
    fits = [n for n in COUNTS if 1e-7 < 2.0 * np.pi / lines / n < 6e-6]
    counts = int(rng.choice(fits or [100]))
    count = 2.0 * np.pi / (lines * counts)
    room = radius * np.sqrt(0.25 * count)
    rows = [
        {"order": int(order), **dict(zip(("cos", "sin"), _pair(rng, size), strict=True))}
        for order in sorted(rng.choice(np.arange(2, 13), int(rng.integers(0, 5)), replace=False).tolist())
        if (size := drawn_log(rng, 2e-7, 1e-5) / order)
    ]
    encoder = {
        "disc_radius": radius,
        "lines_per_revolution": lines,
        "counts_per_line": counts,
        "noise": drawn_log(rng, 0.05 * count + 5e-8, 0.5 * count + 1e-7),
        "heads": _heads(rng),
        "eccentricity": _pair(rng, drawn_log(rng, 0.02 * room, 0.7 * room)),
        "graduation": rows,
    }
    return encoder, float(room)


def _heads(rng: np.random.Generator) -> dict[str, dict[str, float]]:
    """Section `heads`."""
    count = int(rng.choice((4, 2, 3, 5, 6), p=(0.6, 0.1, 0.1, 0.1, 0.1)))
    start = float(rng.choice((0.0, np.pi / 4.0, rng.uniform(-np.pi, np.pi))))
    azimuths = start + 2.0 * np.pi * np.arange(count) / count
    if count == 4 and rng.uniform() < 0.5:
        azimuths = azimuths[[0, 2, 1, 3]]  # as in the paper: A and B opposed
    if count != 4 and rng.uniform() < 0.5:
        azimuths += rng.uniform(-0.3, 0.3, count)
    wrapped = np.where(azimuths > 2.0 * np.pi, azimuths - 2.0 * np.pi, azimuths)
    return {"abcdef"[i]: {"azimuth": float(azimuth)} for i, azimuth in enumerate(wrapped)}


def _autocollimator(rng: np.random.Generator, largest: float) -> dict[str, Any]:
    """Section `autocollimator` of an instrument that sees tilts up to `largest`."""
    ranges = [r * ARCSECOND for r in (100.0, 200.0, 500.0, 1000.0) if r * ARCSECOND > 1.3 * largest]
    resolution = drawn_log(rng, 0.01, 0.5) * ARCSECOND
    section: dict[str, Any] = {
        "range": ranges[int(rng.integers(0, min(2, len(ranges))))],
        "resolution": resolution,
        "noise": resolution * float(rng.uniform(0.3, 1.5)),
    }
    if rng.uniform() < 0.3:
        section["turbulence"] = {"std": drawn_log(rng, 1e-7, 2e-6), "correlation_time": drawn_log(rng, 0.3, 10.0)}
    return section


def _orders(rng: np.random.Generator) -> tuple[int, ...]:
    """Orders of a spindle's error motion: the low ones and some others."""
    others = rng.choice(np.arange(3, 13), int(rng.integers(0, 4)), replace=False)
    low = (1, 2) if rng.uniform() < 0.8 else (1,)
    return (*low, *sorted(others.tolist()))


def _harmonics(rng: np.random.Generator, size: float, orders: Sequence[int]) -> list[dict[str, Any]]:
    """Rows of harmonics that fall with their order, of a root mean square of `size` per axis."""
    waves = rng.standard_normal((len(orders), 2, 2)) / np.array(orders, float)[:, None, None]
    waves *= size / np.sqrt((waves**2).sum() / 4.0)
    return [
        {"order": int(order), "x": wave[0].tolist(), "y": wave[1].tolist()}
        for order, wave in zip(orders, waves, strict=True)
    ]


def _pair(rng: np.random.Generator, size: float) -> list[float]:
    """A vector of the given size in a random direction."""
    angle = rng.uniform(0.0, 2.0 * np.pi)
    return [float(size * np.cos(angle)), float(size * np.sin(angle))]
