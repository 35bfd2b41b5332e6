"""Values with their uncertainty and unit, as people read them."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence

from rotary_error_monitor.effects.effect import ParameterEstimate

_PREFIXES = {0: "", -3: "m", -6: "µ", -9: "n", -12: "p"}
_PREFIXED = re.compile(r"(m|rad|s|N)(?![\w^])")
"""Units at the head of a compound that take a prefix; one with an exponent would raise the prefix as well."""

_WITHOUT = 4
"""Significant digits of a value without uncertainty."""

_OF_UNCERTAINTY = 2
"""Significant digits of an uncertainty (JCGM 100:2008, 7.2.6)."""

_PLAIN = range(-2, 6)
"""Powers of ten of numbers that are written out where no prefix goes with their unit."""


def quantity(estimate: ParameterEstimate, unit: str) -> str:
    """Value, standard uncertainty and unit, such as `1.7090 ± 0.0024 ms`; components of a vector share one unit.

    Args:
        estimate: in the SI unit; without uncertainty where its standard deviation is 0.
        unit: SI unit, such as `m/K`; `1` for a plain number, `m or rad` where either may be meant.
    """
    values = estimate.value if isinstance(estimate.value, tuple) else (estimate.value,)
    stds = estimate.std if isinstance(estimate.std, tuple) else (estimate.std,)
    power = _power(values, stds)
    alternatives = unit.split(" or ")
    if all(_PREFIXED.match(each) for each in alternatives):
        power = _within_prefixes(power)
        unit = " or ".join(_PREFIXES[power] + each for each in alternatives)
        factor = ""
    else:
        unit = "" if unit == "1" else unit
        power = 0 if power in _PLAIN else 3 * (power // 3)
        factor = f"e{power:+03d}" if power else ""
    parts = [_part(value / 10.0**power, std / 10.0**power) for value, std in zip(values, stds, strict=True)]
    whole = ", ".join(parts)
    if len(parts) > 1 or (factor and "±" in whole):
        whole = f"({whole})"
    return f"{whole}{factor} {unit}".strip()


def shared_power(values: Sequence[float], unit: str) -> tuple[str, int]:
    """Unit with the prefix that suits the largest of several values, and its power of ten, for a column of a table.

    Args:
        values: in the SI unit.
        unit: SI unit, such as `m`.
    """
    if not values or not _PREFIXED.match(unit):
        return unit, 0
    power = _within_prefixes(_power(values, (0.0,)))
    return _PREFIXES[power] + unit, power


def number(value: float, std: float, power: int = 0) -> str:
    """A value and its uncertainty (0 for none) over a power of ten, without unit, such as `1.72 ± 0.05`."""
    return _part(value / 10.0**power, std / 10.0**power)


def rounded(value: float, std: float, power: int = 0) -> str:
    """The same without the uncertainty, which only says how many digits there are."""
    return number(value, std, power).partition(" ±")[0]


def _within_prefixes(power: int) -> int:
    return max(min(_PREFIXES), min(0, 3 * (power // 3)))


def _power(values: Sequence[float], stds: Sequence[float]) -> int:
    """Power of ten of the largest value or uncertainty."""
    largest = max(max(map(abs, values)), max(stds))
    return math.floor(math.log10(largest)) if largest > 0.0 and math.isfinite(largest) else 0


def _part(value: float, std: float) -> str:
    if not std > 0.0:
        return f"{value:.{_WITHOUT}g}"
    decimals = _OF_UNCERTAINTY - 1 - math.floor(math.log10(std))
    shown = max(0, decimals)
    return f"{round(value, decimals) + 0.0:.{shown}f} ± {round(std, decimals):.{shown}f}"
