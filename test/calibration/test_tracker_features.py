"""Tables of a laser tracker: spherical or Cartesian, with headers or without, and features that are not one curve."""

from __future__ import annotations

import csv
import math
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml

from rotary_error_monitor.calibration.tracker_features import read_tracker
from rotary_error_monitor.cli import main
from rotary_error_monitor.description.column_layout import ColumnLayout
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.resources import config

EXAMPLE = Path(__file__).parents[2] / "doc" / "calibration" / "tracker_head.csv"
NOISE = ["--distance-um", "1", "--distance-ppm", "0", "--angle-arcsec", "0.1"]


def readings() -> list[tuple[str, float, float, float]]:
    with EXAMPLE.open(encoding="utf-8") as file:
        rows = [row for row in csv.reader(file) if not row[0].startswith("#")]
    return [(name, float(d), math.radians(float(e)), math.radians(float(a))) for name, d, e, a in rows[1:]]


def points() -> list[tuple[str, float, float, float]]:
    """In mm, by Equation 16 of Pan et al. 2013."""
    return [
        (n, d * math.cos(e) * math.cos(a), d * math.cos(e) * math.sin(a), d * math.sin(e)) for n, d, e, a in readings()
    ]


def calibrate(source: Path, folder: Path, *more: str) -> int:
    machine = folder / "machine.yaml"
    shutil.copy(config("machines/pan2013.yaml"), machine)
    words = [str(source), "--machine", str(machine), *NOISE, "-o", str(folder / "out.yaml"), *more]
    return main(["calibrate", "squareness", *words])


def errors_of(path: Path) -> list[float]:
    bodies = yaml.safe_load(path.read_text(encoding="utf-8"))["machine"]["bodies"]
    found: list[float] = []
    for body in bodies:
        for section in ("squareness", "location_error"):
            for value in (body.get(section) or {}).values():
                found += value if isinstance(value, list) else [value]
    return found


def point_list(folder: Path, how: str) -> tuple[Path, list[str]]:
    """The example as a point list: with headers in metres, or without in mm or inches."""
    path = folder / f"points_{how}.txt"
    if how == "headers":
        rows = [
            ";".join([str(k), *(f"{value / 1e3:.12f}".replace(".", ",") for value in place), feature])
            for k, (feature, *place) in enumerate(points())
        ]
        path.write_text("\n".join(["Job 7", "No;East;North;Up;Group", *rows]), encoding="utf-8")
        return path, ["feature=Group", "x=East,m", "y=North,m", "z=Up,m"]
    mark, unit, scale = {"commas": (", ", "mm", 1.0), "blanks": ("   ", "mm", 1.0), "inches": ("\t", "in", 25.4)}[how]
    cells = [
        [feature, f"p{k}", *(f"{value / scale:.9f}" for value in place)] for k, (feature, *place) in enumerate(points())
    ]
    rows = [mark.join(["Measured", *row]) for row in cells]
    path.write_text("\n".join(["// points in the frame of the instrument", "", *rows, ""]), encoding="utf-8")
    return path, ["feature=#2", f"x=#4,{unit}", f"y=#5,{unit}", f"z=#6,{unit}"]


@pytest.mark.few(2)
@pytest.mark.parametrize("how", ["headers", "commas", "blanks", "inches"])
def test_points_say_what_readings_say(tmp_path: Path, how: str) -> None:
    """Angles of the example are written to 2e-11 rad."""
    assert calibrate(EXAMPLE, tmp_path) == 0
    expected = errors_of(tmp_path / "out.yaml")
    source, words = point_list(tmp_path, how)
    assert calibrate(source, tmp_path, "--columns", *words) == 0
    np.testing.assert_allclose(errors_of(tmp_path / "out.yaml"), expected, rtol=1e-5, atol=1e-9)


def test_readings_of_points_all_round(tmp_path: Path) -> None:
    rng = np.random.default_rng(4)
    places = rng.uniform(-3e3, 3e3, (200, 3))
    rows = [f"{x:.9f},X,{z:.9f},{y:.9f}" for x, y, z in places]
    path = tmp_path / "points.csv"
    path.write_text("\n".join(["x_mm,feature,z_mm,y_mm", *rows]), encoding="utf-8")
    seen = read_tracker(path)["X"]
    level = seen.distance * np.cos(seen.elevation)
    back = [level * np.cos(seen.azimuth), level * np.sin(seen.azimuth), seen.distance * np.sin(seen.elevation)]
    np.testing.assert_allclose(np.transpose(back) * 1e3, places, atol=1e-8)
    assert list(seen.lines[:3]) == [2, 3, 4]


def changed(folder: Path, change: dict[str, str]) -> Path:
    """The example, some of its features under other names."""
    path = folder / "tracker.csv"
    lines = EXAMPLE.read_text(encoding="utf-8").splitlines()
    cells = [line.partition(",") for line in lines]
    path.write_text("\n".join(change.get(name, name) + mark + rest for name, mark, rest in cells), encoding="utf-8")
    return path


def first_line(name: str) -> int:
    return next(k for k, line in enumerate(EXAMPLE.read_text().splitlines(), start=1) if line.startswith(f"{name},"))


