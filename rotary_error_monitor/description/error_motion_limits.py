"""Limits of a stage's error motion values: what it must keep to be good, in a file or on the command line."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from rotary_error_monitor.description.expected import Expected
from rotary_error_monitor.description.sections import from_content, read, stated
from rotary_error_monitor.description.yaml_files import read_yaml
from rotary_error_monitor.errors import InputError, excerpt
from rotary_error_monitor.units import ANGLE_UNITS, MICRO, without_rounding_error

SECTION = "error_motion_limits"
"""Key of the section in a file, beside `stage` or alone."""

UNITS: Mapping[str, tuple[str, float]] = {
    "nm": ("m", 1e9),
    "um": ("m", MICRO),
    "nrad": ("rad", 1e9),
    **{name: ("rad", ANGLE_UNITS[name]) for name in ("urad", "arcsec")},
}
"""Units of a limit on the command line: SI unit, and how many there are in it."""

Length = Annotated[float, Expected("largest value in m, at most 10 mm", above=0, most=0.01)]
Angle = Annotated[float, Expected("largest value in rad, at most 10 mrad", above=0, most=0.01)]


@dataclass(frozen=True)
class ErrorMotionLimits:
    """Largest error motion values (ISO 230-7), for all directions, speeds and heights that are analysed."""

    radial_total: Length | None = None
    radial_synchronous: Length | None = None
    radial_asynchronous: Length | None = None
    tilt_total: Angle | None = None
    tilt_synchronous: Angle | None = None
    tilt_asynchronous: Angle | None = None
    tilt_fundamental: Angle | None = None
    tilt_residual_synchronous: Angle | None = None
    axial_total: Length | None = None
    axial_synchronous: Length | None = None
    axial_asynchronous: Length | None = None
    axial_fundamental: Length | None = None
    axial_residual_synchronous: Length | None = None

    @property
    def stated(self) -> Mapping[str, float]:
        """Those that are stated, by name, m or rad."""
        return stated(self)


def limits_from_file(path: Path | str, *, needed: bool = True) -> ErrorMotionLimits:
    """Limits of the section `error_motion_limits` of a YAML file; none where it lacks the section and need not have it.

    Raises:
        InputError: the file cannot be read, or states what is out of range; the message names file, line and value.
    """
    found = read_yaml(Path(path))
    if not needed and (not isinstance(found.content, Mapping) or SECTION not in found.content):
        return ErrorMotionLimits()
    return read(ErrorMotionLimits, found, (SECTION,), SECTION)


def limits_of(words: Sequence[str], twin: Path | None, origin: str = "--limits") -> ErrorMotionLimits:
    """Limits of words as `limits_from_words`, or of the file that the only word names; without words, of the twin's.

    Raises:
        InputError: as `limits_from_words` and `limits_from_file`.
    """
    if not words:
        return ErrorMotionLimits() if twin is None else limits_from_file(twin, needed=False)
    if len(words) == 1 and "=" not in words[0]:
        return limits_from_file(words[0])
    return limits_from_words(words, origin)


def limits_from_words(words: Iterable[str], origin: str = "--limits") -> ErrorMotionLimits:
    """Limits from words such as `radial_synchronous_um=2`, the unit (one of `UNITS`) at the end of the name.

    Args:
        words: of the limits.
        origin: where they stand, for messages.

    Raises:
        InputError: a word is no limit; the message says what is one.
    """
    content: dict[str, float] = {}
    known = list(ErrorMotionLimits.__dataclass_fields__)
    for word in words:
        name, _, text = word.partition("=")
        figure, _, unit = name.rpartition("_")
        size = UNITS.get(unit, ("", 1.0))
        right = "rad" if figure.startswith("tilt") else "m"
        try:
            value = float(text)
        except ValueError:
            value = 0.0
        if figure not in known or size[0] != right or not value > 0:
            raise InputError(
                f"{origin} {excerpt(word)}: expected NAME_UNIT=NUMBER above 0, such as radial_synchronous_um=2 or "
                f"tilt_total_urad=50; names: {', '.join(known)}; units: nm, um for lengths, nrad, urad, arcsec for tilt"
            )
        if figure in content:
            raise InputError(f"{origin} {excerpt(word)}: {figure} is stated twice; state it once")
        content[figure] = without_rounding_error(value / size[1])
    return from_content(ErrorMotionLimits, content, origin)
