"""Finding the bags below a folder, and telling by their files whether one has changed."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Sequence
from pathlib import Path

from rotary_error_monitor.bags.bag_files import BagFiles
from rotary_error_monitor.bags.listing import bag_files, stem_of
from rotary_error_monitor.bags.marks import METADATA, SUFFIXES
from rotary_error_monitor.bags.naming import Naming, cells_in
from rotary_error_monitor.errors import InputError, excerpt
from rotary_error_monitor.files import exists


def find_bags(folder: Path) -> list[Path]:
    """All bags in and below a folder, by their path; links to folders are not followed.

    A folder with `metadata.yaml` is a bag, and what is below it is its own. So is one without, whose recorder was
    killed, where all its files are named after it, as recorders name the parts of a bag. Any other file is a bag by
    itself.

    Raises:
        InputError: it is no folder, cannot be read, or no bag is below it.
    """
    if not folder.is_dir():
        there = "no folder" if exists(folder) else "no such folder"
        raise InputError(f"{excerpt(folder)}: {there}; give a folder with bags below it, at any depth")
    denied: list[OSError] = []
    found: list[Path] = []
    for place, folders, _ in os.walk(folder, onerror=denied.append):
        here = Path(place)
        files = bag_files(here, SUFFIXES)
        if (here / METADATA).exists() or {_bag_of(file) for file in files} == {here.resolve().name}:
            found.append(here)
            folders.clear()
        else:
            found += files
    if denied:
        raise InputError(f"{denied[0].filename}: cannot be read ({denied[0].strerror}); give a folder that may be read")
    if not found:
        raise InputError(
            f"{excerpt(folder)}: no bag below it; expected folders with {METADATA}, or files {', '.join(SUFFIXES)}"
        )
    return sorted(found)


def _bag_of(file: Path) -> str:
    """Name of the folder in which a recorder would have put it."""
    stem = stem_of(file.name)
    return next(stem.removesuffix(suffix) for suffix in SUFFIXES if stem.endswith(suffix))


def fingerprint_of(bag: Path) -> str:
    """What changes with every change of a bag: names, sizes and times of modification of its files, hashed.

    Raises:
        InputError: a file cannot be looked at, as where the bag was just removed.
    """
    try:
        rows = [(path.name, path.stat()) for path in _files(bag)]
    except OSError as error:
        raise InputError(f"{error.filename or bag}: cannot be read ({error.strerror}); is it being removed?") from error
    told = "\n".join(f"{name!r} {status.st_size} {status.st_mtime_ns}" for name, status in rows)
    return hashlib.sha256(told.encode()).hexdigest()


def _files(bag: Path) -> Sequence[Path]:
    return sorted(path for path in bag.iterdir() if path.is_file()) if bag.is_dir() else [bag]


def cells_of(bag: Path, naming: Naming) -> list[str]:
    """Cells of a bag that a reader may mean: the one that is named, or all that it has.

    Raises:
        InputError: the bag cannot be read.
    """
    if naming.cell is not None:
        return [naming.cell]
    given = {row.topic for row in naming.topics.values()}
    return cells_in({name: each for name, each in BagFiles(bag).topics.items() if name not in given})
