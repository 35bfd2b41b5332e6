"""Runs that contradict one another and positions in another unit are no straightness; made by plain numpy."""

from __future__ import annotations

import argparse
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import yaml
from draws import seeds

from rotary_error_monitor.commands import calibrate
from rotary_error_monitor.resources import config

BOW, NOISE = 35.0, 0.1
SEEDS = range(8)
Array = np.ndarray
Reading = Callable[[Array], Array]


def bow(x: Array) -> Array:
    """µm over m, 35 µm high over 5 m."""
    return np.asarray(BOW * (1 - (x / 2.5) ** 2))


def written(
    folder: Path, runs: list[tuple[int, Reading]], seed: int, scale: float = 1e3, scattered: bool = False
) -> Path:
    """Runs, each with its direction and what it reads over positions in m; `scale` is m in the unit of the file."""
    rng = np.random.default_rng(seed)
    lines = ["segment,run,direction,position_mm,reading_um"]
    for number, (way, read) in enumerate(runs, start=1):
        x = np.linspace(-2.5, 2.5, 21)
        if scattered:
            x[1:-1] += 0.1 * rng.uniform(-1, 1, size=len(x) - 2)
        x = x[::way]
        y = read(x) + NOISE * rng.normal(size=len(x))
        lines += [f"1,{number},{way},{p * scale:.9g},{v:.6f}" for p, v in zip(x, y, strict=True)]
    source = folder / f"runs_{seed}.csv"
    source.write_text("\n".join(lines), encoding="utf-8")
    return source


def run(source: Path, machine: Path, *more: object, length: float = 5000.0) -> int:
    parser = argparse.ArgumentParser()
    calibrate.add(parser)
    words = ["straightness", source, "--machine", machine, "--component", "EYX", "--mirror-length-mm", length]
    words += ["--mirror-flatness-um", 0.001, "--noise-um", NOISE, *more]
    arguments = parser.parse_args([*map(str, words)])
    return int(arguments.run(arguments))


@pytest.fixture
def machine(tmp_path: Path) -> Path:
    return Path(shutil.copy(config("machines/pan2013.yaml"), tmp_path / "machine.yaml"))


def check_refused_and_covered(source: Path, machine: Path, text: str, capsys: pytest.CaptureFixture[str]) -> None:
    """Not written; by force with an uncertainty that holds the distance from the true bow."""
    before = machine.read_bytes()
    assert run(source, machine) == calibrate.NOT_GOOD
    assert re.search(f"does not fit: segment 1: .*{text}", capsys.readouterr().out)
    assert machine.read_bytes() == before
    assert run(source, machine, "--force") == 0
    section = yaml.safe_load(machine.read_text(encoding="utf-8"))["machine"]
    table, note = section["errors"]["EYX"]["table"], section["calibration"]["EYX"]
    x = np.array(table["positions"])
    error = np.array(table["values"]) * 1e6 - bow(x)
    error -= np.polyval(np.polyfit(x, error, 1), x)
    assert np.abs(error).max() < 2.5e6 * note["uncertainty"]
    assert text in note["remark"]


@pytest.mark.parametrize("each", [1, 2])
@pytest.mark.parametrize("seed", SEEDS)
def test_directions_of_opposite_sign(
    tmp_path: Path, machine: Path, seed: int, each: int, capsys: pytest.CaptureFixture[str]
) -> None:
    source = written(tmp_path, [(1, bow), (-1, lambda x: -bow(x))] * each, seed)
    check_refused_and_covered(source, machine, "forward and backward differ by", capsys)


@pytest.mark.parametrize("seed", SEEDS)
def test_one_direction_of_half_the_size(
    tmp_path: Path, machine: Path, seed: int, capsys: pytest.CaptureFixture[str]
) -> None:
    source = written(tmp_path, [(1, bow), (-1, lambda x: 0.4 * bow(x))] * 2, seed)
    check_refused_and_covered(source, machine, "forward and backward differ by", capsys)


