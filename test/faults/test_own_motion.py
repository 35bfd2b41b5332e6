"""What one instrument shows may be its own: an autocollimator that goes off by no more than the rotor can tilt.

No limit of the stage tells such a fault, and nothing else shows the tilt. So it is told by its uncertainty, which holds
what is not as in the first turn.
"""

from __future__ import annotations

from itertools import count, islice

import numpy as np
import pytest
from draws import seeds
from world import Options, make_recording, random_stage
from world.fault import SECOND

from faults.documenting import Row, shows
from faults.judging import judge
from faults.recordings import MOST_WRONG
from rotary_error_monitor.signals.blocks import SampleBlock

DURATION, BEGIN, BACK = 12.0, 5.0, 5.8
"""Length of a recording, begin of a fault, and end of a gap, s."""

TILTS = ("eac", "ebc")
WHO = "/stage/autocollimator/samples"

STAGES = tuple(islice((n for n in count() if len(random_stage(n)["encoder"]["heads"]) >= 4), 12))
"""Random stages whose heads show what the ring does."""


def stepped(draw, passed):
    """Off from one sample to the next, by some times the noise."""
    return (passed > 0) * draw.choice([-1, 1]) * draw.uniform(2e-6, 6e-5)


def drifting(draw, passed):
    return np.maximum(passed, 0.0) * draw.choice([-1, 1]) * 10 ** draw.uniform(-6.5, -5.0)


def ramped(draw, passed):
    """Off within 0.3 s to 3 s."""
    return np.clip(passed / draw.uniform(0.3, 3.0), 0.0, 1.0) * draw.choice([-1, 1]) * draw.uniform(4e-6, 2e-5)


def off_behind_a_gap(draw, passed):
    """Silent for a while, and back at another zero."""
    return np.where(passed > BACK - BEGIN, draw.choice([-1, 1]) * draw.uniform(3e-6, 8e-5), 0.0)


def recorded(number):
    options = Options(motion="s_curves", peak_speed=6.0, lost_blocks=0.0, clock_drift=0.0, block_period=0.05)
    return make_recording(number, duration=DURATION, stage=random_stage(number), options=options)


def with_fault(number, fault):
    """A recording whose autocollimator goes off along a drawn direction."""
    sound, draw = recorded(number), np.random.default_rng(number)
    seed, way = int(draw.integers(2**31)), draw.uniform(0.0, 2 * np.pi)
    resolution = sound.stage["autocollimator"]["resolution"]

    def changed(block: SampleBlock) -> SampleBlock:
        passed = (block.stamp_ns - sound.start_ns) / SECOND + block.rows[:, 0] - BEGIN
        off = np.outer(fault(np.random.default_rng(seed), passed), [np.cos(way), np.sin(way)])
        rows = block.rows + np.column_stack([np.zeros(len(off)), np.rint(off / resolution) * resolution])
        kept = (passed <= 0.0) | (passed > BACK - BEGIN) if fault is off_behind_a_gap else np.ones(len(off), bool)
        return SampleBlock(block.stamp_ns, block.names, rows[kept])

    blocks = [changed(block) for block in sound.blocks[WHO]]
    kept = [i for i, block in enumerate(blocks) if len(block.rows)]
    arrivals = np.asarray(sound.arrivals[WHO])[kept]
    return sound.with_topics({WHO: ([blocks[i] for i in kept], arrivals)})


@shows(
    Row(
        "autocollimator",
        "The autocollimator steps, drifts, or comes back from a gap with another zero, by no more than the rotor tilts",
        "by the uncertainty of the tilt; a step or a place beyond what the stage can do is named as such",
        "nothing tells it from a tilt of the rotor: what differs from the first turn, at the same angle, is three "
        "standard deviations for as long as it does, but for what the ring shows the rotor to have yielded to a push",
        "everything, the tilt with that uncertainty, within a window (10 ms) of its begin",
        "at once where it goes back; a reset takes the next turn for the first one",
    )
)
@pytest.mark.parametrize("fault", [stepped, drifting, ramped, off_behind_a_gap])
def test_a_tilt_that_may_be_the_instruments_own_is_as_uncertain(fault):
    wrong = {}
    for place in seeds(len(STAGES)):
        found = judge(with_fault(STAGES[place], fault), random_stage(STAGES[place]))
        wrong[place] = max(found.wrong[name] for name in TILTS)
    assert sum(part > MOST_WRONG for part in wrong.values()) <= 0.1 * len(wrong), wrong
    assert max(wrong.values()) < 2 * MOST_WRONG, wrong


def test_of_a_healthy_stage_all_goes_on_and_is_right():
    for place in seeds(len(STAGES)):
        found = judge(recorded(STAGES[place]), random_stage(STAGES[place]))
        assert found.worst <= MOST_WRONG and min(found.available[name] for name in TILTS) > 0.9
