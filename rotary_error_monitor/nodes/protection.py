"""Security at the start of a node: asked for and not in effect is said; where it is enforced, nothing starts."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Sequence
from itertools import zip_longest

from rclpy.node import Node
from rclpy.utilities import get_rmw_implementation_identifier

from rotary_error_monitor.description.settings import Setting
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.nodes.diagnostics import Condition, Level
from rotary_error_monitor.security.effect import Security, asked_by, judge

_REQUIRED = "required"
SECURITY = Setting(
    "security",
    "environment",
    "whether the node starts without the security of ROS: as its variables ROS_SECURITY_* say, or never",
    choices=("environment", _REQUIRED),
    at_start=True,
)
_OVERRIDE = "ROS_SECURITY_ENCLAVE_OVERRIDE"
_WITHOUT_PLUGINS = "doesn't have the security libraries"
"""What Fast DDS says where it was built without its security plugins, as the wheels of the package index are."""


def check_environment(args: Sequence[str] | None) -> None:
    """Before ROS starts: refuse to go on where security is enforced and cannot be in effect.

    Raises:
        InputError: naming what asks for it, and everything that lacks.
    """
    words = sys.argv if args is None else args
    security = judge(os.environ, _enclave_in(words), get_rmw_implementation_identifier(), required=False)
    if security.enforced and security.lacking:
        raise InputError(security.complaint)


def explained(error: RuntimeError) -> RuntimeError:
    """An error of rcl at the start, with what is known of it where security was asked for."""
    asked = asked_by(os.environ)
    if not asked:
        return error
    why = str(error)
    if _WITHOUT_PLUGINS in why:
        why = "this Fast DDS was built without its security plugins; take that of an apt-installed ROS 2"
    return RuntimeError(f"security is asked for ({asked}) and cannot be had: {why}")


def judge_node(node: Node) -> Security:
    """Whether security is asked for and in effect for a node that is there; what lacks is logged.

    Raises:
        InputError: something lacks, and the environment or the node's parameter does not let it start without.
    """
    required = node.get_parameter(SECURITY.name).value == _REQUIRED
    if not asked_by(os.environ, required=required):
        return Security("", False, ())
    own = node.get_name(), node.get_namespace()
    found = node.get_node_names_and_namespaces_with_enclaves()
    enclave = next((enclave for name, namespace, enclave in found if (name, namespace) == own), "/")
    security = judge(os.environ, enclave, get_rmw_implementation_identifier(), required=required)
    if security.lacking and security.enforced:
        raise InputError(f"{node.get_fully_qualified_name()}: {security.complaint}")
    if security.lacking:
        node.get_logger().error(security.complaint)
    return security


def security_conditions(security: Security) -> Iterator[Condition]:
    """What `/diagnostics` says of security: nothing where nobody asked for it."""
    if security.lacking:
        yield Condition("security", Level.ERROR, security.complaint)
    elif security.asked:
        yield Condition("security", Level.OK, "in effect")


def _enclave_in(words: Sequence[str]) -> str:
    """Enclave that a command line or the environment names; `/` where neither does."""
    if os.environ.get(_OVERRIDE):
        return os.environ[_OVERRIDE]
    within, named = False, "/"
    for word, after in zip_longest(words, words[1:], fillvalue=""):
        if word in ("--ros-args", "--"):
            within = word == "--ros-args"
        elif within and word in ("-e", "--enclave"):
            named = after or named
    return named
