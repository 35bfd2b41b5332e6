"""Steps that take some time: the courses that describe them, and how counts lost little by little are told."""

from __future__ import annotations

import numpy as np
import pytest
from draws import seeds

from rotary_error_monitor.cases.making import make_stage_case
from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.effects.library import load_effects
from rotary_error_monitor.effects.rotor import StageEffect
from rotary_error_monitor.gap.diagnosis import diagnose
from rotary_error_monitor.kinds.stage.gradual import SPANS, begun_before, moment_of, ramps
from rotary_error_monitor.kinds.stage.problem import StageProblem
from rotary_error_monitor.twin.recording import record_stage

EFFECTS = load_effects(StageEffect)
LOST = next(effect for effect in EFFECTS if effect.name == "head_missed_counts")
SEEDS = seeds(14, 40)


@pytest.mark.parametrize("span", [0.27, 0.7, 1.9, 3.3])
@pytest.mark.parametrize("begin", [-1.0, -0.5, 0.0])
def test_a_straight_course_is_a_sum_of_courses(span, begin):
    """One that begins a part of its span before the moment, within 6.5 % of the step (rms while it lasts)."""
    time = np.arange(-10.0, 10.0, 0.001)
    straight = np.clip((time - begin * span) / span, 0, 1) - (time >= 0)
    columns = ramps(0.0, time)
    left = straight - columns @ np.linalg.lstsq(columns, straight, rcond=None)[0]
    assert np.sqrt(np.sum(left**2) * 0.001 / span) < 0.065


def test_courses_are_the_step_itself_outside_their_spans():
    time = np.array([-1.01 * SPANS[-1], 1.01 * SPANS[-1]])
    assert np.all(ramps(0.0, time) == 0)
    assert np.all(np.ptp(ramps(2.0, np.linspace(-9.0, 9.0, 1000)), axis=0) <= 1.0)


def test_the_earlier_step_is_there_while_any_course_lasts():
    cause = Cause(LOST, "head_a", np.array([12.0, 1e-5]))
    assert moment_of(begun_before(cause)) == 12.0 - SPANS[-1]
    assert moment_of(cause) == 12.0 and begun_before(cause).values[1] == 1e-5


def test_counts_that_are_lost_little_by_little_are_told():
    """The plant loses them by a law of its own; all but one are named, and told where it stands out."""
    named, told = [], []
    for seed in SEEDS:
        rough = bool(seed % 2)
        sizes = (250.0, 5000.0) if rough else (120.0, 3000.0)
        case = make_stage_case(seed, "variant", ["head_missed_counts"], sizes, rough)
        departure = case.truth.departure
        if not departure.mechanism.startswith("lost little by little"):
            continue
        blocks = {stream: list(found) for stream, found in case.blocks.items()}
        recording = record_stage(blocks, sorted(case.twin.encoder.azimuths))
        causes = diagnose(StageProblem(case.twin, recording, EFFECTS)).causes
        named.append([each.cause.effect.name for each in causes] == ["head_missed_counts"])
        if max(departure.off_textbook_snr.values()) > 30:
            told.append(any("little by little" in row.pattern for each in causes for row in each.departures))
    assert len(named) > len(SEEDS) // 3
    assert sum(named) >= len(named) - 1 and sum(told) >= len(told) - 1, (named, told)
