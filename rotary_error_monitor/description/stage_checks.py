"""What a schema cannot say of a stage description: whether its parts fit one another."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from rotary_error_monitor.description.listed_sensors import is_input, quantity

Place = list[str | int]

PARAMETERS: Mapping[str, tuple[str, ...]] = {
    "encoder": (
        "disc_radius",
        "lines_per_revolution",
        "counts_per_line",
        "noise",
        "azimuth",
        "eccentricity",
        "graduation",
        "timing",
    ),
    "mirror": ("tilt", "flatness"),
    "autocollimator": ("range", "resolution", "noise"),
    "spindle": ("radial", "axial", "tilt", "radial_compliance", "tilt_compliance", "radial_thermal"),
    "lvdt": ("height", "noise", "artefact_eccentricity"),
    "command": ("timing",),
}
"""What the section `uncertainty` may name of each section, whether a stage has that section or not."""

MOST_STREAMS = 51
"""Heads and listed sensors but inputs: with autocollimator and command as many bits as a float64, in which masks
travel, holds."""

_NO_PLACE = ("kind", "noise", "resolution", "range", "uncertainty", "zero", "form", "latency")
"""Of a listed sensor: what is no number that moves its reading, and what its own `uncertainty` is of."""


def contradictions(section: Mapping[str, Any]) -> Iterator[tuple[Place, str]]:
    """Where a section that is valid by the schema contradicts itself, and what would be right."""
    heads, sensors = section.get("encoder", {}).get("heads", {}), section.get("sensors", {})
    poses = [name for name, sensor in sensors.items() if not is_input(sensor["kind"])]
    if not (heads or poses or "autocollimator" in section):
        yield [], "nothing measures the rotor; expected a section 'encoder', 'autocollimator' or 'sensors'"
    if len(heads) + len(poses) > MOST_STREAMS:
        yield (
            ["sensors"],
            f"{len(poses)} sensors beside {len(heads)} heads; a mask of streams has place for {MOST_STREAMS} of both",
        )
    for name, sensor in sensors.items():
        for limit in ("resolution", "zero"):
            said = sensor.get(limit, 0.0)
            if max(map(abs, said if isinstance(said, list) else [said])) >= sensor["range"]:
                _, unit = quantity(sensor["kind"])
                yield ["sensors", name, limit], f"{said} is beyond the range of {sensor['range']} {unit}"
    for part in ("uncertainty", "calibration"):
        for name in section.get(part, {}):
            if "encoder" not in section and name.partition(".")[0] == "encoder":
                yield [part, name], "the stage has no section 'encoder'; expected that section, or nothing about it"
    for name in section.get("uncertainty", {}):
        part, _, parameter = name.rpartition(".")
        known = _parameters(section, part)
        if not known:
            listed = [f"sensors.{each}" for each in poses]
            yield (
                ["uncertainty", name],
                f"there is no part '{part}'; expected one of {', '.join([*PARAMETERS, *listed])}",
            )
        elif parameter not in known:
            yield ["uncertainty", name], f"{part} has no '{parameter}'; expected one of {', '.join(known)}"


def _parameters(section: Mapping[str, Any], part: str) -> tuple[str, ...]:
    """What may be uncertain of one part of a stage; nothing where there is no such part."""
    head, _, listed = part.partition(".")
    if head != "sensors":
        return PARAMETERS.get(part, ())
    sensor = section.get("sensors", {}).get(listed)
    if sensor is None or is_input(sensor["kind"]):
        return ()
    return ("gain", *(name for name in sensor if name not in (*_NO_PLACE, "gain")))
