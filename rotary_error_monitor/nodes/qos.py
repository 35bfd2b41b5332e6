"""Quality of service of the nodes' topics, and what of it a user may override."""

from __future__ import annotations

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions

from rotary_error_monitor.bags.part import Recordable

OVERRIDABLE = QoSOverridingOptions(
    (QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH, QoSPolicyKind.RELIABILITY, QoSPolicyKind.DURABILITY)
)
"""Parameters `qos_overrides.<topic>.…` of each publisher and subscription."""


def profile(topic: Recordable) -> QoSProfile:
    """Quality of service of a topic, such as one of the contract."""
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=topic.qos.depth,
        reliability=ReliabilityPolicy[topic.qos.reliability.upper()],
        durability=DurabilityPolicy[topic.qos.durability.upper()],
    )


def driver_profile() -> QoSProfile:
    """Quality of service that fits the publisher of any driver: best effort listens to reliable ones as well."""
    return QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)


def onlooker_profile(depth: int) -> QoSProfile:
    """Quality of service of who looks at a topic and misses nothing by missing a message: nobody waits for it."""
    return QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT)
