"""Recordings of instruments that are slower than `max_gap`: what was live is repeated, and else it is said."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from mock_bags import EPOCH_NS
from pushed_inputs import push_block

from rotary_error_monitor import analyse, estimate
from rotary_error_monitor.bags.writer import write_messages
from rotary_error_monitor.cli import main
from rotary_error_monitor.codec.error_motion_blocks import block_from_error_motion
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.description.topics import samples_topic
from rotary_error_monitor.description.wire import load_wire
from rotary_error_monitor.pipeline.estimation import Estimator
from rotary_error_monitor.pipeline.estimator_settings import EstimatorSettings
from rotary_error_monitor.recordings.replay import replay_bag
from rotary_error_monitor.recordings.stage_check import check_stage
from rotary_error_monitor.signals.blocks import block_from_samples
from rotary_error_monitor.sources.mock import MockSettings, mock_stage

STREAMS = (*(f"head_{head}" for head in "abcd"), "autocollimator", "command")
RATE, SECONDS, PERIOD_NS = 500, 5, 4_000_000
MOTION = load_wire().topic("error_motion_samples")


def samples_of(seed, every):
    """Blocks of each stream of a stage that turns at 4 rad/s; of every so many samples one is kept."""
    plant = mock_stage(load_stage(), MockSettings(seed, EPOCH_NS, (4.0,), forces=False, rate=float(RATE)))
    found = {}
    for stream in STREAMS:
        whole = plant.samples(stream, 0, RATE * SECONDS)
        step = every.get(stream, 1)
        times, names = whole.times_ns[::step], whole.names[1:]
        values, size = whole.columns(names)[::step], max(1, 20 // step)
        edges = [*range(0, len(times), size), len(times)]
        found[stream] = [block_from_samples(times[a:b], names, values[a:b]) for a, b in itertools.pairwise(edges)]
    return found


def published(blocks, max_gap_ns):
    """What an estimator publishes of these blocks as they come, live."""
    estimator = Estimator(load_stage(), EstimatorSettings(period_ns=PERIOD_NS, max_gap_ns=max_gap_ns))
    in_order = sorted(((b.newest_ns, name, b) for name, each in blocks.items() for b in each), key=lambda x: x[:2])
    parts = [part for _, name, block in in_order for part in push_block(estimator, name, block)]
    return [*parts, *estimator.finish()]


def recorded(folder, blocks, live=()):
    contents = {samples_topic(name): each for name, each in blocks.items()}
    if live:
        contents[MOTION.name] = [block_from_error_motion(part, MOTION.columns) for part in live]
    write_messages(folder, contents)
    return folder


@pytest.mark.parametrize("seed", [3, 4])
@pytest.mark.parametrize(
    "every", [{"autocollimator": 13}, {f"head_{head}": 13 for head in "abcd"}, dict.fromkeys(STREAMS, 17)]
)
def test_a_live_run_that_joined_more_is_repeated_bit_for_bit(tmp_path, seed, every):
    """Samples 26 and 34 ms apart with `max_gap` at 60 ms: the bag tells which were used, not that number."""
    blocks = samples_of(seed, every)
    live = published(blocks, 60_000_000)
    result = replay_bag(recorded(tmp_path / "bag", blocks, live), load_stage())
    assert result.is_complete
    np.testing.assert_array_equal(result.stamp_ns, np.concatenate([part.times_ns for part in live]))
    np.testing.assert_array_equal(result.motion.components, np.concatenate([part.components for part in live]))
    np.testing.assert_array_equal(result.motion.covariance, np.concatenate([part.covariance for part in live]))
    late = slice(len(result) // 2, -50)  # the last samples have none behind them
    assert result.motion.observable[late][:, [0, 1, 3, 4]].all()


def test_what_a_live_run_did_not_join_stays_so(tmp_path):
    """The autocollimator's samples are 26 ms apart, `max_gap` was 20 ms."""
    blocks = samples_of(3, {"autocollimator": 13})
    live = published(blocks, 20_000_000)
    result = replay_bag(recorded(tmp_path / "bag", blocks, live), load_stage())
    assert result.is_complete
    np.testing.assert_array_equal(result.motion.components, np.concatenate([part.components for part in live]))
    assert not result.motion.observable[:, 3:5].any()


@pytest.fixture(scope="module")
def slow(tmp_path_factory):
    """Recording of drivers alone, the autocollimator at 25 samples a second."""
    return recorded(tmp_path_factory.mktemp("slow") / "bag", samples_of(5, {"autocollimator": 20}))


SAID = "samples of autocollimator are 40 ms apart; what is further apart than max_gap of 25 ms is not joined; "


def test_every_command_says_that_a_stream_is_not_joined_and_by_what_it_is(slow, tmp_path, capsys):
    out = str(tmp_path / "out.npz")
    for words in (["replay", "-o", out], ["analyse", "-o", str(tmp_path / "out.json")], ["check"]):
        assert main([words[0], str(slow), *words[1:]]) == 0
        told = capsys.readouterr()
        assert SAID + "--max-gap-ms joins more" in told.err + told.out
        assert main([words[0], str(slow), *words[1:], "--max-gap-ms", "90"]) == 0
        told = capsys.readouterr()
        assert "not joined" not in told.err + told.out
        for wrong in ("0.09", "1001", "nan"):
            assert main([words[0], str(slow), *words[1:], "--max-gap-ms", wrong]) == 2
            assert f"--max-gap-ms is {float(wrong)}; it must be from 0.1 to 1000" in capsys.readouterr().err
    with np.load(tmp_path / "out.npz") as found:
        assert np.isfinite(found["error_motion"][:, [3, 4]]).mean() > 0.95


def test_an_instrument_that_is_joined_gives_as_good_a_tilt_as_a_fast_one(slow, tmp_path):
    """Against the same stage at 500 samples a second, after the turn that verifies the description."""
    fast = estimate(recorded(tmp_path / "bag", samples_of(5, {})))
    found = estimate(slow, max_gap=0.09)
    _, here, there = np.intersect1d(found.stamp_ns, fast.stamp_ns, return_indices=True)
    late = here[found.stamp_ns[here] > EPOCH_NS + 3_000_000_000]
    there = there[-len(late) :]
    differences = found.error_motion[late][:, 3:5] - fast.error_motion[there][:, 3:5]
    sigma = np.hypot(found.sigma[late][:, 3:5], fast.sigma[there][:, 3:5])
    seen = np.isfinite(differences)
    assert seen.mean() > 0.9
    assert (np.abs(differences[seen]) < 1.96 * sigma[seen]).mean() >= 0.9
    assert check_stage(slow, load_stage(), settings=EstimatorSettings(max_gap_ns=90_000_000)).fits
    tilts = analyse(slow, max_gap=0.09).to_dataframe().query("unit == 'rad' and quantity.str.startswith('tilt')")
    assert len(tilts) and (tilts["U95"] < 5e-6).all()
