"""Recordings between centres that fit their model and are wrong: exchanged axes, and shafts that their centres move."""

from __future__ import annotations

import argparse
import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from draws import seeds
from shaft_bags import TRUTH, simulated

from rotary_error_monitor.commands import calibrate
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.resources import config

SEEDS = range(3)
SIZE = np.hypot(*TRUTH["tilt"])


def run(*words: object) -> int:
    parser = argparse.ArgumentParser()
    calibrate.add(parser)
    arguments = parser.parse_args(["assembly", *map(str, words), "--date", "2026-11-21"])
    return int(arguments.run(arguments))


def notes_of(path: Path) -> Any:
    return yaml.safe_load(path.read_text(encoding="utf-8"))["stage"]["calibration"]


@pytest.fixture
def stage(tmp_path: Path) -> Path:
    return Path(shutil.copy(config("stage.yaml"), tmp_path / "stage.yaml"))


def mirrored(way: str, seed: int) -> dict[str, Any]:
    """What a shaft shows of tilt and flatness if the axes of the autocollimator are exchanged, or one is negated."""
    x, y = TRUTH["tilt"]
    rows = {order: row if seed else (0.0, 0.0, 0.0, 0.0) for order, row in TRUTH["flatness"].items()}
    if way == "exchanged":
        flatness = {order: (c, d, a, b) for order, (a, b, c, d) in rows.items()}
        # y = tilt_x, x = tilt_y of a tilt that goes with the rotation
        return {"tilt": (0.0, 0.0), "flatness": {**flatness, 1: (y, x, x, -y)}}
    sign = -1.0 if way == "x" else 1.0
    flatness = {order: (sign * a, sign * b, -sign * c, -sign * d) for order, (a, b, c, d) in rows.items()}
    return {"tilt": (0.0, 0.0), "flatness": {**flatness, 1: (sign * x, -sign * y, -sign * y, -sign * x)}}


@pytest.mark.parametrize("way", ["exchanged", "x", "y"])
@pytest.mark.parametrize("seed", SEEDS)
def test_exchanged_axes_of_the_autocollimator_are_named(
    tmp_path: Path, stage: Path, seed: int, way: str, capsys: pytest.CaptureFixture[str]
) -> None:
    before, bag = stage.read_bytes(), simulated(tmp_path, mirrored(way, seed), seed=seed)
    assert run(bag, "--stage", stage) == calibrate.NOT_GOOD
    text = capsys.readouterr().out
    assert re.search(r"order 1 goes against the rotation, by 12\.9\d\d arcsec", text)
    assert "are its two axes exchanged, or is one of them of the wrong sign?" in text
    assert stage.read_bytes() == before
    assert run(bag, "--stage", stage, "--force") == 0
    error = np.abs(np.subtract(load_stage(stage).mirror.tilt, TRUTH["tilt"])).max()
    assert error < 2 * notes_of(stage)["mirror"]["uncertainty"]
    assert "against the rotation" in notes_of(stage)["mirror"]["remark"]


@pytest.mark.parametrize("seed", SEEDS)
def test_flatness_of_order_one_beside_a_tilt_is_written(tmp_path: Path, stage: Path, seed: int) -> None:
    flatness = {**TRUTH["flatness"], 1: (2e-6, 1e-6, 1e-6, -2e-6)}
    assert run(simulated(tmp_path, {"flatness": flatness}, seed=seed), "--stage", stage) == 0


def moving(radial: float, lean: float, phase: float) -> dict[str, Any]:
    """A shaft that its centres carry round with the rotation, m and rad."""
    return {
        "radial": lambda a, t, w: radial * np.exp(1j * (a + phase)),
        "lean": lambda a, t, w: lean * np.exp(1j * (a + phase)),
    }


