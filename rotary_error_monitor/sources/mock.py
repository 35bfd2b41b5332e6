"""The mock stage: each process evaluates the same seeded plant as a function of time, so all see the same rotor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.plant.environment import FORCE_CYCLE, Forces, intermittent_forces
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
        force_cycle: after which the pushes repeat, s.
    """

    seed: int
    epoch_ns: int
    speeds: Sequence[float]
    forces: bool = True
    rate: float | None = None
    force_cycle: float = FORCE_CYCLE


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
        forces=intermittent_forces(settings.seed, settings.force_cycle) if settings.forces else Forces(),
        clocks=stage_clocks(tuple(stage.encoder.azimuths), settings.rate),
    )


class MockSource:
    """Samples of one stream of the mock stage.

    The plant knows the future as well as the past, so blocks are made ahead of their need: many at once cost hardly
    more than one, and what is left to do on time is little.
    """

    def __init__(self, plant: StagePlant, stream: str) -> None:
        """Samples of `stream`, such as `head_a`, `autocollimator`, `lvdt`, `command`, `force`, `temperature`."""
        self._plant = plant
        self._stream = stream
        self._ahead: dict[tuple[int, int], SampleBlock | None] = {}

    def take(self, since_ns: int, until_ns: int) -> SampleBlock | None:
        """Block of the samples from `since_ns` to before `until_ns`."""
        if (since_ns, until_ns) not in self._ahead:
            self._look_ahead(since_ns, until_ns - since_ns)
        return self._ahead.pop((since_ns, until_ns))

    def _look_ahead(self, since_ns: int, duration_ns: int) -> None:
        """Blocks of equal duration from `since_ns` on."""
        edges = since_ns + duration_ns * np.arange(max(_AHEAD // duration_ns, 1) + 1)
        first, last = (self._plant.index_at(self._stream, int(edge)) for edge in edges[[0, -1]])
        # One sample more, so that there is one even in a span shorter than the distance of two.
        samples = self._plant.samples(self._stream, first, last - first + 1)
        places = np.searchsorted(samples.times_ns, edges).tolist()
        self._ahead = {
            (begin, end): _part(samples, i, k)
            for (begin, end), (i, k) in zip(pairwise(edges.tolist()), pairwise(places), strict=True)
        }


def _part(samples: SampleBlock, first: int, last: int) -> SampleBlock | None:
    if first == last:
        return None
    return block_from_samples(samples.times_ns[first:last], samples.names[1:], samples.rows[first:last, 1:])
