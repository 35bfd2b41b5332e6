"""Characteristic matrices as formulas: the paper's printed ones, and their values against brute-force matrices."""

from __future__ import annotations

import math
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from pytransform3d.rotations import matrix_from_compact_axis_angle

from rotary_error_monitor.description.machine import DIRECTIONS, MachineDescription, load_machine
from rotary_error_monitor.description.machine_parts import Axis, Body, Displacement
from rotary_error_monitor.machine.characteristic import (
    CharacteristicMatrices,
    Entries,
    chain_equations,
    characteristic_matrices,
    plain,
)
from rotary_error_monitor.machine.kinematics import arrange_machine, stand
from rotary_error_monitor.machine.topology import low_order_array
from rotary_error_monitor.report.characteristic import array_latex, array_text

Array = NDArray[np.float64]


def by_body(machine: MachineDescription) -> dict[str, CharacteristicMatrices]:
    return {each.body.name: each for each in characteristic_matrices(machine)}


def rows(entries: Entries) -> list[str]:
    return [" ".join(plain(entry) for entry in row) for row in entries]


def test_the_matrices_that_the_paper_prints() -> None:
    """Equations 10-12, entry by entry; its x_wd, y_wd, z_wd are numbers of the machine here."""
    machine = load_machine("pan2013")
    workpiece = replace(
        machine.body("workpiece"),
        pose=Displacement(shift=(0.5, -0.25, 0.125)),
        location_error=Displacement((1e-6, 2e-6, 3e-6), (4e-6, 5e-6, 6e-6)),
    )
    gantry = machine.body("gantry")
    found = by_body(replace(machine, bodies=(workpiece, gantry, *machine.bodies[2:])))
    identity: Entries = ()
    (_, tp), (name, dtp), (_, ts), (_, dts) = found["workpiece"].matrices  # Equation 10
    assert rows(tp) == ["1 0 0 500", "0 1 0 -250", "0 0 1 125", "0 0 0 1"]
    assert name == "\\Delta T_{01,p}"
    assert rows(dtp) == ["1 -Δγ_wd Δβ_wd Δx_wd", "Δγ_wd 1 -Δα_wd Δy_wd", "-Δβ_wd Δα_wd 1 Δz_wd", "0 0 0 1"]
    assert (ts, dts) == (identity, identity)
    (_, tp), (_, dtp), (_, ts), (name, dts) = found["gantry"].matrices  # Equation 11
    assert (tp, dtp) == (identity, identity)
    assert rows(ts) == ["1 0 0 0", "0 1 0 y", "0 0 1 0", "0 0 0 1"]
    assert name == "\\Delta T_{02,s}"
    assert rows(dts) == ["1 -Δγ_y Δβ_y Δx_y", "Δγ_y 1 -Δα_y Δy_y", "-Δβ_y Δα_y 1 Δz_y", "0 0 0 1"]
    (_, tp), (_, dtp), (_, ts), (_, dts) = found["carriage"].matrices  # Equation 12
    assert tp == identity
    assert rows(dtp) == ["1 -Δγ_xy 0 0", "Δγ_xy 1 0 0", "0 0 1 0", "0 0 0 1"]
    assert rows(ts) == ["1 0 0 x", "0 1 0 0", "0 0 1 0", "0 0 0 1"]
    assert rows(dts) == ["1 -Δγ_x Δβ_x Δx_x", "Δγ_x 1 -Δα_x Δy_x", "-Δβ_x Δα_x 1 Δz_x", "0 0 0 1"]
    assert [plain(each) for each in chain_equations(machine)] == [  # Equations 13-15
        "0T_w = T_01 T_w",
        "0T_t = T_02 T_23 T_34 T_45 T_56 T_67 T_78 T_89 T_t",
        "E = 0T_t - 0T_w",
    ]


