"""Positioning and straightness of machines whose file has other errors, moved by the plant's exact rotations."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from rotary_error_monitor.calibration.grinding import VerticalErrors, predict_flatness
from rotary_error_monitor.cli import main
from rotary_error_monitor.description.machine import MachineDescription, load_machine
from rotary_error_monitor.plant.machine import MachinePlant, MachineStates
from rotary_error_monitor.resources import config

Array = NDArray[np.float64]
TARGETS = np.array([-0.24, -0.19, -0.15, -0.1, -0.045, 0.005, 0.05, 0.1, 0.145, 0.2, 0.24])

SIGN = {"tool": 1.0, "workpiece": -1.0}
"""Of an axis' own errors in the tool's place as the workpiece sees it."""


def machine_file(folder: Path, seed: int, carried: str = "tool") -> Path:
    """The tilting-table machine with angular errors, a slope and a tool of other sizes in its file."""
    rng, path = np.random.default_rng(seed), folder / "machine.yaml"
    shutil.copy(config("machines/xyzac_trt.yaml"), path)
    text = path.read_text(encoding="utf-8")
    for name in ("EAX", "EBX", "ECX"):
        row = next(line for line in text.splitlines() if line.strip().startswith(f"{name}: "))
        a, b = 3e-5 * rng.normal(size=2)
        text = text.replace(row, f"    {name}: {{poly: [0.0, {a:.3e}, {b:.3e}]}}")
    text = text.replace("EYX: {poly: [0.0, 0.0,", "EYX: {poly: [0.0, 2.0e-05,")
    x, y, z = rng.uniform(-0.3, 0.3, 3)
    text = text.replace(
        "{name: tool, parent: ram}", f"{{name: tool, parent: ram, pose: {{position: [{x:.3f}, {y:.3f}, {z:.3f}]}}}}"
    )
    if carried == "workpiece":  # X carries the table
        text = text.replace("{name: carriage, parent: saddle, axis: X, squareness: {Y: -1.6e-05}}", "CARRIAGE")
        text = text.replace("    - CARRIAGE\n", "").replace("parent: carriage", "parent: saddle")
        text = text.replace(
            "    - {name: trunnion, parent: base",
            "    - {name: carriage, parent: base, axis: X}\n    - {name: trunnion, parent: carriage",
        )
        text = text.replace("squareness: {X: 1.1e-05, Y: -1.9e-05}", "squareness: {Y: -1.9e-05}")
    path.write_text(text, encoding="utf-8")
    return path


def tool(machine: MachineDescription, x: Array, way: float, warming: float, others: dict[str, float]) -> Array:
    """(n, 3) true deviation of the tool at X, m."""
    at = np.tile([others.get(letter, 0.0) for letter in machine.letters], (len(x), 1))
    ways = np.zeros_like(at)
    at[:, 0], ways[:, 0] = x, way
    return MachinePlant(machine).tool_offset(MachineStates(at, ways, np.full(len(x), warming)))[:, :3]


def moved(machine: MachineDescription, beside: tuple[float, float, float]) -> MachineDescription:
    body = machine.body(machine.tool)
    shift = tuple(float(a + b) for a, b in zip(body.pose.shift, beside, strict=True))
    other = replace(body, pose=replace(body.pose, shift=shift))
    return replace(machine, bodies=tuple(other if each is body else each for each in machine.bodies))


@pytest.mark.parametrize("carried", ["tool", "workpiece"])
@pytest.mark.parametrize(
    ("beside", "others", "warming"),
    [
        ((0.0, 0.0, 0.0), {}, 0.0),
        ((0.05, -0.1, 0.2), {"Y": 0.15, "Z": -0.2}, 0.0),
        ((0.0, 0.0, 0.0), {"Z": 0.1}, 6.0),
    ],
)
def test_positioning_is_what_other_errors_of_the_file_leave(
    tmp_path: Path, carried: str, beside: tuple[float, float, float], others: dict[str, float], warming: float
) -> None:
    """The file as a whole then makes what was read, where it was read: to the noise; without it 10 to 30 µm off."""
    for seed in range(4):
        path, rng = machine_file(tmp_path, seed, carried), np.random.default_rng([seed, 1])
        start = load_machine(path)
        truth = start.with_error("EXX", poly=(2e-6, 5e-6, -4e-6)).with_axis("X", reversal=2e-6)
        lines = ["target_mm,direction,cycle,deviation_um"]
        for cycle in range(1, 6):
            for way in (1, -1):
                read = SIGN[carried] * tool(moved(truth, beside), TARGETS, way, warming, others)[:, 0]
                rows = zip(TARGETS, read + 5e-8 * rng.normal(size=len(TARGETS)), strict=True)
                lines += [f"{1e3 * x:.3f},{way},{cycle},{1e6 * e:.4f}" for x, e in list(rows)[::way]]
        source = tmp_path / "runs.csv"
        source.write_text("\n".join(lines), encoding="utf-8")
        words = ["calibrate", "positioning", str(source), "--machine", str(path), "--axis", "X"]
        words += ["--beside-mm", *(f"{1e3 * each:g}" for each in beside)]
        words += ["--at", *(f"{name}={1e3 * q:g}" for name, q in others.items())] if others else []
        assert main([*words, "--temperature-c", f"{20 + warming:g}"]) == 0
        after = load_machine(path)
        for way in (1.0, -1.0):
            for place, warmer in ((beside, warming), ((0.0, 0.0, 0.0), 0.0), ((0.1, 0.1, 0.1), 3.0)):
                one, other = (tool(moved(each, place), TARGETS, way, warmer, others)[:, 0] for each in (after, truth))
                off = one - other
                # the place of the instrument's zero is nobody's: what other axes do at rest may be in it
                assert np.ptp(off) < 3e-7, (seed, way, place)


@pytest.mark.parametrize("carried", ["tool", "workpiece"])
def test_straightness_is_what_other_errors_of_the_file_leave(tmp_path: Path, carried: str) -> None:
    """Read 0.2 m above the tool: the file then makes the curve there, and a slope that no straightness shows stays."""
    beside = (0.03, -0.05, 0.2)
    for seed in range(4):
        path, rng = machine_file(tmp_path, seed, carried), np.random.default_rng([seed, 2])
        truth = load_machine(path).with_error("EYX", poly=(0.0, 0.0, 2e-6, 3e-6))
        x, lines = np.linspace(-0.25, 0.25, 51), ["segment,run,direction,position_mm,reading_um"]
        for run, way in enumerate((1, -1, 1, -1), start=1):
            read = SIGN[carried] * tool(moved(truth, beside), x, 0.0, 0.0, {})[:, 1] + 5e-8 * rng.normal(size=len(x))
            rows = [f"1,{run},{way},{1e3 * at:.3f},{1e6 * e:.4f}" for at, e in zip(x, read, strict=True)]
            lines += rows[::way]
        source = tmp_path / "runs.csv"
        source.write_text("\n".join(lines), encoding="utf-8")
        words = ["calibrate", "straightness", str(source), "--machine", str(path), "--component", "EYX"]
        assert main([*words, "--noise-um", "0.05", "--beside-mm", *(f"{1e3 * each:g}" for each in beside)]) == 0
        after = load_machine(path)
        for place in (beside, (0.0, 0.0, 0.0)):
            one, other = (tool(moved(each, place), x, 0.0, 0.0, {})[:, 1] for each in (after, truth))
            off = one - other
            level = off - np.polyval(np.polyfit(x, off, 1), x)
            assert np.ptp(level) < 3e-7
            # the file had a slope of 80 µrad; the test has one of its own, by the cubic, which levelling takes off
            assert abs(np.polyfit(x, off, 1)[0]) < 1.5e-5


@pytest.mark.parametrize("seed", range(3))
def test_angular_errors_lift_a_ground_surface_by_the_lever_of_the_wheel(seed: int) -> None:
    """A roll that bends, with the wheel beside and below its slide: each curve is that of the tool along its axis."""
    rng, machine = np.random.default_rng(seed), load_machine("grinder_zhou2023")
    for name in ("EAX", "ECX", "EAZ", "ECZ"):
        machine = machine.with_error(name, poly=(0.0, *map(float, 1e-5 * rng.normal(size=2))))
    machine = moved(machine, (0.2, -0.1, 0.3))
    workpiece = {"X": (-1.4, 0.0), "Z": (-0.65, -0.15)}
    found = predict_flatness(machine, "Y", workpiece, VerticalErrors((0.0,), 1e-6, 20e-6))
    for letter, curve in zip(found.feeds, found.curves, strict=True):
        at = np.zeros((len(curve.positions), len(machine.letters)))
        at[:, machine.letters.index(letter)] = curve.positions
        states = MachineStates(at, np.zeros_like(at), np.zeros(len(at)))
        off = MachinePlant(machine).tool_offset(states)[:, 1] - curve.errors
        level = off - np.polyval(np.polyfit(curve.positions, off, 1), curve.positions)
        assert np.abs(level).max() < 1e-8
