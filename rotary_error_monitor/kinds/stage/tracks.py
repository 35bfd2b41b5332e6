"""White rows of a stage's channels with what they may depend on, for tests of structure."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.effects.rotor import HEAD
from rotary_error_monitor.gap.problem import Rows, StructureTest
from rotary_error_monitor.gap.structure import Track, find_shared, find_structure
from rotary_error_monitor.kinds.stage.rows import StageRows
from rotary_error_monitor.sensors.library import instrument_of

FEWEST_ROWS = 100
"""Rows of a channel below which its structure is not looked at."""


@dataclass(frozen=True)
class _Instants:
    """What rows may depend on that are used of some channels.

    Attributes:
        time: (m,) s of all rows of such a channel.
        used: (m,) which of them are used.
        track: of these, without rows.
    """

    time: Array
    used: NDArray[np.bool_]
    track: Track

    def are_of(self, time: Array, used: NDArray[np.bool_]) -> bool:
        """Whether another channel has the same instants, and uses the same of them."""
        return time is self.time and np.array_equal(used, self.used)


class Tracks:
    """Channels one at a time: of a long recording all together would fill the memory.

    Args:
        problem: recording beside twin.
    """

    def __init__(self, problem: StageRows) -> None:
        self._problem = problem
        self._kept: dict[str, tuple[Array, _Instants]] = {}

    def of(self, rest: Rows) -> Iterator[Track]:
        """White rows (m, 1) as tracks; rows of little weight are left out, and channels that have few others."""
        last: _Instants | None = None
        for channel, rows in rest.items():
            expected = self._problem.expected(channel)
            used = expected > 0.5 * float(expected.max(initial=0.0))
            if np.count_nonzero(used) < FEWEST_ROWS:
                continue
            last = self._instants(channel, expected, used, last)
            white = rows[used, 0] / np.sqrt(expected[used])
            yield replace(last.track, channel=channel, rows=white)

    def structure(self, rest: Rows) -> list[StructureTest]:
        """Tests of each channel against orders, lines, places and times; of those of one instrument together."""
        own: dict[str, list[StructureTest]] = {}
        shared: list[StructureTest] = []
        # Those of one instrument one after the other, so that no more than these are held: a channel that begins late
        # stands behind all others.
        instruments = {channel: instrument_of(channel) for channel in rest}
        for instrument in dict.fromkeys(instruments.values()):
            tracks = []
            for track in self.of({channel: rest[channel] for channel in rest if instruments[channel] == instrument}):
                own[track.channel] = find_structure(track)
                tracks.append(track)
            if len(tracks) > 1:
                # What each head shows beyond their mean: those of one instant sum to zero.
                shared += find_shared(tracks, len(tracks) - (instrument == HEAD))
        return [finding for channel in rest for finding in own.get(channel, ())] + shared

    def _instants(self, channel: str, expected: Array, used: NDArray[np.bool_], last: _Instants | None) -> _Instants:
        """Those of a channel: the same object as the last one's where they are; kept until the noise is another."""
        keeps = self._problem.keeps_signatures
        kept = self._kept.get(channel) if keeps else None
        if kept is not None and kept[0] is expected:
            return kept[1]
        time = self._problem.times(channel)
        found = last if last is not None and last.are_of(time, used) else self._made(channel, time, used)
        if keeps:
            self._kept[channel] = expected, found
        return found

    def _made(self, channel: str, time: Array, used: NDArray[np.bool_]) -> _Instants:
        problem, conditions = self._problem, self._problem.conditions
        labels = np.zeros(len(time), np.min_scalar_type(len(conditions.names)))
        for stretch in range(conditions.stretches):
            for block, part in conditions.pieces(channel, time, stretch):
                labels[part] = conditions.labels[block]
        own = time[used]
        angle = np.asarray(problem.twin.inputs.command(own), np.float64)
        keeps = problem.keeps_signatures
        return _Instants(time, used, Track(channel, np.zeros(0), own, angle, labels[used], conditions.names, keeps))
