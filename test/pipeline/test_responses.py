"""Instruments with zero, sign, gain, axes and delay of their own: the estimator says what it says of ideal ones."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from motion_numbers import assert_same_bits
from pushed_inputs import push_block

from rotary_error_monitor.bags.writer import write_messages
from rotary_error_monitor.description.response import Response
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.description.wire import wire_of
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.metrology.error_motion import ErrorMotion
from rotary_error_monitor.mock_cell.figures import reference_comparisons
from rotary_error_monitor.mock_cell.recorded import RecordedTopics
from rotary_error_monitor.pipeline.estimation import Estimator
from rotary_error_monitor.plant import StagePlant
from rotary_error_monitor.recordings.replay import replay_bag
from rotary_error_monitor.signals.blocks import block_from_samples

EPOCH = 1_763_700_000_000_000_000
IDEAL = load_stage()
RESPONSES = {
    "head_a": Response((2.7,)),
    "head_b": Response((-1.9,), -1.0),
    "head_c": Response((5.1,), latency=3e-4),
    "head_d": Response((0.4,), -1.0),
    "autocollimator": Response((2e-5, -3e-5), 1.02, math.radians(12), 2e-3),
    "lvdt": Response((1e-5, -2e-5), -0.98, 0.4, 1e-3),
    "command": Response((1.3, 0.0), -1.0, latency=4e-3),
}
OWN = replace(IDEAL, responses=RESPONSES)
SEEN = [0, 1, 3, 4, 5]
"""All components but the axial one, which no instrument of this stage sees."""


def recorded(stage, seed, duration, streams):
    """The plant and blocks of each stream, in the order in which they would come."""
    plant, found = StagePlant(stage, seed, EPOCH), []
    for name in streams:
        last = plant.index_at(name, EPOCH + round(duration * 1e9))
        found += [(name, plant.samples(name, k, min(50, last - k))) for k in range(0, last, 50)]
    return plant, sorted(found, key=lambda pair: int(pair[1].times_ns[-1]))


def estimated(made, known=None, seed=0, duration=12.0):
    """Estimator and error motion of what a stage `made` shows to one that is `known`; its error beside the truth."""
    estimator = Estimator(known or made)
    plant, pairs = recorded(made, seed, duration, estimator.inputs)
    out = [made for name, block in pairs for made in push_block(estimator, name, block)] + estimator.finish()
    motion = ErrorMotion.joined(out)
    truth = plant.scene((motion.times_ns - EPOCH) * 1e-9).error_motion
    return estimator, motion, (motion.components - truth)[:, SEEN]


def rms(values):
    return np.sqrt(np.mean(values**2, axis=0))


@pytest.mark.parametrize("seed", range(3))
def test_error_motion_is_that_of_ideal_instruments(seed):
    """Both are noise away from the truth and from one another, and nothing that goes round with the axis is left."""
    _, ideal, off = estimated(IDEAL, seed=seed)
    estimator, own, error = estimated(OWN, seed=seed)
    assert not list(estimator.reasons) and not estimator.status.saturated
    assert len(own.theta) > 0.998 * len(ideal.theta)
    np.testing.assert_allclose(rms(error), rms(off), rtol=0.05)
    assert (rms(error) < [5e-8, 5e-8, 5e-7, 5e-7, 4e-7]).all()
    _, i, j = np.intersect1d(ideal.times_ns, own.times_ns, return_indices=True)
    between = (ideal.components[i] - own.components[j])[:, SEEN]
    assert (rms(between) < [7e-8, 7e-8, 7e-7, 7e-7, 5e-7]).all()
    for order in range(4):
        left = np.abs(np.mean(between * np.exp(1j * order * ideal.theta[i, None]), axis=0))
        assert (left < [5e-9, 5e-9, 5e-8, 5e-8, 5e-8]).all(), (order, left)


@pytest.mark.parametrize(
    ("stream", "wrong", "told"),
    [
        ("head_b", Response((-1.9,)), "head_b"),
        ("head_d", Response((0.41,), -1.0), "head_d"),
        ("autocollimator", Response((2e-5, -3e-5), -1.02, math.radians(12), 2e-3), "autocollimator"),
        ("command", Response((1.3, 0.0), latency=4e-3), "command"),
        ("command", Response((1.3, 0.0), -1.0), "command"),
    ],
    ids=["sign", "zero", "gain", "command's sign", "command's latency"],
)
def test_a_response_that_is_described_wrongly_is_told(stream, wrong, told):
    estimator, *_ = estimated(OWN, replace(OWN, responses={**RESPONSES, stream: wrong}))
    assert told in dict(estimator.reasons)


def test_a_replay_repeats_the_bits_and_the_lvdt_agrees(tmp_path):
    streams = (*Estimator(OWN).inputs, "lvdt")
    _, pairs = recorded(OWN, 5, 6.0, streams)
    wire, bag = wire_of(OWN), tmp_path / "bag"
    write_messages(bag, {wire.of_stream(s).name: [b for name, b in pairs if name == s] for s in streams}, wire)
    replayed = replay_bag(bag, OWN)
    _, motion, _ = estimated(OWN, seed=5, duration=6.0)
    assert_same_bits(replayed.motion, motion)
    assert np.array_equal(np.isnan(replayed.error_motion), ~motion.observable), "what cannot be observed is NaN there"
    assert np.array_equal(np.nan_to_num(replayed.error_motion), motion.components)
    height = OWN.lvdt.height
    whole = SimpleNamespace(heights=[(height, EPOCH, EPOCH + 6_000_000_000)])
    found = dict(reference_comparisons(whole, RecordedTopics(bag, [wire.topic("lvdt_samples")]), wire, OWN, replayed))[
        height
    ]
    assert len(found.stamp_ns) > 3000 and found.rms < 0.1e-6


def test_arrivals_are_held_against_the_time_that_samples_are_of():
    stage = replace(IDEAL, responses={"head_a": Response((0.0,), latency=0.9)})
    block = block_from_samples(EPOCH + np.arange(5) * 1_000_000, ("angle",), np.zeros((5, 1)))
    with pytest.raises(InputError, match="too old at arrival"):
        Estimator(stage).accept("head_a", block, int(block.times_ns[-1]) + 200_000_000)
    Estimator(stage).accept("head_b", block, int(block.times_ns[-1]) + 200_000_000)
    with pytest.raises(InputError, match="stamped in the future"):
        Estimator(stage).accept("head_b", block, EPOCH - 500_000_000)
    Estimator(stage).accept("head_a", block, EPOCH - 500_000_000)


def test_a_sample_at_the_end_of_what_the_instrument_reads_is_left_out():
    most = IDEAL.autocollimator.range
    response = Response((0.5 * most, 0.0))
    estimator = Estimator(replace(IDEAL, responses={"autocollimator": response}))
    readings = np.array([[0.0, 0.0], [most, 0.0], [-0.9 * most, 0.0]])
    times = EPOCH + np.arange(3) * 1_000_000
    estimator.accept("autocollimator", block_from_samples(times, ("tilt_x", "tilt_y"), readings))
    at_its_end = estimator.status.saturated.total()
    assert at_its_end == 1, "a tilt of half of the range is at its end, one of 1.4 ranges is not"
