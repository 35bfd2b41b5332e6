"""Tables for controllers: their content by hand, and a COMP_FILE in a real headless LinuxCNC."""

from __future__ import annotations

import json
import math
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import pytest

from rotary_error_monitor.calibration.controller_tables import (
    AxisCompensation,
    comp_file,
    predict_axis_compensation,
    volumetric_table,
)
from rotary_error_monitor.cli import main
from rotary_error_monitor.description.machine import MachineDescription, load_machine
from rotary_error_monitor.description.machine_parts import ErrorComponent, ErrorTable
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.linuxcnc_controller.instance import Instance
from rotary_error_monitor.machine.correction import remaining_offset
from rotary_error_monitor.machine.kinematics import arrange_machine
from rotary_error_monitor.resources import config

POSITIONS = (-0.25, -0.1, 0.0, 0.05, 0.25)
FORWARD = (12e-6, 4e-6, 0.0, -5e-6, -20e-6)
BACKWARD = (15e-6, 8e-6, 3e-6, 1e-6, -14e-6)
MOTOR = Path(__file__).parent / "linuxcnc_motor.py"


def measured_machine() -> MachineDescription:
    """xyzac_trt with a measured positioning error of X by direction of travel."""
    machine = load_machine("xyzac_trt")
    axes = tuple(replace(axis, reversal=0.0, expansion=0.0) if axis.letter == "X" else axis for axis in machine.axes)
    table = ErrorComponent(table=ErrorTable(POSITIONS, FORWARD, BACKWARD))
    return replace(machine, axes=axes, errors={**machine.errors, "EXX": table})


def test_both_types_by_hand() -> None:
    compensation = predict_axis_compensation(measured_machine(), "X")
    np.testing.assert_allclose(compensation.positions, POSITIONS)
    np.testing.assert_allclose(compensation.forward, FORWARD, atol=1e-18)
    np.testing.assert_allclose(compensation.backward, BACKWARD, atol=1e-18)
    assert compensation.residue < 1e-15
    positions = [[float(word) for word in line.split()] for line in comp_file(compensation, 0).splitlines()]
    np.testing.assert_allclose(positions[0], [-250, -249.988, -249.985])
    trims = [[float(word) for word in line.split()] for line in comp_file(compensation, 1).splitlines()]
    np.testing.assert_allclose(trims[-1], [250, 0.020, 0.014])
    assert len(trims) == 5


def test_rotary_axis_is_in_degrees_and_reversal_is_in_the_columns() -> None:
    machine = load_machine("xyzac_trt")
    machine = replace(machine, axes=tuple(replace(a, reversal=8e-6) if a.letter == "C" else a for a in machine.axes))
    compensation = predict_axis_compensation(machine, "C", rows=181)
    np.testing.assert_allclose(compensation.backward - compensation.forward, 8e-6, atol=1e-18)
    rows = [[float(word) for word in line.split()] for line in comp_file(compensation, 1).splitlines()]
    component = machine.errors["ECC"]
    q = math.radians(rows[7][0])
    error = sum(w.cos * math.cos(w.order * q) + w.sin * math.sin(w.order * q) for w in component.harmonic)
    assert rows[7][1] == pytest.approx(-math.degrees(error - 4e-6), abs=2e-9)
    assert 0 < compensation.residue < 1e-8


def test_refusals() -> None:
    machine = measured_machine()
    with pytest.raises(InputError, match="from 2 to 256"):
        predict_axis_compensation(machine, "X", rows=257)
    with pytest.raises(InputError, match="no axis"):
        predict_axis_compensation(machine, "W")
    long = np.linspace(0, 1, 257)
    with pytest.raises(InputError, match="at most 256"):
        comp_file(AxisCompensation("X", False, long, long, long, 0.0), 0)
    with pytest.raises(InputError, match="not finite"):
        comp_file(AxisCompensation("X", False, long[:2], np.array([0, math.nan]), long[:2], 0.0), 1)
    with pytest.raises(InputError, match="COMP_FILE_TYPE 2"):
        comp_file(AxisCompensation("X", False, long[:2], long[:2], long[:2], 0.0), 2)  # type: ignore[arg-type]
    with pytest.raises(InputError, match="two points or more"):
        volumetric_table(machine, {"X": 1})


