"""QUALITY_DECLARATION.md claims only what is there, and the level that it has earned."""

from __future__ import annotations

import re
import subprocess
import tomllib
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

import rotary_error_monitor

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "QUALITY_DECLARATION.md").read_text(encoding="utf-8")
SPOKEN = set(re.findall(r"`([^`]+)`", TEXT))
PATHS = sorted(
    name for name in SPOKEN if re.fullmatch(r"[\w.]+/[\w./]*|[A-Z_]+\.(md|rst)|LICENSE|[a-z]+\.(xml|py|toml)", name)
)
TARGETS = sorted(name.split()[1] for name in SPOKEN if name.startswith("make "))


@pytest.mark.parametrize("name", PATHS)
def test_what_is_named_is_there(name):
    path = ROOT / name
    assert path.exists()
    if name.startswith("test/"):
        assert path.is_file() or [*path.glob("test_*.py"), *path.glob("*_*.py")]


@pytest.mark.parametrize("target", TARGETS)
def test_targets_are_those_of_the_makefile(target):
    assert re.search(rf"^{target}:", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)


def test_everything_named_is_a_path_a_target_or_a_known_word():
    words = SPOKEN - set(PATHS) - {f"make {target}" for target in TARGETS}
    assert words == {"rotary_error_monitor wire", "domain_coordinator"}


def test_versions_agree():
    package = ET.parse(ROOT / "package.xml").findtext("version")
    setup = re.search(r'version="([\d.]+)"', (ROOT / "setup.py").read_text(encoding="utf-8"))
    assert setup is not None
    assert package == setup[1] == rotary_error_monitor.__version__
    assert f"Not stable: {package}" in TEXT


def test_the_tools_are_set_as_claimed():
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]
    assert "D" in settings["ruff"]["lint"]["select"]
    assert settings["mypy"]["strict"]
    assert settings["pytest"]["ini_options"]["filterwarnings"][0] == "error"
    assert settings["coverage"]["report"]["fail_under"] == 90 and settings["coverage"]["run"]["branch"]


def test_dependencies_are_all_named():
    block = re.search(r"install_requires=\[(.*?)\]", (ROOT / "setup.py").read_text(encoding="utf-8"), re.DOTALL)
    assert block is not None
    for name in re.findall(r'"([A-Za-z0-9.]+)', block[1]):
        assert name in TEXT, name


def test_the_level_is_the_one_that_is_earned():
    """Level 4 asks for a licence and a copyright statement in each source file, Level 3 for a stable version."""
    listed = subprocess.run(["git", "ls-files", "*.py"], cwd=ROOT, check=True, capture_output=True, text=True).stdout
    sources = [ROOT / name for name in listed.splitlines() if (ROOT / name).is_file()]
    stated = all("Copyright" in path.read_text(encoding="utf-8")[:500] for path in sources)
    assert sources and (ROOT / "LICENSE").is_file()
    assert f"**Level: {4 if stated else 5}.**" in TEXT
    assert int(rotary_error_monitor.__version__.split(".")[0]) < 1
