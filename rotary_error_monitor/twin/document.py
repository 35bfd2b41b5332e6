"""Twins as the content of YAML files: descriptions written back, and effects that have no place in a description."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any, TypeVar

import numpy as np

from rotary_error_monitor.description.listed_sensors import name_of, sensors_section
from rotary_error_monitor.description.machine_section import machine_mapping as machine_mapping
from rotary_error_monitor.description.response import angle_rows, two_axis_rows
from rotary_error_monitor.description.stage import Encoder, PlanarHarmonic, StageDescription
from rotary_error_monitor.effects.effect import AnyEffect, Cause
from rotary_error_monitor.effects.library import effect_named
from rotary_error_monitor.errors import InputError, excerpt

Kind = TypeVar("Kind", bound=AnyEffect)


def stage_mapping(stage: StageDescription) -> dict[str, Any]:
    """Content of a `stage` section: the inverse of `stage_from_mapping`."""
    spindle = stage.spindle
    content: dict[str, Any] = {} if stage.encoder is None else {"encoder": _encoder_mapping(stage, stage.encoder)}
    content |= {
        "mirror": {"tilt": list(stage.mirror.tilt), "flatness": _rows(stage.mirror.flatness)},
        "spindle": {
            "radial": _rows(spindle.radial),
            "tilt": _rows(spindle.tilt),
            "radial_compliance": spindle.radial_compliance,
            "tilt_compliance": spindle.tilt_compliance,
            "radial_thermal": list(spindle.radial_thermal),
            "axial": [{"order": row.order, "cos": row.cos, "sin": row.sin} for row in spindle.axial],
        },
        "environment": {"reference_temperature": stage.reference_temperature},
    }
    if stage.autocollimator is not None:
        content["autocollimator"] = {
            key: value for key, value in asdict(stage.autocollimator).items() if value is not None
        } | two_axis_rows(stage.response("autocollimator"))
    if stage.lvdt is not None:
        content["lvdt"] = {
            "height": stage.lvdt.height,
            "noise": stage.lvdt.noise,
            "artefact_eccentricity": list(stage.lvdt.artefact_eccentricity),
        } | two_axis_rows(stage.response("lvdt"))
    if command := angle_rows(stage.response("command")):
        content["command"] = command
    if stage.listed:
        content["sensors"] = sensors_section(stage.listed)
        for stream, sensor in stage.listed.items():
            if latency := stage.response(stream).latency:
                content["sensors"][name_of(stream, sensor)]["latency"] = latency
    if stage.stated_limits:
        content["limits"] = dict(stage.stated_limits)
    if stage.uncertainty:
        content["uncertainty"] = dict(stage.uncertainty)
    return content


def _encoder_mapping(stage: StageDescription, encoder: Encoder) -> dict[str, Any]:
    return {
        "disc_radius": encoder.disc_radius,
        "lines_per_revolution": encoder.lines_per_revolution,
        "counts_per_line": encoder.counts_per_line,
        "noise": encoder.noise,
        "heads": {
            letter: {"azimuth": azimuth} | angle_rows(stage.response(f"head_{letter}"))
            for letter, azimuth in encoder.azimuths.items()
        },
        "eccentricity": list(encoder.eccentricity),
        "graduation": [{"order": row.order, "cos": row.cos, "sin": row.sin} for row in encoder.graduation],
    }


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
        try:
            effect = effect_named(str(row["effect"]), effects)
            found.append(Cause(effect, str(row.get("location") or ""), effect.values_from(row["parameters"])))
        except InputError as error:
            raise InputError(f"{origin}: effects, row {number}: {error}") from error
    return tuple(found)


def _rows(rows: Sequence[PlanarHarmonic]) -> list[dict[str, Any]]:
    return [{"order": row.order, "x": list(row.x), "y": list(row.y)} for row in rows]