def test_long_tables_are_thinned_to_what_linuxcnc_takes() -> None:
    positions = np.linspace(-0.25, 0.25, 1000)
    wave = 1e-6 * np.sin(40 * positions)
    table = ErrorComponent(table=ErrorTable(tuple(positions), tuple(wave), tuple(wave)))
    machine = replace(measured_machine(), errors={"EXX": table})
    compensation = predict_axis_compensation(machine, "X")
    assert len(compensation.positions) == 256
    assert compensation.residue < 1e-6 * (40 * 0.5 / 255) ** 2 / 8 * 1.1


def test_volumetric_table_nulls_the_tool_offset() -> None:
    machine = load_machine("xyzac_trt")
    lines = volumetric_table(machine, {"X": 3, "Z": 4, "C": 2}).splitlines()
    assert lines[0] == "X_mm,Y_mm,Z_mm,A_deg,C_deg,dX_um,dY_um,dZ_um,dA_arcsec,dC_arcsec"
    values = np.array([[float(word) for word in line.split(",")] for line in lines[1:]])
    assert values.shape == (24, 10)
    radian = math.pi / 180
    positions = values[:, :5] * [1e-3, 1e-3, 1e-3, radian, radian]
    corrections = values[:, 5:] * [1e-6, 1e-6, 1e-6, radian / 3600, radian / 3600]
    left = remaining_offset(arrange_machine(machine), positions, corrections)
    assert np.abs(left[:, :3]).max() < 1e-9


@pytest.mark.few(1)
@pytest.mark.linuxcnc
@pytest.mark.parametrize("kind", [0, 1])
def test_linuxcnc_moves_the_motor_by_the_table(kind: Literal[0, 1], tmp_path: Path) -> None:
    """The motor goes where the axis then is at its nominal position, from either side and between rows."""
    if shutil.which("linuxcnc") is None:
        pytest.skip("LinuxCNC is not installed")
    folder = tmp_path / "machine"
    shutil.copytree(config("linuxcnc/xyzac_trt.ini").parent, folder)
    ini = folder / "xyzac_trt.ini"
    entry = f"[JOINT_0]\nCOMP_FILE = x.comp\nCOMP_FILE_TYPE = {kind}\n"
    ini.write_text(ini.read_text(encoding="utf-8").replace("[JOINT_0]\n", entry), encoding="utf-8")
    compensation = predict_axis_compensation(measured_machine(), "X")
    (folder / "x.comp").write_text(comp_file(compensation, kind), encoding="utf-8")
    with Instance(ini) as instance:
        targets = [-150.0, 30.0, 100.0, 240.0, 100.0, 30.0, -150.0]
        answer = subprocess.run(
            [*instance.enter, "/usr/bin/python3", str(MOTOR)],
            input=json.dumps(targets),
            env=instance.environment,
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
        assert answer.returncode == 0, answer.stderr + instance.log
    rows = np.array(json.loads(answer.stdout.splitlines()[-1]))
    direction = np.array([-1, 1, 1, 1, -1, -1, -1])
    x = rows[:, 0] * 1e-3
    np.testing.assert_allclose(rows[:, 0], targets, atol=1e-6)
    error = np.where(direction > 0, np.interp(x, POSITIONS, FORWARD), np.interp(x, POSITIONS, BACKWARD))
    np.testing.assert_allclose((rows[:, 1] - rows[:, 0]) * 1e-3, -error, atol=1e-9)


@pytest.mark.parametrize(
    ("grid", "points"),
    [(["X=1000", "Y=1000"], "1000000"), (["X=1e9", "Y=1e9", "Z=1e9"], "1e\\+27"), (["X=100001"], "100001")],
)
def test_a_grid_of_too_many_points_is_refused_at_once(
    tmp_path: Path,
    grid: list[str],
    points: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    out = tmp_path / "grid.csv"
    monkeypatch.setattr("numpy.meshgrid", lambda *_, **__: pytest.fail("points were made"))
    assert main(["calibrate", "tables", "xyzac_trt", "--grid", *grid, "-o", str(out)]) == 2
    assert re.search(f"a grid of {points} points; at most 100000 are solved", capsys.readouterr().err)
    assert not out.exists()
