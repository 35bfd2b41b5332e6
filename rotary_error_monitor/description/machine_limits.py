"""What a machine's thermometer can show: readings that say otherwise are doubted, not believed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

FASTEST = {"linear": 2.0, "rotary": 60.0}
"""Speed of an axis where the file states none, m/s and rad/s: what the fastest machining centres reach."""

QUICKEST = {"linear": 20.0, "rotary": 1000.0}
"""Acceleration of an axis where the file states none, m/s² and rad/s²: what linear motors and torque motors reach."""


@dataclass(frozen=True)
class MachineLimits:
    """Limits of a machine's temperature; a machine file may state each of them (section `limits`).

    Attributes:
        temperature: lowest and highest that a machine shop has, °C.
        temperature_rate: fastest change of a body of iron, K/s.
        temperature_age: how old a temperature may become before it counts as uncertain, s.
    """

    temperature: tuple[float, float] = (5.0, 45.0)
    temperature_rate: float = 0.5
    temperature_age: float = 10.0


def limits_from_mapping(section: Mapping[str, Any]) -> MachineLimits:
    """Limits with what a section `limits` states."""
    given: dict[str, Any] = {name: float(value) for name, value in section.items() if name != "temperature"}
    if "temperature" in section:
        low, high = section["temperature"]
        given["temperature"] = float(low), float(high)
    return replace(MachineLimits(), **given)


def limits_mapping(limits: MachineLimits) -> dict[str, Any]:
    """The section `limits` again; empty where nothing differs from the defaults."""
    if limits == MachineLimits():
        return {}
    return {
        "temperature": list(limits.temperature),
        "temperature_rate": limits.temperature_rate,
        "temperature_age": limits.temperature_age,
    }
