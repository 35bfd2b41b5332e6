"""`rotary_error_monitor security`: policies of a cell, keys that put them in effect, and users of its OPC UA server."""

from __future__ import annotations

import argparse
import getpass
import os
import socket
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.description.wire import load_services, wire_of
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.security.access import Access, cell_accesses
from rotary_error_monitor.security.documents import policy_xml

_DAYS = 3650
"""Ten years, as SROS2 gives: a machine outlives shorter ones, and none of its nodes starts once they have run out."""

_HIGHEST_DOMAIN = 232
"""Beyond it the ports of DDS do not fit into 65535."""


def add(parser: argparse.ArgumentParser) -> None:
    """Describe the command's arguments."""
    actions = parser.add_subparsers(title="what", required=True, metavar="WHAT")
    policy = actions.add_parser("policy", help="print the policy, in the format of SROS2")
    policy.set_defaults(run=run_policy)
    keys = actions.add_parser("keys", help="make a keystore with keys and signed permissions of every node")
    keys.add_argument("keystore", type=Path, help="folder for ROS_SECURITY_KEYSTORE; its authority is kept, if any")
    keys.add_argument("--domain", type=int, help="ROS domain id, by default that of ROS_DOMAIN_ID, else 0")
    keys.add_argument("--days", type=int, default=_DAYS, help=f"how long the keys are valid, by default {_DAYS}")
    keys.add_argument("--node", action="append", metavar="NODE", help="only these nodes; may be given several times")
    keys.set_defaults(run=run_keys)
    user = actions.add_parser("user", help="write a user with a hashed password, for the node opcua_server")
    user.add_argument("file", type=Path, help="file of users, for the parameter `users`; made where it is not there")
    user.add_argument("name", help="of the user; the password is asked for, or read from standard input")
    user.set_defaults(run=run_user)
    opcua = actions.add_parser("opcua", help="make certificate and key of the node opcua_server")
    opcua.add_argument("folder", type=Path, help="for certificate.pem and key.pem")
    opcua.add_argument("--host", action="append", default=[], help="name or address that clients use; several times")
    opcua.add_argument("--days", type=int, default=_DAYS, help=f"how long it is valid, by default {_DAYS}")
    opcua.set_defaults(run=run_opcua)
    for each in (policy, keys):
        each.add_argument(
            "--stage", type=Path, help="YAML file of the stage, for its heads and listed sensors; default the embedded"
        )
        each.add_argument(
            "--listen",
            action="append",
            default=[],
            metavar="NODE=TOPIC",
            help="topic of a third-party driver that a node listens to, such as encoder_head_a=/joint_states",
        )
        each.add_argument(
            "--call",
            action="append",
            default=[],
            metavar="NODE=SERVICE",
            help="service of a person that a node may call, such as opcua_server=/compensation/reset",
        )


def run_policy(arguments: argparse.Namespace) -> int:
    """Print the policy."""
    print(policy_xml(_accesses(arguments)), end="")
    return 0


def run_keys(arguments: argparse.Namespace) -> int:
    """Write the keystore."""
    # Signing needs a library that nothing else here loads.
    from rotary_error_monitor.security.keystore import write_keystore

    domain = _domain(arguments.domain)
    _check_days(arguments.days)
    accesses = _chosen(_accesses(arguments), arguments.node)
    write_keystore(arguments.keystore, accesses, domain, arguments.days)
    print(f"{arguments.keystore}: keys of {', '.join(access.enclave for access in accesses)}, for ROS domain {domain}")
    print("Keep private/ away from the machine. Start each node with --ros-args --enclave /<its name>, and")
    print(
        f"ROS_SECURITY_ENABLE=true ROS_SECURITY_STRATEGY=Enforce ROS_SECURITY_KEYSTORE={arguments.keystore.resolve()}"
    )
    return 0


def run_user(arguments: argparse.Namespace) -> int:
    """Write a user into a file."""
    from rotary_error_monitor.security.users import add_user

    asked = f"password of {arguments.name}: "
    password = getpass.getpass(asked) if sys.stdin.isatty() else sys.stdin.readline().rstrip("\n")
    add_user(arguments.file, arguments.name, password)
    print(f"{arguments.file}: user {arguments.name}")
    return 0


def run_opcua(arguments: argparse.Namespace) -> int:
    """Write certificate and key of the OPC UA server."""
    from rotary_error_monitor.security.opcua_certificate import write_application

    _check_days(arguments.days)
    hosts = arguments.host or [socket.gethostname(), "localhost", "127.0.0.1"]
    certificate, key = write_application(arguments.folder, hosts, arguments.days)
    print(f"{certificate}, {key}: for {', '.join(hosts)}")
    return 0


def _check_days(days: int) -> None:
    if days < 1:
        raise InputError(f"--days {days}: expected a whole number from 1")


def _accesses(arguments: argparse.Namespace) -> tuple[Access, ...]:
    stage = load_stage(arguments.stage)
    heard = _granted("--listen", "TOPIC", arguments.listen, "encoder_head_a=/joint_states")
    called = _granted("--call", "SERVICE", arguments.call, "opcua_server=/compensation/reset")
    return cell_accesses(wire_of(stage), load_services(), heard, called)


def _granted(option: str, what: str, pairs: Sequence[str], example: str) -> Mapping[str, list[str]]:
    found: dict[str, list[str]] = {}
    for pair in pairs:
        node, equals, name = pair.partition("=")
        if not (node and equals and name):
            raise InputError(f"{option} {pair}: expected NODE={what}, such as {example}")
        found.setdefault(node, []).append(name)
    return found


def _chosen(accesses: Sequence[Access], names: Sequence[str] | None) -> list[Access]:
    known = {access.node: access for access in accesses}
    unknown = sorted(set(names or ()) - set(known))
    if unknown:
        raise InputError(f"no node is called {', '.join(unknown)}; the cell has {', '.join(known)}")
    return [known[name] for name in names or known]


def _domain(given: int | None) -> int:
    text = str(given) if given is not None else os.environ.get("ROS_DOMAIN_ID") or "0"
    if not text.isdecimal() or int(text) > _HIGHEST_DOMAIN:
        raise InputError(f"ROS domain id {text}: expected a whole number from 0 to {_HIGHEST_DOMAIN}")
    return int(text)
