"""A recording and a twin from files, joined to a problem of diagnosis, whatever kind of thing they are of."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import numpy as np

from rotary_error_monitor.description.yaml_files import read_yaml
from rotary_error_monitor.effects.effect import AnyEffect, Cause, Role, order_location
from rotary_error_monitor.effects.library import is_foreign, load_effects
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.gap.kind import ENTRY_POINTS, AnyKind, Kind, TwinFile
from rotary_error_monitor.gap.problem import DiagnosableProblem, Rows
from rotary_error_monitor.plugins import load_plugin, origin_of, plugins_of
from rotary_error_monitor.twin.document import causes_from_rows, effect_rows
from rotary_error_monitor.twin.rates import MOST_RATE

AnyTwinFile = TwinFile[Any, Any]

ROUNDING = 1e-3
"""Change of a prediction, standard deviations of an instrument's noise, below which it may be that of rounding: an
angle of ten thousand turns is rounded to less than a ten-thousandth of a noise of 0.1 µrad."""


def load_twin(path: Path, effect_files: Sequence[Path] = ()) -> AnyTwinFile:
    """Twin of the kind whose section the file has.

    Raises:
        InputError: the file is missing, holds no section of a kind, or breaks its schema.
    """
    content = _content(path)
    section, kind = _kind_of(content, path)
    effects = load_effects(kind.effect, effect_files)
    known = causes_from_rows(content.get("effects", []), effects, str(path))
    return TwinFile(path, section, kind, kind.describe(path), effects, known)


def load_problem(recording: Path, twin: AnyTwinFile, most_rate: float = MOST_RATE) -> DiagnosableProblem:
    """A recording beside a twin, as the twin's kind reads it; effects that are not the package's own are tried.

    Args:
        recording: its bag or file.
        twin: that is held against it.
        most_rate: samples a second (Hz) that are used of one sensor, for kinds that sample in time.

    Raises:
        InputError: the file does not hold what the twin needs, values are not finite, or the recording is too short.
    """
    problem: DiagnosableProblem = twin.kind.problem(recording, twin, most_rate)
    _try_foreign(problem, twin)
    return problem


def improved_twin(twin: AnyTwinFile, causes: Sequence[Cause]) -> dict[str, Any]:
    """Content of a twin file with the causes in it: in its parameters where they have a place there, or as effects."""
    content = _content(twin.path)
    description, others = twin.description, list(twin.known)
    for cause in causes:
        amended = twin.kind.amended(description, cause)
        if amended is description or amended == description:
            others.append(cause)
        description = amended
    mapping = twin.kind.mapping(description)
    content |= {} if mapping is None else {twin.section: mapping}
    content.pop("effects", None)
    if others:
        content["effects"] = effect_rows(others)
    return content


def known_kinds() -> dict[str, AnyKind]:
    """All kinds of things that can be diagnosed, by the section that makes a file a twin of one.

    Raises:
        InputError: one of them cannot be loaded, or is none.
    """
    return {entry.name: _kind(entry) for entry in plugins_of(ENTRY_POINTS)}


def _kind(entry: EntryPoint) -> AnyKind:
    found = load_plugin(entry)
    if not (isinstance(found, type) and issubclass(found, Kind)):
        raise InputError(f"{origin_of(entry)}: {entry.value} is no kind; name a class derived from Kind")
    kind: AnyKind = found()
    return kind


def _try_foreign(problem: DiagnosableProblem, twin: AnyTwinFile) -> None:
    """Predict with each foreign effect, at its first place and at its usual size, and without size.

    Raises:
        InputError: an effect fails, or what it gives has another type or shape than expected or is not finite, or it
            changes the prediction although all its values are 0.
    """
    thing = twin.kind.acted_on(problem, twin.description)
    before: Rows = {}
    for effect in filter(is_foreign, twin.effects):
        for place in _first_place(effect, thing):
            values = effect.start(place)
            amplitudes = effect.indices(Role.LINEAR, Role.SHAPE)
            values[amplitudes] = effect.scales()[amplitudes]
            try:
                twin.kind.attempt(problem, Cause(effect, place, values))
                before = before or problem.residual(())
                _check_without_size(before, problem.residual((Cause(effect, place, effect.start(place)),)))
            except (Exception, SystemExit) as error:  # whatever a user's effect raises is reported with its name
                raise _failed(effect, error) from error


def _check_without_size(before: Rows, after: Rows) -> None:
    """Hold white rows beside an effect whose values are all 0 against those without it.

    Raises:
        ValueError: they differ.
    """
    for channel, rows in before.items():
        changed = float(np.max(np.abs(after[channel] - rows), initial=0.0))
        if np.isnan(changed) or changed > ROUNDING:
            raise ValueError(
                f"with all values 0 it changes the prediction of {channel} by {changed:.3g} standard deviations of its "
                "noise; expected: the prediction as it was"
            )


def _first_place(effect: AnyEffect, thing: object) -> tuple[str, ...]:
    """The first of the places that an effect lists; none if there is no place for it.

    Raises:
        InputError: it fails, or lists something else than different names.
    """
    try:
        places: object = effect.locations(thing)
        if not (isinstance(places, (tuple, list)) and all(isinstance(place, str) for place in places)):
            raise TypeError(f"locations gives {places!r}; expected a tuple of names")
        if len(set(places)) < len(places):
            raise ValueError(f"locations gives {places!r}; expected different names")
    except (Exception, SystemExit) as error:
        raise _failed(effect, error) from error
    return tuple(order_location(effect.lowest, place) if effect.orders else place for place in places[:1])


def _failed(effect: AnyEffect, error: BaseException) -> InputError:
    module = type(effect).__module__.rpartition(".")[2]
    return InputError(f"effect '{effect.name}' of {module} fails: {type(error).__name__}: {error}")


def _content(path: Path) -> dict[str, Any]:
    content = read_yaml(path, "a twin's YAML file").content
    if not isinstance(content, dict):
        raise InputError(f"{path}: no twin; expected a mapping with a section {_sections()}")
    return content


def _sections() -> str:
    return " or ".join(f"'{entry.name}'" for entry in plugins_of(ENTRY_POINTS))


def _kind_of(content: Mapping[str, Any], path: Path) -> tuple[str, AnyKind]:
    """Name and kind of the section that makes the file a twin; of several that of the highest rank, else the first."""
    installed = plugins_of(ENTRY_POINTS)
    if not installed:
        raise InputError(
            f"{path}: no kind of thing is known: nothing is registered as '{ENTRY_POINTS}'; "
            "install this package again (make setup, or pip install)"
        )
    entries = [entry for entry in installed if entry.name in content]
    for one, other in itertools.pairwise(entries):
        if one.name == other.name:
            raise InputError(f"{path}: {origin_of(one)} and {origin_of(other)}: two kinds of one name; remove one")
    kinds = {entry.name: _kind(entry) for entry in entries}
    if not kinds:
        raise InputError(f"{path}: no section {_sections()}; it has {sorted(map(str, content)) or 'nothing'}")
    return max(kinds.items(), key=lambda named: named[1].rank)
