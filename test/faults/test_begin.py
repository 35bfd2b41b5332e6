"""At once after its begin an estimator knows no speed yet: what its stamps may be off by counts all the same."""

from __future__ import annotations

import numpy as np
from world import Options, make_recording, random_stage

from faults.judging import judge
from faults.recordings import MOST_WRONG

SEEDS = range(40)
DURATION = 0.2


def test_the_first_tenths_of_a_second_are_as_right_as_any():
    """Stages that turn already: forty begins, of which one after another had ten wrong ticks before."""
    wrong = []
    for seed in SEEDS:
        options = Options(motion="steady", odd_rates=False, peak_speed=4.0)
        recording = make_recording(seed, duration=DURATION, stage=random_stage(7000 + seed), options=options)
        wrong.append(judge(recording, recording.stage).worst)
    assert np.mean(wrong) <= MOST_WRONG, [(seed, part) for seed, part in zip(SEEDS, wrong, strict=True) if part]
