"""`rotary_error_monitor security`: least-privilege policies of a cell, and the keys that put them in effect."""

from __future__ import annotations

import argparse
import os
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


def add(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Describe the command's arguments."""
    parser = subparsers.add_parser("security", help="SROS2 policies and keys of a cell, least privilege a node")
    actions = parser.add_subparsers(title="what", required=True, metavar="WHAT")
    policy = actions.add_parser("policy", help="print the policy, in the format of SROS2")
    policy.set_defaults(run=run_policy)
    keys = actions.add_parser("keys", help="make a keystore with keys and signed permissions of every node")
    keys.add_argument("keystore", type=Path, help="folder for ROS_SECURITY_KEYSTORE; its authority is kept, if any")
    keys.add_argument("--domain", type=int, help="ROS domain id, by default that of ROS_DOMAIN_ID, else 0")
    keys.add_argument("--days", type=int, default=_DAYS, help=f"how long the keys are valid, by default {_DAYS}")
    keys.add_argument("--node", action="append", metavar="NODE", help="only these nodes; may be given several times")
    keys.set_defaults(run=run_keys)
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


def run_policy(arguments: argparse.Namespace) -> int:
    """Print the policy."""
    print(policy_xml(_accesses(arguments)), end="")
    return 0


def run_keys(arguments: argparse.Namespace) -> int:
    """Write the keystore."""
    # Signing needs a library that nothing else here loads.
    from rotary_error_monitor.security.keystore import write_keystore

    domain = _domain(arguments.domain)
    if arguments.days < 1:
        raise InputError(f"--days {arguments.days}: expected a whole number from 1")
    accesses = _chosen(_accesses(arguments), arguments.node)
    write_keystore(arguments.keystore, accesses, domain, arguments.days)
    print(f"{arguments.keystore}: keys of {', '.join(access.enclave for access in accesses)}, for ROS domain {domain}")
    print("Keep private/ away from the machine. Start each node with --ros-args --enclave /<its name>, and")
    print(
        f"ROS_SECURITY_ENABLE=true ROS_SECURITY_STRATEGY=Enforce ROS_SECURITY_KEYSTORE={arguments.keystore.resolve()}"
    )
    return 0


def _accesses(arguments: argparse.Namespace) -> tuple[Access, ...]:
    stage = load_stage(arguments.stage)
    return cell_accesses(wire_of(stage), load_services(), _listened(arguments.listen))


def _listened(pairs: Sequence[str]) -> Mapping[str, list[str]]:
    found: dict[str, list[str]] = {}
    for pair in pairs:
        node, equals, topic = pair.partition("=")
        if not (node and equals and topic):
            raise InputError(f"--listen {pair}: expected NODE=TOPIC, such as encoder_head_a=/joint_states")
        found.setdefault(node, []).append(topic)
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
