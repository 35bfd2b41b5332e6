"""Every command that the README shows is run, here or in the test named beside it."""

from __future__ import annotations

import re
import shlex
import subprocess
from pathlib import Path

import numpy as np
import pytest
from mock_bags import write_mock_bag

from rotary_error_monitor.cli import main
from rotary_error_monitor.testing import Cell

ROOT = Path(__file__).parents[1]
README = (ROOT / "README.md").read_text(encoding="utf-8")
ELSEWHERE = {
    "make run": "test/mock_cell/test_run.py",
    "make run-linuxcnc": "test/linuxcnc_demonstration/test_run.py",
    "make test": ".ci/run",
    "rotary_error_monitor up config/real_cell.yaml": "test/supervision/test_up.py",
    "venv/bin/python -m colcon build": "test/test_package.py",
    "ros2 run rotary_error_monitor rotary_error_monitor wire": "test/test_package.py",
}
ROOMS = "|".join(path.parent.name for path in (ROOT / "rotary_error_monitor").glob("*/__init__.py"))
ONLY_WITH_APT = {
    "rosdep install --from-paths src --ignore-src -y",
    "python3 -m venv --system-site-packages venv && touch venv/COLCON_IGNORE",
}


def commands() -> list[str]:
    """Lines of the README's sh blocks, without their comments."""
    blocks = re.findall(r"```sh\n(.*?)```", README, re.DOTALL)
    return [line.split("#")[0].strip() for block in blocks for line in block.splitlines() if line.strip()]


TWIN_CASES = sorted((ROOT.parent / "shared" / "cases" / "open").glob("*/twin.yaml"))


def of_kind(beginning: str) -> list[str]:
    found = [command for command in commands() if command.startswith(beginning)]
    assert found, f"the README shows no command that begins with '{beginning}'"
    return found


def test_no_command_is_left_out():
    known = ("ros2 run rotary_error_monitor ", "rotary_error_monitor ", "venv/bin/python -m pip install ")
    for command in commands():
        assert command in ELSEWHERE or command in ONLY_WITH_APT or command.startswith(known), command


@pytest.mark.parametrize("command", sorted(ELSEWHERE))
def test_a_command_that_is_run_elsewhere_is_run_there(command):
    assert command in commands()
    words = command.split()[-1]
    assert words in (ROOT / ELSEWHERE[command]).read_text(encoding="utf-8")


@pytest.mark.parametrize("command", of_kind("make "))
def test_the_makefile_knows_the_target(command):
    assert subprocess.run(["make", "-n", *command.split()[1:]], cwd=ROOT, capture_output=True).returncode == 0


def test_pip_installs_what_setup_py_asks_for():
    (command,) = of_kind("venv/bin/python -m pip install")
    setup = (ROOT / "setup.py").read_text(encoding="utf-8")
    for requirement in shlex.split(command)[4:]:
        assert f'"{requirement}"' in setup


@pytest.mark.parametrize("command", [c for c in of_kind("ros2 run rotary_error_monitor ") if c not in ELSEWHERE])
def test_a_node_runs_as_shown(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    executable, *arguments = shlex.split(command)[3:]
    ros_args = [word for word in arguments if word != "--ros-args"]
    name = next((w.removeprefix("__node:=") for w in ros_args if w.startswith("__node:=")), executable)
    with Cell() as cell:
        process = cell.start(executable, name, ros_args=ros_args)
        cell.wait_for_status(f"{name}: state", "active", 40.0)
        assert process.stop() == 0


SAMPLES = 12_000
"""Of each stream, 2,000 a second: two turns, in the first of which the stage's description is verified."""


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    """A recording of the mock cell's signals, made without starting it."""
    return write_mock_bag(tmp_path_factory.mktemp("readme") / "bag", SAMPLES)


@pytest.mark.skipif(not TWIN_CASES, reason="no recorded cases beside the checkout")
@pytest.mark.parametrize("command", of_kind("rotary_error_monitor diagnose "))
def test_diagnose_works_as_shown(command, tmp_path):
    twin = TWIN_CASES[0]
    names = {"BAG": str(twin.parent / "bag"), "TWIN.yaml": str(twin), "DIR": str(tmp_path / "diagnosis")}
    code = main([names.get(word, word) for word in shlex.split(command)[1:]])
    assert code in (0, 10, 11, 12)
    assert (tmp_path / "diagnosis" / "diagnosis.json").is_file()


@pytest.mark.parametrize(
    "command", [c for c in of_kind("rotary_error_monitor ") if " diagnose " not in c and c not in ELSEWHERE]
)
def test_the_command_line_works_as_shown(command, bag, tmp_path, monkeypatch, capsys):
    out = tmp_path / "out.npz"
    page = tmp_path / "page.html"
    files = {"BAG": str(bag), "OUT.npz": str(out), "PAGE.html": str(page)}
    words = [files.get(word, word) for word in shlex.split(command)[1:]]
    monkeypatch.chdir(ROOT)
    assert main(words) == 0
    assert capsys.readouterr().out
    assert page.is_file() == (str(page) in words)
    if str(out) in words:
        with np.load(out) as found:
            verified = 2 * len(found["stamp_ns"]) // 3
            assert np.isfinite(found["tool_offset"][verified:]).all(axis=1).mean() > 0.9


@pytest.mark.parametrize("document", sorted(path.name for path in (*ROOT.glob("*.md"), *(ROOT / "doc").glob("*.md"))))
def test_files_that_a_document_names_are_there(document):
    place = next(place for place in (ROOT, ROOT / "doc") if (place / document).is_file())
    text = (place / document).read_text(encoding="utf-8")
    named = set(re.findall(r"`((?:test|config|doc|rotary_error_monitor|msg_defs)/[\w./-]*)`", text))
    named |= {f"rotary_error_monitor/{name}" for name in re.findall(rf"`((?:{ROOMS})/[\w/]+\.py)`", text)}
    assert not [name for name in named if not (ROOT / name).exists()]
    linked = [link.split("#")[0] for link in re.findall(r"\]\(([^)\s]+)\)", text) if "://" not in link]
    assert not [link for link in linked if link and not (place / link).exists()]
