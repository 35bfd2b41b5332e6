"""A measured surface that straightness does not make: nothing of a trajectory is written but by force."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from rotary_error_monitor.cli import main
from rotary_error_monitor.description.machine import load_machine

COMMAND = ["calibrate", "flatness", "grinder_zhou2023", "--vertical", "Y", "--workpiece", "X=-1400,0", "Z=-650,-150"]
COMMAND += ["--positioning-um", "1.2", "--reversal-um", "1"]


def surface_csv(path: Path, seed: int, sign: float, process: float = 1e-6) -> Path:
    """What the tables of the grinder make of a workpiece, times a sign, and waves of the process, m."""
    rng, machine = np.random.default_rng(seed), load_machine("grinder_zhou2023")
    x, z = (axis.ravel() for axis in np.meshgrid(np.linspace(-1.4, 0, 57), np.linspace(-0.65, -0.15, 21)))
    heights = process * np.sin(rng.uniform(20, 60) * x + rng.uniform(0, 6.3)) + 5e-8 * rng.normal(size=x.size)
    for name, at in (("EYX", x), ("EYZ", z)):
        table = machine.errors[name].table
        assert table is not None
        heights = heights + sign * np.interp(at, table.positions, table.forward)
    rows = [f"{a * 1e3:g},{b * 1e3:g},{h * 1e6:.5f}" for a, b, h in zip(x, z, heights, strict=True)]
    path.write_text("\n".join(["X_mm,Z_mm,height_um", *rows]), encoding="utf-8")
    return path


@pytest.mark.parametrize("seed", range(4))
def test_a_negated_surface_does_not_fit(tmp_path: Path, seed: int, capsys: pytest.CaptureFixture[str]) -> None:
    trajectory = tmp_path / "wheel.csv"
    words = [*COMMAND, "--trajectory", str(trajectory), "--measured", str(surface_csv(tmp_path / "x.csv", seed, -1.0))]
    assert main(words) == 10
    told = capsys.readouterr().out
    assert "does not fit: the surface is flatter without what straightness predicts (-" in told
    assert "it is like the prediction negated" in told and "wheel.csv not written; --force writes it" in told
    assert not trajectory.exists()
    assert main([*words, "--force"]) == 0
    assert trajectory.exists() and "does not fit: " in capsys.readouterr().out


@pytest.mark.parametrize("seed", range(8))
def test_a_surface_that_straightness_makes_fits(tmp_path: Path, seed: int, capsys: pytest.CaptureFixture[str]) -> None:
    """Also where the process makes half of it."""
    trajectory, surface = tmp_path / "wheel.csv", surface_csv(tmp_path / "x.csv", seed, 1.0, 1e-6 * (1 + seed % 3))
    assert main([*COMMAND, "--trajectory", str(trajectory), "--measured", str(surface)]) == 0
    assert "does not fit" not in capsys.readouterr().out
    assert trajectory.exists()
