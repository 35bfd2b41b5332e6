"""Names and values of an analysis as people read them."""

from __future__ import annotations

import re
from collections.abc import Sequence

from rotary_error_monitor.effects.effect import ParameterEstimate
from rotary_error_monitor.gap.quantities import quantity
from rotary_error_monitor.metrology.spindle_figures import ErrorMotionValue

_HEIGHT = re.compile(r"(?<=\d)mm\b")
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def spoken(name: str) -> str:
    """Name of a signal or figure in words: `radial_x_at_60mm.drift` is `radial x at 60 mm: drift`."""
    return _HEIGHT.sub(" mm", name.replace("_", " ").replace(".", ": "))


def counted(number: int, what: str) -> str:
    """So many of something: `1 stage`, `2 stages`."""
    return f"{number} {what}{'' if number == 1 else 's'}"


def aligned(lines: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a table for a terminal, each column as wide as it must be."""
    widths = [max(map(len, column)) for column in zip(*lines, strict=True)]
    return ["  ".join(map(str.ljust, line, widths)).rstrip() for line in lines]


def power_of_ten(exponent: int) -> str:
    """A power of ten as it is written by hand, such as `10⁻⁶`."""
    return "10" + f"{exponent}".translate(_RAISED)


def amount(value: ErrorMotionValue, unit: str) -> str:
    """Value and expanded uncertainty, such as `1.72 ± 0.05 µm`."""
    return with_unit(value.value, unit, value.expanded)


def with_unit(value: float, unit: str, uncertainty: float = 0.0) -> str:
    """A value of an SI unit with the prefix that suits it, and its uncertainty, where there is one."""
    return quantity(ParameterEstimate(value, uncertainty), unit)
