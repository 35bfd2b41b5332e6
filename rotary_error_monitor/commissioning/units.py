"""In which unit, and in which direction, a stream tells an angle: from how fast it moves beside the others."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.units import ANGLE_UNITS

CLOSE = 0.02
"""Part by which a ratio of speeds may differ from that of two units: units differ by a tenth at least, and two streams
that show one rotation by far less than this."""

JUMP = 20.0
"""Times the usual largest step between two samples beyond which a step is no motion but a wrap."""

STEP = 0.02
"""Time between the values of which speeds are made, s: slow beside any rate of samples, brief beside any move."""


@dataclass(frozen=True)
class AngleUnit:
    """A unit of an angle: `size` is the reading that one radian gives, `words` complete "it reads …".

    Attributes:
        name: of those in `ANGLE_UNITS` as a parameter of a source calls it.
    """

    name: str
    size: float
    words: str


RADIAN = AngleUnit("rad", 1.0, "radians")

_WORDS = {
    "rad": RADIAN.words,
    "deg": "degrees",
    "turn": "turns",
    "gon": "gon",
    "mrad": "mrad",
    "urad": "µrad",
    "arcmin": "arc minutes",
    "arcsec": "arc seconds",
}


def angle_units(resolution: float) -> tuple[AngleUnit, ...]:
    """The units in which drivers tell angles, the right one first; `resolution` is one count in rad."""
    return (
        *(AngleUnit(name, size, _WORDS[name]) for name, size in ANGLE_UNITS.items()),
        AngleUnit("count", 1 / resolution, "counts"),
        *(
            AngleUnit(
                f"{factor:g} rad", factor, f"{factor:g} times the angle, as with a wrong number of counts per line"
            )
            for factor in (2.0, 0.5, 4.0, 0.25)
        ),
    )


def tilt_units() -> tuple[AngleUnit, ...]:
    """The units in which drivers of autocollimators tell tilts, the right one first."""
    return tuple(unit for unit in angle_units(1.0) if unit.name in ("rad", "deg", "mrad", "urad", "arcmin", "arcsec"))


def closest(size: float, units: Iterable[AngleUnit]) -> AngleUnit | None:
    """The unit of that size; None where none is within `CLOSE`."""
    return next((unit for unit in units if abs(size / unit.size - 1) < CLOSE), None)


def unwrapped(values: Array, units: Iterable[AngleUnit]) -> tuple[Array, AngleUnit | None]:
    """Readings (n,) that start again after a turn carried on, and the unit that this turn is of; None where none do.

    What jumps by something else than a turn of one of the units stays as it is.
    """
    steps = np.diff(values)
    usual = float(np.quantile(np.abs(steps), 0.99)) if len(steps) else 0.0
    around = np.convolve(steps, [1.0, 0.0, 1.0], mode="same")
    # a wrap goes against the motion, a jump over lost samples along it
    jumps = (np.abs(steps) > JUMP * usual) & (steps * around < 0)
    if usual == 0.0 or not jumps.any():
        return values, None
    # it is off the turn by how far the stage moved meanwhile, which is more where samples are lost as well
    sizes = np.abs(steps[jumps])
    unit = closest(float(np.median(sizes[sizes > sizes.max() / 2])) / (2 * math.pi), units)
    if unit is None:
        return values, None
    jumps &= np.abs(steps) > math.pi * unit.size
    turns = np.concatenate([[0.0], np.cumsum(np.where(jumps, -np.sign(steps), 0.0))])
    return np.asarray(values + turns * 2 * math.pi * unit.size), unit


@dataclass(frozen=True)
class Speeds:
    """Speeds of several streams at common times.

    Attributes:
        values: (m,) of each, in its own unit per s.
        ratio: of each to the first, by least squares.
        still: names of those that do not move while the others do.
    """

    values: Mapping[str, Array]
    ratio: Mapping[str, float]
    still: tuple[str, ...]


def compare_speeds(streams: Mapping[str, tuple[NDArray[np.int64], Array]]) -> Speeds:
    """Speeds of streams of times (n,) ns and continuous readings (n,), over the time that they have in common."""
    first = max(int(times[0]) for times, _ in streams.values())
    last = min(int(times[-1]) for times, _ in streams.values())
    grid = np.arange(first, max(last, first + 1), round(STEP * 1e9), dtype=np.int64)
    speeds: dict[str, Array] = {}
    for name, (times, values) in streams.items():
        at = np.interp((grid - first) * 1e-9, (times - first) * 1e-9, values - values[0])
        speeds[name] = np.diff(at) / STEP
    reference = _liveliest(speeds)
    along = speeds[reference]
    square = float(along @ along)
    ratio = {name: float(each @ along) / square if square else 0.0 for name, each in speeds.items()}
    still = tuple(name for name, each in speeds.items() if not _follows(each, along))
    return Speeds(speeds, ratio, still)


def _liveliest(speeds: Mapping[str, Array]) -> str:
    """The stream that most others follow, the first of several: one that is stuck or broken must not be the measure."""
    names = list(speeds)
    return max(names, key=lambda name: sum(_follows(speeds[other], speeds[name]) for other in names))


def _follows(speed: Array, other: Array) -> bool:
    """Whether two speeds are, up to a factor, the same motion."""
    sizes = float(np.linalg.norm(speed) * np.linalg.norm(other))
    return sizes > 0 and abs(float(speed @ other)) > 0.9 * sizes


def common_units(ratio: Sequence[float], units: Sequence[AngleUnit]) -> list[tuple[AngleUnit, list[AngleUnit | None]]]:
    """For each unit that the first of some streams may have, the units of all by the ratios (n,) of their speeds.

    Those come first in which more of the streams have the right unit; a stream whose ratio fits none has None.
    """
    found = []
    for unit in units:
        all_of = [closest(abs(each / ratio[0]) * unit.size, units) for each in ratio]
        found.append((unit, all_of))
    return sorted(found, key=lambda pair: -sum(each == units[0] for each in pair[1]))
