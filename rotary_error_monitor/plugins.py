"""What installed packages register under a group of entry points, and how it is loaded."""

from __future__ import annotations

import importlib
import inspect
import logging
import pkgutil
import sys
from collections.abc import Iterator
from functools import cache
from types import ModuleType
from typing import TYPE_CHECKING, Any, TypeVar

from rotary_error_monitor.errors import InputError

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

_PACKAGE = __name__.partition(".")[0]

T = TypeVar("T")


def modules_in(room: ModuleType) -> Iterator[ModuleType]:
    """The modules of a room of this package, in the order of their names."""
    for name in sorted(info.name for info in pkgutil.iter_modules(room.__path__)):
        yield importlib.import_module(f"{room.__name__}.{name}")


def modules_of(room: ModuleType, group: str) -> Iterator[tuple[ModuleType, str]]:
    """The modules of a room of this package, then those that packages register under a group, each with its origin.

    Raises:
        InputError: what is registered cannot be loaded, or is no module.
    """
    for module in modules_in(room):
        yield module, module.__name__
    for entry in plugins_of(group):
        plugged = load_plugin(entry)
        if not isinstance(plugged, ModuleType):
            raise InputError(f"{origin_of(entry)}: {entry.value} is no module; name the module that holds the classes")
        yield plugged, origin_of(entry)


def classes_in(module: ModuleType, base: type[Any]) -> Iterator[type[Any]]:
    """Classes derived from `base` that a module defines, not those that it imports."""
    for item in vars(module).values():
        if inspect.isclass(item) and issubclass(item, base) and item.__module__ == module.__name__:
            yield item


def plugged_classes(group: str, base: type[T]) -> Iterator[tuple[str, type[T], str]]:
    """The classes that packages register under a group, each with its name there and its origin.

    Raises:
        InputError: what is registered cannot be loaded, or is no class derived from `base`.
    """
    for entry in plugins_of(group):
        found = load_plugin(entry)
        if not (inspect.isclass(found) and issubclass(found, base)):
            raise InputError(f"{origin_of(entry)}: {entry.value} is no class derived from {base.__name__}")
        yield entry.name, found, origin_of(entry)


def plugins_of(group: str) -> tuple[EntryPoint, ...]:
    """The entry points of a group, in the order of their names."""
    found = [entry for entry in _entry_points(tuple(sys.path)) if entry.group == group]
    return tuple(sorted(found, key=lambda entry: entry.name))


@cache
def _entry_points(path: tuple[str, ...]) -> tuple[EntryPoint, ...]:
    """Of all packages on the path, which is `sys.path`: a file of each of them is read, so they are read once."""
    import importlib.metadata  # here, for what has no use of entry points starts sooner without it

    found = importlib.metadata.entry_points()
    return tuple(entry for group in found.groups for entry in found.select(group=group))


def load_plugin(entry: EntryPoint) -> object:
    """What an entry point names; that it runs code of another package is logged.

    Raises:
        InputError: it cannot be loaded; the message says of which package it is.
    """
    if not entry.value.startswith(f"{_PACKAGE}."):
        logging.getLogger(entry.group).warning("%s: %s runs as code", origin_of(entry), entry.value)
    try:
        return entry.load()
    except (Exception, SystemExit) as error:  # whatever a plug-in raises is reported with its name
        raise InputError(f"{origin_of(entry)}: cannot be loaded: {type(error).__name__}: {error}") from error


def origin_of(entry: EntryPoint) -> str:
    """Name and package of an entry point, for messages."""
    package = f" of {entry.dist.name}" if entry.dist is not None else ""
    return f"entry point '{entry.name}'{package}"
