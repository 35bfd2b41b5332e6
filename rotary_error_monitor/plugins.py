"""What installed packages register under a group of entry points, and how it is loaded."""

from __future__ import annotations

import importlib.metadata
import logging
from importlib.metadata import EntryPoint

from rotary_error_monitor.errors import InputError

_PACKAGE = __name__.partition(".")[0]


def plugins_of(group: str) -> tuple[EntryPoint, ...]:
    """The entry points of a group, in the order of their names."""
    return tuple(sorted(importlib.metadata.entry_points(group=group), key=lambda entry: entry.name))


def load_plugin(entry: EntryPoint) -> object:
    """What an entry point names; that it runs code of another package is logged.

    Raises:
        InputError: it cannot be loaded; the message says of which package it is.
    """
    if not entry.value.startswith(f"{_PACKAGE}."):
        logging.getLogger(entry.group).warning("%s: %s runs as code", origin_of(entry), entry.value)
    try:
        return entry.load()
    except Exception as error:  # whatever a plug-in raises is reported with its name
        raise InputError(f"{origin_of(entry)}: cannot be loaded: {type(error).__name__}: {error}") from error


def origin_of(entry: EntryPoint) -> str:
    """Name and package of an entry point, for messages."""
    package = f" of {entry.dist.name}" if entry.dist is not None else ""
    return f"entry point '{entry.name}'{package}"
