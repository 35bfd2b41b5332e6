"""The effects that are known in one run: those of this package, of installed plug-ins, of a user's files."""

from __future__ import annotations

import importlib
import importlib.metadata
import importlib.util
import inspect
import pkgutil
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from types import ModuleType
from typing import TypeVar

import rotary_error_monitor.effects as room
from rotary_error_monitor.effects.effect import AnyEffect, Effect
from rotary_error_monitor.errors import InputError

ENTRY_POINTS = "rotary_error_monitor.effects"

Kind = TypeVar("Kind", bound=AnyEffect)


def load_effects(kind: type[Kind], files: Sequence[Path] = ()) -> tuple[Kind, ...]:
    """All effects of one kind, in the order of their names.

    Args:
        kind: the base class, such as `StageEffect`.
        files: Python files of a user, each with effect classes of its own.

    Raises:
        InputError: a file cannot be loaded or holds no effect, or two effects share a name.
    """
    found: dict[str, Kind] = {}
    for module in (*_own_modules(), *_plugged_modules()):
        _collect(found, kind, module, module.__name__)
    for file in files:
        module = _module_of(file)
        if not any(_defined(Effect, module)):
            raise InputError(f"{file}: defines no effect; expected a class with a 'name' derived from {kind.__name__}")
        _collect(found, kind, module, str(file))
    return tuple(found[name] for name in sorted(found))


def effect_named(name: str, effects: Iterable[Kind]) -> Kind:
    """The effect of that name.

    Raises:
        InputError: there is none; the message lists those that are known.
    """
    known = {effect.name: effect for effect in effects}
    if name not in known:
        raise InputError(f"no effect is called '{name}'; known are {', '.join(sorted(known))}")
    return known[name]


def _own_modules() -> list[ModuleType]:
    names = sorted(info.name for info in pkgutil.iter_modules(room.__path__))
    return [importlib.import_module(f"{room.__name__}.{name}") for name in names]


def _plugged_modules() -> list[ModuleType]:
    loaded = [entry.load() for entry in importlib.metadata.entry_points(group=ENTRY_POINTS)]
    return [item for item in loaded if isinstance(item, ModuleType)]


def _module_of(file: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"{ENTRY_POINTS}.of_user.{file.stem}", file)
    if spec is None or spec.loader is None or not file.is_file():
        raise InputError(f"{file}: no Python file; --effects takes the path of a .py file with effect classes")
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    try:
        spec.loader.exec_module(module)
    except Exception as error:  # whatever a user's file raises is reported with its place
        raise InputError(f"{file}: cannot be loaded: {type(error).__name__}: {error}") from error
    return module


def _defined(kind: type[Kind], module: ModuleType) -> Iterable[type[Kind]]:
    for item in vars(module).values():
        own = inspect.isclass(item) and issubclass(item, kind) and item.__module__ == module.__name__
        if own and item.is_concrete():
            yield item


def _collect(found: dict[str, Kind], kind: type[Kind], module: ModuleType, origin: str) -> None:
    for item in _defined(kind, module):
        if item.name in found:
            raise InputError(f"{origin}: effect '{item.name}' is already known; choose another name")
        found[item.name] = item()
