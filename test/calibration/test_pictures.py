"""Pictures of `calibrate`: a file that cannot be drawn is refused before anything is measured or written."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from rotary_error_monitor.cli import main
from rotary_error_monitor.resources import config

EXAMPLES = Path(__file__).parents[2] / "doc" / "calibration"
STEPS = {
    "positioning": ["x_positioning.csv", "--machine", "machine.yaml", "--axis", "X"],
    "straightness": ["x_direct.csv", "--machine", "machine.yaml", "--component", "EZX", "--noise-um", "0.06"],
    "squareness": ["tracker.csv", "--machine", "machine.yaml"],
    "autocollimator": ["autocollimator.csv", "--stage", "stage.yaml", "--reference-arcsec", "0.1"],
    "assembly": ["between_centres", "--stage", "stage.yaml"],
    "errors": ["machine.yaml"],
}


def calibrate(folder: Path, step: str, *more: str) -> int:
    source, *words = STEPS[step]
    path = folder / source if source.endswith("yaml") else EXAMPLES / source
    places = [str(folder / word) if word.endswith("yaml") else word for word in words]
    return main(["calibrate", step, str(path), *places, *more])


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    shutil.copy(config("machines/xyzac_trt.yaml"), tmp_path / "machine.yaml")
    shutil.copy(config("stage.yaml"), tmp_path / "stage.yaml")
    return tmp_path


@pytest.mark.parametrize("step", STEPS)
@pytest.mark.parametrize("name", ["picture.foo", "picture"])
def test_a_kind_of_picture_that_there_is_not(folder: Path, step: str, name: str, capsys) -> None:
    before = {path: path.read_bytes() for path in folder.iterdir()}
    with pytest.raises(SystemExit) as ended:
        calibrate(folder, step, "--figure", str(folder / name))
    assert ended.value.code == 2
    assert f"{name} must end in .png, .svg or .pdf" in capsys.readouterr().err
    assert {path: path.read_bytes() for path in folder.iterdir()} == before


@pytest.mark.parametrize("step", STEPS)
def test_a_folder_that_there_is_not(folder: Path, step: str, capsys) -> None:
    before = {path: path.read_bytes() for path in folder.iterdir()}
    assert calibrate(folder, step, "--figure", str(folder / "no" / "picture.png")) == 2
    told = capsys.readouterr()
    assert "picture.png: cannot be written (no folder" in told.err
    assert not told.out
    assert {path: path.read_bytes() for path in folder.iterdir()} == before


@pytest.mark.parametrize(("ending", "start"), [("png", b"\x89PNG"), ("svg", b"<?xml"), ("PDF", b"%PDF")])
def test_pixels_and_lines(folder: Path, ending: str, start: bytes) -> None:
    picture = folder / f"picture.{ending}"
    assert calibrate(folder, "straightness", "-o", str(folder / "out.yaml"), "--figure", str(picture)) == 0
    assert picture.read_bytes().startswith(start)
