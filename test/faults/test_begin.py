"""At once after its begin, or after a silence, an estimator knows less: what may be off counts, and no longer."""

from __future__ import annotations

import numpy as np
import pytest
from described_stages import stage_of
from draws import seeds
from pushed_inputs import push_block
from world import Options, make_recording, random_stage

from faults.judging import judge
from faults.recordings import MOST_WRONG
from rotary_error_monitor.metrology.error_motion import ErrorMotion
from rotary_error_monitor.pipeline.estimation import Estimator
from rotary_error_monitor.pipeline.verdict import DOUBTS
from rotary_error_monitor.signals.blocks import block_from_samples

SEEDS = seeds(40)
LATE_NS = 20_000
DURATION = 0.2


def test_the_first_tenths_of_a_second_are_as_right_as_any():
    """Stages that turn already: begins, of which one in forty had ten wrong ticks before."""
    wrong = []
    for seed in SEEDS:
        options = Options(motion="steady", odd_rates=False, peak_speed=4.0)
        recording = make_recording(seed, duration=DURATION, stage=random_stage(7000 + seed), options=options)
        wrong.append(judge(recording, recording.stage).worst)
    assert np.mean(wrong) <= MOST_WRONG, [(seed, part) for seed, part in zip(SEEDS, wrong, strict=True) if part]


@pytest.mark.few(4)
@pytest.mark.parametrize("seed", seeds(4))
@pytest.mark.parametrize(("later", "told"), [(0.0, True), (0.06, True), (0.3, True), (0.9, False)])
def test_heads_that_are_back_before_the_command_are_still_where_they_were(seed, later, told):
    """After a network was away all come back within some tenths of a second: no turn has to show the zero again."""
    drawn = (random_stage(number) for number in range(900 * seed, 900 * seed + 900))
    section = next(each for each in drawn if len(each["encoder"]["heads"]) > 3 and "mirror" in each)
    options = Options(motion="steady", odd_rates=False, peak_speed=3.0, clock_wander=0.0, lost_blocks=0.0)
    recording = make_recording(seed, duration=8.0, stage=section, options=options)
    estimator, parts = Estimator(stage_of(section)), []
    for _, topic, block in recording.timeline():
        name = topic.split("/")[2]
        at = (int(block.times_ns[-1]) - recording.start_ns) * 1e-9 if len(block.rows) else 5.0
        away = 5.0 <= at < 6.0 + later * (name == "command")
        if name in estimator.inputs and not away:
            parts += push_block(estimator, name, block)
    motion = ErrorMotion.joined(parts)
    at = (motion.times_ns - recording.start_ns) * 1e-9
    unverified = motion.doubts >> DOUBTS.index("unverified") & 1 == 1
    assert not unverified[(at > 4.5) & (at < 4.9)].any(), "it was verified before"
    after = unverified[(at > 6.6 + later) & (at < 6.9 + later)]
    assert len(after) > 100
    assert not after.any() if told else after.all()


@pytest.mark.parametrize("seed", seeds(4))
def test_a_command_that_is_away_for_a_moment_is_as_late_as_before(seed):
    """What is known of the delay still counts in the window after a gap."""
    drawn = (random_stage(number) for number in range(900 * seed, 900 * seed + 900))
    section = next(each for each in drawn if len(each["encoder"]["heads"]) > 3 and "mirror" in each)
    options = Options(motion="both_directions", odd_rates=False, peak_speed=3.0, clock_wander=0.0, lost_blocks=0.0)
    recording = make_recording(seed, duration=16.0, stage=section, options=options)
    estimator, parts = Estimator(stage_of(section)), []
    for _, topic, block in recording.timeline():
        name = topic.split("/")[2]
        if name not in estimator.inputs or len(block.rows) == 0:
            continue
        at = (int(block.times_ns[-1]) - recording.start_ns) * 1e-9
        if name == "command":
            block = block_from_samples(block.times_ns + LATE_NS, block.names[1:], block.rows[:, 1:])
        if name != "command" or at % 0.4 > 0.08:
            parts += push_block(estimator, name, block)
    delay = abs(estimator.belief.command.delay)
    assert delay == pytest.approx(LATE_NS * 1e-9, rel=0.3), "it was measured"
    assert not dict(estimator.belief.reasons)
    motion = ErrorMotion.joined(parts)
    stamps = motion.times_ns
    speed = np.abs(np.gradient(motion.theta, stamps * 1e-9))
    late = (stamps - recording.start_ns) * 1e-9 > 12.0
    fast = motion.observable[:, 5] & late & (speed > 0.5 * np.median(speed[late])) & (np.abs(np.gradient(speed)) < 0.01)
    assert np.count_nonzero(fast) > 500
    assert (motion.lag[fast] > 0.7 * delay * speed[fast]).mean() > 0.998
