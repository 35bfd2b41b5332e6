"""Policies as SROS2 and as DDS Security read them.

The policy is that of SROS2 (schema 0.2.0: `ros2 security create_permission` takes it). Permissions and governance are
those of OMG DDS Security 1.1, sections 9.4.1.2 and 9.4.1.3, with names mangled as ROS 2 does (`rt`, `rq`, `rr`).
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable
from datetime import UTC, datetime

from rotary_error_monitor.security.access import Access

_SCHEMA = "http://www.omg.org/spec/DDS-SECURITY/20170901/omg_shared_ca_{kind}.xsd"
_XSI = "{http://www.w3.org/2001/XMLSchema-instance}"

GRAPH_TOPIC = "ros_discovery_info"
"""On which the middlewares of ROS 2 tell one another their nodes; no participant can do without it."""


def policy_xml(accesses: Iterable[Access]) -> str:
    """SROS2 policy with an enclave a node."""
    top = ET.Element("policy", version="0.2.0")
    enclaves = ET.SubElement(top, "enclaves")
    for access in accesses:
        profiles = ET.SubElement(ET.SubElement(enclaves, "enclave", path=access.enclave), "profiles")
        profile = ET.SubElement(profiles, "profile", ns="/", node=access.node)
        for kind, may, names in (
            ("topic", "publish", access.publish),
            ("topic", "subscribe", access.subscribe),
            ("service", "reply", access.reply),
            ("service", "request", access.request),
        ):
            if names:
                _list(profile, kind, names, {may: "ALLOW"})
    return _text(top)


def permissions_xml(access: Access, domain: int, begin: datetime, end: datetime) -> str:
    """DDS permissions of one node, valid from `begin` to `end`; what is not allowed is denied."""
    published = {f"rt{name}" for name in access.publish} | {GRAPH_TOPIC}
    heard = {f"rt{name}" for name in access.subscribe} | {GRAPH_TOPIC}
    published |= {f"rr{name}Reply" for name in access.reply} | {f"rq{name}Request" for name in access.request}
    heard |= {f"rq{name}Request" for name in access.reply} | {f"rr{name}Reply" for name in access.request}
    top = _document("permissions")
    grant = ET.SubElement(ET.SubElement(top, "permissions"), "grant", name=access.enclave)
    ET.SubElement(grant, "subject_name").text = f"CN={access.enclave}"
    validity = ET.SubElement(grant, "validity")
    ET.SubElement(validity, "not_before").text = _time(begin)
    ET.SubElement(validity, "not_after").text = _time(end)
    rule = ET.SubElement(grant, "allow_rule")
    _domain(rule, domain)
    for may, names in (("publish", published), ("subscribe", heard)):
        _list(ET.SubElement(rule, may), "topic", sorted(names))
    ET.SubElement(grant, "default").text = "DENY"
    return _text(top)


def governance_xml(domain: int) -> str:
    """DDS governance of a domain: nobody joins without keys, everything is checked and encrypted."""
    top = _document("governance")
    rule = ET.SubElement(ET.SubElement(top, "domain_access_rules"), "domain_rule")
    _domain(rule, domain)
    _fields(
        rule,
        allow_unauthenticated_participants="false",
        enable_join_access_control="true",
        discovery_protection_kind="ENCRYPT",
        liveliness_protection_kind="ENCRYPT",
        rtps_protection_kind="ENCRYPT",
    )
    _fields(
        ET.SubElement(ET.SubElement(rule, "topic_access_rules"), "topic_rule"),
        topic_expression="*",
        enable_discovery_protection="true",
        enable_liveliness_protection="true",
        enable_read_access_control="true",
        enable_write_access_control="true",
        metadata_protection_kind="ENCRYPT",
        data_protection_kind="ENCRYPT",
    )
    return _text(top)


def _document(kind: str) -> ET.Element:
    return ET.Element("dds", {f"{_XSI}noNamespaceSchemaLocation": _SCHEMA.format(kind=kind)})


def _domain(rule: ET.Element, domain: int) -> None:
    ET.SubElement(ET.SubElement(rule, "domains"), "id").text = str(domain)


def _fields(parent: ET.Element, **fields: str) -> None:
    for name, text in fields.items():
        ET.SubElement(parent, name).text = text


def _list(parent: ET.Element, kind: str, names: Iterable[str], may: dict[str, str] | None = None) -> None:
    group = ET.SubElement(parent, f"{kind}s", may or {})
    for name in names:
        ET.SubElement(group, kind).text = name


def _time(instant: datetime) -> str:
    return instant.astimezone(UTC).strftime("%Y-%m-%dT%H:%M:%S")


def _text(top: ET.Element) -> str:
    ET.indent(top)
    return '<?xml version="1.0" encoding="UTF-8"?>\n' + ET.tostring(top, encoding="unicode") + "\n"
