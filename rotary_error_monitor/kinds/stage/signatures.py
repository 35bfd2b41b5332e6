"""White signatures of effects without size, kept between steps and made new where the noise is known better.

What an effect does is predicted once; a better known noise changes only how that is whitened.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.streams import AUTOCOLLIMATOR, COMMAND
from rotary_error_monitor.effects.rotor import HEAD
from rotary_error_monitor.gap.problem import Rows
from rotary_error_monitor.kinds.stage.predictions import KEPT
from rotary_error_monitor.noise.stage_noise import StageNoise
from rotary_error_monitor.sensors.library import instrument_of

SignatureKey = tuple[str, str, bytes, tuple[int, ...]]
"""Name and location of an effect, its values, and which of them are asked for."""


class KeptSignatures:
    """Rows (m, p) by channel, with what the heads share of them (n, p) before whitening.

    Attributes:
        recent: rows of causes with sizes, which are made again once the noise is known better.
    """

    def __init__(self) -> None:
        self._kept: dict[SignatureKey, tuple[Rows, Array | None]] = {}
        self.recent: dict[Hashable, Rows] = {}

    def get(self, key: SignatureKey) -> Rows | None:
        """White rows, or None where they are not kept."""
        found = self._kept.get(key)
        return None if found is None else found[0]

    def keep(self, key: SignatureKey, rows: Rows, shared: Array | None) -> None:
        """Keep white rows; `shared` is what the heads share, if anything."""
        self._kept[key] = rows, shared

    def keep_recent(self, key: Hashable, rows: Rows) -> None:
        """Keep white rows of a cause with a size: some of them, the last ones."""
        while len(self.recent) >= KEPT:
            self.recent.pop(next(iter(self.recent)))
        self.recent[key] = rows

    def follow_command(self, noise: StageNoise) -> None:
        """Whiten what the heads share again: the jitter, or the noise of the readings beside it, has changed."""
        self.recent.clear()
        for key, (rows, shared) in self._kept.items():
            if shared is not None:
                self._kept[key] = {**rows, COMMAND: noise.command_rows(shared)}, shared

    def follow_levels(self, noise: StageNoise, louder: Mapping[str, Array]) -> None:
        """Take the noise of some instruments for so many times what it was, in all rows (1,) or in each (m,)."""
        self.recent.clear()
        if AUTOCOLLIMATOR in louder:
            # Beside the turbulence the filter has another shape: these are predicted again.
            self._kept = {key: kept for key, kept in self._kept.items() if f"{AUTOCOLLIMATOR}.x" not in kept[0]}
        for key, (rows, shared) in self._kept.items():
            own = {c: instrument_of(c) for c in rows}
            quieter = {c: values / louder[own[c]][:, None] for c, values in rows.items() if own[c] in louder}
            self._kept[key] = {**rows, **quieter}, shared
        if HEAD in louder:
            self.follow_command(noise)

    def follow_slow_noise(self, instrument: str) -> None:
        """Make those that an instrument shows again when they are wanted: its slow noise is known better."""
        self.recent.clear()
        shown = {instrument, COMMAND} if instrument == HEAD else {instrument}
        self._kept = {key: kept for key, kept in self._kept.items() if shown.isdisjoint(map(instrument_of, kept[0]))}
