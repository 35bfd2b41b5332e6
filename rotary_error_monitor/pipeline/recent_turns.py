"""The last turns of a stage, kept in bounded memory while its streams run on."""

from __future__ import annotations

import itertools
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.description.streams import COMMAND
from rotary_error_monitor.description.topics import samples_columns
from rotary_error_monitor.signals.blocks import NANOSECONDS, SampleBlock, block_from_samples

_SLACK = 1.0
"""Rotation, rad, beyond what the commanded speed allows, from which a step is no motion but a new count."""


_Samples = tuple[NDArray[np.int64], NDArray[np.float64]]


@dataclass(frozen=True)
class _Piece:
    times: NDArray[np.int64]
    values: NDArray[np.float64]
    travel: float

    @property
    def newest_ns(self) -> int:
        return int(self.times[-1])


@dataclass
class _Memory:
    """What is kept of one stream, oldest first."""

    names: tuple[str, ...]
    pieces: deque[_Piece] = field(default_factory=deque)
    samples: int = 0
    travel: float = 0.0
    stride: int = 0
    skip: int = 0

    @property
    def oldest_ns(self) -> int:
        return int(self.pieces[0].times[0])

    @property
    def newest_ns(self) -> int:
        return self.pieces[-1].newest_ns

    def thinned(self, times: NDArray[np.int64], values: NDArray[np.float64], rate: float) -> _Samples:
        """Each so-manieth sample, so that `rate` a second or a few more are left; the first two settle how many."""
        seen = times if len(times) > 1 or not self.pieces else np.array([self.newest_ns, times[-1]])
        if self.stride == 0 and len(seen) > 1:
            self.stride = max(1, int((len(seen) - 1) * NANOSECONDS / (rate * int(seen[-1] - seen[0])) + 1e-6))
        if self.stride <= 1:
            return times, values
        kept = slice(self.skip, None, self.stride)
        self.skip = (self.skip - len(times)) % self.stride
        return times[kept], values[kept]

    def append(self, piece: _Piece) -> None:
        self.pieces.append(piece)
        self.samples += len(piece.times)
        self.travel += piece.travel

    def drop_oldest(self) -> None:
        piece = self.pieces.popleft()
        self.samples -= len(piece.times)
        self.travel -= piece.travel

    def between(self, begin_ns: int, end_ns: int) -> list[_Piece]:
        """Pieces cut to the samples of a span of time, both ends included."""
        found = []
        for piece in self.pieces:
            if piece.times[0] < begin_ns or piece.newest_ns > end_ns:
                part = slice(*np.searchsorted(piece.times, (begin_ns, end_ns + 1)))
                piece = _Piece(piece.times[part], piece.values[part], piece.travel)
            if len(piece.times):
                found.append(piece)
        return found

    def clear(self) -> None:
        self.pieces.clear()
        self.samples, self.travel, self.stride, self.skip = 0, 0.0, 0, 0


