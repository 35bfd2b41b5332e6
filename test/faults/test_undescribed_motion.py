"""Stages as they are before anybody has measured them: error motion that no description has is no fault of a sensor."""

from __future__ import annotations

from collections.abc import Mapping
from copy import deepcopy
from typing import Any

import numpy as np
import pytest
from described_stages import stage_of
from world import Options, make_recording, random_stage

from faults.judging import TURNING, Judgement, judge
from faults.recordings import MOST_WRONG

STAGES = 8
SPEEDS = (1.0, 4.0)


def undescribed(section: Mapping[str, Any]) -> dict[str, Any]:
    """The description without error motion; its limits are of a bearing that may have it."""
    known, limits = deepcopy(dict(section)), stage_of(section).limits
    spindle = known["spindle"]
    stated = {name: getattr(limits, name) for name in ("radial", "tilt", "radial_rate", "tilt_rate")}
    for name in ("radial", "tilt"):
        for row in spindle.pop(name, ()):
            size = float(np.linalg.norm([row["x"], row["y"]]))
            stated[name] += size
            stated[f"{name}_rate"] += 1.1 * max(SPEEDS) * row["order"] * size
    known["limits"] = known.get("limits", {}) | stated
    return known


@pytest.fixture(scope="module", params=[100.0, 10_000.0])
def judged(request: pytest.FixtureRequest) -> list[Judgement]:
    """Estimates of drawn stages with slow and with fast autocollimators."""
    found = []
    for seed in range(STAGES):
        section = random_stage(7000 + seed)
        motion, speed = TURNING[seed % len(TURNING)], SPEEDS[seed // len(TURNING) % 2]
        rates = {"/stage/autocollimator/samples": request.param}
        options = Options(motion=motion, peak_speed=speed, lost_blocks=0.0, rates=rates)
        recording = make_recording(seed, duration=6.0, stage=section, options=options)
        found.append(judge(recording, undescribed(section)))
    return found


def test_sound_instruments_are_believed(judged):
    assert not [found.doubted for found in judged if found.doubted]


def test_what_is_published_is_right(judged):
    assert max(found.worst for found in judged) <= MOST_WRONG
