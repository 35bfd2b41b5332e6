"""What `make setup` installs is pinned by hash, and it is what setup.py asks for."""

from __future__ import annotations

import ast
import re
import subprocess
from importlib.metadata import PackageNotFoundError, version
from itertools import pairwise
from pathlib import Path

import pytest
from packaging.markers import default_environment
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]
LOCKS = sorted((ROOT / "requirements").glob("*.lock"))
FOR = [("3.11", "x86_64"), ("3.12", "x86_64"), ("3.11", "aarch64"), ("3.12", "aarch64")]


def asked_for() -> dict[str, list[str]]:
    """Requirements of setup.py by extra, '' for those of the package itself, read without running it."""
    tree = ast.parse((ROOT / "setup.py").read_text(encoding="utf-8"))
    (call,) = (n for n in ast.walk(tree) if isinstance(n, ast.Call) and getattr(n.func, "id", "") == "setup")
    given = {keyword.arg: keyword.value for keyword in call.keywords}
    extras = ast.literal_eval(given["extras_require"])
    return {"": list(ast.literal_eval(given["install_requires"])), **extras}


OF_SITE = "docs"
"""Extra of what makes the site; it is installed apart from the cell, with a lock of its own."""

REQUIREMENTS = sorted(
    {(OF_SITE if extra == OF_SITE else "cell", text) for extra, texts in asked_for().items() for text in texts}
)


def locked(path: Path) -> list[tuple[Requirement, list[str]]]:
    """Each pinned requirement with its hashes."""
    joined = path.read_text(encoding="utf-8").replace("\\\n", " ")
    return [(Requirement(line.split(" --hash=")[0]), re.findall(r"--hash=(\S+)", line)) for line in joined.splitlines()]


def versions(name: str, python: str, machine: str, lock: str = "cell") -> list[str]:
    """Versions of a package that a lock installs on such a computer."""
    environment = default_environment() | {
        "python_version": python,
        "python_full_version": f"{python}.0",
        "platform_machine": machine,
        "sys_platform": "linux",
    }
    return [
        next(iter(pin.specifier)).version
        for pin, _ in locked(ROOT / "requirements" / f"{lock}.lock")
        if canonicalize_name(pin.name) == canonicalize_name(name)
        and (pin.marker is None or pin.marker.evaluate({k: str(v) for k, v in environment.items()}))
    ]


@pytest.mark.parametrize("path", LOCKS, ids=[path.name for path in LOCKS])
def test_each_file_that_may_be_installed_is_known_by_its_hash(path):
    pins = locked(path)
    assert pins
    for pin, hashes in pins:
        assert [each.operator for each in pin.specifier] == ["=="], pin
        assert hashes and all(re.fullmatch(r"sha256:[0-9a-f]{64}", each) for each in hashes), pin


@pytest.mark.parametrize("path", LOCKS, ids=[path.name for path in LOCKS])
def test_no_file_says_where_from(path):
    assert "://" not in path.read_text(encoding="utf-8")
    assert not re.search(r"^\s*-", path.read_text(encoding="utf-8").replace("    --hash=", ""), re.MULTILINE)


@pytest.mark.parametrize(("lock", "text"), REQUIREMENTS)
def test_the_lock_holds_what_setup_py_asks_for(lock, text):
    wanted = Requirement(text)
    for python, machine in FOR:
        found = versions(wanted.name, python, machine, lock)
        assert len(found) == 1, f"{wanted.name} for {python} on {machine}: {found}; run: make lock"
        assert wanted.specifier.contains(found[0]), f"{found[0]} is locked, {text} is asked for; run: make lock"


def test_what_builds_the_package_is_what_it_is_tested_with():
    (setuptools,) = (pin for pin, _ in locked(ROOT / "requirements" / "build.lock") if pin.name == "setuptools")
    assert str(setuptools.specifier) == f"=={versions('setuptools', '3.11', 'x86_64')[0]}"


def test_setup_installs_nothing_whose_hash_is_not_known():
    dry = subprocess.run(
        ["make", "--always-make", "--dry-run", ".venv/.ready"], cwd=ROOT, check=True, capture_output=True, text=True
    )
    commands = re.split(r"[;&\n]+", dry.stdout.replace("\\\n", " "))
    installs = [command for command in commands if "pip install" in command]
    assert len(installs) == 3
    for command in installs:
        assert "--require-hashes" in command or "--no-deps" in command, command
    assert all("--no-build-isolation" in command for command in installs[1:])  # a build would fetch its tools by itself


def test_what_is_installed_here_is_what_is_locked():
    """In the environment of `make setup`; elsewhere, as with an apt-installed ROS, other versions in the ranges do."""
    if not (ROOT / ".venv" / ".ready").exists():
        pytest.skip("not installed by make setup")
    here = default_environment()
    differing = {}
    for pin, _ in locked(ROOT / "requirements" / "cell.lock"):
        if pin.marker is None or pin.marker.evaluate({k: str(v) for k, v in here.items()}):
            try:
                found = version(pin.name)
            except PackageNotFoundError:
                found = "nothing"
            if not pin.specifier.contains(found):
                differing[pin.name] = found
    assert not differing, f"run: make setup ({differing})"


def test_requirements_stand_once():
    for texts in asked_for().values():
        names = sorted(canonicalize_name(Requirement(text).name) for text in texts)
        assert not [name for name, after in pairwise(names) if name == after]
