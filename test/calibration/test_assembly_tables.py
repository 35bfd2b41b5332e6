"""Ring and mirror as measured curves: what `calibrate assembly --as table` writes, and how sure it is."""

from __future__ import annotations

import csv
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from calibration.drawn_calibrations import rates, true_flatness, true_graduation
from shaft_bags import TRUTH, simulated

from rotary_error_monitor.calibration.assembly_tables import (
    shown_orders,
)
from rotary_error_monitor.cli import main
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.metrology.periodic_curves import angular_values, planar_values
from rotary_error_monitor.resources import config

ARCSEC = np.pi / 648000
PSI = np.linspace(0, 2 * np.pi, 1001)
IDEAL = ("--centre-radial-um", "0", "--centre-lean-arcsec", "0")


@pytest.fixture
def stage(tmp_path: Path) -> Path:
    return Path(shutil.copy(config("stage.yaml"), tmp_path / "stage.yaml"))


def calibrate(bag: Path, stage: Path, *words: str) -> int:
    return main(["calibrate", "assembly", str(bag), "--stage", str(stage), "--date", "2026-11-21", *words])


def section(path: Path) -> Any:
    return yaml.safe_load(path.read_text(encoding="utf-8"))["stage"]


def test_curves_are_written_beside_the_stage_file(
    tmp_path: Path, stage: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert calibrate(simulated(tmp_path), stage, "--as", "table", *IDEAL) == 0
    printed = capsys.readouterr().out
    found = section(stage)
    names = found["encoder"]["graduation_table"]["file"], found["mirror"]["flatness_table"]["file"]
    assert names[0].startswith("stage_graduation_") and names[1].startswith("stage_flatness_")
    assert all((tmp_path / name).is_file() and str(tmp_path / name) in printed for name in names)
    assert found["encoder"]["graduation"] == found["mirror"]["flatness"] == []
    assert "in it orders 2 to 79 without 4, 8, 12" in printed and "in it orders 2 to 79\n" in printed
    described = load_stage(stage)
    ring, mirror = described.ring.graduation_table, described.mirror.flatness_table
    assert ring is not None and mirror is not None
    for table, left in (
        (ring, angular_values(ring, PSI) - true_graduation(TRUTH["graduation"], PSI)),
        (mirror, planar_values(mirror, PSI) - true_flatness(TRUTH["flatness"], PSI)),
    ):
        assert np.sqrt(np.mean(left**2)) < 1.5 * table.uncertainty < 2e-7
    rows = list(csv.reader(line for line in (tmp_path / names[0]).read_text().splitlines() if line[0] != "#"))
    assert rows[0] == ["angle_deg", "graduation_arcsec", "uncertainty_arcsec"]
    assert float(rows[2][1]) * ARCSEC == pytest.approx(ring.values[1], rel=1e-9)
    assert "2026-11-21" in (tmp_path / names[0]).read_text().splitlines()[0]
    assert "graduation_uncertainty" not in found["calibration"]["encoder"]["figures"]


@pytest.mark.long
def test_orders_and_curves_follow_one_another(tmp_path: Path, stage: Path) -> None:
    """What was there before goes to the history, with the file of an earlier curve still there."""
    assert calibrate(simulated(tmp_path), stage, "--as", "table", *IDEAL) == 0
    first = section(stage)["encoder"]["graduation_table"]["file"]
    assert calibrate(simulated(tmp_path, seed=1), stage, *IDEAL) == 0
    by_orders = section(stage)
    assert "graduation_table" not in by_orders["encoder"] and "flatness_table" not in by_orders["mirror"]
    assert [row["order"] for row in by_orders["encoder"]["graduation"]] == [2, 13]
    history = by_orders["calibration"]["encoder"]["history"]
    assert history[0]["values"]["encoder.graduation_table"] == {"file": first} and (tmp_path / first).is_file()
    assert calibrate(simulated(tmp_path, seed=2), stage, "--as", "table", *IDEAL) == 0
    second = section(stage)["encoder"]["graduation_table"]["file"]
    assert second != first
    assert calibrate(simulated(tmp_path, seed=3), stage, "--as", "table", *IDEAL) == 0
    assert len(list(tmp_path.glob("stage_graduation_*.csv"))) == 3


@pytest.mark.long
def test_what_these_heads_cannot_see_of_a_curve_stays(
    tmp_path: Path, stage: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Order 4 of the curve that the file has is hidden from four heads: it stays, as an order."""
    angles = np.arange(0, 360, 5)
    truth = {**TRUTH["graduation"], 4: (2e-6, -3e-6)}
    values = true_graduation(truth, np.radians(angles)) / ARCSEC
    lines = ["angle_deg,graduation_arcsec,uncertainty_arcsec"]
    lines += [f"{angle},{value:.6f},0.01" for angle, value in zip(angles, values, strict=True)]
    (tmp_path / "ring.csv").write_text("\n".join(lines), encoding="utf-8")
    text = stage.read_text(encoding="utf-8")
    stage.write_text(text.replace("    graduation:\n", "    graduation_table: {file: ring.csv}\n    graduation:\n"))
    content = yaml.safe_load(stage.read_text(encoding="utf-8"))
    content["stage"]["encoder"]["graduation"] = []
    stage.write_text(yaml.safe_dump(content), encoding="utf-8")
    bag = simulated(tmp_path, {"graduation": truth})
    for form in ("table", "orders"):
        assert calibrate(bag, stage, "--as", form, *IDEAL) == 0
        assert "graduation order 4: 0.74" in (printed := capsys.readouterr().out) and "cannot see it" in printed
        (row,) = [row for row in section(stage)["encoder"]["graduation"] if row["order"] == 4]
        np.testing.assert_allclose([row["cos"], row["sin"]], truth[4], atol=2e-8)


@pytest.mark.long
def test_a_ring_that_is_another_one_than_its_curve_says_is_told(
    tmp_path: Path, stage: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert calibrate(simulated(tmp_path), stage, "--as", "table", *IDEAL) == 0
    before = stage.read_bytes()
    other = {"graduation": {**TRUTH["graduation"], 5: (2e-6, 0.0)}}
    files = sorted(tmp_path.glob("*.csv"))
    capsys.readouterr()
    assert calibrate(simulated(tmp_path, other, seed=1), stage, "--as", "table", *IDEAL) == 10
    assert "encoder.graduation, order 5, was" in capsys.readouterr().out
    assert stage.read_bytes() == before and sorted(tmp_path.glob("*.csv")) == files


def test_a_stage_file_that_cannot_be_written_leaves_no_curve(
    tmp_path: Path, stage: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = simulated(tmp_path)

    def full(self: Path, target: Path) -> None:
        if ".draft" in self.name:
            raise OSError(28, "No space left on device")
        rename(self, target)

    rename = Path.replace
    monkeypatch.setattr(Path, "replace", full)
    assert calibrate(bag, stage, "--as", "table", *IDEAL) == 2
    assert "No space left" in capsys.readouterr().err
    assert not list(tmp_path.glob("*.csv")) and load_stage(stage) == load_stage()


def test_a_copy_elsewhere_lacks_the_curves_beside_the_file(
    tmp_path: Path, stage: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """What is written elsewhere would name files that are not there: it is not written, and the file is named."""
    assert calibrate(simulated(tmp_path), stage, "--as", "table", *IDEAL) == 0
    steps = Path(__file__).parents[2] / "doc" / "calibration" / "autocollimator.csv"
    (tmp_path / "elsewhere").mkdir()
    out = tmp_path / "elsewhere" / "other.yaml"
    words = ["calibrate", "autocollimator", str(steps), "--stage", str(stage), "-o", str(out), "--force"]
    assert main([*words, "--reference-arcsec", "0.115"]) == 2
    told = capsys.readouterr().err
    assert f"{out}:" in told and "graduation_table: " in told and "draft" not in told
    assert not list(out.parent.iterdir())


@pytest.mark.long
def test_bounds_hold_the_truth_as_often_as_they_say() -> None:
    """Of 12 drawn calibrations; of many more in `test_assembly_table_rates.py`.

    A curve has some 58 independent coefficients, so that 12 calibrations tell the rate to 0.9 % (one standard
    deviation).
    """
    for name, share in rates(range(12)).items():
        assert 0.92 < share < 0.98, (name, share)


def test_orders_in_words() -> None:
    assert shown_orders([2, 3, 4]) == "orders 2 to 4"
    assert shown_orders([2, 3, 5, 7]) == "orders 2 to 7 without 4, 6"
