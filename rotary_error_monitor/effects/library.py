"""The effects that are known in one run: those of this package, of installed plug-ins, of a user's files."""

from __future__ import annotations

import importlib.util
import logging
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from types import ModuleType
from typing import TypeVar

import rotary_error_monitor.effects as room
from rotary_error_monitor.effects.definition import check_definition
from rotary_error_monitor.effects.effect import AnyEffect, Effect, Searched
from rotary_error_monitor.effects.rotor import StageEffect
from rotary_error_monitor.errors import InputError, excerpt
from rotary_error_monitor.plugins import classes_in, modules_of

ENTRY_POINTS = "rotary_error_monitor.effects"
_OF_USER = f"{ENTRY_POINTS}.of_user."
_LOG = logging.getLogger(ENTRY_POINTS)

Kind = TypeVar("Kind", bound=AnyEffect)


def load_effects(kind: type[Kind], files: Sequence[Path] = ()) -> tuple[Kind, ...]:
    """All effects of one kind, in the order of their names.

    Args:
        kind: the base class, such as `StageEffect`.
        files: Python files of a user, each with effect classes of its own; they run as code, which is logged.

    Raises:
        InputError: a file or a plug-in cannot be loaded, a file holds no effect, an effect's name or parameters cannot
            be used, or two effects share a name.
    """
    found: dict[str, Kind] = {}
    for module, origin in modules_of(room, ENTRY_POINTS):
        _collect(found, kind, module, origin)
    for file in files:
        module = _module_of(file)
        if not any(_defined(Effect, module)):
            raise InputError(f"{file}: defines no effect; expected a class with a 'name' derived from {kind.__name__}")
        _collect(found, kind, module, str(file))
    return tuple(found[name] for name in sorted(found))


def is_foreign(effect: AnyEffect) -> bool:
    """Whether an effect is of a plug-in or of a user's file."""
    module = type(effect).__module__
    return not module.startswith(f"{room.__name__.partition('.')[0]}.") or module.startswith(_OF_USER)


def effect_named(name: str, effects: Iterable[Kind]) -> Kind:
    """The effect of that name.

    Raises:
        InputError: there is none; the message lists those that are known.
    """
    known = {effect.name: effect for effect in effects}
    if name not in known:
        raise InputError(f"no effect is called '{excerpt(name)}'; known are {', '.join(sorted(known))}")
    return known[name]


def _module_of(file: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"{_OF_USER}{file.stem}", file)
    if spec is None or spec.loader is None or not file.is_file():
        raise InputError(f"{file}: no Python file; --effects takes the path of a .py file with effect classes")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    _LOG.warning("%s: effects of your own run as code, with all that you may do", file)
    try:
        spec.loader.exec_module(module)
    except (Exception, SystemExit) as error:  # whatever a user's file raises is reported with its place
        raise InputError(f"{file}: cannot be loaded: {type(error).__name__}: {error}") from error
    return module


def _defined(kind: type[Kind], module: ModuleType) -> Iterable[type[Kind]]:
    return (item for item in classes_in(module, kind) if item.is_concrete())


def _collect(found: dict[str, Kind], kind: type[Kind], module: ModuleType, origin: str) -> None:
    for item in _defined(kind, module):
        check_definition(item, origin)
        if item.name in found:
            raise InputError(f"{origin}: effect '{item.name}' is already known; choose another name")
        _check_searched(item, origin)
        try:
            found[item.name] = item()
        except TypeError as error:
            raise InputError(f"{origin}: effect '{item.name}' is to be made without arguments: {error}") from error


def _check_searched(item: type[AnyEffect], origin: str) -> None:
    if item.searched is None:
        return
    known = ", ".join(f"Searched.{each.name}" for each in item.searchable)
    if item.searched not in item.searchable:
        raise InputError(f"{origin}: effect '{item.name}' is searched by {item.searched!r}; expected {known or 'none'}")
    wanted = item.searchable[item.searched]
    if wanted not in {row.name for row in item.parameters}:
        raise InputError(f"{origin}: effect '{item.name}' is searched by {item.searched.name}, but has no {wanted}")
    if item.searched is Searched.MOMENT and item.locations in (Effect.locations, StageEffect.locations):
        raise InputError(f"{origin}: effect '{item.name}' begins at a moment of one head: list heads in 'locations'")
