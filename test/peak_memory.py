"""A command in a process of its own, and the most memory that it took."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

_RUN = """
import sys
from rotary_error_monitor.cli import main
from rotary_error_monitor.signals import rows
rows.PART = int(sys.argv[1]) or rows.PART
code = main(sys.argv[2:])
print(open("/proc/self/status").read(), file=sys.stderr)
sys.exit(code)
"""


@dataclass(frozen=True)
class Measured:
    """How a command ended, and its peak of resident memory, MB: of its own, not of who started it, as `rusage` says."""

    code: int
    peak: float


_STEADY = {"PYTHONHASHSEED": "0", "MALLOC_MMAP_THRESHOLD_": "131072", "MALLOC_TRIM_THRESHOLD_": "131072"}
"""What the C library takes by itself at its start: later it raises both as it goes, and keeps some MB more or less."""


def measured(arguments: Sequence[str | Path], part: int = 0, steady: bool = False) -> Measured:
    """Run a command of the package, with parts of so many rows, or of as many as it has by itself.

    `steady` has what was given back leave the process at once, so that two runs can be compared to 1 MB.
    """
    done = subprocess.run(
        [sys.executable, "-c", _RUN, str(part), *map(str, arguments)],
        env={**os.environ, **(_STEADY if steady else {})},
        capture_output=True,
        text=True,
        check=False,
    )
    found = re.search(r"VmHWM:\s+(\d+) kB", done.stderr)
    assert found, done.stderr
    return Measured(done.returncode, int(found[1]) / 1024)
