"""Bags of several cells: each command says of a cell what it says of a bag of that cell alone."""

from __future__ import annotations

import io
import json
from collections.abc import Callable
from contextlib import redirect_stdout
from pathlib import Path

import numpy as np
import pytest
import yaml
from world.newly_built import NewlyBuilt, build

from rotary_error_monitor.bags.writer import write_messages
from rotary_error_monitor.cli import main

CELLS = ("/left", "/hall/right")
OTHER = "/encoders/first"


@pytest.fixture(scope="module")
def stages() -> dict[str, NewlyBuilt]:
    """Of another number of heads and another ring each."""
    return {
        cell: build(seed, count=count, even=False, swap=False, duration=14.0)
        for cell, seed, count in zip(CELLS, (51, 52), (5, 4), strict=True)
    }


@pytest.fixture(scope="module")
def folder(stages: dict[str, NewlyBuilt], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bag of both, one of each, one with a topic of another name; what each stage truly is, and nominally."""
    path = tmp_path_factory.mktemp("cells")
    both = {}
    for k, (cell, built) in enumerate(stages.items()):
        blocks = {topic: each for topic, each in built.recording.blocks.items() if each}
        both |= {cell + topic: each for topic, each in blocks.items()}
        write_messages(path / f"bag{k}", blocks)
        named = {OTHER if topic == "/stage/head_a/samples" else topic: each for topic, each in blocks.items()}
        write_messages(path / f"named{k}", named)
        for name, section in (("true", built.true), ("nominal", built.nominal)):
            (path / f"{name}{k}.yaml").write_text(yaml.safe_dump({"stage": section}), encoding="utf-8")
    write_messages(path / "both", both)
    (path / "map.yaml").write_text(f"/stage/head_a/samples: {OTHER}\n", encoding="utf-8")
    return path


def words(command: str, bag: Path, folder: Path, k: int, output: Path, *more: str) -> list[str]:
    true, nominal = str(folder / f"true{k}.yaml"), str(folder / f"nominal{k}.yaml")
    return {
        "replay": ["replay", str(bag), "--twin", true, "-o", str(output / "out.npz"), *more],
        "check": ["check", str(bag), "--stage", true, *more],
        "analyse": ["analyse", str(bag), "--twin", true, "-o", str(output / "out.json"), *more],
        "diagnose": ["diagnose", str(bag), "--twin", true, "-o", str(output), "--no-report", *more],
        "commission": [
            *("commission", str(bag), "--stage", nominal, "-o", str(output / "stage.yaml"), "--force"),
            *("--date", "2026-11-27", *more),
        ],
    }[command]


def result(command: str, output: Path) -> object:
    """What a command leaves, but for names of bags and their hashes."""
    if command == "replay":
        with np.load(output / "out.npz") as found:
            return {name: found[name].tobytes() for name in found.files if found[name].dtype != object}
    if command == "analyse":
        return json.loads((output / "out.json").read_text(encoding="utf-8"))["figures"]
    if command == "diagnose":
        content = json.loads((output / "diagnosis.json").read_text(encoding="utf-8"))
        return {name: each for name, each in content.items() if name != "remarks"}
    if command == "commission":
        stage = yaml.safe_load((output / "stage.yaml").read_text(encoding="utf-8"))["stage"]
        stage.pop("calibration")
        return stage
    return None


Alone = Callable[[str, int], tuple[int, object]]


@pytest.fixture(scope="module")
def alone(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Alone:
    """Function that gives exit code and result of a command for the bag of one cell; it prints what that says."""
    known: dict[tuple[str, int], tuple[int, object, str]] = {}

    def given(command: str, k: int) -> tuple[int, object]:
        if (command, k) not in known:
            output, said = tmp_path_factory.mktemp("alone"), io.StringIO()
            with redirect_stdout(said):
                code = main(words(command, folder / f"bag{k}", folder, k, output))
            known[command, k] = code, result(command, output), said.getvalue()
        code, left, text = known[command, k]
        print(text, end="")
        return code, left

    return given


@pytest.mark.few(2)
@pytest.mark.parametrize("command", ["replay", "check", "analyse", "diagnose", "commission"])
@pytest.mark.parametrize("how", ["cell", "name"])
def test_a_cell_of_several_gives_what_its_own_bag_gives(
    command: str, how: str, folder: Path, alone: Alone, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    both = how == "cell" and command in ("replay", "check")  # what takes longer reads its bag as these do
    for k, cell in enumerate(CELLS if both else CELLS[1:], start=int(not both)):
        among = tmp_path / f"among{k}"
        among.mkdir()
        code, expected = alone(command, k)
        said = capsys.readouterr().out
        bag, more = (folder / "both", ["--cell", cell])
        if how == "name":
            bag, more = folder / f"named{k}", ["--topics", str(folder / "map.yaml")]
        assert main(words(command, bag, folder, k, among, *more)) == code != 2
        told = capsys.readouterr().out
        assert result(command, among) == expected
        if command == "check":
            assert told == said
        if command == "commission":
            assert told.partition("written to")[0] == said.partition("written to")[0]
            assert f"{more[0]} {more[1]}" in told, "the next command is as it has to be typed"


@pytest.mark.parametrize("command", ["replay", "check", "analyse", "diagnose", "commission"])
def test_cells_and_names_that_are_not_there_are_refused(
    command: str, folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(words(command, folder / "both", folder, 0, tmp_path)) == 2
    assert "the bag holds 2 cells: /hall/right, /left; name one with --cell" in capsys.readouterr().err
    assert main(words(command, folder / "both", folder, 0, tmp_path, "--cell", "/up")) == 2
    assert "no cell /up; the bag has /hall/right, /left" in capsys.readouterr().err
    names = tmp_path / "names.yaml"
    names.write_text("# mine\n/stage/head_x: /encoders/first\n", encoding="utf-8")
    assert main(words(command, folder / "both", folder, 0, tmp_path, "--topics", str(names))) == 2
    assert "names.yaml:2: '/stage/head_x' is no topic of the wire contract" in capsys.readouterr().err
    assert not [path for path in tmp_path.iterdir() if path != names]
