"""A setting that people give to a node or a device: its default, unit, range and meaning, apart from ROS."""

from __future__ import annotations

import math
from array import array
from collections.abc import Iterable
from dataclasses import dataclass

from rotary_error_monitor.errors import InputError

Value = bool | int | float | str | list[int] | list[float]

_KINDS = {
    bool: "true or false",
    int: "a whole number",
    float: "a number with a point, such as 5.0",
    str: "a text",
    list: "a list",
}


@dataclass(frozen=True)
class Setting:
    """One parameter of a node.

    Attributes:
        default: value without an override; its type is the parameter's type.
        meaning: what it does, with its unit.
        bounds: smallest and largest value, for numbers; of a list, of each.
        choices: the values allowed, for text; empty where any text will do.
        at_start: given at the start or never, for what runs programs: who may set parameters shall not run any.
        required: of a text that has no default: empty says that nobody has given it, and no node configures so.
        hint: what to give for one that is required, where the choices alone do not tell.
    """

    name: str
    default: Value
    meaning: str
    bounds: tuple[float, float] | None = None
    choices: tuple[str, ...] = ()
    at_start: bool = False
    required: bool = False
    hint: str = ""

    @property
    def expected(self) -> str:
        """What a right value looks like, in words."""
        kind = _KINDS[type(self.default)]
        if self.bounds is not None and isinstance(self.default, list):
            kind = f"a list of numbers with a point, each from {self.bounds[0]:g} to {self.bounds[1]:g}, such as [5.0]"
        elif self.bounds is not None:
            kind += f", from {self.bounds[0]:g} to {self.bounds[1]:g}"
        if self.choices:
            kind = f"one of {', '.join(self.choices)}"
        return f"{self.meaning} ({kind})"

    def check_itself(self) -> None:
        """Hold what was declared against itself.

        Raises:
            InputError: the default is of no type that a parameter may have, or not within the bounds or choices.
        """
        where = f"setting '{self.name}'"
        if type(self.default) not in _KINDS:
            raise InputError(f"{where}: default {self.default!r}; expected {', '.join(_KINDS.values())}")
        self.check(self.default, where)
        inside = self.bounds is None or all(self.bounds[0] <= x <= self.bounds[1] for x in _numbers(self.default))
        if not inside:
            raise InputError(f"{where}: default {self.default!r}; expected: {self.expected}")

    def check(self, value: object, where: str) -> None:
        """Hold a value against choices, finiteness, and the bounds of a list, which a descriptor of ROS cannot express.

        Raises:
            InputError: naming parameter, value and what is expected.
        """
        finite = all(math.isfinite(number) for number in _numbers(value))
        lacking = self.required and value == ""
        if isinstance(self.default, list) and self.bounds is not None:
            finite = finite and all(self.bounds[0] <= number <= self.bounds[1] for number in _numbers(value))
        if not finite or (self.choices and value not in self.choices and not lacking):
            raise InputError(f"{where}: parameter '{self.name}' is {value!r}; expected: {self.expected}")

    def check_given(self, value: object, where: str) -> None:
        """Refuse that nobody has given a value that is required.

        Raises:
            InputError: naming the parameter and what to give.
        """
        if self.required and value == "":
            raise InputError(f"{where}: parameter '{self.name}' is not given; expected: {self.hint or self.expected}")


def _numbers(value: object) -> Iterable[float]:
    values = value if isinstance(value, list | tuple | array) else [value]  # rclpy makes arrays of lists of numbers
    return (number for number in values if isinstance(number, int | float))