class RecentTurns:
    """Samples of all streams, back to where the last turns of the command began.

    A turn is 2π of the way that the command travels, forward or backward. Memory is bounded however slowly the stage
    turns and however fast samples come: by a time and by a number of samples. Samples that are not after those before
    them are dropped; where the clock was set back behind everything in memory, or the controller counts its angle anew,
    memory starts anew as well.

    Attributes:
        late: blocks dropped because they were not after the one before, or not in order themselves.
    """

    def __init__(
        self,
        streams: Mapping[str, Sequence[str]],
        command: str,
        turns: float,
        shortest: float,
        longest: float,
        most_samples: int,
        rate: float = np.inf,
    ) -> None:
        """Keep nothing yet.

        Args:
            streams: columns to keep by stream.
            command: the stream by whose angle and speed turns are counted.
            turns: of the stage.
            shortest: time, s, that is kept at least however fast the stage turns.
            longest: time, s, that is kept at most.
            most_samples: of each stream that are kept at most.
            rate: samples a second that are enough; of faster streams only each so-manieth is kept, as it is.
        """
        self.late = 0
        self._memories = {name: _Memory(tuple(columns)) for name, columns in streams.items()}
        self._command = command
        self._turns = turns
        self._shortest_ns = round(shortest * NANOSECONDS)
        self._longest_ns = round(longest * NANOSECONDS)
        self._most_samples = most_samples
        self._rate = rate
        self._is_bounded = False

    @property
    def turns(self) -> float:
        """Turns of the stage in memory."""
        return self._memories[self._command].travel / (2 * np.pi)

    @property
    def duration(self) -> float:
        """Time from the first to the last sample of the command in memory, s."""
        command = self._memories[self._command]
        return (command.newest_ns - command.oldest_ns) / NANOSECONDS if command.pieces else 0.0

    @property
    def newest_ns(self) -> int | None:
        """Timestamp (ns) of the last sample of the command; None before the first."""
        command = self._memories[self._command]
        return command.newest_ns if command.pieces else None

    @property
    def is_full(self) -> bool:
        """Whether all turns are there, or one of the bounds of memory leaves no room for more."""
        command = self._memories[self._command]
        return self._is_bounded or bool(command.pieces and self._holds_all(command, command.oldest_ns, command.travel))

    def push(self, stream: str, block: SampleBlock) -> None:
        """Take in a block of a stream.

        Raises:
            InputError: the block lacks one of the stream's columns.
        """
        memory = self._memories[stream]
        times, values = block.times_ns, block.columns(memory.names)
        if not bool((times[1:] > times[:-1]).all()):  # nothing tells which of its stamps are right
            self.late += 1
            return
        if memory.pieces and times[0] <= memory.newest_ns:
            if times[-1] >= memory.oldest_ns:
                self.late += 1
                return
            self.clear()
        times, values = memory.thinned(times, values, self._rate)
        if len(times):
            memory.append(_Piece(times, values, self._travel(times, values) if stream == self._command else 0.0))
            self._forget(stream)

    def clear(self) -> None:
        """Forget everything."""
        self._is_bounded = False
        for memory in self._memories.values():
            memory.clear()

    def blocks(self, span: float = 0.0) -> dict[str, list[SampleBlock]]:
        """Samples by stream while the command went its last turns; a stream that has none then is left out.

        Args:
            span: blocks are joined until they are this long, s; 0 leaves them as they came.
        """
        command = self._memories[self._command]
        if not command.pieces:
            return {}
        found = {
            name: _joined(memory.names, memory.between(command.oldest_ns, command.newest_ns), span)
            for name, memory in self._memories.items()
        }
        return {name: blocks for name, blocks in found.items() if blocks}

    def _travel(self, times: NDArray[np.int64], values: NDArray[np.float64]) -> float:
        """Way, rad, from the last sample of the command through the next ones; a new count forgets all before it."""
        memory = self._memories[self._command]
        motion = [memory.names.index(name) for name in samples_columns(COMMAND)]
        angle, velocity = values[:, motion].T
        within = float(np.abs(np.diff(angle)).sum())
        if not memory.pieces:
            return within
        last_angle, last_velocity = (float(value) for value in memory.pieces[-1].values[-1, motion])
        step = abs(float(angle[0]) - last_angle)
        passed = (int(times[0]) - memory.newest_ns) / NANOSECONDS
        if step > passed * max(abs(last_velocity), abs(float(velocity[0]))) + _SLACK:
            self.clear()
            return within
        return step + within

    def _holds_all(self, command: _Memory, oldest_ns: int, travel: float) -> bool:
        """Whether memory from `oldest_ns` on, in which the command went `travel`, is long enough."""
        return travel >= 2 * np.pi * self._turns and command.newest_ns - oldest_ns >= self._shortest_ns

    def _forget(self, stream: str) -> None:
        memory, command = self._memories[stream], self._memories[self._command]
        if stream == self._command:
            while len(memory.pieces) > 1 and self._holds_all(
                memory, int(memory.pieces[1].times[0]), memory.travel - memory.pieces[0].travel
            ):
                memory.drop_oldest()
        begin_ns = command.oldest_ns if command.pieces else 0
        while len(memory.pieces) > 1:
            too_long = memory.newest_ns - memory.oldest_ns > self._longest_ns
            too_many = memory.samples > self._most_samples
            if not (too_long or too_many or memory.pieces[0].newest_ns < begin_ns):
                break
            self._is_bounded |= too_many or (too_long and stream == self._command)
            memory.drop_oldest()


def _joined(names: Sequence[str], pieces: Sequence[_Piece], span: float) -> list[SampleBlock]:
    """Blocks of neighbouring pieces, each up to about `span` s long."""
    if not pieces:
        return []
    begins = np.array([int(piece.times[0]) for piece in pieces])
    group = (begins - begins[0]) // max(round(span * NANOSECONDS), 1)
    edges = [0, *(np.flatnonzero(np.diff(group)) + 1), len(pieces)]
    return [
        block_from_samples(
            np.concatenate([piece.times for piece in pieces[a:b]]),
            names,
            np.concatenate([piece.values for piece in pieces[a:b]]),
        )
        for a, b in itertools.pairwise(edges)
    ]
