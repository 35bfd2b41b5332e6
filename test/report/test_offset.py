"""`rotary_error_monitor offset`: what it prints and writes is the model's, and wrong input is named."""

from __future__ import annotations

import csv
import json
import math
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from rotary_error_monitor.cli import main
from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.machine.budget import estimate_budget
from rotary_error_monitor.machine.error_model import predict_tool_offset
from rotary_error_monitor.machine.kinematics import arrange_machine
from rotary_error_monitor.resources import config

COMPONENTS = ("dx_um", "dy_um", "dz_um", "da_urad", "db_urad", "dc_urad")
AT = ["--at", "X=100", "Y=-50", "A=30", "C=90"]
POSE = np.array([[0.1, -0.05, 0.0, math.radians(30), math.radians(90)]])
PROGRAM = "X_mm,Y_mm,Z_mm,A_deg,C_deg\n0,0,0,0,0\n# a comment\n100,-50,0,30,90\n-20,10,5,-15,400\n"
WAYS = "X_direction,Y_direction,Z_direction,A_direction,C_direction"


def run(*words: object) -> int:
    return main(["offset", *map(str, words)])


def lines_of(text: str) -> dict[str, list[float]]:
    """Rows of figures by their names."""
    found = re.finditer(r"^(.{32})((?: +-?[0-9.]+){6})$", text, re.MULTILINE)
    return {row[1].strip(): [float(word) for word in row[2].split()] for row in found}


def test_what_is_printed_is_the_models(capsys: pytest.CaptureFixture[str]) -> None:
    assert run("xyzac_trt", *AT, "--direction", "X=+", "C=-", "--temperature", "23.5") == 0
    rows = lines_of(capsys.readouterr().out)
    model = arrange_machine(load_machine("xyzac_trt"))
    how = {"direction": np.array([[1.0, 0, 0, 0, -1.0]]), "temperature": 23.5}
    for name, exact in (("exact", True), ("first order", False)):
        expected = predict_tool_offset(model, POSE, exact=exact, **how)[0] * 1e6
        np.testing.assert_allclose(rows[name], expected, rtol=0, atol=6e-5)
    bodies = [values for name, values in rows.items() if ": " in name]
    assert len(bodies) == 12  # seven bodies, five of them with an axis
    np.testing.assert_allclose(np.sum(bodies, axis=0), rows["sum"], rtol=0, atol=13 * 5e-5)
    np.testing.assert_allclose(rows["sum"], rows["first order"], rtol=0, atol=1e-12)


def test_what_is_not_known_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("xyzac_trt", *AT, "--direction", "X=+", "A=+") == 0
    text = capsys.readouterr().out
    assert "direction of travel of Y, Z, C is not known" in text
    assert "the file states no uncertainty" in text
    stated = tmp_path / "machine.yaml"
    content = config("machines/xyzac_trt.yaml").read_text(encoding="utf-8")
    content = content.replace("  name: xyzac_trt\n", "  name: xyzac_trt\n  uncertainty: {squareness: 2.0e-06}\n")
    stated.write_text(content, encoding="utf-8")
    assert run(stated, *AT) == 0
    text = capsys.readouterr().out
    assert "states no uncertainty" not in text
    # X and Y turn the tool about z, Z and X about y, Z and Y about x: any rotation of it is known to 2 µrad.
    np.testing.assert_allclose(lines_of(text)["standard uncertainty"][3:], 2.0, rtol=0, atol=1e-3)


