"""Fuzzing for minutes: `make fuzz`. FUZZ_MINUTES says how many, FUZZ_SEED from which number on.

What does not end cleanly is kept in the corpus, which every run of the tests tries again.
"""

from __future__ import annotations

import itertools
import os
import time
from pathlib import Path

from .fuzzing import Fuzzer
from .sandbox import Sandbox
from .targets import CORPUS, targets

MINUTES = 10.0


def test_changed_files_end_cleanly(sandbox: Sandbox, tmp_path: Path) -> None:
    minutes = float(os.environ.get("FUZZ_MINUTES", MINUTES))
    first = int(os.environ.get("FUZZ_SEED", time.time_ns() // 1_000_000))
    (tmp_path / "templates").mkdir()
    wanted = os.environ.get("FUZZ_TARGETS", "").split()
    all_targets = [each for each in targets(tmp_path / "templates") if not wanted or each.name in wanted]
    fuzzer = Fuzzer(sandbox, tmp_path / "tried", tmp_path / "templates")
    print(f"\nfrom seed {first} for {minutes:g} minutes")
    end = time.monotonic() + 60 * minutes
    told = 0
    for seed in itertools.count(first):
        for target in all_targets:
            fuzzer.draw(target, seed)
            for fault in fuzzer.faults[told:]:
                print(f"{fault.keep(CORPUS)}: {fault.run}", flush=True)
            told = len(fuzzer.faults)
        if time.monotonic() > end:
            break
    print(f"{fuzzer.codes.total()} runs of at most {fuzzer.most:.1f} s processor time, {told} not clean")
    for target in all_targets:
        codes = {code: count for (name, code), count in fuzzer.codes.items() if name == target.name}
        print(f"{target.name:14}", codes)
    assert not told, f"{told} files did not end cleanly; they are in {CORPUS}"