@pytest.mark.parametrize(
    ("change", "at", "told"),
    [
        ({"X": "Y"}, "X", "feature Y: two features under one name? From here on the points lie on another line"),
        ({"Z": "X"}, "Z", "feature X: two features under one name? From here on the points lie on another line"),
        ({"C.2": "C.1"}, "C.2", "feature C.1: two features under one name? .* on another circle; .* such as C.1 and"),
        ({"A.1": "A", "A.2": "A"}, "A.2", "feature A: two features under one name? .* another circle; .* such as A.1"),
        ({"spindle.2": "spindle.1"}, "spindle.2", "feature spindle.1: two features under one name?"),
        ({"Z": "X.2"}, "Z", "feature X.2: a linear axis is one feature; call all of its points X"),
        ({"spindle.1": "spndle.1"}, "spindle.1", "feature spndle.1: no axis of machine pan2013 is called 'spndle'"),
    ],
)
def test_features_under_wrong_names(tmp_path: Path, change: dict[str, str], at: str, told: str, capsys) -> None:
    assert calibrate(changed(tmp_path, change), tmp_path) == 2
    error = capsys.readouterr().err
    assert f"tracker.csv:{first_line(at)}: " in error
    assert re.search(told.replace("?", r"\?"), error), error
    assert not (tmp_path / "out.yaml").exists()


@pytest.mark.parametrize("how", ["there and back", "one row too early"])
def test_a_run_that_goes_back(tmp_path: Path, how: str, capsys) -> None:
    head, *rows = EXAMPLE.read_text(encoding="utf-8").splitlines()[1:]
    own = [row for row in rows if row.startswith("X,")]
    if how == "there and back":
        run, line = [*own, *own[-2::-1]], len(own) + 2
    else:
        run, line = [*own[:4], own[5], own[4], *own[6:]], 7
    source = tmp_path / "tracker.csv"
    source.write_text("\n".join([head, *run, *(row for row in rows if not row.startswith("X,"))]), encoding="utf-8")
    assert calibrate(source, tmp_path) == 2
    places = [np.array(p) for name, *p in points() if name == "X"]
    step = float(np.linalg.norm(places[5] - places[4]))
    said = capsys.readouterr().err
    found = re.search(r"tracker\.csv:(\d+): feature X: this point lies (\S+) mm before", said)
    assert found, said
    assert int(found[1]) == line
    assert float(found[2]) == pytest.approx(step, rel=1e-3)
    assert "in the order of its positive direction" in said


@pytest.mark.few(2)
@pytest.mark.parametrize("seed", range(5))
def test_several_readings_at_a_station_are_one_run(tmp_path: Path, seed: int) -> None:
    rng = np.random.default_rng(seed)
    path = tmp_path / "points.csv"
    repeated = [(n, np.array(p) + 1e-3 * rng.normal(size=3)) for n, *p in points() for _ in range(5)]
    path.write_text(
        "\n".join(["feature,x_mm,y_mm,z_mm", *(f"{n},{x:.6f},{y:.6f},{z:.6f}" for n, (x, y, z) in repeated)]),
        encoding="utf-8",
    )
    assert calibrate(path, tmp_path) == 0


@pytest.mark.few(2)
@pytest.mark.parametrize("feature", ["X", "C.1", "A.2", "spindle.1", "zero"])
@pytest.mark.parametrize("count", [1, 2, 3, 4])
def test_few_points_of_a_feature_are_told_without_a_traceback(tmp_path: Path, feature: str, count: int, capsys) -> None:
    head, *rows = EXAMPLE.read_text(encoding="utf-8").splitlines()[1:]
    own = [row for row in rows if row.startswith(f"{feature},")][:count] or [f"zero,5000,-10,{k}" for k in range(count)]
    source = tmp_path / "tracker.csv"
    source.write_text("\n".join([head, *own, *(row for row in rows if not row.startswith(f"{feature},"))]))
    assert calibrate(source, tmp_path) in (0, 2, 10)
    said = capsys.readouterr().err
    assert not said or f"tracker.csv: feature {feature.partition('.')[0]}: " in said, said


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("feature,distance_mm,elevation_deg,azimuth_deg\nX,100,0,0\nX,0,0,0\n", ":3: a distance that is not above 0"),
        ("feature,x_mm,y_mm,z_mm\nX,100,0,0\nX,0,0,0\n", ":3: a point at the instrument itself"),
        ("feature,x_mm,y_mm,z_mm\nX,100,0,0\nX,200000,0,0\n", ":3: x_mm 200000 is beyond ±100000: is it in another"),
        ("feature,x_mm,y_mm\nX,100,0\n", "header feature,x_mm,y_mm; expected feature,distance_mm,.* or feature,x_mm"),
    ],
)
def test_bad_points(tmp_path: Path, text: str, told: str) -> None:
    path = tmp_path / "points.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=told):
        read_tracker(path)


def test_angles_in_another_unit(tmp_path: Path, capsys) -> None:
    path = tmp_path / "tracker.csv"
    rows = [f"{name},{d:.6f},{e:.12f},{a:.12f}" for name, d, e, a in readings()]
    path.write_text("\n".join(["feature,distance_mm,elevation_deg,azimuth_deg", *rows]), encoding="utf-8")
    assert calibrate(path, tmp_path) == 2
    assert "are angles and distances in the units of the header" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "text", "told"),
    [
        (["feature=#1", "x=X", "y=Y", "z=Z"], "A 1 2 3", "headers and numbers of columns are mixed"),
        (["feature=#1", "x=#2", "y=#3", "z=#5"], "A 1 2 3", "no line has 5 columns, which --columns asks for"),
        (["feature=#1", "x=#2", "y=#3", "z=#4"], "A 1 2 3\nB 1 2", ":2: 3 columns; expected one for each of #1, #2"),
        (["feature=#1", "x=#2", "y=#3", "z=#4"], "A 1 2 3\nB 1 2 far", ":2: z_mm 'far' is no number"),
    ],
)
def test_columns_by_number(tmp_path: Path, words: list[str], text: str, told: str) -> None:
    path = tmp_path / "points.txt"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=told):
        read_tracker(path, ColumnLayout.of(words))
