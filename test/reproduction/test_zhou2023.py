"""The procedure of Zhou et al. 2023 carried out once: through the commands, against the truth of the simulation."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from rotary_error_monitor.cli import main
from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.reproduction.zhou2023_plant import (
    MIRROR_1,
    MIRROR_2,
    POSITIONING,
    PROCESS,
    REVERSAL,
    RUNS,
    SENSOR_NOISE,
    X,
    Z,
    ZhouGrinder,
    follow,
    process,
)

SEED = 4
FIGURES = (4, 6, 7, 8, 9, 10, 11, 12, 13, 15, 16, 17)


@pytest.fixture(scope="module")
def carried_out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the results."""
    folder = tmp_path_factory.mktemp("reproduction") / "zhou2023"
    assert main(["reproduce", "zhou2023", "-o", str(folder), "--seed", str(SEED)]) == 0
    return folder


def level(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.asarray(y - np.polyval(np.polyfit(x, y, 1), x))


def flatness(x: np.ndarray, z: np.ndarray, heights: np.ndarray) -> float:
    plane = np.stack([np.ones(heights.size), *(each.ravel() for each in np.meshgrid(x, z, indexing="ij"))], axis=1)
    return float(np.ptp(heights.ravel() - plane @ np.linalg.lstsq(plane, heights.ravel(), rcond=None)[0]))


def test_guideways_are_found(carried_out):
    """To what the unknown mirror leaves, 0.3 µm, and to 0.06 µm where its form is known (noise of ten runs at most)."""
    for name, component, guideway, most in (
        ("grinder.yaml", "EYZ", Z, 0.3e-6),
        ("grinder.yaml", "EYX", X, 0.3e-6),
        ("direct.yaml", "EYZ", Z, 0.15e-6),
        ("known_mirror.yaml", "EYZ", Z, 0.06e-6),
    ):
        table = load_machine(carried_out / name).errors[component].table
        assert table is not None
        at, found = np.array(table.positions), np.array(table.forward)
        assert np.ptp(at) > 0.995 * (guideway.travel[1] - guideway.travel[0])
        assert np.abs(level(at, found) - level(at, guideway.true(at))).max() < most, (name, component)


def test_the_wheel_takes_straightness_out(carried_out):
    """What is left of both curves under the trajectory is what the guideways were found wrong by."""
    rows = np.genfromtxt(carried_out / "wheel.csv", delimiter=",", names=True)
    x, z = ZhouGrinder(SEED).grid
    added = rows["Y_correction_um"].reshape(x.size, z.size) * 1e-6
    straightness = X.true(x)[:, None] + Z.true(z)[None, :]
    assert flatness(x, z, straightness) > 7e-6
    assert flatness(x, z, straightness + added) < 0.6e-6
    # the pass goes on in one way only, so the positioning error is all that Y adds
    assert np.all(np.diff(added, axis=0) < 1.5e-10)


def test_surfaces_are_those_that_were_ground(carried_out):
    grinder = ZhouGrinder(SEED)
    x, z = grinder.grid
    wheel = np.genfromtxt(carried_out / "wheel.csv", delimiter=",", names=True)
    added = wheel["Y_correction_um"].reshape(x.size, z.size) * 1e-6
    for name, corrections in (("before", None), ("after", added)):
        table = np.genfromtxt(carried_out / f"workpiece_{name}.csv", delimiter=",", names=True)
        heights = table["height_um"].reshape(x.size, z.size) * 1e-6
        # noise makes a range larger, by four standard deviations at either end
        assert 0 < flatness(x, z, heights) - flatness(x, z, grinder.ground(corrections)) < 8 * SENSOR_NOISE


def test_the_page_has_each_figure_and_each_command(carried_out):
    page = (carried_out / "page.html").read_text(encoding="utf-8")
    for figure in FIGURES:
        assert f"alt='Figure {figure}: " in page, figure
    assert page.count("alt='Figure 13: ") == 2
    assert len(re.findall(r"<pre>\$ rotary_error_monitor calibrate (straightness|flatness|tables)", page)) == 9
    assert "Simulated: " in page
    assert "no value" in page
    assert "✗" not in page.partition("<h2>1. ")[0]


def test_truth_has_the_numbers_of_the_paper():
    """By brute force on a grid of a tenth of a millimetre."""
    for guideway, straightness in ((X, 5.5e-6), (Z, 5.8e-6)):
        at = np.linspace(*guideway.travel, 14_001)
        assert np.ptp(level(at, guideway.true(at))) == pytest.approx(straightness, rel=2e-3)
    for mirror, length, height in ((MIRROR_1, 0.44, 0.08e-6), (MIRROR_2, 0.84, 0.12e-6)):
        at = np.linspace(0.0, length, 8_401)
        assert np.ptp(level(at, mirror.true(at))) == pytest.approx(height, rel=2e-3)
    x, z = ZhouGrinder(0).grid
    assert flatness(x, z, process(x, z)) == pytest.approx(PROCESS, rel=1e-3)
    assert flatness(x, z, ZhouGrinder(0).ground(None)) == pytest.approx(7.54e-6, rel=0.02)


def test_the_vertical_axis_lags_by_half_its_reversal_error():
    """Up and down again, against the closed form of play."""
    up, down = np.linspace(0.0, 10e-6, 101), np.linspace(9.9e-6, 2e-6, 80)
    reached = follow(np.concatenate([up, down, [11e-6]]))
    np.testing.assert_allclose(reached[:101], up - REVERSAL / 2, atol=1e-18)
    np.testing.assert_allclose(reached[101:181], np.minimum(10e-6 - REVERSAL / 2, down + REVERSAL / 2), atol=1e-18)
    assert follow(-up)[-1] == pytest.approx(-10e-6 + REVERSAL / 2)


def test_a_compensated_surface_has_process_and_positioning_error():
    """With a trajectory of the true curves, rising along each pass."""
    grinder = ZhouGrinder(0)
    x, z = grinder.grid
    exact = -(X.true(x)[:, None] + Z.true(z)[None, :]) + 40e-6 * (x[:, None] + 1.4)
    rest = grinder.ground(exact) - process(x, z)
    assert flatness(x, z, rest) < 1.2 * POSITIONING
    assert flatness(x, z, rest) > 0.8 * POSITIONING


@pytest.mark.parametrize("seed", range(3))
def test_readings_are_as_the_sensor_takes_them(tmp_path, seed):
    """Five runs each way over either placement, a millimetre apart, about their truth by the sensor's noise."""
    path = tmp_path / "z.csv"
    ZhouGrinder(seed).write_runs(path, Z, MIRROR_1, (-0.8, -0.44))
    rows = np.genfromtxt(path, delimiter=",", names=True)
    for segment, start in ((1, -0.8), (2, -0.44)):
        ways = []
        for run in range(1, 2 * RUNS + 1):
            of = rows[(rows["segment"] == segment) & (rows["run"] == run)]
            at = of["position_mm"] * 1e-3
            ways.append(int(of["direction"][0]))
            np.testing.assert_allclose(np.diff(at), ways[-1] * 1e-3, atol=2e-7)
            assert start <= at.min() < at.max() <= start + MIRROR_1.length
            rest = level(at, of["reading_um"] * 1e-6 - Z.true(at) - MIRROR_1.true(at - start))
            # 440 readings tell the noise to 3 %; drift and direction are below a third of it
            assert np.std(rest) == pytest.approx(SENSOR_NOISE, rel=0.3)
        assert ways.count(1) == ways.count(-1) == RUNS
