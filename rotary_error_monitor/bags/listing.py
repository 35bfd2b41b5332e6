"""The files of a bag, and whether they are those that its `metadata.yaml` tells of."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from pathlib import Path

from rotary_error_monitor.bags.marks import METADATA
from rotary_error_monitor.bags.metadata import BagMetadata, read_metadata
from rotary_error_monitor.errors import InputError


def read_listing(folder: Path) -> BagMetadata:
    """What the `metadata.yaml` of a bag says; nothing where there is none, or it cannot be read."""
    try:
        return read_metadata(folder)
    except InputError:
        return BagMetadata()


def bag_files(folder: Path, suffixes: Iterable[str] = (".mcap",)) -> list[Path]:
    """The files of a bag in the order in which they were recorded: `bag_10.mcap` after `bag_9.mcap`."""
    found = {path for suffix in suffixes for path in folder.glob(f"*{suffix}") if path.is_file()}
    return sorted(found, key=_place)


def own_files(folder: Path, listing: BagMetadata, suffixes: Iterable[str] = (".mcap",)) -> list[Path]:
    """Those of them that the metadata tells of, and that continue these; all where it tells of none.

    A recorder that was killed may have begun a file of which its metadata does not know yet. What else lies in the
    folder, such as a copy, is somebody's own.
    """
    stems = {stem_of(name) for name in listing.files}
    return [path for path in bag_files(folder, suffixes) if not stems or stem_of(path.name) in stems]


def distinct(files: Iterable[Path]) -> tuple[list[Path], list[str]]:
    """The files, each once, and the names of those that come again, by whatever name or link."""
    found: dict[tuple[int, int] | Path, Path] = {}
    again: dict[str, None] = {}
    for path in files:
        try:
            status = path.stat()
        except OSError:  # what cannot be read is told where it is
            found.setdefault(path, path)
            continue
        if found.setdefault((status.st_dev, status.st_ino), path) is not path:
            again[path.name] = None
    return list(found.values()), list(again)


def count_remarks(listing: BagMetadata, counts: Mapping[str, int]) -> Iterable[str]:
    """Where a bag holds another number of messages than `metadata.yaml` says."""
    differing = [
        f"{topic} {counts.get(topic, 0)} instead of {listing.counts.get(topic, 0)}"
        for topic in sorted({*counts, *listing.counts})
        if counts.get(topic, 0) != listing.counts.get(topic, 0)
    ]
    if differing:
        yield f"the bag holds another number of messages than {METADATA} says: {_several(differing)}"


def _several(texts: list[str]) -> str:
    more = len(texts) - 4
    return ", ".join(texts[:4]) + (f" and {more} topics more" if more > 0 else "")


def stem_of(name: str) -> str:
    """Name of a file without the number that a split gives it."""
    return re.sub(r"_\d+(?=\.)", "", name)


def _place(path: Path) -> tuple[tuple[bool, int, str], ...]:
    parts = re.split(r"(\d+)", path.name)
    return tuple((part.isdecimal(), int(part) if part.isdecimal() else 0, part) for part in parts)