def value(entry: str, symbols: dict[str, float]) -> float:
    """Value of an entry in LaTeX, by Python's own arithmetic."""
    text = re.sub(r" \\cdot 10\^\{(-?\d+)\}", r"e\1", entry)
    for symbol in sorted(symbols, key=len, reverse=True):
        text = text.replace(symbol, f"({symbols[symbol]!r})")
    text = re.sub(r"\\(cos|sin) ", r"\1 ", text)
    text = re.sub(r"(\d\)?) (?=cos|sin|\()", r"\1 * ", text)
    return float(eval(text, {"cos": math.cos, "sin": math.sin}))


def as_matrix(entries: Entries, symbols: dict[str, float]) -> Array:
    if not entries:
        return np.eye(4)
    return np.array([[value(entry, symbols) for entry in row] for row in entries])


def evaluated(each: CharacteristicMatrices, machine: MachineDescription, at: dict[str, float], error: float) -> Array:
    """Product of the four matrices of a body in mm and rad, each error motion being `error`."""
    symbols = {}
    for symbol in each.symbols:
        number = re.match(r"[-\d.]+( \\cdot 10\^\{-?\d+\})?(?=\\ \\mathrm\{(mm|rad)\}$)", symbol.value)
        symbols[symbol.symbol] = value(number[0], {}) if number else error
    if each.body.axis is not None:
        axis = machine.axis(each.body.axis)
        letter = axis.letter
        symbols[letter.lower() if axis.kind == "linear" else f"\\theta_{{{letter}}}"] = at[letter]
    product = np.eye(4)
    for _, entries in each.matrices:
        product = product @ as_matrix(entries, symbols)
    return product


def skewed(name: str, seed: int) -> MachineDescription:
    """The machine with poses that turn, location errors everywhere, and axes in odd directions."""
    rng = np.random.default_rng(seed)

    def vector(size: float) -> tuple[float, float, float]:
        x, y, z = rng.normal(size=3) * size
        return float(x), float(y), float(z)

    def odd(axis: Axis) -> Axis:
        direction = rng.normal(size=3)
        x, y, z = direction / np.linalg.norm(direction)
        return replace(axis, direction=(float(x), float(y), float(z)))

    def moved(body: Body) -> Body:
        return replace(
            body,
            pose=Displacement(vector(0.3), vector(0.5)),
            location_error=Displacement(vector(1e-5), vector(1e-5)),
        )

    machine = load_machine(name)
    return replace(
        machine,
        monitored=None,
        bodies=tuple(map(moved, machine.bodies)),
        axes=tuple(map(odd, machine.axes)),
    )


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("name", ["pan2013", "xyzac_trt", "grinder_zhou2023"])
def test_formulas_have_the_values_of_the_model(name: str, seed: int) -> None:
    """Evaluated by Python's arithmetic they give the exact transforms but for squares of errors (10 µrad, 10 µm)."""
    machine = skewed(name, seed)
    rng = np.random.default_rng(50 + seed)
    q = np.array([rng.uniform(*axis.travel) for axis in machine.axes])
    at = {
        axis.letter: float(value) * (1e3 if axis.kind == "linear" else 1.0)
        for axis, value in zip(machine.axes, q, strict=True)
    }
    small = 1e-5
    errors = {
        f"E{direction}{axis.letter}": machine.with_error(f"E{direction}{axis.letter}", poly=(part,)).errors
        for axis in machine.axes
        for direction, part in zip(DIRECTIONS, [small * 1e-3] * 3 + [small] * 3, strict=True)
    }
    machine = replace(machine, errors={}, axes=tuple(replace(a, expansion=0.0, reversal=0.0) for a in machine.axes))
    for name_ in errors:
        machine = machine.with_error(name_, poly=(small * (1e-3 if name_[1] in "XYZ" else 1.0),))
    model = arrange_machine(machine)
    stance = stand(model, q[:, None], model.components.at(q[:, None], None, None))
    matrices = by_body(machine)
    for way, end in ((machine.tool, stance.tool.end), (machine.workpiece, stance.workpiece.end)):
        product, body = np.eye(4), way
        while body != "base":
            product = evaluated(matrices[body], machine, at, small) @ product
            body = machine.body(body).parent
        expected = np.vstack([end[:, :, 0], [0, 0, 0, 1]])
        expected[:3, 3] *= 1e3
        np.testing.assert_allclose(product[:3, :3], expected[:3, :3], rtol=0, atol=1e-5)
        # numbers have six digits, of lengths of up to 4 m
        np.testing.assert_allclose(product[:3, 3], expected[:3, 3], rtol=0, atol=0.05)


