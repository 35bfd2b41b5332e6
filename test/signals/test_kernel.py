"""The compiled form of blocks, admission and resampling against numpy's, to the last bit, on drawn streams."""

from __future__ import annotations

import numpy as np
import pytest
from kernels import computing_by, is_built

from rotary_error_monitor.signals.admission import SampleLimits
from rotary_error_monitor.signals.blocks import SampleBlock
from rotary_error_monitor.signals.kernel import chosen_kernel
from rotary_error_monitor.signals.resampling import Resampled, count_decided, resample_all, tick_times
from rotary_error_monitor.signals.streams import SampleStream
from rotary_error_monitor.units import TURN

pytestmark = pytest.mark.skipif(not is_built(), reason="the library was not compiled")

EPOCH = 1_764_000_000_000_000_000
PERIOD = 1_000_000
COLUMNS = ("values", "gain", "travel", "bend", "valid")


def drawn_times(rng: np.random.Generator) -> np.ndarray:
    """Rising stamps at 100 to 200,000 samples a second, with jitter, gaps, or none at all."""
    count = int(rng.choice([0, 1, 2, 3, 4, 5, 7, 40, 300, 3000]))
    step = 1e9 / 10.0 ** rng.uniform(2.0, 5.3)
    steps = np.maximum(1, step * (1.0 + rng.choice([0.0, 0.1, 0.9]) * rng.uniform(-1.0, 1.0, count)))
    steps[rng.random(count) < rng.choice([0.0, 0.01])] *= rng.uniform(1.0, 50.0)
    return EPOCH + np.cumsum(steps).astype(np.int64)


def assert_same_bits(one: Resampled, other: Resampled) -> None:
    for name in COLUMNS:
        mine, its = getattr(one, name), getattr(other, name)
        assert mine.shape == its.shape and mine.dtype == its.dtype
        assert mine.tobytes() == its.tobytes(), name


