"""Whether the class of an effect says what an effect must say: names, and sizes that a fit can use."""

from __future__ import annotations

import math

from rotary_error_monitor.effects.effect import AnyEffect, Parameter
from rotary_error_monitor.errors import InputError, excerpt


def check_definition(item: type[AnyEffect], origin: str) -> None:
    """Refuse an effect whose name or parameters cannot be used.

    Args:
        item: its class.
        origin: file or plug-in that it is of, for messages.

    Raises:
        InputError: the name is no identifier, there are no parameters, two share a name, or a size or bound is none.
    """
    # What a user's class holds may be of any type, whatever is declared.
    name: object = item.name
    rows: object = item.parameters
    if not (isinstance(name, str) and name.isidentifier()):
        raise InputError(f"{origin}: name {excerpt(repr(name))} of an effect; expected letters, digits and underscores")
    if not rows:
        raise InputError(f"{origin}: effect '{name}' has no parameters; what shall be fitted?")
    if not (isinstance(rows, (tuple, list)) and all(isinstance(row, Parameter) for row in rows)):
        raise InputError(
            f"{origin}: effect '{name}': parameters are {excerpt(repr(rows))}; expected a tuple of Parameter"
        )
    names = [row.name for row in rows]
    if len(set(names)) < len(names):
        raise InputError(
            f"{origin}: effect '{name}': parameters {', '.join(map(str, names))}; expected different names"
        )
    for row in rows:
        _check_parameter(row, f"{origin}: effect '{name}', parameter '{row.name}'")


def _check_parameter(row: Parameter, where: str) -> None:
    if not (isinstance(row.size, int) and row.size >= 1):
        raise InputError(f"{where}: size is {row.size!r}; expected how many components it has, 1 or more")
    if not (_is_number(row.scale) and 0 < row.scale < math.inf):
        raise InputError(f"{where}: scale is {row.scale!r}; expected its usual size, a finite number above 0")
    if not (_is_number(row.bound) and row.bound > 0):
        raise InputError(f"{where}: bound is {row.bound!r}; expected the largest sensible magnitude, above 0")
    if row.least is not None and not (_is_number(row.least) and row.least < row.bound):
        raise InputError(f"{where}: least is {row.least!r}; expected a number below the bound {row.bound:g}")


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not math.isnan(value)
