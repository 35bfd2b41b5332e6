"""Intervals of a predicted flatness: against closed forms, on workpieces ground by plain numpy, and by the command."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from calibration.ground_workpieces import WAYS, rates
from numpy.typing import NDArray
from scipy.stats import norm

from rotary_error_monitor.cli import main
from rotary_error_monitor.metrology.ground_range import compensated_bounds, level_factor, uncompensated_bounds
from rotary_error_monitor.resources import config

Array = NDArray[np.float64]
AT = np.linspace(-0.4, 0.6, 101)
NONE = np.zeros((101, 1))


def bow(size: float) -> Array:
    shape = AT**2
    return np.asarray(size * (shape - np.polyval(np.polyfit(AT, shape, 1), AT)))


def test_a_slope_and_a_height_are_no_uncertainty_of_a_curve() -> None:
    positions = np.linspace(-1, 1, 33)
    factor = np.column_stack([np.ones(33), positions, 2 * positions - 5])
    np.testing.assert_allclose(level_factor(positions, factor, AT), 0.0, atol=1e-12)


def test_without_uncertainty_the_intervals_are_the_flatness_itself() -> None:
    curves = bow(3e-6), bow(-1e-6)
    surface = curves[0][:, None] + curves[1][None, :]
    assert uncompensated_bounds(curves, (NONE, NONE)) == pytest.approx([np.ptp(surface)] * 2)
    assert compensated_bounds([surface], (NONE, NONE)) == pytest.approx([np.ptp(surface)] * 2)


@pytest.mark.parametrize("size", [1e-8, 4e-7])
def test_one_bow_of_unknown_size_leaves_the_quantiles_of_its_size(size: float) -> None:
    """What compensation leaves of a flat rest is |N| times the bow: half-normal quantiles. Before it, N about it."""
    factor = level_factor(AT, bow(size)[:, None], AT)
    low, high = compensated_bounds([np.zeros((101, 101))], (factor, NONE))
    expected = np.ptp(bow(size)) * norm.ppf([0.5 + 0.0125, 0.5 + 0.4875])
    assert high == pytest.approx(expected[1], rel=0.05)  # of 2000 draws a quantile has a standard error of 2 %
    assert low == pytest.approx(expected[0], abs=0.012 * np.ptp(bow(size)))
    before = uncompensated_bounds((bow(30 * size), bow(7 * size)), (factor, NONE))
    middle, half = 37 * np.ptp(bow(size)), 1.96 * np.ptp(bow(size))
    np.testing.assert_allclose(before, [middle - half, middle + half], rtol=0.01)


def test_what_may_lie_between_readings_raises_the_upper_end_alone() -> None:
    plain = compensated_bounds([np.zeros((101, 101))], (bow(1e-7)[:, None], NONE))
    wider = compensated_bounds([np.zeros((101, 101))], (bow(1e-7)[:, None], NONE), (5e-8, 0.0))
    assert wider[0] == plain[0] and wider[1] > plain[1] + 1e-7


def test_intervals_hold_the_flatness_of_ground_workpieces() -> None:
    """A few of each way, all together; `test_flatness_bound_rates.py` asks 500 of each."""
    found = [rate for way in WAYS for rate in rates(way, 3).values()]
    assert np.mean(found) > 0.76, "12 workpieces: three standard deviations below 95 %"


def measured(path: Path, length: float, seed: int) -> Path:
    """Runs there and back of an interferometer over a guideway from -length to 0."""
    rng = np.random.default_rng(seed)
    x = np.linspace(-length, 0.0, 141)
    height = 3e-6 * np.cos(2 * np.pi * x / length + seed) + 1e-6 * np.sin(5 * np.pi * x / length)
    rows = ["segment,run,direction,position_mm,reading_um"]
    for run in range(1, 5):
        way = 1 if run % 2 else -1
        readings = height[::way] + 6e-8 * rng.normal(size=x.size)
        rows += [
            f"1,{run},{way},{at * 1e3:.6g},{value * 1e6:.4f}" for at, value in zip(x[::way], readings, strict=True)
        ]
    path.write_text("\n".join(rows) + "\n", encoding="utf-8")
    return path


@pytest.fixture
def grinder(tmp_path: Path) -> tuple[Path, list[Path]]:
    """Machine file with two curves that were measured, and the files of their covariances."""
    machine = Path(shutil.copy(config("machines/grinder_zhou2023.yaml"), tmp_path / "machine.yaml"))
    files = []
    for seed, (name, length) in enumerate((("EYX", 1.4), ("EYZ", 0.8))):
        source = measured(tmp_path / f"{name}.csv", length, seed)
        files.append(tmp_path / f"{name}_covariance.csv")
        words = ["--machine", str(machine), "--component", name, "--noise-um", "0.06", "--covariance", str(files[-1])]
        assert main(["calibrate", "straightness", str(source), *words]) == 0
    return machine, files


def flatness(machine: Path, *words: str) -> int:
    limits = ["--vertical", "Y", "--workpiece", "X=-1400,0", "Z=-650,-150", "--positioning-um", "0.2"]
    return main(["calibrate", "flatness", str(machine), *limits, *words])


def test_the_command_says_intervals_by_the_covariances(grinder, capsys: pytest.CaptureFixture[str]) -> None:
    machine, (x, z) = grinder
    assert flatness(machine, "--covariance", f"X={x}", f"Z={z}", "--reversal-um", "0", "1") == 0
    said = capsys.readouterr().out
    predicted = float(re.search(r"before compensation ([\d.]+) µm; after", said).group(1))
    low, high = map(float, re.search(r"95 % interval before compensation ([\d.]+) to ([\d.]+) µm", said).groups())
    assert low < predicted + 0.1 and predicted - 0.2 < high and 0.02 < high - low < 0.5
    rows = re.findall(r"^ +([\d.]+) +([\d.]+) to ([\d.]+) +([\d.]+) to ([\d.]+)$", said, re.MULTILINE)
    assert [float(row[0]) for row in rows] == [0.0, 1.0]
    for row in rows:
        assert 0 < float(row[1]) < float(row[2]) and 0 < float(row[3]) < float(row[4])
    # curves that were rotated feel the reversal error as another place of the wave alone
    assert [float(each) for each in rows[0][3:]] == pytest.approx([float(each) for each in rows[1][3:]], abs=0.05)
    assert float(rows[1][1]) > float(rows[0][1]) + 0.2, "the others do"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda text: text.replace("position_mm", "place_mm"), r"header .*expected position_mm,value_um,further_um"),
        (lambda text: re.sub(r"\n-1400,[-\d.]+,", "\n-1400,0.5,", text), r"not of the curve EYX of the machine file"),
        (lambda text: text.replace("\n-1380,", "\n-1400,"), r"position_mm -1400 does not rise"),
        (lambda text: "\n".join(text.splitlines()[:-9]) + "\n", r"62 positions, the machine 71"),
    ],
)
def test_a_file_that_does_not_belong_is_an_error(grinder, capsys, change, words: str) -> None:
    machine, (x, z) = grinder
    text = x.read_text(encoding="utf-8")
    assert change(text) != text
    x.write_text(change(text), encoding="utf-8")
    assert flatness(machine, "--covariance", f"X={x}", f"Z={z}") == 2
    said = capsys.readouterr().err
    assert str(x) in said and re.search(words, said), said


def test_covariances_of_other_axes_are_an_error(grinder, capsys) -> None:
    machine, (x, z) = grinder
    assert flatness(machine, "--covariance", f"X={x}", f"Y={z}") == 2
    assert "--covariance of X, Y; expected one of each of X, Z" in capsys.readouterr().err
    assert flatness(machine, "--covariance", f"X={z}", f"Z={x}") == 2
    assert "not of the curve EYX" in capsys.readouterr().err
