"""Every test is run by `make test`, by one of its parts alone, or by `make rates`."""

from __future__ import annotations

import shlex
import subprocess
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).parents[1]
PARTS = ("test-live", "test-models", "test-others", "rates")


def is_below(path, places):
    return any(path == place or place in path.parents for place in places)


def test_every_file_of_tests_is_run_once():
    printed = subprocess.run(["make", "-n", *PARTS], cwd=ROOT, check=True, capture_output=True, text=True).stdout
    runs = [shlex.split(line)[1:] for line in printed.splitlines() if "-m pytest" in line]
    assert len(runs) >= len(PARTS)
    files, count = sorted(path.relative_to(ROOT) for path in (ROOT / "test").rglob("test_*.py")), Counter()
    for words in runs:
        taken = [Path(word) for word in words if word.startswith("test/")] or [Path("test")]
        left_out = [Path(word.removeprefix("--ignore=")) for word in words if word.startswith("--ignore=")]
        assert all((ROOT / place).exists() for place in (*taken, *left_out)), "a path that is not there"
        count.update(file for file in files if is_below(file, taken) and not is_below(file, left_out))
    assert {file for file in files if count[file] != 1} == set()
