"""Which nodes a parameter file names, and the unit of systemd that starts them."""

from __future__ import annotations

import shlex
import shutil
import subprocess
from pathlib import Path

import pytest

from rotary_error_monitor.cli import main
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.resources import config
from rotary_error_monitor.supervision.cell_file import CellNode, executables, nodes_of
from rotary_error_monitor.supervision.supervisor import RestartTimes

SETUP = Path(__file__).parents[2] / "setup.py"


def _file(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "cell.yaml"
    path.write_text(text)
    return path


def test_executables_are_those_that_setup_installs() -> None:
    listed = SETUP.read_text().partition("NODES = [")[2].partition("]")[0]
    assert set(executables()) == {word.strip(' ",') for word in listed.split()}


def test_names_and_namespaces(tmp_path: Path) -> None:
    path = _file(
        tmp_path,
        "/**: {ros__parameters: {stage: s.yaml}}\n"
        "/**/encoder_head_a: {ros__parameters: {source: mock}}\n"
        "/left/error_estimator: {ros__parameters: {}}\n"
        "/hall/**/listed_sensor_top: {ros__parameters: {}}\n"
        "stage_command: {ros__parameters: {}}\n"
        "/right/error_estimator: {ros__parameters: {}}\n",
    )
    assert nodes_of(path) == (
        CellNode("encoder_head", "encoder_head_a"),
        CellNode("error_estimator", "error_estimator", "/left"),
        CellNode("listed_sensor", "listed_sensor_top", "/hall"),
        CellNode("stage_command", "stage_command"),
        CellNode("error_estimator", "error_estimator", "/right"),
    )


def test_the_file_for_a_real_cell_names_a_whole_one() -> None:
    names = [node.name for node in nodes_of(config("real_cell.yaml"))]
    assert {"encoder_head_d", "autocollimator", "stage_command", "error_estimator", "compensation", "recorder"} < {
        *names
    }
    assert "mock_controller" not in names


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("- 1\n", r"no parameter file; expected sections"),
        ("", r"no parameter file"),
        ("/**: {ros__parameters: {}}\n", r"names no node to start"),
        ("/**/recorder: {folder: x}\n", r"cell.yaml:1: '/\*\*/recorder': expected ros__parameters in it"),
        (
            "/**: {ros__parameters: {}}\n/**/encoder: {ros__parameters: {}}\n",
            r":2: no executable serves a node 'encoder'",
        ),
        (
            "recorder: {ros__parameters: {}}\n/**/recorder: {ros__parameters: {}}\n",
            r":2: '/\*\*/recorder' names recorder a",
        ),
    ],
)
def test_what_is_no_cell(tmp_path: Path, text: str, said: str, capsys: pytest.CaptureFixture[str]) -> None:
    path = _file(tmp_path, text)
    with pytest.raises(InputError, match=said):
        nodes_of(path)
    assert main(["up", str(path)]) == 2
    assert str(path) in capsys.readouterr().err


def test_waits_double_and_begin_anew() -> None:
    pace = RestartTimes(shortest=1.0, longest=30.0, settled=60.0)
    waits = [0.0]
    for _ in range(7):
        waits.append(pace.wait(waits[-1], ran=3.0))
    assert waits[1:] == [1.0, 2.0, 4.0, 8.0, 16.0, 30.0, 30.0]
    assert pace.wait(30.0, ran=61.0) == 1.0


def test_a_unit_of_systemd(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    folder = tmp_path / "a 100% odd $HOME"
    folder.mkdir()
    path = folder / "cell.yaml"
    path.write_text("/**/recorder: {ros__parameters: {}}\n")
    monkeypatch.setenv("ROS_DOMAIN_ID", "17")
    assert main(["up", str(path), "--namespace", "/left", "--systemd"]) == 0
    text = capsys.readouterr().out
    (started,) = [line.removeprefix("ExecStart=") for line in text.splitlines() if line.startswith("ExecStart=")]
    words = [word.replace("%%", "%").replace("$$", "$") for word in shlex.split(started)]
    assert words[-4:] == ["up", str(path), "--namespace", "/left"]
    assert 'Environment="ROS_DOMAIN_ID=17"' in text.splitlines()
    if shutil.which("systemd-analyze") is None:
        pytest.skip("no systemd-analyze here to verify the unit with")
    written = tmp_path / "cell.service"
    written.write_text(text)
    done = subprocess.run(["systemd-analyze", "verify", "--user", str(written)], capture_output=True, text=True)
    assert str(written) not in done.stderr and written.name not in done.stderr, done.stderr
