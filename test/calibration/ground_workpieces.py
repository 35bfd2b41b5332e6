"""Workpieces ground on guideways of known form with measured corrections, by plain numpy, and what is predicted."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from calibration.simulated_guideway import READING, Plant, level, measure, stratified
from numpy.typing import NDArray

from rotary_error_monitor.calibration.flatness_doubts import CurveDoubt, covariance_factor, predict_bounds
from rotary_error_monitor.calibration.grinding import FlatnessPrediction, VerticalErrors, predict_flatness
from rotary_error_monitor.calibration.straightness_doubts import find_doubts
from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.description.machine_parts import ErrorComponent, ErrorTable
from rotary_error_monitor.metrology.reference_mirror import ReferenceMirror

Array = NDArray[np.float64]

WAYS = ("spliced", "spliced, turned, and an interferometer", "interferometers", "loud interferometers")
"""How X and Z are measured: along mirrors shorter than they are, a placement both ways up, or without any."""

REVERSAL, PERIOD = 0.4e-6, 20e-6
"""Of the vertical axis, m; the range of its positioning error is drawn."""

WORKPIECE = {"X": (-1.4, 0.0), "Z": (-0.65, -0.15)}


def rates(way: str, count: int) -> dict[str, float]:
    """How often each interval holds the flatness of the workpiece that was ground, of so many."""
    curvatures = zip(stratified(count, 0), stratified(count, 1), strict=True)
    found = [_held(way, [count, seed], *curved) for seed, curved in enumerate(curvatures)]
    return {name: round(float(np.mean([each[name] for each in found])), 3) for name in found[0]}


def _guideway(way: str, plant: Plant, mirror: float, curvature: float) -> tuple[CurveDoubt, Plant]:
    """Table of a guideway as `calibrate straightness` makes it, with its covariance; positions from -length to 0."""
    flatness = 0.1e-6
    form = plant.mirror(flatness, curvature)
    known: ReferenceMirror | None = ReferenceMirror(mirror, flatness)
    placements = [plant.placement(at, mirror, form) for at in (0.0, plant.length - mirror)]
    if "turned" in way:
        placements.append(plant.placement(0.0, mirror, form, turned=True))
        known = ReferenceMirror(mirror, None)
    if "interferometer" in way and "turned" not in way:
        placements, known = [plant.placement(0.0, plant.length, np.zeros(5))], None
    reading = replace(READING, noise=plant.noise)
    parts, spliced = measure(placements, known) if plant.noise == READING.noise else _loud(placements, reading)
    straightness = spliced.straightness()
    doubts = find_doubts(parts, spliced, straightness, plant.noise)
    positions = np.linspace(spliced.positions[0], spliced.positions[-1], 101)
    values = np.interp(positions, spliced.positions, straightness.deviations)
    factor = covariance_factor(spliced, doubts, positions)
    further = float(np.hypot(doubts.between, doubts.doubt))
    return CurveDoubt(Path("curve.csv"), positions - plant.length, values, factor, further), plant


def _loud(placements, reading):
    from rotary_error_monitor.calibration.straightness_runs import place_runs
    from rotary_error_monitor.metrology.splicing import splice_segments

    parts = [place_runs(placement, reading) for placement in placements]
    return parts, splice_segments([part.segment for part in parts], None)


def _held(way: str, seed: list[int], first: float, second: float) -> dict[str, float]:
    """Whether each interval holds the flatness of one workpiece."""
    rng = np.random.default_rng([*seed, WAYS.index(way)])
    noise = 250e-9 if "loud" in way else 60e-9
    other = "interferometer" if "and an" in way else way
    guideways = [
        _guideway(each, Plant(rng, length, noise, 7e-3), mirror, curvature)
        for each, length, mirror, curvature in ((way, 1.4, 0.84, first), (other, 0.8, 0.5, second))
    ]
    machine = load_machine("grinder_zhou2023")
    tables = {
        name: ErrorComponent(
            table=ErrorTable(*(tuple(v.tolist()) for v in (doubt.positions, doubt.values, doubt.values)))
        )
        for name, (doubt, _) in zip(("EYX", "EYZ"), guideways, strict=True)
    }
    machine = replace(machine, errors={**machine.errors, **tables})
    positioning = float(rng.choice([0.0, 0.2e-6, 1.2e-6]))
    prediction = predict_flatness(machine, "Y", WORKPIECE, VerticalErrors((REVERSAL,), positioning, PERIOD))
    bounds = predict_bounds(prediction, {"X": guideways[0][0], "Z": guideways[1][0]})
    phase = rng.uniform(0, 2 * np.pi)
    held = {}
    for name, interval, which in (
        ("before", bounds.before, None),
        ("after, as measured", bounds.unrotated[0], "errors"),
        ("after, rotated", bounds.rotated[0], "rotated"),
    ):
        flatness = ground(prediction, [plant for _, plant in guideways], which, positioning, phase)
        held[name] = float(interval[0] <= flatness <= interval[1])
    return held


def ground(
    prediction: FlatnessPrediction, plants: list[Plant], which: str | None, positioning: float, phase: float
) -> float:
    """Flatness, m, of what is ground on the true guideways while the vertical axis is told to follow measured ones."""
    x, z = (curve.positions for curve in prediction.curves)
    truth = sum(
        np.expand_dims(plant.truth(at + plant.length), 1 - k)
        for k, (plant, at) in enumerate(zip(plants, (x, z), strict=True))
    )
    heights = np.asarray(truth)
    if which is not None:
        one, other = (getattr(curve, which) for curve in prediction.curves)
        told = -(one[:, None] + other[None, :])
        heights = heights + _followed(told, positioning, phase)
    for axis, at in ((0, x), (1, z)):
        mean = heights.mean(axis=1 - axis)
        heights = heights - np.expand_dims(mean - level(at, mean), 1 - axis)
    return float(np.ptp(heights))


def _followed(told: Array, positioning: float, phase: float) -> Array:
    """Where an axis with play comes to that follows each column, its play taken up before as the column goes on."""
    half = REVERSAL / 2
    rises = told[-1].mean() > told[0].mean()
    place = told[0] - half if rises else told[0] + half
    reached = []
    for target in told:
        place = np.where(place < target - half, target - half, np.where(place > target + half, target + half, place))
        reached.append(place)
    at = np.array(reached)
    return at + positioning / 2 * np.sin(2 * np.pi * at / PERIOD + phase)
