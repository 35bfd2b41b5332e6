"""Measured curves in a stage file: inline or as a CSV file beside it; what is wrong has its file and line."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
import yaml
from described_stages import stage_of

from rotary_error_monitor.description.stage import load_stage, stage_mapping
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.resources import config

ARCSEC = np.pi / 648000
EVEN = np.arange(0.0, 360.0, 10.0)


def stage_file(folder: Path, ring: object = None, mirror: object = None) -> Path:
    content = yaml.safe_load(config("stage.yaml").read_text(encoding="utf-8"))
    if ring is not None:
        content["stage"]["encoder"]["graduation_table"] = ring
    if mirror is not None:
        content["stage"]["mirror"]["flatness_table"] = mirror
    path = folder / "stage.yaml"
    path.write_text(yaml.safe_dump(content, sort_keys=False, default_flow_style=None), encoding="utf-8")
    return path


def line_of(path: Path, words: str) -> int:
    return next(k for k, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1) if words in line)


def csv(folder: Path, header: str, *columns: Sequence[float], name: str = "ring.csv") -> Path:
    rows = [",".join(f"{value:.9g}" for value in row) for row in zip(*columns, strict=True)]
    path = folder / name
    path.write_text("\n".join(["# a ring", header, *rows]) + "\n", encoding="utf-8")
    return path


def inline(angles: np.ndarray, values: np.ndarray) -> dict[str, list[float]]:
    return {"angles": np.radians(angles).tolist(), "values": values.tolist()}


def test_a_table_in_a_file_is_the_same_as_one_that_stands_there(tmp_path: Path) -> None:
    """Values in arcsec and angles in degrees are what they are in rad, and a twin holds the numbers themselves."""
    rng = np.random.default_rng(1)
    values, doubts = rng.normal(size=36), rng.uniform(0.1, 0.2, 36)
    csv(tmp_path, "angle_deg,graduation_arcsec,uncertainty_arcsec", EVEN, values, doubts)
    csv(tmp_path, "tilt_y_urad,angle_rad,tilt_x_urad", values, np.radians(EVEN), doubts, name="mirror.csv")
    stage = load_stage(stage_file(tmp_path, {"file": "ring.csv"}, {"file": "mirror.csv"}))
    ring, mirror = stage.ring.graduation_table, stage.mirror.flatness_table
    assert ring is not None and mirror is not None
    np.testing.assert_allclose(ring.angles, np.radians(EVEN), rtol=1e-8)
    np.testing.assert_allclose(ring.values, values * ARCSEC, rtol=1e-8)
    np.testing.assert_allclose(ring.uncertainties, doubts * ARCSEC, rtol=1e-8)
    np.testing.assert_allclose(mirror.y, values * 1e-6, rtol=1e-8)
    np.testing.assert_allclose(mirror.x, doubts * 1e-6, rtol=1e-8)
    assert mirror.uncertainties == () and mirror.uncertainty == 0.0
    written = {"angles": list(ring.angles), "values": list(ring.values), "uncertainties": list(ring.uncertainties)}
    assert load_stage(stage_file(tmp_path, written)).ring == stage.ring
    assert stage_of(stage_mapping(stage)) == stage


def test_the_uncertainty_of_a_table_is_that_over_the_turn(tmp_path: Path) -> None:
    """Of uneven angles each counts by its share of the turn: here against a fine sum of the linear course between."""
    rng = np.random.default_rng(2)
    angles = np.sort(rng.uniform(0, 2 * np.pi, 60))
    squares = rng.uniform(0.5, 2.0, 60) * 1e-12
    row = {"angles": angles.tolist(), "values": [0.0] * 60, "uncertainties": np.sqrt(squares).tolist()}
    table = load_stage(stage_file(tmp_path, row)).ring.graduation_table
    assert table is not None
    fine = np.interp(np.linspace(0, 2 * np.pi, 100_000), angles, squares, period=2 * np.pi)
    assert table.uncertainty == pytest.approx(np.sqrt(fine.mean()), rel=1e-3)


def test_a_closing_row_closes_the_table(tmp_path: Path) -> None:
    angles = np.append(EVEN, 360.0)
    values = np.append(np.cos(np.radians(EVEN)), 0.9)
    csv(tmp_path, "angle_deg,graduation_arcsec,uncertainty_arcsec", angles, values, np.full(37, 0.1))
    table = load_stage(stage_file(tmp_path, {"file": "ring.csv"})).ring.graduation_table
    assert table is not None
    knots, closed = table.knots
    assert len(knots) == 37 and knots[-1] == pytest.approx(2 * np.pi)
    assert closed[0] == closed[-1] == pytest.approx(0.95 * ARCSEC)


def turned(k: int) -> np.ndarray:
    angles = EVEN.copy()
    angles[[k, k + 1]] = angles[[k + 1, k]]
    return angles


ZERO = np.zeros(36)
DAMAGE = {
    "doubled": (np.where(EVEN == 50.0, 40.0, EVEN), ZERO, 8, r"the angle 0\.698\d* rad \(40°\) stands twice"),
    "unsorted": (turned(4), ZERO, 8, r"the angle 0\.698\d* rad \(40°\) comes after 0\.87\d* rad \(50°\)"),
    "half a turn": (EVEN / 2, ZERO, 38, r"does not close over the turn: it ends at .*\(175°\) and begins at 0 rad"),
    "radians": (np.radians(EVEN), ZERO, 38, r"does not close .*are they rad under the name of degrees\?"),
    "two turns": (
        EVEN - 180 + np.where(EVEN > 170, 180, 0),
        ZERO,
        38,
        "more than a turn; give the mean over the turns",
    ),
    "beyond": (EVEN * 2, ZERO, 22, "angle_deg 380 is beyond ±360: is it in another unit"),
    "a hole": (np.where(EVEN > 100, EVEN / 2 + 180, EVEN), ZERO, 14, "no angle within .*; expected 8 a turn at least"),
    "a unit that cannot be": (EVEN, np.where(EVEN == 30.0, 3000.0, 0.0), 6, "3000 is beyond ±2062.65: is it in ano"),
    "no number": (EVEN, np.where(EVEN == 30.0, np.nan, 0.0), 6, "graduation_arcsec nan is no finite number"),
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_what_is_wrong_with_a_file_has_its_line(tmp_path: Path, damage: str) -> None:
    angles, values, line, message = DAMAGE[damage]
    csv(tmp_path, "angle_deg,graduation_arcsec", angles, values)
    with pytest.raises(InputError, match=rf"^{tmp_path}/ring\.csv:{line}: .*{message}"):
        load_stage(stage_file(tmp_path, {"file": "ring.csv"}))


def test_a_seam_that_does_not_close_has_its_line(tmp_path: Path) -> None:
    """A ring that drifted while it was measured; with and without a stated uncertainty."""
    angles = np.append(EVEN, 360.0)
    values = 0.1 * np.cos(np.radians(angles)) + angles / 360
    csv(tmp_path, "angle_deg,graduation_arcsec", angles, values)
    with pytest.raises(InputError, match=r"ring\.csv:39: the table does not close over the turn: values begins at"):
        load_stage(stage_file(tmp_path, {"file": "ring.csv"}))
    values = 5 * np.cos(np.radians(angles)) + np.where(angles == 360, 0.5, 0.0)
    csv(tmp_path, "angle_deg,graduation_arcsec,uncertainty_arcsec", angles, values, np.full(37, 0.1))
    with pytest.raises(InputError, match=r"ring\.csv:39: the table does not close .*did it drift"):
        load_stage(stage_file(tmp_path, {"file": "ring.csv"}))


def test_what_is_wrong_with_a_file_as_a_whole(tmp_path: Path) -> None:
    path = stage_file(tmp_path, {"file": "ring.csv"})
    place = f"{path}:{line_of(path, 'graduation_table')}: stage.encoder.graduation_table"
    with pytest.raises(InputError, match=rf"^{place}: .*/ring\.csv: no such file; .*relative to the stage file"):
        load_stage(path)
    csv(tmp_path, "angle_deg,graduation_arcsec", EVEN[::6], ZERO[::6])
    with pytest.raises(InputError, match=r"ring\.csv: 6 rows; expected 8 to 4096 angles over a turn"):
        load_stage(path)
    csv(tmp_path, "angle,graduation", EVEN, ZERO)
    with pytest.raises(InputError, match=r"ring\.csv:2: header angle,graduation; expected angle_deg,graduation_arcsec"):
        load_stage(path)
    csv(tmp_path, "angle_deg,graduation_arcsec,uncertainty_arcsec", EVEN, ZERO, np.where(EVEN == 20, -0.1, 0.1))
    with pytest.raises(InputError, match=r"ring\.csv:5: a standard uncertainty below 0"):
        load_stage(path)
    both = stage_file(tmp_path, {"file": "ring.csv", **inline(EVEN, ZERO)})
    with pytest.raises(InputError, match=r"stage\.encoder\.graduation_table: .*expected: {file: NAME.csv} or {angles"):
        load_stage(both)


@pytest.mark.parametrize(
    ("angles", "values", "message"),
    [
        (np.degrees(EVEN), ZERO, r"graduation_table\.angles\.1: .*expected: rising angles in rad .*not degrees"),
        (EVEN, np.where(EVEN == 30.0, 1.5, 0.0), r"graduation_table\.values\.3: .*at most 10 mrad, not in arcsec"),
        (EVEN, ZERO[:30], r"graduation_table\.values: 30 values at 36 angles; expected one for each"),
        (turned(4), ZERO, r"graduation_table\.angles\.5: the angle .* comes after"),
        (EVEN[::6], ZERO[::6], r"graduation_table\.angles: .* is too short"),
    ],
)
def test_what_is_wrong_in_the_stage_file_has_its_line(
    tmp_path: Path, angles: np.ndarray, values: np.ndarray, message: str
) -> None:
    path = stage_file(tmp_path, inline(angles, values))
    with pytest.raises(InputError, match=rf"^{path}:\d+: stage\.encoder\.{message}"):
        load_stage(path)


def test_the_page_shows_what_is_read(tmp_path: Path) -> None:
    """doc/sensors.md: its rows of a stage file, and the columns of a file of which it shows the beginning."""
    page = (Path(__file__).parents[2] / "doc" / "sensors.md").read_text(encoding="utf-8")
    part = page.partition("## Ring and mirror as measured curves")[2].partition("\n## ")[0]
    (rows,) = re.findall(r"```yaml\n(.*?)```", part, re.DOTALL)
    (beginning,) = re.findall(r"```text\n(.*?)```", part, re.DOTALL)
    header, *shown = beginning.splitlines()
    step = float(shown[1].split(",")[0])
    more = [f"{angle:g},0.3,0.016" for angle in np.arange(len(shown) * step, 360, step)]
    (tmp_path / "my_ring.csv").write_text("\n".join([header, *shown, *more]), encoding="utf-8")
    content, told = (yaml.safe_load(text)["stage"] for text in (config("stage.yaml").read_text("utf-8"), rows))
    for part_name, fields in told.items():
        content[part_name] |= fields
    path = tmp_path / "stage.yaml"
    path.write_text(yaml.safe_dump({"stage": content}), encoding="utf-8")
    stage = load_stage(path)
    assert stage.ring.graduation_table is not None and len(stage.ring.graduation_table.angles) == 72
    assert stage.ring.graduation_table.values[1] == pytest.approx(float(shown[1].split(",")[1]) * ARCSEC)
    assert stage.mirror.flatness_table is not None and stage.mirror.flatness_table.uncertainty == pytest.approx(2e-7)
