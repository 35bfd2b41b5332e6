"""Sample blocks: many samples of one signal in one message, times measured from the block's stamp."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.errors import InputError, excerpt
from rotary_error_monitor.signals.kernel import chosen_kernel

NANOSECONDS = 1_000_000_000

TIME_COLUMN = "t"
"""First column of every block: seconds after its stamp."""


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
    rows: Array

    @cached_property
    def times_ns(self) -> NDArray[np.int64]:
        """(n,) timestamp (ns) of each sample."""
        times = self._compiled_times()
        return self.stamp_ns + np.rint(self.rows[:, 0] * 1e9).astype(np.int64) if times is None else times

    @cached_property
    def newest_ns(self) -> int:
        """Timestamp (ns) of the newest sample, wherever in the block it stands."""
        return int(self.times_ns.max())

    def is_timed(self) -> bool:
        """Whether the library finds all times finite and within 2^31 s of the stamp; false where numpy computes."""
        return self._compiled_times() is not None

    def _compiled_times(self) -> NDArray[np.int64] | None:
        """Timestamps by the library, with the newest put where both are looked for first."""
        kernel = chosen_kernel()
        found = None if kernel is None else kernel.times(self.rows, self.stamp_ns)
        if found is None:
            return None
        vars(self)["times_ns"], vars(self)["newest_ns"] = found
        return found[0]

    def column(self, name: str) -> Array:
        """(n,) samples of one field.

        Raises:
            InputError: the block has no such field.
        """
        try:
            return self.rows[:, self.names.index(name)]
        except ValueError:
            raise InputError(f"a sample block holds {excerpt(', '.join(self.names))}, but no field '{name}'") from None

    def check_fields(self, stream: str, fields: Sequence[str]) -> None:
        """Hold that the block of a stream has its fields.

        Raises:
            InputError: it lacks one of them; the message names the stream and its fields.
        """
        if tuple(fields) != self.names[1:]:
            lacking = [name for name in fields if name not in self.names]
            if lacking:
                raise InputError(
                    f"{stream}: a sample block holds {excerpt(', '.join(self.names))}, but no field "
                    f"'{lacking[0]}'; expected t, {', '.join(fields)}"
                )

    def columns(self, names: Sequence[str]) -> Array:
        """(n, len(names)) samples of several fields.

        Raises:
            InputError: the block lacks one of them.
        """
        if tuple(names) == self.names[1:]:
            return self.rows[:, 1:]
        return np.stack([self.column(name) for name in names], axis=1)


def block_from_samples(times_ns: NDArray[np.int64], names: Sequence[str], values: Array) -> SampleBlock:
    """Block of samples at `times_ns` (n,) with `values` (n, k) named `names`, stamped with its first.

    Raises:
        InputError: there is no sample, or the shapes do not fit.
    """
    if len(times_ns) == 0 or values.shape != (len(times_ns), len(names)):
        raise InputError(f"{len(times_ns)} times and {len(names)} names do not fit values of shape {values.shape}")
    stamp = int(times_ns[0])
    rows = np.empty((len(times_ns), 1 + len(names)), "<f8")
    rows[:, 0], rows[:, 1:] = (times_ns - stamp) * 1e-9, values
    return SampleBlock(stamp, (TIME_COLUMN, *names), rows)
