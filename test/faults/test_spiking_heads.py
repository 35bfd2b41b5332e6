"""Single samples of one head that are far off cost what rests on them, and nothing around."""

from __future__ import annotations

from itertools import count, islice

import numpy as np
from draws import seeds
from world import Options, make_recording, random_stage

from faults.documenting import Row, shows
from faults.judging import judge
from faults.recordings import MOST_WRONG
from rotary_error_monitor.signals.blocks import SampleBlock

DURATION, SPIKES = 8.0, 12

STAGES = tuple(islice((n for n in count() if len(random_stage(n)["encoder"]["heads"]) >= 4), 12))


def spiking(number):
    """A recording of which one head now and then gives a sample that is 1 to 100 mrad off, as a torn cable does."""
    rates = {f"/stage/head_{head}/samples": 250.0 for head in random_stage(number)["encoder"]["heads"]}
    options = Options(motion="s_curves", peak_speed=5.0, rates=rates, lost_blocks=0.0, clock_drift=0.0)
    sound = make_recording(number, duration=DURATION, stage=random_stage(number), options=options)
    draw = np.random.default_rng(number)
    topic = draw.choice(sound.head_topics)
    blocks = list(sound.blocks[topic])
    for place in draw.choice(len(blocks), SPIKES, replace=False):
        block, rows = blocks[place], blocks[place].rows.copy()
        rows[draw.integers(len(rows)), 1] += draw.choice([-1, 1]) * 10 ** draw.uniform(-3.0, -1.0)
        blocks[place] = SampleBlock(block.stamp_ns, block.names, rows)
    return sound.with_topics({topic: (blocks, sound.arrivals[topic])})


@shows(
    Row(
        "heads",
        "Single samples of one head are off by 1 mrad to 100 mrad",
        "by the uncertainty of the ticks around them, or in `/diagnostics` as samples refused",
        "what interpolation makes of a sample far off its neighbours' course counts as uncertain; neither ring nor "
        "command is doubted by it",
        "everything, the ticks between that sample and its neighbours with that uncertainty",
        "with the next sample but one",
    )
)
def test_what_rests_on_other_samples_goes_on():
    """Each spike cost half a second of all that the heads show: it passed for a motion of the ring."""
    lost, wrong = {}, {}
    for place in seeds(len(STAGES)):
        found = judge(spiking(STAGES[place]), random_stage(STAGES[place]))
        lost[place] = 1.0 - min(found.available[name] for name in ("exc", "eyc"))
        wrong[place] = found.worst
    assert np.mean(list(lost.values())) < 0.1 and max(lost.values()) < 0.25, lost
    assert sum(part > MOST_WRONG for part in wrong.values()) <= 0.05 * len(wrong), wrong


def test_samples_that_are_not_a_number_leave_most_of_the_estimates():
    """Scattered over all heads, by 4 % of each, they had every head distrusted: 1 to 3 % of the estimates were left."""
    available = []
    for place in seeds(len(STAGES)):
        section, draw = random_stage(STAGES[place]), np.random.default_rng(place)
        rates = {f"/stage/head_{head}/samples": 500.0 for head in section["encoder"]["heads"]}
        options = Options(motion="s_curves", peak_speed=5.0, rates=rates, lost_blocks=0.0, clock_drift=0.0)
        sound = make_recording(STAGES[place], duration=DURATION, stage=section, options=options)
        changed = {}
        for topic in sound.head_topics:
            blocks = []
            for block in sound.blocks[topic]:
                rows = block.rows.copy()
                rows[draw.random(len(rows)) < 0.04, 1] = np.nan
                blocks.append(SampleBlock(block.stamp_ns, block.names, rows))
            changed[topic] = blocks, sound.arrivals[topic]
        found = judge(sound.with_topics(changed), section)
        assert found.worst <= MOST_WRONG
        available.append(found.available["exc"])
    assert np.mean(available) > 0.5 and min(available) > 0.3, available
