"""What it costs to doubt every sample, beside the estimate itself and beside the filter that one would try first."""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
import pytest
from described_stages import stage_of
from faults.judging import stream_of
from pushed_inputs import push_block
from scipy.ndimage import median_filter
from world import Options, make_recording, random_stage
from world.recording import AUTOCOLLIMATOR, COMMAND

from rotary_error_monitor.pipeline.belief import Belief
from rotary_error_monitor.pipeline.estimation import Estimator
from rotary_error_monitor.signals.admission import Admission

DURATION = 4.0
HAMPEL_WINDOW = 7
"""Samples that a Hampel filter takes the median of, as its textbooks and toolboxes do."""


class Stopwatch:
    """Time that calls of some functions take, s."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self._patch, self.spent = monkeypatch, 0.0

    def on(self, owner: type, name: str) -> None:
        called: Callable[..., object] = getattr(owner, name)

        def timed(*arguments: object) -> object:
            begin = time.perf_counter()
            try:
                return called(*arguments)
            finally:
                self.spent += time.perf_counter() - begin

        self._patch.setattr(owner, name, timed)


def hampel(values: np.ndarray) -> np.ndarray:
    """Rows without what stands off by more than three scaled median absolute deviations."""
    size = (HAMPEL_WINDOW, 1)
    middle = median_filter(values, size)
    spread = 1.4826 * median_filter(np.abs(values - middle), size)
    return np.where(np.abs(values - middle) > 3 * spread, middle, values)


@pytest.mark.parametrize("rate", [1_000.0, 10_000.0, 50_000.0])
def test_what_belief_costs(rate, monkeypatch):
    section = random_stage(4)
    heads = [f"/stage/head_{name}/samples" for name in section["encoder"]["heads"]]
    options = Options(motion="steady", odd_rates=False, rates=dict.fromkeys([*heads, AUTOCOLLIMATOR, COMMAND], rate))
    recording = make_recording(4, duration=DURATION, stage=section, options=options)
    streams = [(a, stream_of(t), b) for a, t, b in recording.timeline() if stream_of(t) is not None]
    admission, belief = Stopwatch(monkeypatch), Stopwatch(monkeypatch)
    admission.on(Admission, "admit")
    belief.on(Belief, "assess")
    estimator = Estimator(stage_of(section))
    begin = time.perf_counter()
    for arrival, stream, block in streams:
        push_block(estimator, stream, block, arrival)
    whole = time.perf_counter() - begin
    begin = time.perf_counter()
    for _, _, block in streams:
        hampel(block.rows[:, 1:])
    filtered = time.perf_counter() - begin
    assert estimator.status.estimates > 0.9 * DURATION * 1e3
    estimate = whole - admission.spent - belief.spent
    print(f"\n{rate:.0f} samples a second from each of {len(heads) + 2} streams: share of a core, part of the estimate")
    for what, spent in (
        ("estimate alone", estimate),
        ("every sample checked", admission.spent),
        ("streams judged over time", belief.spent),
        ("instead: a Hampel filter", filtered),
    ):
        print(f"  {what:<26} {spent / DURATION:6.1%} {spent / estimate:7.0%}")
