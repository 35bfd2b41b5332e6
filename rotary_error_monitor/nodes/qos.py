"""Quality of service of the nodes' topics, and what of it a user may override."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions

if TYPE_CHECKING:  # what writes bags takes as long to load as all of rclpy
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


_DRIVER_DEPTH = 10_000
"""Messages of a driver that may wait: those of a second at 10 kHz, for which a source sends late blocks after all. What
waits costs memory, some 200 bytes a message; what does not fit is lost."""


def driver_profile() -> QoSProfile:
    """Quality of service that fits the publisher of any driver: best effort listens to reliable ones as well."""
    return QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=_DRIVER_DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)


def onlooker_profile(depth: int) -> QoSProfile:
    """Quality of service of who looks at a topic and misses nothing by missing a message: nobody waits for it."""
    return QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=depth, reliability=ReliabilityPolicy.BEST_EFFORT)
