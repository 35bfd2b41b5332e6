"""COMP_FILEs of LinuxCNC read back: what they take out, how far one is from another, and files that are none."""

from __future__ import annotations

import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
import pytest

from rotary_error_monitor.calibration.controller_tables import (
    AxisCompensation,
    comp_file,
    compare_compensations,
    predict_axis_compensation,
    read_comp_file,
)
from rotary_error_monitor.cli import main
from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.resources import config

MACHINE = load_machine("xyzac_trt")
TYPES: tuple[Literal[0, 1], ...] = (0, 1)


def drawn(seed: int, letter: str = "X", rows: int = 20) -> AxisCompensation:
    rng = np.random.default_rng(seed)
    axis = MACHINE.axis(letter)
    positions = np.sort(rng.uniform(*axis.travel, rows))
    forward, backward = 1e-5 * rng.normal(size=(2, rows))
    return AxisCompensation(letter, axis.kind == "rotary", positions, forward, backward, 0.0)


@pytest.mark.parametrize("kind", TYPES)
@pytest.mark.parametrize("letter", ["X", "C"])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_what_was_written_is_read(tmp_path: Path, seed: int, letter: str, kind: Literal[0, 1]) -> None:
    made = drawn(seed, letter)
    path = tmp_path / "axis.comp"
    path.write_text(comp_file(made, kind) + "\n", encoding="ascii")
    found = read_comp_file(path, MACHINE.axis(letter), kind)
    assert (found.letter, found.rotary) == (letter, letter == "C")
    for name in ("positions", "forward", "backward"):
        # nine decimals of mm or degrees; of type 0 two of them
        np.testing.assert_allclose(getattr(found, name), getattr(made, name), atol=4e-11)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_change_is_that_of_a_fine_grid(seed: int) -> None:
    """Against sums over a fine grid: linear between rows, constant beyond them."""
    before, after = drawn(seed), drawn(seed + 10)
    change = compare_compensations(before, after)
    grid = np.linspace(after.positions[0], after.positions[-1], 200_001)
    apart = [
        np.interp(grid, after.positions, new) - np.interp(grid, before.positions, old)
        for new, old in ((after.forward, before.forward), (after.backward, before.backward))
    ]
    assert change.rms == pytest.approx(float(np.sqrt(np.mean(np.square(apart)))), rel=1e-4)
    assert abs(change.largest) == pytest.approx(np.abs(apart).max(), rel=1e-3)
    way = 0 if change.direction > 0 else 1
    assert np.interp(change.position, grid, apart[way]) == pytest.approx(change.largest, rel=1e-3)
    outside = max(0.0, before.positions[0] - grid[0]) + max(0.0, grid[-1] - before.positions[-1])
    assert change.uncovered == pytest.approx(outside / (grid[-1] - grid[0]))
    same = compare_compensations(after, after)
    assert same.rms == same.largest == same.uncovered == 0.0


@pytest.mark.parametrize(
    ("text", "kind", "message"),
    [
        ("0 0 0\n1 x 1\n", 1, r":2: 1 x 1; expected nominal position, value for travel in positive and in negative"),
        ("0 0 0\n1 0\n", 1, r":2: 1 0; expected nominal position"),
        ("0 0 0\n1 nan 0\n", 1, r":2: 1 nan 0; expected nominal"),
        ("0 0 0\n\n0 0 0\n", 1, r":3: 0 after 0 mm; nominal positions must rise"),
        ("0 0 0\n100 100.01 100\n", 1, r":2: it moves the axis by 100.01 mm; is the file of COMP_FILE_TYPE 0"),
        ("-100 0.01 0.01\n100 0 0\n", 0, r":1: it moves the axis by 100\.01 mm; is the file of COMP_FILE_TYPE 1"),
        ("0 0 0\n", 1, r": 1 rows; a COMP_FILE has 2 to 256"),
        ("".join(f"{k} 0 0\n" for k in range(257)), 1, r": 257 rows; a COMP_FILE has 2 to 256"),
    ],
)
def test_files_that_are_none(tmp_path: Path, text: str, kind: Literal[0, 1], message: str) -> None:
    path = tmp_path / "axis.comp"
    path.write_text(text, encoding="ascii")
    with pytest.raises(InputError, match=f"^{re.escape(str(path))}{message}"):
        read_comp_file(path, MACHINE.axis("X"), kind)


def test_the_command_tells_what_changed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    machine = Path(shutil.copy(config("machines/xyzac_trt.yaml"), tmp_path / "machine.yaml"))
    made = predict_axis_compensation(load_machine(machine), "X")
    old = replace(made, forward=made.forward + 2e-6, backward=made.backward - 1e-6)
    (tmp_path / "old.comp").write_text(comp_file(old, 1), encoding="ascii")
    words = ["calibrate", "tables", str(machine), "--axis", "X", "--type", "1", "--against", str(tmp_path / "old.comp")]
    assert main([*words, "-o", str(tmp_path / "new.comp")]) == 0
    told = capsys.readouterr().out.splitlines()[-1]
    assert f"differs from that of {tmp_path / 'old.comp'} by 1.581 µm (root mean square), most by -2.000 µm" in told
    assert told.endswith("direction +1")
    assert main([*words, "-o", str(tmp_path / "old.comp")]) == 2
    assert "not written, for it is the input" in capsys.readouterr().err
    grid = ["calibrate", "tables", str(machine), "--grid", "X=3", "--against", str(tmp_path / "old.comp")]
    assert main([*grid, "-o", str(tmp_path / "grid.csv")]) == 2
    assert "a COMP_FILE is of one axis; give --axis as well" in capsys.readouterr().err