def test_where_a_direction_is_not_known_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Of an axis whose direction is known at some poses nothing else is said than at how many it is not."""
    program = tmp_path / "poses.csv"
    rows = ["1,0,0,0,0,1,0,1,-1,0", "2,0,0,0,0,1,1,1,-1,0", "3,0,0,0,0,1,0,1,-1,0"]
    program.write_text("\n".join([f"X_mm,Y_mm,Z_mm,A_deg,C_deg,{WAYS}", *rows]), encoding="utf-8")
    assert run("xyzac_trt", "--program", program) == 0
    assert "direction of travel of Y at 2 of 3 poses, C is not known; the mean" in capsys.readouterr().out


@pytest.mark.parametrize("more", ["", f",{WAYS}", ",temperature_degC", f",{WAYS},temperature_degC"])
def test_a_program_gives_what_its_poses_give_one_by_one(
    more: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rng = np.random.default_rng(len(more))
    machine = load_machine("xyzac_trt")
    positions = np.array([rng.uniform(*axis.travel, 30) for axis in machine.axes]).T
    direction, warm = rng.choice([-1.0, 0.0, 1.0], positions.shape), rng.uniform(15.0, 30.0, 30)
    program = tmp_path / "poses.csv"
    lines = ["X_mm,Y_mm,Z_mm,A_deg,C_deg" + more]
    for q, way, degrees in zip(positions, direction, warm, strict=True):
        row = [*(q[:3] * 1e3), *np.degrees(q[3:])]
        row += [*way] if "direction" in more else []
        row += [degrees] if "temperature" in more else []
        lines.append(",".join(f"{value:.12g}" for value in row))
    program.write_text("\n".join(lines), encoding="utf-8")
    assert run("xyzac_trt", "--program", program, "-o", tmp_path / "out.csv", "--format", "csv,json,html,png") == 0
    assert "30 poses" in capsys.readouterr().out
    budget = estimate_budget(
        machine,
        positions,
        direction=direction if "direction" in more else None,
        temperature=warm if "temperature" in more else None,
    )
    with (tmp_path / "out.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    told = json.loads((tmp_path / "out.json").read_text(encoding="utf-8"))["poses"]
    assert len(rows) == len(told) == 30
    for k, (row, each) in enumerate(zip(rows, told, strict=True)):
        for name, values in (("exact", budget.exact), ("first_order", budget.first_order)):
            found = [float(row[f"{name}_{component}"]) for component in COMPONENTS]
            np.testing.assert_allclose(found, values[k] * 1e6, rtol=1e-9, atol=1e-7)
            np.testing.assert_allclose([each[name][c] for c in COMPONENTS], found, rtol=1e-12)
        parts = [part for body in each["bodies"].values() for part in body.values()]
        total = [math.fsum(part[component] for part in parts) for component in COMPONENTS]
        np.testing.assert_allclose(total, budget.first_order[k] * 1e6, rtol=0, atol=1e-9)
    page = (tmp_path / "out.html").read_text(encoding="utf-8")
    assert page.count("<img") == 2 and "trunnion: location" in page
    with Image.open(tmp_path / "out.png") as picture:
        assert min(picture.size) > 500


@pytest.mark.parametrize(("separator", "decimal"), [(",", "."), (";", ",")])
def test_tables_hold_poses_as_they_were_written(separator: str, decimal: str, tmp_path: Path) -> None:
    """Without the digits that mm and degrees have after a way through SI, and as spreadsheets write them."""
    rng = np.random.default_rng(7)
    axes = load_machine("xyzac_trt").axes
    scales = [1e3 if axis.kind == "linear" else 180 / math.pi for axis in axes]
    given = [
        [float(f"{rng.uniform(*axis.travel) * scale:.{digits}g}") for axis, scale in zip(axes, scales, strict=True)]
        for digits in rng.integers(1, 13, 300)
    ]
    given = [
        row
        for row in given
        if all(
            axis.travel[0] * scale <= value <= axis.travel[1] * scale
            for axis, scale, value in zip(axes, scales, row, strict=True)
        )
    ]
    header = separator.join(["X_mm", "Y_mm", "Z_mm", "A_deg", "C_deg"])
    rows = [separator.join(map(repr, row)).replace(".", decimal) for row in given]
    (tmp_path / "poses.csv").write_text("\n".join([header, *rows]), encoding="utf-8")
    words = ["--program", tmp_path / "poses.csv", "-o", tmp_path / "out.csv", "--format", "csv,json"]
    assert run("xyzac_trt", *words) == 0
    with (tmp_path / "out.csv").open(encoding="utf-8") as file:
        assert [[*map(float, row[:5])] for row in list(csv.reader(file))[1:]] == given
    told = json.loads((tmp_path / "out.json").read_text(encoding="utf-8"))["poses"]
    assert [[*each["pose"].values()][:5] for each in told] == given
    assert "-0.0," not in (tmp_path / "out.csv").read_text(encoding="utf-8")


def test_one_pose_as_page_and_picture(tmp_path: Path) -> None:
    assert run("pan2013", "--at", "X=1000", "A=30", "-o", tmp_path / "pose.html", "--format", "html,png,csv") == 0
    page = (tmp_path / "pose.html").read_text(encoding="utf-8").replace("\u00a0", " ")
    assert "3 carriage: location" in page and "X 1000 mm" in page
    assert (tmp_path / "pose.png").stat().st_size > 5_000


@pytest.mark.parametrize(
    ("travel", "expected"), [("[0.1, 0.6]", 0.1), ("[-0.6, -0.1]", -0.1), ("[-0.1, 0.6]", 0.0)], ids=str
)
def test_axes_not_named_stand_where_they_stand_in_a_table(travel: str, expected: float, tmp_path: Path) -> None:
    """At 0, or as near to it as they go: at one pose and over a grid."""
    content = config("machines/xyzac_trt.yaml").read_text(encoding="utf-8")
    assert content.count("Z: {kind: linear, direction: [0, 0, 1], travel: [-0.25, 0.25]") == 1
    machine, table = tmp_path / "machine.yaml", tmp_path / "table.csv"
    machine.write_text(content.replace("1], travel: [-0.25, 0.25]", f"1], travel: {travel}"), encoding="utf-8")
    assert run(machine, "--at", "X=100", "-o", tmp_path / "pose.csv") == 0
    assert main(["calibrate", "tables", str(machine), "--grid", "X=3", "-o", str(table)]) == 0
    for path, count in ((tmp_path / "pose.csv", 1), (table, 3)):
        with path.open(encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        assert len(rows) == count
        assert all([float(row[n]) for n in ("Y_mm", "Z_mm", "A_deg")] == [0.0, 1e3 * expected, 0.0] for row in rows)


@pytest.mark.parametrize("how", ["text", "latex"])
def test_the_array_is_printed(how: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("pan2013", "--array", how) == 0
    text = capsys.readouterr().out
    assert ("L^1(j)  0  0  0  2  3  4  5  6  7  8" if how == "text" else "0 & 0 & 0 & 2 & 3 & 4") in text


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["--at", "X=9000"], "--at: axis X at 9000 mm is beyond its travel"),
        (["--at", "X=one"], "--at X=one: 'one' is no number"),
        (["--at", "X=nan"], "--at X=nan: expected a finite number"),
        (["--at", "B=1"], "no axis of machine"),
        (["--at", "X"], "expected an axis, =, and a value"),
        (["--at", "X=1", "X=2"], "axis X is given twice"),
        ([*AT, "--direction", "X=up"], "--direction X=up: expected + or -"),
        ([*AT, "--direction", "X=+", "X=-"], "axis X is given twice"),
        ([*AT, "--temperature", "300"], "--temperature is 300"),
        ([*AT, "-o", "out.pdf"], "ends in none of"),
        ([*AT, "--format", "csv"], "it needs -o OUT"),
        ([*AT, "-o", "no/such/folder/out.csv"], "no folder"),
        (["--program", "poses.csv", "--temperature", "20"], "--temperature belongs to --at"),
        (["--program", "absent.csv"], "cannot be read"),
        (["--array", "text", "-o", "out.csv"], "what --array prints is not written"),
    ],
)
def test_wrong_input_is_named(
    words: list[str], expected: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("poses.csv").write_text(PROGRAM, encoding="utf-8")
    assert run("xyzac_trt", *words) == 2
    assert expected in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["poses.csv"]


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("X_mm", "X_m", "poses.csv:1: header"),
        ("\n0,0,0,0,0", "\n0,0,0,0", "poses.csv:2: 4 values"),
        ("30,90", "30,x", "poses.csv:4: C_deg 'x' is no number"),
        ("100,-50", "1000,-50", "poses.csv:4: axis X at 1000 mm is beyond its travel"),
        ("400", "nan", "poses.csv:5: C_deg nan is no finite number"),
    ],
)
def test_a_wrong_program_is_named_by_line(
    old: str, new: str, expected: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    program = tmp_path / "poses.csv"
    program.write_text(PROGRAM.replace("400", "300").replace(old, new) if old != "400" else PROGRAM.replace(old, new))
    assert run("xyzac_trt", "--program", program) == 2
    assert expected in capsys.readouterr().err


def test_a_direction_that_is_none_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    program = tmp_path / "poses.csv"
    program.write_text(f"X_mm,Y_mm,Z_mm,A_deg,C_deg,{WAYS}\n0,0,0,0,0,1,1,1,1,2\n", encoding="utf-8")
    assert run("xyzac_trt", "--program", program) == 2
    assert "poses.csv:2: C_direction 2; expected 1, -1, or 0" in capsys.readouterr().err


def test_nothing_is_written_over_what_is_read(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    program = Path(shutil.copy(config("machines/xyzac_trt.yaml"), tmp_path / "poses.csv"))
    before = program.read_bytes()
    assert run("xyzac_trt", "--program", program, "-o", program) == 2
    assert "it is the input" in capsys.readouterr().err
    assert program.read_bytes() == before
