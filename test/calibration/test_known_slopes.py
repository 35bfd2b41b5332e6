"""Squareness of machines whose file has slopes and angular errors already, as the plant's exact rotations move them."""

from __future__ import annotations

import shutil
from dataclasses import replace
from datetime import date
from pathlib import Path

import numpy as np
import pytest
from calibration import tracked_axes
from numpy.typing import NDArray

from rotary_error_monitor.calibration.axis_lines import SquarenessResult, calibrate_squareness
from rotary_error_monitor.calibration.machine_file import MachineFile
from rotary_error_monitor.calibration.steps import Job
from rotary_error_monitor.description.machine import MachineDescription, load_machine
from rotary_error_monitor.description.machine_parts import Displacement, ErrorComponent
from rotary_error_monitor.metrology.tracker import TrackerNoise
from rotary_error_monitor.plant.machine import MachinePlant, MachineStates
from rotary_error_monitor.resources import config

Array = NDArray[np.float64]
NOISE = 3e-7, 1e-7
SQUARE = {("X", "Y"): ("carriage", 2), ("Z", "Y"): ("ram", 0), ("Z", "X"): ("ram", 1)}
SIGNS = {("X", "Y"): -1.0, ("Z", "Y"): 1.0, ("Z", "X"): -1.0}


def with_errors(rng: np.random.Generator, size: float = 2e-5) -> MachineDescription:
    """The tilting-table machine with slopes, bows and angular errors of X, Y and Z drawn anew, without reversal."""
    machine = load_machine("xyzac_trt")
    names = [f"E{part}{axis}" for axis in "XYZ" for part in "XYZABC" if part != axis]
    drawn = {name: ErrorComponent(poly=(0.0, *map(float, size * rng.normal(size=3)))) for name in names}
    return replace(machine, errors=drawn, axes=tuple(replace(axis, reversal=0.0) for axis in machine.axes))


def squared(machine: MachineDescription, angles: dict[tuple[str, str], float]) -> MachineDescription:
    """The machine with these angles less 90 degrees between its linear axes, and no others."""
    for name in ("carriage", "ram"):
        a, b, c = (-part for part in machine.body(name).location_error.rotation)
        machine = machine.with_location_error(name, Displacement(rotation=(a, b, c)))
    for pair, angle in angles.items():
        name, place = SQUARE[pair]
        a, b, c = (SIGNS[pair] * angle * (k == place) for k in range(3))
        machine = machine.with_location_error(name, Displacement(rotation=(a, b, c)))
    return machine


def path(machine: MachineDescription, letter: str, positions: Array) -> Array:
    """(n, 3) where the tool tip is, reached from below."""
    number = machine.letters.index(letter)
    at, ways = np.zeros((2, len(positions), len(machine.letters)))
    at[:, number], ways[:, number] = positions, 1.0
    nominal = np.outer(positions, machine.axis(letter).direction) + np.array(machine.body(machine.tool).pose.shift)
    return nominal + MachinePlant(machine).tool_offset(MachineStates(at, ways, np.zeros(len(at))))[:, :3]


def calibrated(
    folder: Path, machine: MachineDescription, features: dict[str, Array], seed: int, reflector: Array
) -> SquarenessResult:
    file = MachineFile(Path(shutil.copy(config("machines/xyzac_trt.yaml"), folder / "machine.yaml")))
    file.machine = machine
    source = folder / "tracker.csv"
    text = tracked_axes.rows(features, NOISE, np.random.default_rng([seed, 1]))
    source.write_text(text, encoding="utf-8")
    job = Job(source, file, folder / "out.yaml", date(2026, 11, 26), force=True)
    x, y, z = map(float, reflector)
    return calibrate_squareness(job, TrackerNoise(NOISE[0], 0.0, NOISE[1], NOISE[1]), (x, y, z))


def ratios(found: SquarenessResult, angles: dict[tuple[str, str], float]) -> list[float]:
    return [(angle - angles[letter, other]) / uncertainty for letter, other, angle, uncertainty in found.squareness]


@pytest.mark.parametrize("beside", [0.0, 0.15])
def test_what_the_file_has_is_not_counted_twice(tmp_path: Path, beside: float) -> None:
    """Slopes and levers turn the lines by up to 100 µrad; what is written is the squareness that they came from."""
    off, known = [], []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        machine, reflector = with_errors(rng), beside * rng.normal(size=3)
        angles = {pair: float(3e-5 * rng.normal()) for pair in SQUARE}
        truth = squared(machine, angles)
        body = truth.body(truth.tool)
        moved = replace(body, pose=replace(body.pose, shift=tuple(map(float, reflector))))
        truth = replace(truth, bodies=tuple(moved if each is body else each for each in truth.bodies))
        steps = np.linspace(-0.24, 0.2, 15)
        features = {letter: path(truth, letter, steps) for letter in "YXZ"}
        found = calibrated(tmp_path, machine, features, seed, reflector)
        assert all(each.is_placed for each in found.known.values())
        off += ratios(found, angles)
        known += [float(np.abs(each.slope).max()) for each in found.known.values()]
    assert max(known) > 5e-5
    assert np.sqrt(np.mean(np.square(off))) < 1.4 and np.abs(off).max() < 4


def test_where_on_the_travel_the_points_lie_counts_where_nothing_tells(tmp_path: Path) -> None:
    """A third of the travel, anywhere, each feature with another nest of the reflector."""
    off = []
    for seed in range(16):
        rng = np.random.default_rng([seed, 2])
        machine = with_errors(rng)
        angles = {pair: float(3e-5 * rng.normal()) for pair in SQUARE}
        truth = squared(machine, angles)
        features = {}
        for letter in "YXZ":
            begin = rng.uniform(-0.25, 0.08)
            features[letter] = path(truth, letter, np.linspace(begin, begin + 0.17, 15)) + 0.02 * rng.normal(size=3)
        found = calibrated(tmp_path, machine, features, seed, np.zeros(3))
        assert not any(each.is_placed for each in found.known.values())
        off += ratios(found, angles)
    # the doubt is that of the component and the place that matter most
    assert 0.2 < np.sqrt(np.mean(np.square(off))) < 1.2
    assert np.mean(np.abs(off) < 1.96) > 0.9
