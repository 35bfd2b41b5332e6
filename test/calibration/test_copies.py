"""Measurements that are in a file twice, and coarse ones that are equal by chance."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rotary_error_monitor.calibration.machine_poses import read_probed_poses
from rotary_error_monitor.calibration.measurements import read_positioning, read_straightness
from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.errors import InputError

TARGETS = [-240, -150, -60, 35, 120, 230]


def positioning(seed: int, cycles: int, noise: float, digits: int) -> list[str]:
    """Rows of a test with noise in µm, to so many digits."""
    rng, rows = np.random.default_rng(seed), []
    for cycle in range(1, cycles + 1):
        for direction in (1, -1):
            for target in TARGETS[::direction]:
                rows.append(f"{target},{direction},{cycle},{5 * np.sin(target) + noise * rng.normal():.{digits}f}")
    return rows


def again(rows: list[str], cycles: int) -> list[str]:
    """The same with their cycles counted on."""
    cells = [row.split(",") for row in rows]
    return [",".join([c[0], c[1], str(int(c[2]) + cycles), c[3]]) for c in cells]


def written(path: Path, header: str, rows: list[str]) -> Path:
    path.write_text("\n".join([header, *rows]), encoding="utf-8")
    return path


HEADER = "target_mm,direction,cycle,deviation_um"


@pytest.mark.parametrize(("cycles", "digits"), [(1, 3), (1, 4), (2, 2), (2, 4), (5, 2), (5, 3)])
def test_a_test_that_is_there_twice_is_refused(tmp_path: Path, cycles: int, digits: int) -> None:
    rows = positioning(1, cycles, 0.3, digits)
    source = written(tmp_path / "runs.csv", HEADER, rows + again(rows, cycles))
    line = len(rows) + 2
    with pytest.raises(InputError, match=rf"runs.csv:{line}: cycle {cycles + 1} is cycle 1 once more, .* \(line 2\)"):
        read_positioning(source, rotary=False)


@pytest.mark.parametrize("noise", [0.02, 0.1, 0.3])
def test_coarse_readings_that_are_equal_by_chance_are_read(tmp_path: Path, noise: float) -> None:
    """Steps of 1 µm and of 0.1 µm: many cycles are the same, and nothing is wrong."""
    for seed in range(40):
        for digits in (0, 1):
            read_positioning(written(tmp_path / "runs.csv", HEADER, positioning(seed, 5, noise, digits)), rotary=False)


def test_readings_that_are_all_the_same_are_read(tmp_path: Path) -> None:
    rows = [f"{target},{way},{cycle},0" for cycle in range(1, 6) for way in (1, -1) for target in TARGETS[::way]]
    assert read_positioning(written(tmp_path / "runs.csv", HEADER, rows), rotary=False).forward.max() == 0.0


def test_a_run_of_straightness_that_is_there_twice_is_refused(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    rows = [f"1,1,1,{x},{0.05 * rng.normal():.3f}" for x in range(0, 200, 10)]
    twice = [row.replace("1,1,1", "1,2,1", 1) for row in rows]
    source = written(tmp_path / "s.csv", "segment,run,direction,position_mm,reading_um", rows + twice)
    with pytest.raises(InputError, match=r"s.csv:22: segment 1, run 2 is segment 1, run 1 once more"):
        read_straightness(source)


def test_poses_that_are_there_twice_are_refused(tmp_path: Path) -> None:
    machine, rng = load_machine("grinder_zhou2023"), np.random.default_rng(1)
    header = ",".join([*(f"{a.letter}_mm" for a in machine.axes), "temperature_degC,dx_um,dy_um,dz_um"])
    low, high = (1e3 * np.array(each) for each in zip(*(a.travel for a in machine.axes), strict=True))
    at = rng.uniform(low, high, size=(30, len(low)))
    rows = [",".join([*(f"{x:.3f}" for x in pose), "20", *(f"{x:.1f}" for x in rng.normal(0, 1.5, 3))]) for pose in at]
    with pytest.raises(InputError, match=r"p.csv:32: pose 31 is pose 1 once more"):
        read_probed_poses(written(tmp_path / "p.csv", header, rows + rows), machine, 1.5e-6)
    repeated = [",".join([*row.split(",")[:-3], *(f"{x:.1f}" for x in rng.normal(0, 1.5, 3))]) for row in rows]
    read_probed_poses(written(tmp_path / "p.csv", header, rows + repeated), machine, 1.5e-6)
