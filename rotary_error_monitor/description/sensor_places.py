"""Sensors of one kind at one place: two bodies cannot stand there, and would show the same but for their noise."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Protocol

from rotary_error_monitor.description.listed_sensors import listed_sensor
from rotary_error_monitor.description.sections import Place
from rotary_error_monitor.description.sensor_section import PROBE_WIDTH, SensorSection

HEAD_WIDTH = 4e-3
"""Width, m, below which there is no read head: the packages of the smallest encoder chips. Heads with a housing are 10
to 35 mm wide, but a file does not say of which make its heads are."""


class OnRing(Protocol):
    """A read head."""

    @property
    def azimuth(self) -> float:
        """Angle about +z, rad."""


def least_angle(radius: float) -> float:
    """Angle, rad, between two heads whose fronts, `HEAD_WIDTH` wide, touch side by side at a ring of a radius, m."""
    return 2 * math.atan2(HEAD_WIDTH / 2, radius)


def heads_at_one_place(heads: Mapping[str, OnRing], radius: float) -> Iterator[tuple[Place, str]]:
    """Places in the section `encoder` of heads that stand where another one does, and what would be right."""
    least, seen = least_angle(radius), dict[str, float]()
    for letter, head in heads.items():
        for other, azimuth in seen.items():
            if abs(math.remainder(head.azimuth - azimuth, 2 * math.pi)) < least:
                yield (
                    ("heads", letter, "azimuth"),
                    f"{head.azimuth} is where head '{other}' stands ({azimuth}); expected {_upwards(least)} rad or "
                    f"more between them: heads are {HEAD_WIDTH * 1e3:g} mm wide or more (radius {radius:g} m)",
                )
        seen[letter] = head.azimuth


def sensors_at_one_place(sensors: Mapping[str, SensorSection]) -> Iterator[tuple[Place, str]]:
    """Places in the list `sensors` of those that stand where another of their kind does, and what would be right."""
    seen: dict[str, SensorSection] = {}
    for name, sensor in sensors.items():
        for other, before in seen.items():
            one, two = sensor.body, before.body
            if sensor.kind == before.kind and one and two and math.dist(one, two) < PROBE_WIDTH:
                yield (
                    (name,),
                    f"at {_told(sensor)} stands {sensor.kind} '{other}' ({_told(before)}); expected "
                    f"{PROBE_WIDTH * 1e3:g} mm or more between them{sensor.or_else}",
                )
        seen[name] = sensor


def _told(sensor: SensorSection) -> str:
    return ", ".join(f"{name} {round(value, 4) + 0.0:g}" for name, value in listed_sensor(sensor).place.items())


def _upwards(angle: float) -> float:
    """An angle in tenths of a mrad, so that what a message asks for is enough."""
    return math.ceil(angle * 1e4) / 1e4
