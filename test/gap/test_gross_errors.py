"""Errors of mounting that are far larger than an effect's usual size."""

from __future__ import annotations

import math

import numpy as np
import pytest

from rotary_error_monitor.cases.making import make_stage_case
from rotary_error_monitor.effects.library import load_effects
from rotary_error_monitor.effects.rotor import StageEffect
from rotary_error_monitor.gap.diagnosis import diagnose
from rotary_error_monitor.gap.verdict import Verdict
from rotary_error_monitor.kinds.stage.problem import StageProblem
from rotary_error_monitor.signals.blocks import SampleBlock
from rotary_error_monitor.twin.recording import record_stage

EFFECTS = load_effects(StageEffect)


@pytest.fixture(scope="module")
def healthy():
    return make_stage_case(7, "null", duration=20.0)


def turned(case, angle):
    """Problem of a healthy stage whose autocollimator is turned about its line of sight."""
    streams = {stream: list(blocks) for stream, blocks in case.blocks.items()}
    turned = streams["autocollimator"]
    names = turned[0].names
    axes = [names.index("tilt_x"), names.index("tilt_y")]
    cos, sin = math.cos(angle), math.sin(angle)
    for i, block in enumerate(turned):
        rows = block.rows.copy()
        rows[:, axes] = block.rows[:, axes] @ np.array([[cos, -sin], [sin, cos]])
        turned[i] = SampleBlock(block.stamp_ns, block.names, rows)
    return StageProblem(case.twin, record_stage(streams, sorted(case.twin.encoder.azimuths)), EFFECTS)


@pytest.mark.few(2)
@pytest.mark.parametrize("degrees", [-60.0, 20.0, 80.0, 120.0])
def test_an_autocollimator_turned_far_is_found_and_its_angle(healthy, degrees):
    diagnosis = diagnose(turned(healthy, math.radians(degrees)))
    assert diagnosis.verdict is Verdict.EXPLAINED
    (found,) = diagnosis.causes
    assert found.cause.effect.name == "autocollimator_roll"
    assert math.degrees(found.parameters["angle"].value) == pytest.approx(degrees, abs=0.05)
