"""Random numbers that are a function of (seed, name, index), so that every process sees the same noise."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, cached_property, lru_cache
from typing import cast

import numpy as np
from numpy.typing import NDArray

_COUNTER = 4  # Philox gives four 64-bit words per count
_MANTISSA = 2.0**-53
_PER_CORRELATION = 128  # grid points of turbulence per correlation time
_RUN = 256  # grid points computed at once
_WARM_UP = 10 * _PER_CORRELATION  # what came earlier has faded to exp(-10)


@cache
def _normal_quantile() -> Callable[[NDArray[np.float64]], NDArray[np.float64]]:
    """Inverse of the normal distribution; it loads for a third of a second, and nodes without a mock need none."""
    from scipy.special import ndtri

    return cast("Callable[[NDArray[np.float64]], NDArray[np.float64]]", ndtri)


@dataclass(frozen=True)
class Noise:
    """Stream of random numbers with random access: number `i` is the same whenever, wherever and with whom it is drawn.

    The numbers come from the counter-based generator Philox 4x64 (Salmon et al. 2011, "Parallel random numbers: as easy
    as 1, 2, 3", doi:10.1145/2063384.2063405), keyed by a digest of seed and name.

    Attributes:
        seed: seed of the whole plant.
        name: what the noise is for; other names give independent numbers.
    """

    seed: int
    name: str

    def __post_init__(self) -> None:
        _normal_quantile()  # not when the first sample is due

    @cached_property
    def _key(self) -> int:
        return int.from_bytes(hashlib.blake2b(f"{self.seed}/{self.name}".encode(), digest_size=16).digest(), "little")

    def uniform(self, first: int, count: int) -> NDArray[np.float64]:
        """(count,) numbers with the indices from `first` (may be negative), uniform in the open interval (0, 1)."""
        start, skip = divmod(first, _COUNTER)
        generator = np.random.Philox(key=self._key, counter=start % 2**256)
        words = generator.random_raw(skip + count)[skip:]
        return np.asarray(((words >> np.uint64(11)) + 0.5) * _MANTISSA, dtype=np.float64)

    def normal(self, first: int, count: int) -> NDArray[np.float64]:
        """(count,) numbers with the indices from `first`, of standard normal distribution."""
        return np.asarray(_normal_quantile()(self.uniform(first, count)), dtype=np.float64)

    def generator(self) -> np.random.Generator:
        """Generator for a draw that is made as a whole, such as the phases of a plant."""
        return np.random.Generator(np.random.Philox(key=self._key))


@dataclass(frozen=True)
class TurbulenceCourse:
    """Slow noise of standard deviation 1 with the autocorrelation `exp(-|lag| / correlation_time)`, a function of time.

    A first-order autoregressive sequence stands on a grid of 1/128 of the correlation time, computed in whole aligned
    runs so that no value depends on what else was asked for; between grid points it is interpolated linearly.
    """

    noise: Noise
    correlation_time: float

    def at(self, time: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n,) values at the ascending times (n,) in s."""
        place = time * (_PER_CORRELATION / self.correlation_time)
        cell = np.floor(place).astype(np.int64)
        first, last = int(cell[0]) // _RUN, (int(cell[-1]) + 1) // _RUN
        grid = np.concatenate([_run(self.noise, index) for index in range(first, last + 1)])
        before = grid[cell - first * _RUN]
        after = grid[cell - first * _RUN + 1]
        return np.asarray(before + (place - cell) * (after - before), dtype=np.float64)


@lru_cache(maxsize=16)
def _run(noise: Noise, index: int) -> NDArray[np.float64]:
    """Run `index` of the grid; kept, because live blocks are much shorter than a run."""
    from scipy.signal import lfilter  # loads for a second or two, and most stages have no turbulence

    decay = np.exp(-1 / _PER_CORRELATION)
    drive = noise.normal(index * _RUN - _WARM_UP, _WARM_UP + _RUN)
    return np.asarray(lfilter([np.sqrt(1 - decay**2)], [1, -decay], drive)[_WARM_UP:], dtype=np.float64)
