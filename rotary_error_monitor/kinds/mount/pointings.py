"""Pointing files of telescope mounts, in the plain format that pointing analysis programs exchange.

Lines that begin with `!` or a letter are remarks, lines that begin with `:` are options (`:EQUAT`, `:NODA`). The first
line that begins with a sign or digit tells of the site:

    latitude (d m s)  date (y m d)  temperature °C  pressure hPa  height m  humidity 0-1  wavelength µm  lapse rate K/m

and each line after it is one pointing:

    star's right ascension (h m s) and declination (d m s), the mount's (h m s, d m s), sidereal time (h m)

The star's place is that of the day, without refraction. The mount's is what its axes read: a declination beyond 90°
means the other side of the pier.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.errors import InputError, excerpt
from rotary_error_monitor.files import MOST_LINES, lines_of, read_text
from rotary_error_monitor.kinds.mount.refraction import Weather
from rotary_error_monitor.kinds.mount.twin import FEWEST_POINTINGS, MountRecording

SIDEREAL_SECOND = 0.9972696
"""Seconds of time in a second of sidereal time."""

_SITE, _POINTING = 12, 14
_WEATHER = (
    (6, "temperature in °C", -90.0, 60.0),
    (7, "pressure in hPa, 0 where refraction is taken out", 0.0, 1100.0),
    (9, "relative humidity", 0.0, 1.0),
    (10, "wavelength in µm", 0.2, 20.0),
)
"""Fields of the site that refraction is told by, with what is possible on Earth."""
_SUPPORTED = {":EQUAT", ":NODA"}


def read_pointings(path: Path) -> MountRecording:
    """Recording of a mount from a pointing file.

    Raises:
        InputError: the file cannot be read, a line has too few fields or a wrong value, or there are too few lines.
    """
    return parse_pointings(read_text(path, "a pointing file", most_lines=MOST_LINES), str(path))


def parse_pointings(text: str, origin: str) -> MountRecording:
    """Recording of a mount from the content of a pointing file; `origin` names it in messages.

    Raises:
        InputError: as `read_pointings`.
    """
    site: list[float] | None = None
    latitude, rows = 0.0, []
    for number, line in enumerate(lines_of(text), start=1):
        place, words = f"{origin}:{number}", line.split()
        if not words or (site is None and not (words[0][0] in "+-" or words[0][0].isdigit())):
            _check_option(words, place)
        elif site is None:
            site = _numbers(words, _SITE, place, "the site (latitude d m s, date y m d, temperature, pressure, …)")
            _check_weather(site, place)
            latitude = np.radians(_in_range(_angle(words[:3], place), 90.0, words[:3], place, "latitude"))
        else:
            rows.append(_pointing(words, place))
    if site is None:
        raise InputError(f"{origin}: no line of the site; it begins with the latitude in d m s")
    if len(rows) < FEWEST_POINTINGS:
        raise InputError(f"{origin}: {len(rows)} pointings; at least {FEWEST_POINTINGS} are needed")
    different = len(set(rows))
    if different < FEWEST_POINTINGS:
        raise InputError(
            f"{origin}: {different} of {len(rows)} pointings differ from one another; at least {FEWEST_POINTINGS} must"
        )
    return _recording(np.array(rows), float(latitude), site)


def _without_jumps(angles: Array) -> Array:
    """Angles cut where none stands for longest: no axis goes through the place where its cables end."""
    turned = np.mod(angles, 2 * np.pi)
    rising = np.sort(turned)
    gaps = np.diff(rising, append=rising[0] + 2 * np.pi)
    cut = rising[int(np.argmax(gaps))]
    found = np.where(turned > cut, turned - 2 * np.pi, turned)
    return np.asarray(found - 2 * np.pi * np.round(np.mean(found) / (2 * np.pi)), np.float64)


def _check_option(words: Sequence[str], place: str) -> None:
    if words and words[0].startswith(":") and words[0].upper() not in _SUPPORTED:
        raise InputError(
            f"{place}: option {excerpt(words[0])}; only equatorial mounts are known ({', '.join(sorted(_SUPPORTED))})"
        )


def _check_weather(site: Sequence[float], place: str) -> None:
    for field, what, low, high in _WEATHER:
        if not low <= site[field] <= high:
            raise InputError(
                f"{place}: {site[field]:g} in field {field + 1} of the site; expected the {what}, {low:g} to {high:g}"
            )


def _pointing(words: Sequence[str], place: str) -> tuple[float, ...]:
    _numbers(words, _POINTING, place, "a pointing (right ascension, declination, both of the mount, sidereal time)")
    star = _in_range(_angle(words[3:6], place), 90.0, words[3:6], place, "declination of the star")
    mount = _in_range(_angle(words[9:12], place), 360.0, words[9:12], place, "declination of the mount")
    hours = (_angle(words[:3], place), _angle(words[6:9], place), _angle(words[12:14], place))
    ascension, read, sidereal = (_in_range(h, 24.0, words, place, "a right ascension or time") for h in hours)
    return ascension, star, read, mount, sidereal


def _recording(rows: Array, latitude: float, site: Sequence[float]) -> MountRecording:
    ascension, star, read, declination, sidereal = rows.T
    sidereal = np.unwrap(sidereal, period=24.0)
    readings = np.radians(np.stack([15 * (sidereal - read), declination], axis=1))
    readings = np.stack([_without_jumps(column) for column in readings.T], axis=1)
    moved = np.diff(readings, axis=0, prepend=readings[:1])
    stars = np.radians(np.stack([15 * (sidereal - ascension), star], axis=1))
    weather = Weather(temperature=site[6], pressure=site[7], humidity=site[9], wavelength=site[10])
    time = 3600 * SIDEREAL_SECOND * sidereal
    return MountRecording(readings, np.sign(moved), stars, time, latitude, weather)


def _numbers(words: Sequence[str], count: int, place: str, what: str) -> list[float]:
    if len(words) != count:
        raise InputError(f"{place}: {len(words)} fields; {what} has {count}")
    values = []
    for word in words:
        try:
            values.append(float(word))
        except ValueError as error:
            raise InputError(f"{place}: '{excerpt(word)}' is no number; {what} has {count} numbers") from error
    if not np.isfinite(values).all():
        raise InputError(f"{place}: {excerpt(' '.join(words))}: expected finite numbers")
    return values


def _angle(words: Sequence[str], place: str) -> float:
    """Degrees or hours from whole, minutes and seconds; the sign of -0 counts."""
    for word, unit in zip(words[1:], ("minutes", "seconds"), strict=False):
        if not 0 <= float(word) <= 60:  # programs that round write 60 at times
            raise InputError(f"{place}: {excerpt(word)} in {excerpt(' '.join(words))}; expected {unit} from 0 to 60")
    size = sum(abs(float(word)) / 60**power for power, word in enumerate(words))
    return float(-size if words[0].startswith("-") else size)


def _in_range(value: float, limit: float, words: Sequence[str], place: str, what: str) -> float:
    if abs(value) > limit:
        raise InputError(f"{place}: {excerpt(' '.join(words))} as {what}; expected at most {limit:g}")
    return value
