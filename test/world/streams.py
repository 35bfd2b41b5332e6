"""From a signal to sample blocks: sample clock, stamps, cutting into blocks, arrival and loss."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.signals.blocks import SampleBlock

from .noise import drawn_log
from .options import Options, Seeds

Array = NDArray[np.float64]
Times = NDArray[np.int64]
LONGEST = 200  # samples in a block
PERIODS = (2e-3, 0.2)  # s, of blocks
WANDER = 1e-5  # highest rate at which a disciplined clock wanders


@dataclass(frozen=True)
class Stream:
    """The clocks of one topic.

    Attributes:
        topic: its name.
        rate: actual samples per second of true time.
        phase: time in s of the first sample.
        offset: constant error of stamps in s.
        drift: relative drift of stamps.
        wander: amplitude in s, pulsation in rad/s and phase of the slow error of stamps.
        seeds: of all that follows.
    """

    topic: str
    rate: float
    phase: float
    offset: float
    drift: float
    wander: tuple[float, float, float]
    seeds: Seeds

    def generator(self, name: str) -> np.random.Generator:
        """Generator of one habit of the stream."""
        return self.seeds.generator(f"{self.topic}/{name}")

    def times(self, duration: float) -> Array:
        """(n,) true time in s since the begin of each sample."""
        return self.phase + np.arange(max(1, int((duration - self.phase) * self.rate))) / self.rate

    def stamped(self, times: Array, jitter: float) -> Array:
        """(n,) what the stream's clock says at the true `times`."""
        size, pulsation, phase = self.wander
        error = self.offset + self.drift * times
        if size:
            error += size * np.sin(pulsation * times + phase)
        if jitter:
            limit = min(0.3 / self.rate, 5.0 * jitter)
            error += np.clip(jitter * self.generator("jitter").standard_normal(len(times)), -limit, limit)
        return np.asarray(times + error, float)


def make_stream(seeds: Seeds, topic: str, rate: float, options: Options) -> Stream:
    """Clocks of a topic, drawn from its own generator."""
    rng = seeds.generator(f"{topic}/clock")
    rate = options.rates.get(topic, rate)
    size = options.clock_wander * rng.uniform(0.3, 1.5)
    slope = WANDER * rng.uniform(0.2, 1.0)
    return Stream(
        topic=topic,
        rate=rate * (1.0 + options.sampling_drift * rng.standard_normal()),
        phase=rng.uniform(0.0, 1.0) / rate,
        offset=options.clock_offset * rng.standard_normal(),
        drift=options.clock_drift * rng.standard_normal(),
        wander=(size, min(slope / size, 60.0) if size else 0.0, rng.uniform(0.0, 2.0 * np.pi)),
        seeds=seeds,
    )


def make_blocks(
    stream: Stream, times: Array, values: Array, names: tuple[str, ...], start_ns: int, options: Options
) -> tuple[list[SampleBlock], Times]:
    """Blocks of the samples `values` (n, k) taken at the true `times` (n,), and the arrival (ns) of each block."""
    ns = start_ns + np.rint(stream.stamped(times, options.stamp_jitter) * 1e9).astype(np.int64)
    lengths = _lengths(stream.generator("cutting"), len(times), stream.rate, options)
    ends = np.cumsum(lengths)
    begins = ends - lengths
    stamps = ns[begins]
    rng = stream.generator("stamps")
    if options.early_stamps and rng.uniform() < 0.5:
        stamps = stamps - rng.integers(0, int(0.8e9 / stream.rate) + 1, len(stamps))
    rows = np.column_stack([(ns - np.repeat(stamps, lengths)) * 1e-9, values])
    blocks = [
        SampleBlock(stamp, names, rows[begin:end])
        for stamp, begin, end in zip(stamps.tolist(), begins.tolist(), ends.tolist(), strict=True)
    ]
    rng = stream.generator("arrival")
    latency = drawn_log(rng, 1e-4, 3e-3) + rng.exponential(2e-4, len(blocks))
    arrivals = np.maximum.accumulate(start_ns + np.rint((times[ends - 1] + latency) * 1e9).astype(np.int64))
    if options.lost_blocks:
        kept = np.flatnonzero(stream.generator("loss").uniform(size=len(blocks)) >= options.lost_blocks)
        return [blocks[i] for i in kept], arrivals[kept]
    return blocks, arrivals


def _lengths(rng: np.random.Generator, n: int, rate: float, options: Options) -> NDArray[np.int64]:
    """Lengths of the blocks that hold `n` samples: 1 to 200 samples and, but for single samples, at most 200 ms."""
    drawn = drawn_log(rng, *PERIODS)
    period = options.block_period or drawn
    longest = int(np.clip(PERIODS[1] * rate, 1, LONGEST))
    mean = float(np.clip(period * rate, 1, longest))
    style = str(rng.choice(("nearly even", "uniform", "bursts"))) if options.uneven_blocks else "even"
    count = int(3 * n / mean) + 20
    if style == "uniform":
        lengths = rng.integers(1, max(2, round(2 * mean)), count)
    elif style == "bursts":
        lengths = np.where(rng.uniform(size=count) < 0.05, rng.integers(1, longest + 1, count), round(mean))
    else:
        lengths = np.full(count, round(mean))
        if style == "nearly even":
            lengths += rng.integers(-1, 2, count)
    ends = np.cumsum(np.clip(lengths, 1, longest))
    ends = np.append(ends[ends < n], n)
    return np.diff(ends, prepend=0)
