"""Parameters of the nodes: each with its default, unit, range and meaning, and errors that say what would be right."""

from __future__ import annotations

import difflib
import math
from array import array
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, TypeAlias

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node

from rotary_error_monitor.errors import InputError
from rotary_error_monitor.sources.mock import MockSettings

ParameterValue: TypeAlias = Any
"""Value of a parameter; which type, its declaration says."""

Value = bool | int | float | str | list[int] | list[float]

_KINDS = {
    bool: "true or false",
    int: "a whole number",
    float: "a number with a point, such as 5.0",
    str: "a text",
    list: "a list",
}
_OF_EVERY_NODE = ("use_sim_time", "start_type_description_service")
_QOS = "qos_overrides."


@dataclass(frozen=True)
class Setting:
    """One parameter of a node.

    Attributes:
        default: value without an override; its type is the parameter's type.
        meaning: what it does, with its unit.
        bounds: smallest and largest value, for numbers.
        choices: the values allowed, for text; empty where any text will do.
        at_start: given at the start or never, for what runs programs: who may set parameters shall not run any.
    """

    name: str
    default: Value
    meaning: str
    bounds: tuple[float, float] | None = None
    choices: tuple[str, ...] = ()
    at_start: bool = False

    @property
    def expected(self) -> str:
        """What a right value looks like, in words."""
        kind = _KINDS[type(self.default)]
        if self.bounds is not None:
            kind += f", from {self.bounds[0]:g} to {self.bounds[1]:g}"
        if self.choices:
            kind = f"one of {', '.join(self.choices)}"
        return f"{self.meaning} ({kind})"

    def descriptor(self) -> ParameterDescriptor:
        """The description that `ros2 param describe` shows and rclpy holds values against."""
        descriptor = ParameterDescriptor(name=self.name, description=self.expected, read_only=self.at_start)
        if self.bounds is None:
            return descriptor
        low, high = self.bounds
        if isinstance(self.default, float):
            descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high, step=0.0)]
        else:
            descriptor.integer_range = [IntegerRange(from_value=int(low), to_value=int(high), step=1)]
        return descriptor

    def check(self, value: object, where: str) -> None:
        """Hold a value against choices and finiteness, which a descriptor cannot express.

        Raises:
            InputError: naming parameter, value and what is expected.
        """
        finite = all(math.isfinite(number) for number in _numbers(value))
        if not finite or (self.choices and value not in self.choices):
            raise InputError(f"{where}: parameter '{self.name}' is {value!r}; expected: {self.expected}")


def _numbers(value: object) -> Iterable[float]:
    values = value if isinstance(value, list | tuple | array) else [value]  # rclpy makes arrays of lists of numbers
    return (number for number in values if isinstance(number, float))


# What all processes of a cell share; a wildcard section of a parameter file may give these to every node.
CELL_SETTINGS = (
    Setting("stage", "", "YAML file of the rotary stage; empty for the embedded config/stage.yaml"),
    Setting("machine", "", "YAML file of the machine, or the name of one in config/machines; empty for none"),
    Setting("block_period", 0.005, "time covered by one sample block, s", (0.0005, 1.0)),
    Setting("mock.seed", 1, "seed of the mock stage, the same in every process of a cell", (0, 2**31 - 1)),
    Setting(
        "mock.epoch",
        0,
        "instant at which the mock stage starts, ns since 1970, the same in every process; "
        "0 for the last midnight (UTC)",
        (0, 2**62),
    ),
    Setting("mock.speeds", [1.5707963267948966, 6.283185307179586], "speeds of a cycle of the mock stage, rad/s"),
    Setting("mock.forces", True, "whether something pushes at the mock stage's shaft now and then"),
    Setting(
        "mock.force_cycle",
        MockSettings.force_cycle,
        "time after which the pushes at the mock stage repeat, s",
        (7.0, 3600.0),
    ),
)


def cell_settings(*names: str) -> tuple[Setting, ...]:
    """Some of the settings that the nodes of a cell share; a name ending in `.` takes all that begin so."""
    return tuple(
        s for s in CELL_SETTINGS if any(s.name.startswith(n) if n.endswith(".") else s.name == n for n in names)
    )


def declare(node: Node, settings: Iterable[Setting]) -> None:
    """Declare `settings` on the node, so that overrides from the command line or a file take effect.

    Raises:
        InputError: an override has the wrong type, is out of range, or no such parameter exists.
    """
    settings = tuple(settings)
    check_known(node, [setting.name for setting in settings], opened=False)
    where = node.get_fully_qualified_name()
    for setting in settings:
        try:
            value = node.declare_parameter(setting.name, setting.default, setting.descriptor()).value
        except (InvalidParameterTypeException, InvalidParameterValueException) as error:
            wrong = _overrides(node)[setting.name].value
            raise InputError(
                f"{where}: parameter '{setting.name}' is {wrong!r}; expected: {setting.expected}"
            ) from error
        setting.check(value, where)


def check_known(node: Node, names: Iterable[str], *, opened: bool) -> None:
    """Refuse overrides of parameters that do not exist; rclpy would drop a misspelt name in silence.

    Args:
        node: that the overrides are for.
        names: of its parameters.
        opened: whether its publishers and subscriptions are there; before, overrides of their QoS cannot be judged.

    Raises:
        InputError: naming the override and the closest names.
    """
    known = [*names, *_OF_EVERY_NODE, *(setting.name for setting in CELL_SETTINGS)]
    for name in _overrides(node):
        if name not in known and (opened or not name.startswith(_QOS)):
            close = difflib.get_close_matches(name, known, n=3) or sorted(known)
            raise InputError(
                f"{node.get_fully_qualified_name()}: no parameter '{name}'; did you mean: {', '.join(close)}"
            )


def _overrides(node: Node) -> Mapping[str, Any]:
    # rclpy has no public way to ask for overrides of parameters that are not declared.
    return node._parameter_overrides
