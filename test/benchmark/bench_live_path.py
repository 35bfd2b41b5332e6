"""What estimator and compensation spend a set of blocks on, step by step, without DDS and other processes.

Prepared messages are handed to the nodes' own callbacks. Times are those of the processor, of the rounds that took no
more than the median, so that other processes disturb little. BENCH_SETS (3000).
"""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from benchmark.live_feed import Feed, Stopwatch, feed

from rotary_error_monitor.codec.cdr_blocks import BlockDecoder
from rotary_error_monitor.metrology.error_motion import ErrorMotion
from rotary_error_monitor.nodes import compensation, error_estimator, messages
from rotary_error_monitor.nodes.diagnostics import StreamWatch
from rotary_error_monitor.pipeline import estimation
from rotary_error_monitor.pipeline.belief import Belief
from rotary_error_monitor.pipeline.compensation import Compensator
from rotary_error_monitor.pipeline.corrections import CorrectionMaker
from rotary_error_monitor.pipeline.estimation import Estimator
from rotary_error_monitor.pipeline.input_checks import InputChecks
from rotary_error_monitor.pipeline.joints import JointTrack
from rotary_error_monitor.pipeline.live_components import Carrier
from rotary_error_monitor.pipeline.offset_spread import OffsetSpread
from rotary_error_monitor.pipeline.publication import Publication
from rotary_error_monitor.pipeline.ticks import TickMaker
from rotary_error_monitor.signals.admission import Admission
from rotary_error_monitor.signals.streams import SampleStream

SETS = int(os.environ.get("BENCH_SETS", "3000"))
LIVE_AFTER = 1000
"""Sets before which nothing is counted: the stage's description is held against a turn of 4 s first."""

ROUND = 20
"""Sets after which all that is done at a lower rate, down to reports at 20 Hz, has been done equally often."""

STEPS: dict[str, list[tuple[Any, str]]] = {
    "decoding": [(BlockDecoder, "decode"), (compensation, "error_motion_from_block")],
    "watching the streams": [(StreamWatch, "observe"), (StreamWatch, "observe_stamp")],
    "checking arrival and range": [(Estimator, "accept")],
    "checking samples": [(Admission, "admit")],
    "joining samples to their stream": [(SampleStream, "push"), (SampleStream, "trim")],
    "which ticks are decided": [(Estimator, "_decided_until")],
    "values at the ticks": [(estimation, "resample_all")],
    "error motion": [(TickMaker, "make_each")],
    "judging windows": [(Belief, "assess")],
    "what may go out": [(Publication, "finish"), (ErrorMotion, "at")],
    "joint states": [(JointTrack, "push"), (JointTrack, "at"), (JointTrack, "trim")],
    "checking inputs": [(InputChecks, "judge")],
    "components of the axis": [(Carrier, "components")],
    "offsets and corrections": [(CorrectionMaker, "_solve")],
    "limits of corrections": [(CorrectionMaker, "_correct")],
    "uncertainty for reports": [(OffsetSpread, "at"), (CorrectionMaker, "_report")],
    "joining ticks and inputs": [(Estimator, "advance"), (Compensator, "advance")],
    "encoding": [
        (error_estimator, "block_from_error_motion"),
        *((messages, name) for name in ("block_bytes", "joint_state_message", "pose_message", "figures_message")),
    ],
}


def publishers(given: Feed) -> list[Any]:
    estimator, output = given.estimator, given.compensation._output
    own = (estimator._sample_publisher, estimator._pose_publisher, estimator._figures_publisher)
    return [*own, *output._outputs.values()]


def quiet_means(spent: list[dict[str, float]]) -> tuple[dict[str, float], float]:
    """Mean of each step, and of all, a set, over the rounds that took no more than the median, s."""
    names = sorted({name for each in spent for name in each})
    table = np.array([[each.get(name, 0.0) for name in names] for each in spent])
    rounds = table[: len(table) // ROUND * ROUND].reshape(-1, ROUND, len(names)).mean(axis=1)
    totals = rounds.sum(axis=1)
    means = rounds[totals <= np.median(totals)].mean(axis=0)
    return dict(zip(names, means.tolist(), strict=True)), float(means.sum())


@pytest.mark.parametrize("rate", [10_000.0, 50_000.0, 200_000.0])
def test_steps_of_a_set_of_blocks(rate: float, monkeypatch: pytest.MonkeyPatch) -> None:
    watch = Stopwatch()
    for name, places in STEPS.items():
        for owner, attribute in places:
            monkeypatch.setattr(owner, attribute, watch.timed(name, getattr(owner, attribute)))
    spent: dict[str, list[dict[str, float]]] = {"error_estimator": [], "compensation": []}
    with feed(rate) as given:
        for publisher in publishers(given):
            publisher.publish = watch.timed("publishing, nobody listening", publisher.publish)
        for number, deliveries in enumerate(given.sets(LIVE_AFTER + SETS)):
            for name, deliver in zip(spent, deliveries, strict=True):
                watch.spent = {}
                handle(watch, deliver)
                if number >= LIVE_AFTER:
                    spent[name].append(watch.spent)
        assert not given.compensation._compensator.hold
        assert given.estimator._estimator.status.estimates > 5 * SETS
    for name, each in spent.items():
        means, total = quiet_means(each)
        print(f"\n{name}: a set of six blocks of 5 ms at {rate:.0f} samples a second, {total * 1e6:.0f} µs")
        for step, took in sorted(means.items(), key=lambda item: -item[1]):
            print(f"  {step:36} {took * 1e6:7.1f} µs  {took / total:6.1%}")


def handle(watch: Stopwatch, deliver: Callable[[], None]) -> None:
    watch.timed("handing over, and what is left", deliver)()
