"""Parameters of the nodes: each with its default, unit, range and meaning, and errors that say what would be right."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, TypeAlias

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import Parameter

from rotary_error_monitor.description.listed_sensors import EXTERNAL_SENSORS
from rotary_error_monitor.description.settings import Setting
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.sources.mock import MOCK_SETTINGS

ParameterValue: TypeAlias = Any
"""Value of a parameter; which type, its declaration says."""

_OF_EVERY_NODE = ("use_sim_time", "start_type_description_service")
_QOS = "qos_overrides."
_TRUTH_WORDS = {False: ("n", "no", "off", "false"), True: ("y", "yes", "on", "true")}


def descriptor_of(setting: Setting) -> ParameterDescriptor:
    """The description that `ros2 param describe` shows and rclpy holds values against."""
    descriptor = ParameterDescriptor(name=setting.name, description=setting.expected, read_only=setting.at_start)
    if setting.bounds is None or isinstance(setting.default, list):
        return descriptor
    low, high = setting.bounds
    if isinstance(setting.default, float):
        descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high, step=0.0)]
    else:
        descriptor.integer_range = [IntegerRange(from_value=int(low), to_value=int(high), step=1)]
    return descriptor


# What all processes of a cell share; a wildcard section of a parameter file may give these to every node.
CELL_SETTINGS = (
    Setting("stage", "", "YAML file of the rotary stage; empty for the embedded config/stage.yaml"),
    Setting("machine", "", "YAML file of the machine, or the name of one in config/machines; empty for none"),
    Setting("block_period", 0.005, "time covered by one sample block, s", (0.0005, 1.0)),
    Setting(EXTERNAL_SENSORS, [], "sensors that the stage lists and that programs outside the cell's file publish"),
    *MOCK_SETTINGS,
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
            value = _declared(node, setting)
        except (InvalidParameterTypeException, InvalidParameterValueException) as error:
            wrong = _overrides(node)[setting.name].value
            raise InputError(
                f"{where}: parameter '{setting.name}' is {wrong!r}; expected: {setting.expected}"
            ) from error
        setting.check(value, where)


def _declared(node: Node, setting: Setting) -> ParameterValue:
    """Declare one setting; give its value. Of an empty list rclpy would guess that it is one of bytes."""
    given = _overrides(node).get(setting.name)
    if given is not None and (meant := _meant(setting, given.value)):
        return node.declare_parameter(setting.name, meant, descriptor_of(setting), ignore_override=True).value
    if setting.default != []:
        return node.declare_parameter(setting.name, setting.default, descriptor_of(setting)).value
    kind = Parameter.Type.DOUBLE_ARRAY
    value = node.declare_parameter(setting.name, kind, descriptor_of(setting)).value
    if value is None:
        node.set_parameters([Parameter(setting.name, kind, [])])
    return value or []


def _meant(setting: Setting, value: ParameterValue) -> str:
    """The choice that rcl read as a truth value: N, of newton, is false in YAML 1.1 where it has no quotes; or none."""
    words = _TRUTH_WORDS.get(value, ()) if isinstance(value, bool) else ()
    meant = [choice for choice in setting.choices if choice.lower() in words]
    return meant[0] if len(meant) == 1 else ""


def check_given(node: Node, settings: Iterable[Setting]) -> None:
    """Refuse that a parameter lacks which has no default.

    Raises:
        InputError: naming the parameter and what to give.
    """
    for setting in settings:
        setting.check_given(node.get_parameter(setting.name).value, node.get_fully_qualified_name())


def refusal(
    where: str, settings: Iterable[Setting], changed: Sequence[Parameter], closed: Sequence[str] | None = None
) -> str:
    """What is wrong with new values of the node called `where`; empty where nothing is.

    `closed` is given once the node has configured: its settings, and what is named there, wait for the next time.
    """
    known = {setting.name: setting for setting in settings}
    for parameter in changed:
        if parameter.name in known:
            try:
                known[parameter.name].check(parameter.value, where)
            except InputError as error:
                return str(error)
    late = [] if closed is None else [each.name for each in changed if each.name in (*known, *closed)]
    return f"{', '.join(late)}: read when the node configures; clean it up first" if late else ""


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
