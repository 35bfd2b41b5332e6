"""All streams of a stage are stamped late by the same time, as where one computer stamps what it receives."""

from __future__ import annotations

import numpy as np
import pytest
from draws import seeds
from world import random_stage
from world.fault import Size, stamps_fault

from faults.documenting import Row, shows
from faults.judging import judge, record
from faults.recordings import MOST_WRONG

DELAY_NS = 20_000_000
DURATION = 6.0
LATE = stamps_fault("all_late", "All streams are stamped late.", "all", Size(DELAY_NS * 1e-9), when="start", late=True)


@shows(
    Row(
        "messages",
        "All streams are stamped 20 ms late, alike",
        "not told: the streams fit one another, and no other clock is heard",
        "nothing",
        "everything, right for 20 ms before its stamp: off by what changes within 20 ms; let drivers stamp what they "
        "sample, not what they send",
        "nothing is needed",
    )
)
@pytest.mark.parametrize("number", seeds(6, 40))
def test_what_is_published_is_that_of_the_time_before(number):
    section = random_stage(number)
    recording = record(number, section, DURATION)
    late = LATE(recording, np.random.default_rng(number), begin=0.0)
    found = judge(late.recording, section, lambda stamps: stamps - DELAY_NS)
    sound = judge(recording, section)
    assert found.worst <= MOST_WRONG
    assert set(found.doubted) == set(sound.doubted)
    assert all(found.available[name] > part - 0.02 for name, part in sound.available.items())