@pytest.mark.parametrize("angle", [-1.1, 0.4, 2.0])
def test_a_rotation_about_any_direction_is_that_of_rodrigues(angle: float) -> None:
    machine = skewed("pan2013", 9)
    for letter in "CA":
        axis = machine.axis(letter)
        body = machine.body_of(letter)
        entries = by_body(machine)[body.name].matrices[2][1]
        found = as_matrix(entries, {f"\\theta_{{{letter}}}": angle})
        expected = matrix_from_compact_axis_angle(np.array(axis.direction) * angle)
        np.testing.assert_allclose(found[:3, :3], expected, rtol=0, atol=3e-6)


@pytest.mark.parametrize("name", ["pan2013", "xyzac_trt", "grinder_zhou2023"])
def test_text_has_the_array_and_every_body(name: str) -> None:
    machine = load_machine(name)
    lines = array_text(machine).splitlines()
    for power, row in enumerate(low_order_array(machine)):
        assert f"  L^{power}(j)  {'  '.join(map(str, row))}" in lines
    for number, body in enumerate(machine.bodies, start=1):
        assert any(line.startswith(f"body {number} {body.name}, carried by ") for line in lines)
    assert not [line for line in lines if "\\" in line or "{" in line]


@pytest.mark.parametrize("name", ["pan2013", "xyzac_trt", "grinder_zhou2023"])
def test_latex_is_balanced(name: str) -> None:
    text = array_latex(load_machine(name))
    assert text.count("{") == text.count("}")
    for environment in set(re.findall(r"\\begin\{([a-z*]+)\}", text)):
        assert text.count(f"\\begin{{{environment}}}") == text.count(f"\\end{{{environment}}}")
    for matrix in re.findall(r"\\begin\{bmatrix\}(.*?)\\end\{bmatrix\}", text):
        assert [row.count("&") for row in matrix.split("\\\\")] == [3, 3, 3, 3]
    known = {"begin", "end", "Delta", "alpha", "beta", "gamma", "theta", "cos", "sin", "cdot", "mp", "times"}
    assert set(re.findall(r"\\([a-zA-Z]+)", text)) <= known | {"ldots", "mathrm", "equiv", "hline"}
    assert text.isascii() or all(line.startswith("%") for line in text.splitlines() if not line.isascii())


DOCUMENT = """\\documentclass{article}
\\usepackage[landscape,margin=1cm]{geometry}
\\usepackage{amsmath}
\\begin{document}
%s
\\end{document}
"""


@pytest.mark.skipif(shutil.which("pdflatex") is None, reason="no LaTeX on this computer")
@pytest.mark.parametrize("name", ["pan2013", "xyzac_trt", "grinder_zhou2023"])
def test_latex_compiles_and_fits_on_the_page(name: str, tmp_path: Path) -> None:
    (tmp_path / "array.tex").write_text(DOCUMENT % array_latex(load_machine(name)), encoding="utf-8")
    run = subprocess.run(
        ["pdflatex", "-interaction=nonstopmode", "-halt-on-error", "array.tex"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stdout[-2000:]
    assert "Overfull" not in run.stdout
    assert (tmp_path / "array.pdf").stat().st_size > 10_000


def test_numbers_of_two_digits_have_a_comma_between() -> None:
    machine = load_machine("pan2013")
    last = machine.bodies[-1]
    longer = replace(
        machine,
        bodies=(*machine.bodies, Body("probe", last.name), Body("ball", "probe")),
        tool="ball",
    )
    names = [each.name for each in characteristic_matrices(longer)]
    assert names[-3:] == ["T_{89}", "T_{9,10}", "T_{10,11}"]
