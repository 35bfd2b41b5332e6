"""Every test is run by `make test`, by one of its parts alone, or by `make rates`."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
LONG = tuple(f"@pytest.mark.{word}" for word in ("long", "few("))
PARTS = (
    "test-live",
    "test-models",
    "test-others",
    "test-samples",
    "test-bags",
    "test-models-rates",
    "test-faults-rates",
    "test-others-rates",
)


def is_below(path, places):
    return any(path == place or place in path.parents for place in places)


def is_long(file: Path) -> bool:
    """Whether `make test` leaves out some tests of the file."""
    text = (ROOT / file).read_text()
    return any(word in text for word in LONG)


def files_run_by(*parts: str) -> Counter[Path]:
    """How many times each file of tests is run."""
    printed = subprocess.run(["make", "-n", *parts], cwd=ROOT, check=True, capture_output=True, text=True).stdout
    runs = [shlex.split(line)[1:] for line in printed.splitlines() if "-m pytest" in line]
    assert len(runs) >= len(parts)
    files, count = sorted(path.relative_to(ROOT) for path in (ROOT / "test").rglob("test_*.py")), Counter()
    for words in runs:
        taken = [Path(word) for word in words if word.startswith("test/")] or [Path("test")]
        left_out = [Path(word.removeprefix("--ignore=")) for word in words if word.startswith("--ignore=")]
        assert all((ROOT / place).exists() for place in (*taken, *left_out)), "a path that is not there"
        if "long" in words:  # single tests of files whose others `make test` runs
            taken = [file for file in files if is_long(file) and is_below(file, taken)]
        count.update(file for file in files if is_below(file, taken) and not is_below(file, left_out))
    count.update(dict.fromkeys(files, 0))
    return count


def test_every_file_of_tests_is_run_once():
    """By `make test` or by `make rates`; by both where that takes more random stages, or single tests that are long."""
    short, long, live = files_run_by(*PARTS), files_run_by("rates"), files_run_by("test-live")
    drawn = {file for file in short if short[file] and "\nfrom draws import" in (ROOT / file).read_text()}
    partly = {file for file in short if short[file] and not live[file] and is_long(file)}
    assert {file for file in short if (short[file], long[file]) not in ((1, 0), (0, 1), (1, 1))} == set()
    assert {file for file in short if short[file] and long[file]} == drawn | partly


def test_bytecode_is_kept_also_where_the_environment_forbids_it():
    """Else each process compiles all that it loads: a node needs three times the processor's time to start."""
    show = ["make", "--eval", "show: ; @echo kept$$PYTHONDONTWRITEBYTECODE", "show"]
    forbidding = dict(os.environ, PYTHONDONTWRITEBYTECODE="1")
    printed = subprocess.run(show, cwd=ROOT, check=True, capture_output=True, text=True, env=forbidding).stdout
    assert printed.split() == ["kept"]


def test_what_make_test_leaves_out_of_the_live_tests_is_run_with_sweeps():
    command = ["make", "-n", "test-live"]
    assert "-m 'not long'" in subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    sweeps = dict(os.environ, SWEEPS="1")
    found = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True, env=sweeps).stdout
    assert "-m pytest" in found and "not long" not in found


@pytest.mark.few(2)
@pytest.mark.parametrize("second", ["a", "b"])
@pytest.mark.parametrize("first", ["x", "y"])
def test_of_few_cases_make_test_takes_those_with_most_of_the_values(
    first: str, second: str, request: pytest.FixtureRequest
) -> None:
    """Not the first ones, which differ in what is drawn last alone."""
    is_left_out = request.node.get_closest_marker("long") is not None
    assert is_left_out == ((first, second) not in {("x", "a"), ("y", "b")})


def test_a_test_that_hangs_ends_the_run_and_says_where(tmp_path):
    """Else a deadlock in the middleware shows as nothing but a job that was stopped after hours."""
    hanging = tmp_path / "test_hanging.py"
    hanging.write_text("import threading\n\ndef test_that_waits():\n    threading.Event().wait()\n")
    command = [sys.executable, "-m", "pytest", "-c", str(ROOT / "pyproject.toml"), "-o", "faulthandler_timeout=0.5"]
    ended = subprocess.run([*command, str(hanging)], cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert ended.returncode == 1
    assert 'test_hanging.py", line 4 in test_that_waits' in ended.stderr
