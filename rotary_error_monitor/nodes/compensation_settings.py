"""Parameters of the compensation node."""

from __future__ import annotations

from rotary_error_monitor.description.settings import Setting
from rotary_error_monitor.nodes.managed import ManagedNode
from rotary_error_monitor.nodes.parameters import cell_settings
from rotary_error_monitor.pipeline.compensation import CompensationSettings
from rotary_error_monitor.signals.blocks import NANOSECONDS

_DEFAULTS = CompensationSettings()


def _seconds(ns: int) -> float:
    return ns / NANOSECONDS


def _limit_settings(kind: str, unit: str, defaults: tuple[float, float, float]) -> tuple[Setting, ...]:
    meanings = (
        ("warning", f"correction of a {kind} axis beyond which a warning is given, {unit}"),
        ("error", f"correction of a {kind} axis beyond which corrections are held until a reset, {unit}"),
        ("rate", f"how fast the correction of a {kind} axis may change, {unit}/s"),
    )
    return tuple(
        Setting(f"{kind}.{name}", value, meaning, (1e-9, 1.0))
        for (name, meaning), value in zip(meanings, defaults, strict=True)
    )


MOUNTING = (
    Setting(
        "ring_height", _DEFAULTS.ring_height, "height of the monitored body's origin above the ring, m", (-10.0, 10.0)
    ),
    Setting("ring_azimuth", _DEFAULTS.ring_azimuth, "angle from the machine's x to the stage's x, rad", (-6.3, 6.3)),
)
"""How the stage stands in the machine."""

SETTINGS = (
    *cell_settings("machine"),
    Setting("age_limit", 0.2, "oldest offset and correction that are published, s", (0.001, 10.0)),
    Setting(
        "joint_age_limit",
        _seconds(_DEFAULTS.age_limit_ns),
        "oldest joint state that an offset is computed from, s",
        (0.01, 10.0),
    ),
    Setting(
        "joint_lag",
        _seconds(_DEFAULTS.joint_lag_ns),
        "age at which a joint state counts, s: longer than it takes to arrive",
        (0.0, 1.0),
    ),
    Setting(
        "correction_period", _seconds(_DEFAULTS.correction_period_ns), "distance of two corrections, s", (0.0005, 1.0)
    ),
    Setting(
        "hold_limit",
        _seconds(_DEFAULTS.hold_limit_ns),
        "how long a correction is held before it goes on to what the description alone says, s",
        (0.1, 86400.0),
    ),
    Setting(
        "uncertainty_limit",
        _DEFAULTS.uncertainty_limit,
        "largest standard uncertainty of the tool's position with which corrections are published, m",
        (1e-9, 1.0),
    ),
    Setting(
        "feedback_patience",
        1.0,
        "how long to wait for a controller that says which corrections it has in effect, s; after it none are assumed",
        (0.0, 600.0),
    ),
    Setting(
        "temperature_patience",
        _seconds(_DEFAULTS.temperature_patience_ns),
        "how long to wait for the first temperature, s; after it that of reference stands in",
        (0.0, 600.0),
    ),
    Setting(
        "position_tolerance",
        _DEFAULTS.position_tolerance,
        "largest difference of the monitored axis between its encoder and the joint states, rad",
        (1e-6, 3.15),
    ),
    Setting(
        "command_tolerance",
        _DEFAULTS.command_tolerance,
        "difference of command and joint states at standstill from which the command is not used, rad",
        (1e-7, 3.15),
    ),
    Setting(
        "stamp_tolerance",
        _DEFAULTS.stamp_tolerance,
        "how far the stamps of command and joint states may be apart, s",
        (0.0, 1.0),
    ),
    *MOUNTING,
    *_limit_settings("linear", "m", _DEFAULTS.linear_limits),
    *_limit_settings("rotary", "rad", _DEFAULTS.rotary_limits),
)


def compensation_settings(node: ManagedNode) -> CompensationSettings:
    """What the parameters of a node say."""
    setting = node.setting

    def nanoseconds(name: str) -> int:
        return round(setting(name) * NANOSECONDS)

    def limits(kind: str) -> tuple[float, float, float]:
        return setting(f"{kind}.warning"), setting(f"{kind}.error"), setting(f"{kind}.rate")

    return CompensationSettings(
        joint_lag_ns=nanoseconds("joint_lag"),
        age_limit_ns=nanoseconds("joint_age_limit"),
        correction_period_ns=nanoseconds("correction_period"),
        hold_limit_ns=nanoseconds("hold_limit"),
        temperature_patience_ns=nanoseconds("temperature_patience"),
        uncertainty_limit=setting("uncertainty_limit"),
        position_tolerance=setting("position_tolerance"),
        command_tolerance=setting("command_tolerance"),
        stamp_tolerance=setting("stamp_tolerance"),
        ring_height=setting("ring_height"),
        ring_azimuth=setting("ring_azimuth"),
        linear_limits=limits("linear"),
        rotary_limits=limits("rotary"),
    )


def limit_figures(node: ManagedNode) -> dict[str, object]:
    """Limits of corrections, in the units that people read, as figures of a status."""
    figures: dict[str, object] = {}
    for kind, small, rate, scale in (("linear", "um", "mm_s", 1e3), ("rotary", "urad", "rad_s", 1.0)):
        figures[f"{kind}_warning_{small}"] = node.setting(f"{kind}.warning") * 1e6
        figures[f"{kind}_error_{small}"] = node.setting(f"{kind}.error") * 1e6
        figures[f"{kind}_rate_{rate}"] = node.setting(f"{kind}.rate") * scale
    return figures
