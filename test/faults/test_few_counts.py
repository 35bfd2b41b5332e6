"""A head that is off by a few counts is told by its step; what agrees with it later is no proof that it is right."""

from __future__ import annotations

from itertools import count, islice

import numpy as np
import pytest
from draws import seeds
from world import Options, Recording, make_recording, random_stage
from world.fault import SECOND

from faults.documenting import Row, shows
from faults.judging import judge
from faults.recordings import MOST_WRONG
from rotary_error_monitor.signals.blocks import SampleBlock

DURATION, FIRST, LATER = 10.0, 5.0, 7.0
"""Length of a recording, and when heads jump, s."""

EARLY = 1.0
"""When they do before most of them have seen a whole turn, s."""

STAGES = tuple(islice((n for n in count() if len(random_stage(n)["encoder"]["heads"]) == 4), 16))


def recorded(number: int) -> Recording:
    options = Options(motion="s_curves", peak_speed=5.0, lost_blocks=0.0, clock_drift=0.0)
    return make_recording(number, duration=DURATION, stage=random_stage(number), options=options)


def jumped(sound: Recording, topic: str, begin: float, angle: float) -> Recording:
    """The recording with a head that is off by an angle, rad, from a time on, s."""

    def changed(block: SampleBlock) -> SampleBlock:
        time = (block.stamp_ns - sound.start_ns) / SECOND + block.rows[:, 0]
        return SampleBlock(block.stamp_ns, block.names, block.rows + np.outer(time > begin, [0.0, angle]))

    return sound.with_topics({topic: ([changed(block) for block in sound.blocks[topic]], sound.arrivals[topic])})


def step(section: dict) -> float:
    """Of a reading, rad, and no less than twice its noise: fewer tell nothing."""
    encoder = section["encoder"]
    counts = encoder["lines_per_revolution"] * encoder.get("counts_per_line", 1)
    return max(2 * np.pi / counts, 2.0 * encoder["noise"])


def test_a_step_of_some_counts_is_one_heads_and_the_others_go_on():
    """Of steps of 6 to 25 counts nothing was told, and all heads were believed no more, to the end."""
    lost, wrong = {}, {}
    for place in seeds(len(STAGES)):
        section, draw = random_stage(STAGES[place]), np.random.default_rng(place)
        sound = recorded(STAGES[place])
        angle = draw.choice([-1, 1]) * draw.uniform(6.0, 25.0) * step(section)
        found = judge(jumped(sound, draw.choice(sound.head_topics), FIRST, angle), section)
        lost[place], wrong[place] = 1.0 - min(found.available[name] for name in ("exc", "eyc")), found.worst
    assert sum(part > 0.15 for part in lost.values()) <= 0.1 * len(lost), lost
    assert sum(part > MOST_WRONG for part in wrong.values()) <= 0.05 * len(wrong), wrong


@shows(
    Row(
        "heads",
        "A second head goes off by as much as a first one that was left out, so that both agree again",
        "`error_estimator: estimate` names the first one, and that redundancy is lost",
        "once a head was wrong, all that is not as in the first turn, at the same angle, is three standard deviations, "
        "of the rotation as well: that the heads agree proves nothing any more; of the ring's place the same without "
        "redundancy",
        "everything with that uncertainty, or nothing",
        "with a reset, or where the ring is as in the first turn",
    )
)
def test_two_heads_that_are_off_alike_are_not_believed_for_agreeing():
    """With the second one all heads were believed again: radial motion of 10 µm, 150 standard deviations."""
    wrong = {}
    for place in seeds(len(STAGES)):
        section, draw = random_stage(STAGES[place]), np.random.default_rng([place, 2])
        sound = recorded(STAGES[place])
        first, second = draw.permutation(sound.head_topics)[:2].tolist()
        angle = draw.choice([-1, 1]) * draw.uniform(30.0, 150.0) * step(section)
        both = jumped(jumped(sound, first, FIRST, angle), second, LATER, angle)
        found = judge(both, section)
        wrong[place] = max(found.wrong[name] for name in ("exc", "eyc"))
    assert sum(part > MOST_WRONG for part in wrong.values()) <= 0.1 * len(wrong), wrong


AT_FIRST = 0.01
"""Part of a recording of 10 s that is 100 ms: the time until what is published has to be right."""


@shows(
    Row(
        "heads",
        "Two heads go off together, so that the others see a motion of the ring; or the ring is knocked out of place",
        "by the uncertainty; a motion beyond the stage's is named as such",
        "a step of the ring that no bearing makes in the time counts as a head that was wrong: all that is not as in "
        "the first turn, at the same angle, is three standard deviations from then on, of the rotation as well; where "
        "the rotor has not been before, the whole step is",
        "everything with that uncertainty; nothing where the motion is more than the stage can do",
        "with a reset, or where the ring is as in the first turn",
    )
)
@pytest.mark.parametrize("begin", [FIRST, EARLY], ids=["late", "early"])
@pytest.mark.parametrize("alike", [True, False], ids=["alike", "opposite"])
def test_two_heads_that_go_off_together_make_no_motion_of_the_bearing(alike, begin):
    """Of 16 stages 12 and 9 were wrong, most to the end; a step by less than a push makes in 10 ms is left.

    What the first turn shows behind a step was taken for right: of steps within it 12 and 7 were wrong.
    """
    wrong = {}
    for place in seeds(len(STAGES)):
        section, draw = random_stage(STAGES[place]), np.random.default_rng([place, 12])
        sound = recorded(STAGES[place])
        at = {topic: section["encoder"]["heads"][topic.split("/")[2][-1]]["azimuth"] for topic in sound.head_topics}
        one, *others = sorted(at, key=lambda topic: (at[topic] - at[sound.head_topics[0]]) % (2 * np.pi))
        angle = draw.choice([-1, 1]) * draw.uniform(60.0, 200.0) * step(section)
        both = jumped(jumped(sound, one, begin, angle), others[0 if alike else 1], begin, angle if alike else -angle)
        wrong[place] = judge(both, section).worst
    assert sum(part > AT_FIRST for part in wrong.values()) <= 0.15 * len(wrong), wrong
