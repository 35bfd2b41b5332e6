"""Positioning of axes that are inclined to x, y and z, such as the nutating axis of a 45 degree head or a slant bed."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rotary_error_monitor.calibration.controller_tables import predict_axis_compensation
from rotary_error_monitor.cli import main
from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.machine.components import arrange_components

ROOT = math.sqrt(0.5)
DIRECTIONS = {
    "nutating head": ("B", "rotary", (0.0, ROOT, ROOT)),
    "nutating head backwards": ("B", "rotary", (0.0, -ROOT, ROOT)),
    "slant bed": ("X", "linear", (0.6, 0.0, -0.8)),
    "aligned": ("X", "linear", (-1.0, 0.0, 0.0)),
    "of rounded digits": ("B", "rotary", (6.1e-17, 1.0, 0.0)),
}
TARGETS = np.linspace(-0.2, 0.2, 9)


def machine_file(folder: Path, kind: str) -> Path:
    """A machine of one axis with errors in all six components that are no positioning error alone."""
    letter, sort, direction = DIRECTIONS[kind]
    across = np.cross(direction, (0.3, 0.5, 0.7))  # an error that moves nothing along the axis
    first = "XYZ" if sort == "linear" else "ABC"
    rows = "".join(
        f"    E{name}{letter}: {{poly: [0.0, {4e-6 * size:.12f}]}}\n"
        for name, size in zip(first, across.tolist(), strict=True)
        if abs(size) > 1e-9
    )
    path = folder / "machine.yaml"
    path.write_text(
        f"""machine:
  name: inclined
  tool: tool
  workpiece: workpiece
  axes:
    {letter}: {{kind: {sort}, direction: {list(direction)}, travel: [-0.2, 0.2], reversal: 3.0e-06}}
  bodies:
    - {{name: workpiece, parent: base}}
    - {{name: head, parent: base, axis: {letter}}}
    - {{name: tool, parent: head, pose: {{position: [0, 0, -0.1]}}}}
  errors:
{rows or "    EXB: {poly: [0.0]}"}
"""
    )
    return path


def turned_along(machine, letter, q, way):
    """How much farther the axis is at `q` than commanded: of its whole motion, exact, what is along its direction."""
    axis = machine.axis(letter)
    errors = arrange_components(machine).at(np.array([[q]]), np.array([[way]]), None)[:, 0, 0]
    direction = np.array(axis.direction)
    if axis.kind == "linear":
        return float(direction @ (direction * q + errors[:3])) - q
    whole = Rotation.from_rotvec(direction * q) * Rotation.from_rotvec(errors[3:])
    return float(direction @ whole.as_rotvec()) - q


@pytest.mark.parametrize("kind", DIRECTIONS)
def test_a_table_has_what_is_along_the_axis_with_all_of_the_reversal_error(tmp_path, kind):
    machine = load_machine(str(machine_file(tmp_path, kind)))
    letter = DIRECTIONS[kind][0]
    found = predict_axis_compensation(machine, letter)
    for way, column in ((1.0, found.forward), (-1.0, found.backward)):
        expected = [turned_along(machine, letter, q, way) for q in found.positions]
        np.testing.assert_allclose(column, expected, atol=3e-10)  # products of errors
        np.testing.assert_allclose(column, -way * 1.5e-6, atol=3e-10)


@pytest.mark.few(3)
@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("kind", DIRECTIONS)
def test_what_was_measured_along_the_axis_is_what_it_does_and_what_its_table_takes_out(tmp_path, capsys, kind, seed):
    letter, sort, _ = DIRECTIONS[kind]
    path, out = machine_file(tmp_path, kind), tmp_path / "out.yaml"
    rng = np.random.default_rng(seed)
    curves = {way: rng.normal(0.0, 8e-6, len(TARGETS)) for way in (1, -1)}
    position, deviation = (1e3, 1e6) if sort == "linear" else (180 / math.pi, 180 / math.pi * 3600)
    source = tmp_path / "test.csv"
    target, unit = ("target_mm", "um") if sort == "linear" else ("target_deg", "arcsec")
    header = f"{target},direction,cycle,deviation_{unit}"
    lines = [
        f"{q * position:.9f},{way},{cycle},{(curve[k] + rng.normal(0.0, 1e-9)) * deviation:.9f}"
        for cycle in range(1, 6)
        for way, curve in curves.items()
        for k, q in list(enumerate(TARGETS))[::way]
    ]
    source.write_text("\n".join([header, *lines]) + "\n")
    words = ["calibrate", "positioning", str(source), "--machine", str(path), "--axis", letter, "-o", str(out)]
    assert main(words) == 0
    machine = load_machine(str(out))
    for way, curve in curves.items():
        expected = [turned_along(machine, letter, q, float(way)) for q in TARGETS]
        np.testing.assert_allclose(curve, expected, atol=5e-9)
    names, told = ", ".join(machine.axis(letter).positioning_shares), capsys.readouterr().out
    assert f"positioning ({names})" in told
    lost = "across the axis, which the file had in"
    assert (f"{lost} {names}, is in the history now" in told) == (lost in told) == ("," in names)
    if lost in told:  # what is across at the ends of the travel, where no direction is known, by component
        at_end = arrange_components(load_machine(str(path))).at(np.array([[TARGETS[-1]]]), np.zeros((1, 1)), None)
        parts = [at_end["XYZABC".index(name[1]), 0, 0] for name in machine.axis(letter).positioning_shares]
        number, shown = told.partition(f" {lost}")[0].split()[-2:]
        assert shown == ("µm" if sort == "linear" else "arcsec")
        assert float(number) == pytest.approx(np.abs(parts).max() * deviation, rel=0.01)
    table = predict_axis_compensation(machine, letter)
    np.testing.assert_allclose(table.positions, TARGETS, atol=1e-9)
    np.testing.assert_allclose(table.forward, curves[1], atol=5e-9)
    np.testing.assert_allclose(table.backward, curves[-1], atol=5e-9)
