"""`calibrate machine` on poses of a CSV file: noise that is stated too large is told, too few poses name the file."""

from __future__ import annotations

import math
import shutil
from pathlib import Path

import numpy as np
import pytest

from rotary_error_monitor.cli import main
from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.machine.error_model import predict_tool_offset
from rotary_error_monitor.machine.kinematics import arrange_machine
from rotary_error_monitor.resources import config

NOTE = "the readings scatter far less than the noise that is stated or taken"


@pytest.fixture
def machine(tmp_path: Path) -> Path:
    return Path(shutil.copy(config("machines/xyzac_trt.yaml"), tmp_path / "machine.yaml"))


def probed(path: Path, machine: Path, seed: int, count: int, noise_um: float, scale: float = 1e6) -> Path:
    """Offsets of the machine as the file has it, with noise; `scale` is that of the file's offsets."""
    described = load_machine(machine)
    rng = np.random.default_rng(seed)
    low, high = np.transpose([axis.travel for axis in described.axes])
    poses = low + (high - low) * rng.random((count, len(low)))
    offsets = predict_tool_offset(arrange_machine(described), poses)[:, :3] + noise_um * 1e-6 * rng.normal(
        size=(count, 3)
    )
    linear = [axis.kind == "linear" for axis in described.axes]
    units = [1e3 if one else 180 / math.pi for one in linear]
    names = [f"{axis.letter}_{'mm' if one else 'deg'}" for axis, one in zip(described.axes, linear, strict=True)]
    rows = [
        ",".join(f"{value:.9f}" for value in [*(pose * units), 20.0, *(offset * scale)])
        for pose, offset in zip(poses, offsets, strict=True)
    ]
    path.write_text("\n".join([",".join([*names, "temperature_degC", "dx_um", "dy_um", "dz_um"]), *rows]))
    return path


@pytest.mark.few(2)
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("noise_um", "told"), [(1.5, False), (0.3, True)])
def test_noise_that_is_less_than_stated(tmp_path: Path, machine: Path, seed: int, noise_um, told, capsys) -> None:
    """The probe's noise is taken to be 1.5 µm; a p-value below 0.001 is no chance at a fifth of it."""
    source = probed(tmp_path / "poses.csv", machine, seed, 60, noise_um)
    assert main(["calibrate", "machine", str(source), "--machine", str(machine)]) == 0
    assert (NOTE in capsys.readouterr().out) == told


def test_offsets_in_mm_under_a_header_of_um(tmp_path: Path, machine: Path, capsys) -> None:
    source = probed(tmp_path / "poses.csv", machine, 4, 60, 1.5, scale=1e3)
    main(["calibrate", "machine", str(source), "--machine", str(machine)])
    assert f"{NOTE}: if the probe is better, say so (--noise-um)" in capsys.readouterr().out


def test_too_few_poses(tmp_path: Path, machine: Path, capsys) -> None:
    source, before = probed(tmp_path / "poses.csv", machine, 5, 3, 1.5), machine.read_bytes()
    assert main(["calibrate", "machine", str(source), "--machine", str(machine)]) == 2
    assert "poses.csv: 3 poses; the held-out check needs at least 5" in capsys.readouterr().err
    assert machine.read_bytes() == before
