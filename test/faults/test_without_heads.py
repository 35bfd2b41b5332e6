"""Stages without read heads, on recordings of the independent world: three probes at 120°, the rotation by the command.

The world's rotor stands off its command, and follows it late, by as much as the stage's limits allow.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any
from zlib import crc32

import numpy as np
import pytest
from described_stages import stage_of
from motion_numbers import assert_same_bits, decisions_of
from pushed_inputs import push_block
from world import PROBE_FAULTS, Options, Recording, make_recording, random_stage, with_probes, with_probes_alone

from faults.documenting import Row, shows
from faults.judging import Judgement, judge
from faults.recordings import MOST_WRONG
from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.metrology.error_motion import ErrorMotion
from rotary_error_monitor.pipeline.estimation import Estimator
from rotary_error_monitor.signals.blocks import SampleBlock

SEEDS = range(10)
DURATION, BEGIN = 6.0, 4.0
LIMITS = StageDescription().limits
PROBES = ("radial_probe_one", "radial_probe_three", "radial_probe_two")


def recorded_of(seed: int, section: Mapping[str, Any], **options: Any) -> Recording:
    motion = ("both_directions", "s_curves", "steady")[seed % 3]
    made = Options(motion=motion, odd_rates=False, peak_speed=4.0, **options)
    return make_recording(seed, duration=DURATION, stage=section, options=made)


@cache
def recorded(seed: int) -> Recording:
    return recorded_of(seed, with_probes_alone(random_stage(1000 * seed), seed))


def streams_of(recording: Recording) -> tuple[StageDescription, list[tuple[str, SampleBlock]]]:
    """The stage as described, and what its estimator takes in the order of arrival."""
    named = [(topic.split("/")[2], block) for _, topic, block in recording.timeline()]
    return stage_of(recording.stage), [
        (name, block) for name, block in named if name in ("command", *PROBES) and len(block.rows)
    ]


def published(estimator: Estimator, pairs: list[tuple[str, SampleBlock]]) -> ErrorMotion:
    found = [made for name, block in pairs for made in push_block(estimator, name, block)] + estimator.finish()
    return ErrorMotion.joined(found)


@pytest.mark.parametrize("seed", SEEDS)
def test_what_three_probes_show_is_right(seed):
    found = judge(recorded(seed), recorded(seed).stage)
    assert found.worst <= MOST_WRONG and not found.doubted
    assert min(found.available[name] for name in ("exc", "eyc")) > 0.95
    assert not any(found.available[name] for name in ("ezc", "eac", "ebc", "ecc"))
    assert not found.estimator.status.absent and found.estimator.sensor_conflict == 1.0


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("seed", range(6))
def test_a_rotation_off_its_command_by_what_the_limits_allow_is_within_the_uncertainty(seed, sign):
    """Probes as good as they get, before an artefact far off centre: its slope is what counts."""
    section = with_probes_alone(random_stage(1000 * seed), seed)
    form = [{"order": 1, "cos": 2e-5, "sin": 1e-5}, {"order": 2, "cos": -2e-6, "sin": 3e-6}]
    for probe in section["sensors"].values():
        probe |= {"form": form, "noise": 2e-9, "resolution": 1e-9, "uncertainty": 1e-9, "range": 1e-4}
    off = {"following_error": sign * 0.99 * LIMITS.following_error, "drive_lag": max(sign, 0.0) * 0.99 * LIMITS.latency}
    found, right = (judge(recorded_of(seed, section, **each), section) for each in (off, {}))
    assert found.worst <= MOST_WRONG and not found.doubted
    assert max(found.largest["exc"], found.largest["eyc"]) > 6.0 * 2e-9, "more than the probes' own noise explains"
    assert found.largest["exc"] > right.largest["exc"]


def test_the_uncertainty_of_the_rotation_is_what_the_limits_say():
    """At a steady speed: following error and latency as rectangles, stamps beside them."""
    section = with_probes_alone(random_stage(2000), 2)
    recording = make_recording(2, duration=2.0, stage=section, options=Options(motion="steady", peak_speed=3.0))
    _, pairs = streams_of(recording)
    lag = published(Estimator(stage_of(section)), pairs).lag
    expected = np.sqrt(LIMITS.following_error**2 / 3 + 3.0**2 * (LIMITS.latency**2 / 3 + 2e-6**2))
    assert np.median(lag) == pytest.approx(expected, rel=1e-3) and lag.min() > 0.99 * expected


@pytest.mark.parametrize("tilt", [True, False])
@pytest.mark.parametrize("seed", range(6))
def test_with_other_probes_and_an_autocollimator_all_but_the_rotation_is_right(seed, tilt):
    """Four probes at several heights: without the tilt they determine the axial error motion alone."""
    section = with_probes(random_stage(1000 * seed), seed)
    section = {name: part for name, part in section.items() if name != "encoder" and (tilt or name != "autocollimator")}
    off = {"following_error": -0.9 * LIMITS.following_error, "drive_lag": 0.9 * LIMITS.latency}
    found = judge(recorded_of(seed, section, **off), section)
    assert found.worst <= MOST_WRONG and not found.doubted
    assert found.available["ezc"] > 0.9
    for name in ("exc", "eyc", "eac", "ebc"):
        assert found.available[name] > 0.9 if tilt else found.available[name] == 0.0


@shows(
    Row(
        "sensors",
        "A stage without heads: one of three probes of one make repeats a value, steps, drifts, is noisy, at the end "
        "of its range, twice as sensitive, stamped late, or falls silent",
        "`error_estimator: estimate` names it where it repeats or steps as no bearing does; else it says that the "
        "listed sensors contradict one another",
        "a probe that is named is left out; where nothing tells which is wrong, all are as uncertain as they "
        "contradict one another, from that tick on",
        "radial error motion from the other two, or less sure; what two alone show has no check",
        "after 0.5 s without contradiction, where it was before",
    )
)
@pytest.mark.parametrize("fault", sorted(PROBE_FAULTS))
def test_a_probe_that_fails_makes_nothing_wrong(fault):
    for seed in range(6):
        rng = np.random.default_rng(crc32(f"{fault} {seed}".encode()))
        injected = PROBE_FAULTS[fault](recorded(seed), rng, begin=BEGIN, size=None, topic=None)
        found = judge(injected.recording, recorded(seed).stage)
        assert found.worst <= MOST_WRONG, (seed, injected.topics, injected.size, found.wrong)
        who = {topic.split("/")[2] for topic in injected.topics}
        assert found.doubted.keys() <= who
        assert fault != "probe_stuck" or found.doubted.keys() == who
        assert min(found.available[name] for name in ("exc", "eyc")) > 0.95


def test_a_replay_gives_the_same_bits_however_blocks_come():
    fault = PROBE_FAULTS["probe_noisy"](recorded(0), np.random.default_rng(4), begin=2.0, size=60.0, topic=None)
    stage, pairs = streams_of(fault.recording)
    live = published(Estimator(stage), pairs)
    assert_same_bits(repeated(stage, pairs, live), live)
    assert (live.sensor_conflict > 1.0).any(), "what is repeated was decided"


def repeated(stage: StageDescription, pairs: list[tuple[str, SampleBlock]], live: ErrorMotion) -> ErrorMotion:
    """What a replay makes of the same blocks, many at once, with what a live run decided."""
    again, late = [], Estimator(stage, None, decisions_of(live))
    for number, (name, block) in enumerate(pairs):
        late.accept(name, block)
        if number % 97 == 0:
            again += late.advance()
    return ErrorMotion.joined(again + late.finish())


def test_without_command_nothing_is_published_and_with_it_again():
    recording = recorded(1)
    lost = {"/stage/command/samples": ([], np.zeros(0, np.int64))}
    found: Judgement = judge(recording.with_topics(lost), recording.stage)
    assert not any(found.available.values()) and found.estimator.status.estimates == 0
