"""Displacement probes at 1 kHz beside autocollimators that are slow: sound ones are believed, over drawn stages."""

from __future__ import annotations

from world import Options, Recording, make_recording, random_stage, with_probes

from faults.judging import judge
from faults.recordings import MOST_WRONG

RATES = (55.0, 60.0, 70.0, 85.0, 100.0)
"""Samples per s; slower ones are further apart than values are joined."""

STAGES = 60


def recorded(seed: int) -> Recording:
    """A stage with three heads or more and four probes, which makes some turns."""
    drawn = (random_stage(number) for number in range(1000 * seed, 1000 * seed + 1000))
    section = with_probes(next(each for each in drawn if len(each["encoder"]["heads"]) > 2), seed)
    motion = ("both_directions", "s_curves", "steady")[seed % 3]
    rates = {"/stage/autocollimator/samples": RATES[seed % len(RATES)]}
    options = Options(motion=motion, odd_rates=False, peak_speed=4.0, rates=rates)
    return make_recording(seed, duration=6.0, stage=section, options=options)


def test_sound_probes_are_rarely_doubted():
    """In no more than one stage of sixty: that with an axial probe whose readings scatter three times as described."""
    doubted = {}
    for seed in range(STAGES):
        found = judge(recorded(seed), recorded(seed).stage)
        assert found.worst <= MOST_WRONG, seed
        if reasons := [why for name, why in found.doubted.items() if "probe" in name]:
            doubted[seed] = reasons
    assert len(doubted) <= 1, doubted
    assert not [seed for seed in doubted if seed < 32], "none of those that were first looked at"
