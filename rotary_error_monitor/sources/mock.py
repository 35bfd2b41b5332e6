"""The mock stage: each process evaluates the same seeded plant as a function of time, so all see the same rotor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.plant.environment import Forces, intermittent_forces
from rotary_error_monitor.plant.motion import reversing_motion
from rotary_error_monitor.plant.stage import StagePlant, stage_clocks
from rotary_error_monitor.signals.blocks import NANOSECONDS, SampleBlock, block_from_samples

_DAY = 86_400 * NANOSECONDS
_AHEAD = NANOSECONDS // 10


@dataclass(frozen=True)
class MockSettings:
    """What the processes of a mock cell agree on.

    Attributes:
        seed: of all that is random.
        epoch_ns: when the stage starts, timestamp (ns).
        speeds: speeds of a cycle of the stage, rad/s.
        forces: whether something pushes at the shaft now and then.
        rate: samples a second of heads and autocollimator; None for their usual rates.
    """

    seed: int
    epoch_ns: int
    speeds: Sequence[float]
    forces: bool = True
    rate: float | None = None


def last_midnight(now_ns: int) -> int:
    """Timestamp (ns) of the last midnight (UTC): an epoch on which processes agree without a word."""
    return now_ns - now_ns % _DAY


def mock_stage(stage: StageDescription, settings: MockSettings) -> StagePlant:
    """The true stage of a mock cell."""
    return StagePlant(
        stage,
        seed=settings.seed,
        epoch_ns=settings.epoch_ns,
        motion=reversing_motion(settings.speeds),
        forces=intermittent_forces(settings.seed) if settings.forces else Forces(),
        clocks=stage_clocks(tuple(stage.encoder.azimuths), settings.rate),
    )


class MockSource:
    """Samples of one stream of the mock stage.

    The plant knows the future as well as the past, so samples are made in spans of time ahead of their need: one call
    for many samples costs hardly more than one for a few.
    """

    def __init__(self, plant: StagePlant, stream: str) -> None:
        """Samples of `stream`, such as `head_a`, `autocollimator`, `lvdt`, `command`, `force`, `temperature`."""
        self._plant = plant
        self._stream = stream
        self._ahead: SampleBlock | None = None
        self._ahead_from_ns, self._ahead_until_ns = 0, 0

    def take(self, since_ns: int, until_ns: int) -> SampleBlock | None:
        """Block of the samples from `since_ns` to before `until_ns`."""
        if self._ahead is None or not self._ahead_from_ns <= since_ns <= until_ns <= self._ahead_until_ns:
            self._look_ahead(since_ns, max(until_ns, since_ns + _AHEAD))
        ahead = self._ahead
        assert ahead is not None
        first, last = np.searchsorted(ahead.times_ns, (since_ns, until_ns)).tolist()
        if first == last:
            return None
        return block_from_samples(ahead.times_ns[first:last], ahead.names[1:], ahead.rows[first:last, 1:])

    def _look_ahead(self, since_ns: int, until_ns: int) -> None:
        first, last = (self._plant.index_at(self._stream, time_ns) for time_ns in (since_ns, until_ns))
        # One sample more, so that there is one even in a span shorter than the distance of two.
        self._ahead = self._plant.samples(self._stream, first, last - first + 1)
        self._ahead_from_ns, self._ahead_until_ns = since_ns, until_ns
