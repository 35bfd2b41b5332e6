"""By what a bag is known, without reading it: its names. Light, for commands that must not load what reads."""

from __future__ import annotations

from pathlib import Path

METADATA = "metadata.yaml"
SUFFIXES = (".mcap", ".db3", ".mcap.zstd", ".db3.zstd")
"""Endings of the files of a bag."""


def is_bag(path: Path) -> bool:
    """Whether a path is read as one bag: a file of one, or a folder with `metadata.yaml` or files of bags in it."""
    if not path.is_dir():
        return path.name.endswith(SUFFIXES)
    return any(each.name == METADATA or (each.name.endswith(SUFFIXES) and each.is_file()) for each in path.iterdir())
