"""What an estimator or a compensation makes of its inputs, one after another."""

from __future__ import annotations

from collections.abc import Mapping

from rotary_error_monitor.metrology.error_motion import ErrorMotion
from rotary_error_monitor.pipeline.compensation import Compensator
from rotary_error_monitor.pipeline.corrections import CompensationOutput
from rotary_error_monitor.pipeline.estimation import Estimator
from rotary_error_monitor.signals.blocks import SampleBlock


def push_block(
    estimator: Estimator, stream: str, block: SampleBlock, arrival_ns: int | None = None
) -> list[ErrorMotion]:
    """Error motion that is complete as soon as the estimator has the block."""
    estimator.accept(stream, block, arrival_ns)
    return estimator.advance()


def push_error_motion(compensator: Compensator, motion: ErrorMotion) -> CompensationOutput:
    """What can be computed as soon as the compensator has the error motion."""
    compensator.accept_error_motion(motion)
    return compensator.advance()


def push_joint_state(
    compensator: Compensator, stamp_ns: int, positions: Mapping[str, float], velocities: Mapping[str, float]
) -> CompensationOutput:
    """What can be computed as soon as the compensator has the joint state."""
    compensator.accept_joint_state(stamp_ns, positions, velocities)
    return compensator.advance()
