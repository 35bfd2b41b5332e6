"""The uncertainty that a straightness step states, over random guideways, grids and drifts made by plain numpy."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from datetime import date
from pathlib import Path

import numpy as np
import pytest

from rotary_error_monitor.calibration.machine_file import MachineFile
from rotary_error_monitor.calibration.steps import Job
from rotary_error_monitor.calibration.straightness_runs import ReadingSettings
from rotary_error_monitor.calibration.straightness_step import calibrate_straightness
from rotary_error_monitor.metrology.reference_mirror import ReferenceMirror
from rotary_error_monitor.resources import config

LENGTH, STOPS, NOISE = 5.0, 21, 1e-7
GRIDS = ("same", "some left out", "of their own number", "anywhere between")
DRIFTS = ("none", "linear", "wandering")
Form = Callable[[np.ndarray], np.ndarray]


def guideway(rng: np.random.Generator, kind: str) -> Form:
    """Height in m over positions in m."""
    if kind == "bow":
        height = 3e-5 * rng.normal()
        return lambda x: height * (2 * x / LENGTH) ** 2
    if kind == "corner":
        corner = rng.uniform(-0.25, 0.25) * LENGTH
        return lambda x: 2e-5 * np.abs(x - corner) / LENGTH
    rows = [(5e-6 * rng.normal() / k, rng.uniform(0, 2 * np.pi), k) for k in range(1, 6)]
    return lambda x: np.sum([size * np.cos(np.pi * k * x / LENGTH + phase) for size, phase, k in rows], axis=0)


def stops(rng: np.random.Generator, grid: str) -> np.ndarray:
    x = np.linspace(-LENGTH / 2, LENGTH / 2, STOPS)
    if grid == "of their own number":
        return np.linspace(-LENGTH / 2, LENGTH / 2, STOPS + int(rng.integers(-5, 6)))
    if grid == "anywhere between":
        x[1:-1] += rng.uniform(-0.45, 0.45) * LENGTH / (STOPS - 1)
    if grid == "some left out":
        kept = np.ones(STOPS, bool)
        kept[1 + 3 * np.arange(6) + rng.integers(0, 3, 6)] = rng.uniform(size=6) < 0.4
        return x[kept]
    return x


def drifted(rng: np.random.Generator, drift: str, count: int) -> np.ndarray:
    """What a sensor drifts in one run, m."""
    if drift == "linear":
        return np.asarray(1e-6 * rng.normal() * np.arange(count) / count)
    return np.asarray(6e-7 * np.cumsum(rng.normal(size=count)) / np.sqrt(count) * (drift == "wandering"))


def rows(rng: np.random.Generator, form: Form, grid: str, drift: str) -> Iterator[str]:
    """Four runs there and back, with a reversal part, a height of each, and what drifts within it."""
    slope = 1e-4 * rng.normal()
    for number in range(4):
        way = -1 if number % 2 else 1
        x = stops(rng, grid)[::way]
        y = form(x) + slope * x + 0.5e-6 * way * np.cos(3 * x) + 1e-5 * rng.normal() + NOISE * rng.normal(size=len(x))
        y = y + drifted(rng, drift, len(x))
        for position, reading in zip(x, y, strict=True):
            yield f"1,{number},{way},{position * 1e3:.9g},{reading * 1e6:.9f}"


def level(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.asarray(y - np.polyval(np.polyfit(x, y, 1), x))


@pytest.mark.parametrize("drift", DRIFTS)
@pytest.mark.parametrize("grid", GRIDS)
def test_stated_uncertainty_holds(tmp_path: Path, grid: str, drift: str) -> None:
    """Of a point of the curve, and of the straightness error: of 100 errors, 95 are within twice the uncertainty."""
    points, ranges, travels, stated, refused = [], [], [], [], 0
    fine = np.linspace(-LENGTH / 2, LENGTH / 2, 2001)
    source, shipped = tmp_path / "runs.csv", config("machines/pan2013.yaml")
    for seed in range(24):
        rng = np.random.default_rng([seed, GRIDS.index(grid), DRIFTS.index(drift)])
        form = guideway(rng, ("bow", "waves", "corner")[seed % 3])
        lines = ["segment,run,direction,position_mm,reading_um", *rows(rng, form, grid, drift)]
        source.write_text("\n".join(lines), encoding="utf-8")
        job = Job(source, MachineFile(shipped), tmp_path / "out.yaml", date(2026, 1, 1))
        result = calibrate_straightness(job, "EYX", ReferenceMirror(LENGTH, 0.0), ReadingSettings(NOISE))
        x = result.spliced.positions
        error = result.spliced.straightness().deviations - level(x, form(x))
        points.append(np.mean(np.abs(error) < 2 * result.doubts.uncertainty))
        ranges.append(abs(result.error - np.ptp(level(fine, form(fine)))) < 2 * result.doubts.error_uncertainty)
        travels.append((x[0], x[-1]))
        refused += not result.written
        stated.append(result.doubts.uncertainty)
    assert np.mean(points) >= 0.95
    # four standard deviations of 24 draws below 0.95 would be 0.77
    assert np.mean(ranges) >= 0.83
    # of guideways of 20 µm: a corner between stops weighs most
    assert np.median(stated) < 0.4e-6
    np.testing.assert_allclose(travels, np.broadcast_to([-LENGTH / 2, LENGTH / 2], (24, 2)), rtol=0, atol=1e-9)
    # clean runs show a reading that stands off in one of a thousand
    assert refused <= 2


@pytest.mark.parametrize("drift", DRIFTS)
def test_placements_of_a_rough_guideway_do_not_contradict_one_another(tmp_path: Path, drift: str) -> None:
    """Two placements whose stops differ where they overlap: what lies between stops is no contradiction."""
    points, refused = [], 0
    source, shipped = tmp_path / "runs.csv", config("machines/pan2013.yaml")
    grid = np.linspace(-0.51 * LENGTH, 0.51 * LENGTH, 4001)
    for seed in range(20):
        rng = np.random.default_rng([seed, DRIFTS.index(drift)])
        walk = np.cumsum(rng.normal(size=grid.size)) * 1.5e-7
        lines = ["segment,run,direction,position_mm,reading_um"]
        for number, (first, last) in enumerate([(-2.5, 0.7), (-0.7, 2.5)]):
            slope = 1e-4 * rng.normal()
            for run in range(4):
                x = np.linspace(first, last, STOPS)[:: (way := -1 if run % 2 else 1)]
                y = np.interp(x, grid, walk) + slope * x + NOISE * rng.normal(size=STOPS) + drifted(rng, drift, STOPS)
                lines += [f"{number},{run},{way},{p * 1e3:.9g},{v * 1e6:.9f}" for p, v in zip(x, y, strict=True)]
        source.write_text("\n".join(lines), encoding="utf-8")
        job = Job(source, MachineFile(shipped), tmp_path / "out.yaml", date(2026, 1, 1))
        result = calibrate_straightness(job, "EYX", ReferenceMirror(3.2, 1e-9), ReadingSettings(NOISE))
        x = result.spliced.positions
        error = result.spliced.straightness().deviations - level(x, np.interp(x, grid, walk))
        points.append(np.mean(np.abs(error) < 2 * result.doubts.uncertainty))
        refused += not result.written
    assert np.mean(points) >= 0.95
    assert refused <= 1
