"""Sample blocks: many samples of one signal in one message, times measured from the block's stamp."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.errors import InputError, excerpt

NANOSECONDS = 1_000_000_000


@dataclass(frozen=True)
class SampleBlock:
    """Samples of one signal.

    Attributes:
        stamp_ns: stamp of the block, timestamp (ns) since the epoch.
        names: name of each column; the first is `t`.
        rows: (n, k) samples, little-endian float64; column `t` holds seconds after the stamp.
    """

    stamp_ns: int
    names: tuple[str, ...]
    rows: NDArray[np.float64]

    @cached_property
    def times_ns(self) -> NDArray[np.int64]:
        """(n,) timestamp (ns) of each sample."""
        return self.stamp_ns + np.rint(self.rows[:, 0] * 1e9).astype(np.int64)

    @property
    def newest_ns(self) -> int:
        """Timestamp (ns) of the newest sample, wherever in the block it stands."""
        return int(self.times_ns.max())

    def column(self, name: str) -> NDArray[np.float64]:
        """(n,) samples of one field.

        Raises:
            InputError: the block has no such field.
        """
        try:
            return self.rows[:, self.names.index(name)]
        except ValueError:
            raise InputError(f"a sample block holds {excerpt(', '.join(self.names))}, but no field '{name}'") from None

    def columns(self, names: Sequence[str]) -> NDArray[np.float64]:
        """(n, len(names)) samples of several fields.

        Raises:
            InputError: the block lacks one of them.
        """
        if tuple(names) == self.names[1:]:
            return self.rows[:, 1:]
        return np.stack([self.column(name) for name in names], axis=1)


def block_from_samples(times_ns: NDArray[np.int64], names: Sequence[str], values: NDArray[np.float64]) -> SampleBlock:
    """Block of samples at `times_ns` (n,) with `values` (n, k) named `names`, stamped with its first.

    Raises:
        InputError: there is no sample, or the shapes do not fit.
    """
    if len(times_ns) == 0 or values.shape != (len(times_ns), len(names)):
        raise InputError(f"{len(times_ns)} times and {len(names)} names do not fit values of shape {values.shape}")
    stamp = int(times_ns[0])
    seconds = (times_ns - stamp) * 1e-9
    return SampleBlock(stamp, ("t", *names), np.column_stack([seconds, values]).astype("<f8", copy=False))
