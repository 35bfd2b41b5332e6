"""A command in a process of its own, and the most memory that it took."""

from __future__ import annotations

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


def measured(arguments: Sequence[str | Path], part: int = 0) -> Measured:
    """Run a command of the package, with parts of so many rows, or of as many as it has by itself."""
    done = subprocess.run(
        [sys.executable, "-c", _RUN, str(part), *map(str, arguments)], capture_output=True, text=True, check=False
    )
    found = re.search(r"VmHWM:\s+(\d+) kB", done.stderr)
    assert found, done.stderr
    return Measured(done.returncode, int(found[1]) / 1024)