@pytest.mark.parametrize("seed", range(60))
def test_values_at_ticks_have_the_bits_of_numpy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    signals = []
    for _ in range(rng.integers(1, 7)):
        times = drawn_times(rng)
        values = 10.0 ** rng.uniform(-6, 4) + rng.normal(size=(len(times), rng.integers(1, 4)))
        signals.append((times, values))
    period = int(rng.choice([PERIOD, 200_001, 10_000_000]))
    ticks = tick_times(EPOCH // period - 3, int(rng.choice([0, 1, 5, 37])), period)
    gap = int(rng.choice([0, 2_000_000, 40_000_000]))
    found = []
    for form in ("compiled", "numpy"):
        with computing_by(form):
            found.append(resample_all(signals, ticks, period, gap))
    for one, other in zip(*found, strict=True):
        assert_same_bits(one, other)


@pytest.mark.parametrize("seed", range(30))
def test_as_many_ticks_are_decided(seed: int) -> None:
    rng = np.random.default_rng(seed)
    times = drawn_times(rng)
    period = int(rng.choice([PERIOD, 200_001, 10_000_000]))
    first, ticks = int(times.mean()) // period if len(times) else 0, int(rng.integers(0, 40))
    found = []
    for form in ("compiled", "numpy"):
        with computing_by(form):
            found.append(
                [count_decided(times[:n], first, ticks, period) for n in range(0, len(times), 1 + len(times) // 50)]
            )
    assert found[0] == found[1]


@pytest.mark.parametrize("rows", ["columns", "read-only", "float32"])
def test_arrays_that_do_not_lie_in_one_piece_give_the_same(rows: str) -> None:
    rng = np.random.default_rng(3)
    times = EPOCH + np.arange(500) * 20_000
    values = rng.normal(size=(500, 2))
    given = {"columns": np.asfortranarray(values), "read-only": values.copy(), "float32": values.astype(np.float32)}[
        rows
    ]
    given.flags.writeable = rows != "read-only"
    ticks = tick_times(EPOCH // PERIOD, 8, PERIOD)
    with computing_by("compiled"):
        one = resample_all([(times, given)], ticks, PERIOD, 0)[0]
    with computing_by("numpy"):
        other = resample_all([(times, given)], ticks, PERIOD, 0)[0]
    assert_same_bits(one, other)


def drawn_blocks(rng: np.random.Generator, width: int) -> list[SampleBlock]:
    """Blocks of any size that begin on one another, now and then with what is not to be believed."""
    names = ("t", *(f"v{i}" for i in range(width)))
    period = int(rng.choice([20_000, 500_000, 5_000_000]))
    angle, blocks, stamp = 0.0, [], EPOCH
    for _ in range(40):
        count = int(rng.choice([1, 2, 14, 15, 16, 250]))
        t = np.arange(count) * period * 1e-9
        rows = np.column_stack([t, *(angle + 3.0 * t + 1e-7 * rng.normal(size=count) for _ in range(width))])
        angle += 3.0 * count * period * 1e-9
        kind = rng.integers(14)
        place, column = rng.integers(count), 1 + rng.integers(width)
        if kind == 0:
            rows[place, column] = rng.choice([np.nan, np.inf, 1e9, 1e-3, TURN, angle + TURN])
        elif kind == 1:
            rows[place, 0] = rng.choice([-1.0, 0.0, 1e-3, 5.0])
        elif kind == 2:
            angle -= TURN * rng.integers(-2, 3)
        elif kind == 3:
            stamp -= int(rng.integers(0, 2 * period))
        elif kind == 4:
            stamp += int(rng.integers(0, 40 * period))
        blocks.append(SampleBlock(stamp, names, rows))
        stamp += count * period
    return blocks


LIMITS = {
    "angle": SampleLimits(largest=1e7, speed=10.0, turns=True, jitter=1e-3),
    "tilt": SampleLimits(largest=1e4, noise=5e-7),
    "both": SampleLimits(largest=1e4, speed=10.0, jitter=1e-3, noise=5e-7),
    "any": SampleLimits(),
}


def taken_in(
    blocks: list[SampleBlock], limits: SampleLimits, untils: list[int | None], turns: list[int]
) -> list[tuple[object, ...]]:
    """What a stream says of itself after each block."""
    width = max(1, len(blocks[0].names) - 2)  # of three fields the last one is not of the stream
    stream, found = SampleStream(blocks[0].names[1 : 1 + width], 50_000_000, limits), []
    for i, (block, until, turned) in enumerate(zip(blocks, untils, turns, strict=True)):
        count = stream.push(SampleBlock(block.stamp_ns, block.names, block.rows.copy()), until)
        if turned:
            stream.turn_by(turned)
        if i % 7 == 6 and stream.newest_ns is not None:
            stream.trim(stream.newest_ns - 3_000_000)
        admission = stream.admission
        found.append(
            (
                count,
                stream.times_ns.tobytes(),
                stream.values.tobytes(),
                stream.spacing_ns,
                stream.block_duration_ns,
                stream.lost,
                stream.begin_ns,
                dict(admission.refused),
                admission.refusals.tobytes(),
                admission.wraps,
                stream.newest_ns,
            )
        )
    return found


@pytest.mark.parametrize("kind", LIMITS)
@pytest.mark.parametrize("seed", range(25))
def test_a_stream_takes_in_the_same_samples(kind: str, seed: int) -> None:
    rng = np.random.default_rng([seed, *kind.encode()])
    blocks = drawn_blocks(rng, int(rng.integers(1, 4)))
    newest = [block.stamp_ns + int(block.rows[-1, 0] * 1e9) for block in blocks]
    untils = [rng.choice([None, n + 1_000_000, n - 1_000_000], p=[0.45, 0.5, 0.05]) for n in newest]
    turns = (
        rng.choice([0, 0, 0, 0, 0, 0, 0, 0, 0, -1, 2], len(blocks)).tolist() if kind == "angle" else [0] * len(blocks)
    )
    found = []
    for form in ("compiled", "numpy"):
        with computing_by(form):
            found.append(taken_in(blocks, LIMITS[kind], untils, turns))
    assert found[0] == found[1]


def test_a_stream_without_faults_is_copied_by_the_library(monkeypatch: pytest.MonkeyPatch) -> None:
    """Or the test above would hold numpy against numpy."""
    with computing_by("compiled"):
        kernel = chosen_kernel()
        assert kernel is not None
        calls, admit = [], kernel.admit
        monkeypatch.setattr(kernel, "admit", lambda *given: calls.append(admit(*given)) or calls[-1])
        for name, limits in LIMITS.items():
            stream = SampleStream(("a", "b"), 50_000_000, limits)
            for i in range(8):
                t = np.arange(250) * 2e-5
                rows = np.column_stack([t, 3.0 * (t + 5e-3 * i), np.zeros(250)])
                assert stream.push(SampleBlock(EPOCH + 5_000_000 * i, ("t", "a", "b"), rows)) == 250, name
    assert calls == [True] * 8 * len(LIMITS)


@pytest.mark.parametrize("seed", range(20))
def test_stamps_have_the_bits_of_numpy(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(int(rng.choice([1, 2, 5, 250])), 3)) * 10.0 ** rng.uniform(-9, 8, 1)
    rows[rng.random(len(rows)) < 0.2, 0] = (rng.integers(-5, 5) + 0.5) * 1e-9  # halves are rounded to even ones
    found = []
    for form in ("compiled", "numpy"):
        with computing_by(form):
            block = SampleBlock(EPOCH, ("t", "x", "y"), rows)
            found.append((block.times_ns.tobytes(), block.newest_ns))
    assert found[0] == found[1]


def test_a_time_that_is_not_finite_is_numpys() -> None:
    rows = np.array([[0.0, 1.0], [np.nan, 2.0]])
    found = []
    for form in ("compiled", "numpy"):
        with computing_by(form), pytest.warns(RuntimeWarning, match="invalid value"):
            found.append(SampleBlock(EPOCH, ("t", "x"), rows).times_ns.tolist())
    assert found[0] == found[1]