@pytest.mark.parametrize("seed", SEEDS)
def test_a_shaft_that_its_centres_move_is_within_the_uncertainty(tmp_path: Path, stage: Path, seed: int) -> None:
    """Centres with 5 µm of run-out in all, 0.3 m apart: nothing before to hold it against."""
    bag = simulated(tmp_path, moving(2.4e-6, 9e-6, 2.0 * seed), seed=seed)
    assert run(bag, "--stage", stage) == 0
    notes, found = notes_of(stage), load_stage(stage)
    for part, vector, key in (
        ("encoder", found.encoder.eccentricity, "eccentricity"),
        ("mirror", found.mirror.tilt, "tilt"),
    ):
        error = np.abs(np.subtract(vector, TRUTH[key])).max()
        assert error < 2.5 * notes[part]["uncertainty"]
    assert notes["encoder"]["uncertainty"] == pytest.approx(1e-6, rel=0.01)
    assert notes["mirror"]["uncertainty"] == pytest.approx(np.radians(1 / 3600), rel=0.01)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_shaft_that_leans_against_its_rotation_is_within_the_uncertainty(
    tmp_path: Path, stage: Path, seed: int
) -> None:
    """It looks like flatness of order 1, which this mirror has not."""
    bag = simulated(tmp_path, {"lean": lambda a, t, w: 5e-6 * np.exp(-1j * a)}, seed=seed)
    assert run(bag, "--stage", stage) == 0
    row = next(row for row in load_stage(stage).mirror.flatness if row.order == 1)
    assert max(np.abs([*row.x, *row.y])) < 2 * notes_of(stage)["mirror"]["figures"]["flatness_uncertainty"]


@pytest.mark.parametrize("seed", SEEDS)
def test_what_contradicts_an_earlier_calibration_is_written_by_force_only(
    tmp_path: Path, stage: Path, seed: int, capsys: pytest.CaptureFixture[str]
) -> None:
    good = "--centre-radial-um", 0.1, "--centre-lean-arcsec", 0.1
    assert run(simulated(tmp_path, seed=seed), "--stage", stage, *good) == 0
    assert run(simulated(tmp_path, seed=seed + 10), "--stage", stage, *good) == 0, "the same shaft again"
    before = stage.read_bytes()
    bag = simulated(tmp_path, moving(3e-6, 2e-5, 0.7 * seed), seed=seed)
    capsys.readouterr()
    assert run(bag, "--stage", stage, *good) == calibrate.NOT_GOOD
    text = capsys.readouterr().out
    assert re.search(r"encoder.eccentricity was \(\d+\.\d+, 1[45]\.\d+\) ± 0\.1\d* µm and now is \(\d", text)
    assert re.search(r"mirror.tilt was \(-6\.\d+, 11\.\d+\) ± 0\.\d\d* arcsec and now is", text)
    assert stage.read_bytes() == before
    assert run(bag, "--stage", stage, *good, "--force") == 0
    notes, found = notes_of(stage), load_stage(stage)
    for part, vector, key in (
        ("encoder", found.encoder.eccentricity, "eccentricity"),
        ("mirror", found.mirror.tilt, "tilt"),
    ):
        assert np.abs(np.subtract(vector, TRUTH[key])).max() < 2 * notes[part]["uncertainty"]
        assert f"{key} was" in notes[part]["remark"]


def test_a_change_that_the_centres_may_have_made_is_told(
    tmp_path: Path, stage: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """An earlier calibration of some nanometres, then one whose shaft moved by 1 µm, which the default allows."""
    assert run(simulated(tmp_path), "--stage", stage, "--centre-radial-um", 0, "--centre-lean-arcsec", 0) == 0
    assert run(simulated(tmp_path, moving(1e-6, 0.0, 0.0), seed=1), "--stage", stage) == 0
    text = capsys.readouterr().out
    assert re.search(
        r"note: encoder.eccentricity was .* and now is .*; the shaft's motion between centres may be", text
    )


def test_another_graduation_than_before_is_written_by_force_only(
    tmp_path: Path, stage: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(simulated(tmp_path), "--stage", stage) == 0
    other = {**TRUTH["graduation"], 2: (1e-6, 2e-6)}
    assert run(simulated(tmp_path, {"graduation": other}, seed=1), "--stage", stage) == calibrate.NOT_GOOD
    assert re.search(r"encoder.graduation, order 2, was \(.*\) ± .* arcsec and now is", capsys.readouterr().out)


@pytest.mark.parametrize("seed", seeds(6))
def test_the_same_shaft_again_is_no_contradiction(tmp_path: Path, stage: Path, seed: int) -> None:
    """Two recordings whose uncertainty is that of their readings alone."""
    ideal = "--centre-radial-um", 0, "--centre-lean-arcsec", 0
    for number in range(3):
        assert run(simulated(tmp_path, seed=100 + 3 * seed + number), "--stage", stage, *ideal) == 0
