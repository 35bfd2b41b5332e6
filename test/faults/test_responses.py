"""Recordings of the independent world by instruments with responses of their own: estimated as by ideal ones."""

from __future__ import annotations

import numpy as np
import pytest
from draws import seeds
from world import random_stage
from world.responses import answered, draw_responses

from faults.judging import judge, record
from faults.recordings import MOST_WRONG
from rotary_error_monitor.metrology.error_motion import COMPONENTS


@pytest.mark.parametrize("seed", seeds(8))
def test_what_is_published_is_that_of_ideal_instruments(seed):
    """The same samples behind other readings: what is believed, and all numbers but for their rounding."""
    recording = record(seed, random_stage(seed), 8.0)
    section = draw_responses(seed, recording.stage)
    ideal, own = judge(recording, recording.stage), judge(answered(recording, section), section)
    assert own.worst <= MOST_WRONG and set(own.doubted) == set(ideal.doubted)
    for name in COMPONENTS:
        assert own.available.get(name, 0.0) == pytest.approx(ideal.available.get(name, 0.0), abs=0.02), name
        size = 1e-9 if name.startswith("e") and name[1] in "xyz" else 1e-8
        np.testing.assert_allclose(own.largest.get(name, 0.0), ideal.largest.get(name, 0.0), atol=size, err_msg=name)


@pytest.mark.parametrize("seed", seeds(4))
def test_readings_that_nothing_describes_are_not_published(seed):
    """As before there were descriptions of it: heads that count both ways contradict one another."""
    recording = record(seed, random_stage(seed), 8.0)
    section = draw_responses(seed, recording.stage)
    letters = list(section["encoder"]["heads"])
    for place, letter in enumerate(letters):
        section["encoder"]["heads"][letter]["sign"] = -1 if place % 2 else 1
    found = judge(answered(recording, section), recording.stage)
    assert found.worst <= MOST_WRONG and found.doubted
