"""A unit of systemd that starts a cell with the computer and starts it again should it end."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path

KEPT = ("ROS_", "RMW_", "AMENT_", "FASTDDS_", "FASTRTPS_", "PYTHONPATH", "LD_LIBRARY_PATH", "PATH")
"""Beginnings of the names of environment variables that a node's surroundings are made of."""


def unit(cell: Path, options: Sequence[str]) -> str:
    """Text of a user unit that runs `rotary_error_monitor up` on a cell's file, with further options, from here."""
    words = [sys.executable, "-c", "from rotary_error_monitor.start import command; raise SystemExit(command())"]
    command = " ".join(map(_quoted, [*words, "up", str(cell.resolve()), *options])).replace("$", "$$")
    surroundings = [
        f"Environment={_quoted(f'{name}={value}')}"
        for name, value in sorted(os.environ.items())
        if name.startswith(KEPT)
    ]
    return "\n".join(
        [
            "[Unit]",
            f"Description=Machine cell of rotary_error_monitor, {cell.name}",
            "After=network-online.target",
            "",
            "[Service]",
            f"ExecStart={command}",
            f"WorkingDirectory={Path.cwd()}",
            *surroundings,
            "KillMode=mixed",
            "TimeoutStopSec=60",
            "Restart=on-failure",
            "RestartSec=5",
            "",
            "[Install]",
            "WantedBy=default.target",
            "",
        ]
    )


def _quoted(word: str) -> str:
    """A word as systemd reads it back (systemd.syntax(7), specifiers in systemd.unit(5))."""
    escaped = word.replace("\\", "\\\\").replace('"', '\\"').replace("%", "%%")
    return f'"{escaped}"'
