"""No command writes over what it reads, by whatever name it is given."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

import pytest

from rotary_error_monitor.cli import main
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.files import check_outputs
from rotary_error_monitor.resources import config

FILES = (
    "bag/bag_0.mcap",
    "bag/metadata.yaml",
    "stage.yaml",
    "machine.yaml",
    "measured.csv",
    "mirror.csv",
    "direct.csv",
    "own.py",
)
SOURCE = ["--machine", "machine.yaml"]
STRAIGHTNESS = [
    *("calibrate", "straightness", "measured.csv", *SOURCE, "--component", "EYX", "--mirror-length-mm", "100"),
    *("--mirror-flatness-um", "1", "--mirror-profile", "mirror.csv", "--noise-um", "1"),
]
DIAGNOSE = ["diagnose", "bag", "--twin", "stage.yaml", "--effects", "own.py", "-o", "out"]
COMMANDS: Sequence[tuple[Sequence[str], Sequence[str], Sequence[str]]] = [
    (
        ["replay", "bag", "--twin", "stage.yaml", "--machine", "machine.yaml"],
        ["-o"],
        ["bag/bag_0.mcap", "bag/metadata.yaml", "stage.yaml", "machine.yaml", "linked", "symbolic"],
    ),
    (["replay", "bag/bag_0.mcap", "--twin", "stage.yaml"], ["-o"], ["bag/bag_0.mcap", "linked", "symbolic"]),
    (DIAGNOSE, ["--write-twin"], ["bag/bag_0.mcap", "stage.yaml", "own.py"]),
    (["calibrate", "positioning", "measured.csv", *SOURCE, "--axis", "X"], ["-o", "--figure"], ["measured.csv"]),
    (["calibrate", "positioning", "measured.csv", *SOURCE, "--axis", "X"], ["--figure"], ["machine.yaml"]),
    (
        [*STRAIGHTNESS, "--direct", "direct.csv"],
        ["-o", "--figure", "--runs-figure", "--mirror-form"],
        ["measured.csv", "mirror.csv", "direct.csv"],
    ),
    (["calibrate", "squareness", "measured.csv", *SOURCE], ["-o", "--figure"], ["measured.csv"]),
    (["calibrate", "assembly", "bag", "--stage", "stage.yaml"], ["-o"], ["bag/bag_0.mcap", "bag/metadata.yaml"]),
    (
        ["calibrate", "autocollimator", "measured.csv", "--stage", "stage.yaml", "--reference-arcsec", "1"],
        ["-o", "--figure"],
        ["measured.csv"],
    ),
    (["calibrate", "machine", "bag", *SOURCE], ["-o"], ["bag/bag_0.mcap", "bag/metadata.yaml"]),
    (["calibrate", "tables", "machine.yaml", "--axis", "X"], ["-o"], ["machine.yaml"]),
    (["calibrate", "errors", "machine.yaml"], ["--figure"], ["machine.yaml"]),
    (["offset", "machine.yaml", "--program", "measured.csv", "--format", "csv"], ["-o"], ["measured.csv"]),
    (
        ["calibrate", "flatness", "machine.yaml", "--vertical", "Y", "--workpiece", "X=0,1", "Z=0,1"]
        + ["--reversal-um", "1", "--positioning-um", "1"],
        ["--figure"],
        ["machine.yaml"],
    ),
    (["gap-benchmark", "--outcomes", "outcomes.svg"], ["--reliability"], ["outcomes.svg"]),
]


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Inputs of all kinds; whether they are readable does not matter."""
    monkeypatch.chdir(tmp_path)
    Path("bag").mkdir()
    for name in (*FILES, "outcomes.svg"):
        Path(name).write_text(f"this is {name}")
    shutil.copy(config("stage.yaml"), "stage.yaml")
    shutil.copy(config("machines/xyzac_trt.yaml"), "machine.yaml")
    Path("linked").hardlink_to("bag/bag_0.mcap")
    Path("symbolic").symlink_to("bag/bag_0.mcap")
    return tmp_path


def contents(folder: Path) -> dict[Path, bytes]:
    return {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize(("command", "options", "targets"), COMMANDS, ids=lambda value: " ".join(value)[:40])
def test_an_output_that_is_an_input_is_refused(folder, capsys, command, options, targets):
    for target in targets:  # pictures have endings of their own, which inputs have by other names alone
        if command[0] == "calibrate" and not Path(f"{target}.png").exists():
            Path(f"{target}.png").hardlink_to(target)
    before = contents(folder)
    for option in options:
        for target in targets:
            given = f"{target}.png" if option.endswith("figure") else target
            assert main([*command, option, given]) == 2, (option, given)
            said = capsys.readouterr().err
            assert f"{given}: not written, for it is" in said and "give another path" in said
            assert contents(folder) == before


def test_a_result_that_would_replace_the_recording(folder, capsys):
    Path("diagnosis.json").write_text("a recording")
    assert main(["diagnose", "diagnosis.json", "--twin", "stage.yaml", "-o", "."]) == 2
    assert "diagnosis.json: not written, for it is the input diagnosis.json" in capsys.readouterr().err
    assert Path("diagnosis.json").read_text() == "a recording"


def test_results_may_lie_beside_a_recording_and_be_written_anew(folder):
    Path("bag/out.npz").write_text("an earlier result")
    check_outputs([Path("bag/out.npz"), Path("new"), None], [Path("bag"), Path("stage.yaml"), None, Path("nothing")])
    with pytest.raises(InputError, match=r"bag/bag_0\.mcap: not written, for it is a file of the input bag; give"):
        check_outputs([Path("bag/bag_0.mcap")], [Path("bag")])
