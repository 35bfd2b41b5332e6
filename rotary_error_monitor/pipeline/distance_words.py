"""Whether a window tells the distance of rotation and command, and why that is not believed, in words."""

from __future__ import annotations

from rotary_error_monitor.pipeline.evidence import EvidenceWindow


def tells_distance(window: EvidenceWindow) -> bool:
    """Whether the mean distance is one: not of a window that lacks rotation or command at some ticks."""
    return window.has("command") and window.has("heads")


def why_far(distance: float, speed: float, allowed: float) -> str:
    """Of a distance, rad, at a speed, rad/s, where so much is `allowed`, rad."""
    return (
        f"rotation and command are {distance * 1e6:.4g} µrad apart at {speed:.3g} rad/s; following error and latency "
        f"explain {allowed * 1e6:.3g}. Command, its stamps, or the zero of the heads are wrong"
    )


def why_stepped(size: float, within: float) -> str:
    """Of a step, rad, within a time, s."""
    return f"a step of {size * 1e6:.3g} µrad between rotation and command within {within * 1e3:g} ms"


def why_moved(shift: float) -> str:
    """Of a distance that is larger by so much, rad, than before a silence."""
    return (
        f"rotation and command are {shift * 1e6:.3g} µrad further apart than before the heads were silent: "
        "they may have lost counts"
    )


def why_late(delay: float, most: float) -> str:
    """Of a delay of the heads, s, that may be so much at most, s."""
    return (
        f"the heads are {delay * 1e3:.3g} ms behind the command, more than the {most * 1e3:.3g} ms of the stage's "
        "limits: stamps of one of them are wrong"
    )
