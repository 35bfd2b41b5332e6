"""Every test is run by `make test`, by one of its parts alone, or by `make rates`."""

from __future__ import annotations

import shlex
import subprocess
from collections import Counter
from pathlib import Path

ROOT = Path(__file__).parents[1]
PARTS = ("test-live", "test-models", "test-others", "test-models-rates", "test-others-rates")


def is_below(path, places):
    return any(path == place or place in path.parents for place in places)


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
        count.update(file for file in files if is_below(file, taken) and not is_below(file, left_out))
    count.update(dict.fromkeys(files, 0))
    return count


def test_every_file_of_tests_is_run_once():
    """By `make test` or by `make rates`; by both where that takes more random stages than this."""
    short, long = files_run_by(*PARTS), files_run_by("rates")
    drawn = {file for file in short if short[file] and "\nfrom draws import" in (ROOT / file).read_text()}
    assert {file for file in short if (short[file], long[file]) not in ((1, 0), (0, 1), (1, 1))} == set()
    assert {file for file in short if short[file] and long[file]} == drawn