@pytest.mark.parametrize("scattered", [False, True])
@pytest.mark.parametrize("seed", SEEDS)
def test_one_of_three_runs_of_opposite_sign(
    tmp_path: Path, machine: Path, seed: int, scattered: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    source = written(tmp_path, [(1, bow), (1, bow), (1, lambda x: -bow(x))], seed, scattered=scattered)
    check_refused_and_covered(source, machine, "runs of one direction scatter by", capsys)


@pytest.mark.parametrize("seed", SEEDS)
def test_runs_that_drift_many_times_the_noise(
    tmp_path: Path, machine: Path, seed: int, capsys: pytest.CaptureFixture[str]
) -> None:
    def drifting(size: float) -> Reading:
        return lambda x: bow(x) + size * np.sqrt(np.arange(len(x)) / len(x))

    source = written(tmp_path, [(1, bow), (1, drifting(5.0)), (1, drifting(20.0))], seed)
    check_refused_and_covered(source, machine, "runs of one direction scatter by", capsys)


@pytest.mark.parametrize("seed", seeds(20))
def test_a_plausible_reversal_and_drift_are_written(tmp_path: Path, machine: Path, seed: int) -> None:
    """A reversal of 2 µm on a bow of 35 µm, drifts of 0.3 µm: what machines do."""
    rng = np.random.default_rng([seed, 1])

    def read(way: int) -> Reading:
        drift = 0.3 * rng.normal()
        return lambda x: bow(x) + way * np.cos(3 * x) + drift * np.arange(len(x)) / len(x)

    each = 1 + seed % 3
    assert run(written(tmp_path, [(1, read(1)), (-1, read(-1))] * each, seed), machine) == 0


@pytest.mark.parametrize("seed", SEEDS)
def test_single_runs_whose_directions_differ_say_how_unsure_they_are(tmp_path: Path, machine: Path, seed: int) -> None:
    """One run there and one back: nothing tells a drift of 3 µm in one of them from a reversal."""
    source = written(tmp_path, [(1, bow), (-1, lambda x: bow(x) + 3 * np.cos(2 * x))], seed)
    assert run(source, machine) == 0
    section = yaml.safe_load(machine.read_text(encoding="utf-8"))["machine"]
    table, note = section["errors"]["EYX"]["table"], section["calibration"]["EYX"]
    x = np.array(table["positions"])
    error = np.array(table["values"]) * 1e6 - bow(x)
    error -= np.polyval(np.polyfit(x, error, 1), x)
    assert np.mean(np.abs(error) < 2e6 * note["uncertainty"]) > 0.95


@pytest.mark.parametrize(("scale", "length"), [(1.0, 5000.0), (1.0, 5.0), (1e3 / 25.4, 5000.0)])
def test_positions_in_another_unit(
    tmp_path: Path, machine: Path, scale: float, length: float, capsys: pytest.CaptureFixture[str]
) -> None:
    """Metres and inches for mm, on an axis of 6 m."""
    source, before = written(tmp_path, [(1, bow), (-1, bow)], 0, scale), machine.read_bytes()
    assert run(source, machine, length=length) == calibrate.NOT_GOOD
    assert "of the travel of X" in (text := capsys.readouterr().out)
    assert "another unit" in text
    assert machine.read_bytes() == before


def test_a_piece_of_the_travel_as_long_as_its_mirror_is_written(tmp_path: Path, machine: Path) -> None:
    """A mirror of 100 mm on an axis of 6 m."""
    assert run(written(tmp_path, [(1, bow), (-1, bow)], 0, 20.0), machine, length=100) == 0


@pytest.mark.parametrize("seed", SEEDS[:3])
@pytest.mark.parametrize("scattered", [False, True])
def test_readings_in_mm_under_a_header_of_um(
    tmp_path: Path, machine: Path, seed: int, scattered: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    """They scatter by a thousandth of the stated noise; a third of it is an instrument better than stated."""
    source = written(tmp_path, [(1, bow), (-1, bow)] * 3, seed, scattered=scattered)
    assert run(source, machine, "-o", tmp_path / "good.yaml", "--noise-um", 3 * NOISE) == 0
    head, *lines = source.read_text(encoding="utf-8").splitlines()
    cells = [line.rsplit(",", 1) for line in lines]
    rows = [f"{rest},{float(value) / 1000:.9f}" for rest, value in cells]
    source.write_text("\n".join([head, *rows]), encoding="utf-8")
    before = machine.read_bytes()
    capsys.readouterr()
    assert run(source, machine) == calibrate.NOT_GOOD
    said = capsys.readouterr().out
    assert (
        "where noise of 0.1 µm is stated: are the readings in the unit of the header, and is the noise in µm?" in said
    )
    assert machine.read_bytes() == before


def test_a_coarse_sensor_that_shows_the_same_in_all_runs(tmp_path: Path, machine: Path) -> None:
    def coarse(x: Array) -> Array:
        return np.asarray(np.round(bow(x)))

    source = written(tmp_path, [(1, coarse), (-1, coarse)] * 3, seed=0)
    head, *lines = source.read_text(encoding="utf-8").splitlines()
    cells = [line.rsplit(",", 1) for line in lines]
    source.write_text("\n".join([head, *(f"{rest},{round(float(value))}" for rest, value in cells)]), encoding="utf-8")
    assert run(source, machine, "--noise-um", 0.3) == 0
