"""Twins as the content of YAML files: descriptions written back, and effects that have no place in a description."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

import numpy as np

from rotary_error_monitor.effects.effect import AnyEffect, Cause
from rotary_error_monitor.effects.library import effect_named
from rotary_error_monitor.errors import InputError, excerpt, told_of

Kind = TypeVar("Kind", bound=AnyEffect)


def effect_rows(causes: Sequence[Cause]) -> list[dict[str, Any]]:
    """Causes as rows of a twin's `effects` section."""
    rows = []
    for cause in causes:
        reported = cause.effect.report(cause.values, np.zeros((len(cause.values), len(cause.values))))
        parameters = {name: list(e.value) if isinstance(e.value, tuple) else e.value for name, e in reported.items()}
        rows.append({"effect": cause.effect.name, "location": cause.location, "parameters": parameters})
    return rows


def causes_from_rows(rows: object, effects: Sequence[Kind], origin: str) -> tuple[Cause, ...]:
    """Causes from a twin's `effects` section.

    Raises:
        InputError: a row is no mapping with effect, location and parameters, or names an unknown effect or parameter.
    """
    if not isinstance(rows, list):
        raise InputError(f"{origin}: effects: expected a list of rows {{effect, location, parameters}}")
    found = []
    for number, row in enumerate(rows, start=1):
        if not isinstance(row, Mapping) or not {"effect", "parameters"} <= set(row):
            raise InputError(
                f"{origin}: effects, row {number}: {excerpt(row)}; expected effect, location and parameters"
            )
        with told_of(f"{origin}: effects, row {number}"):
            effect = effect_named(str(row["effect"]), effects)
            found.append(Cause(effect, str(row.get("location") or ""), effect.values_from(row["parameters"])))
    return tuple(found)
