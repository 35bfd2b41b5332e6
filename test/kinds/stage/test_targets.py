"""Two probes before one ball: what is wrong about the ball is one cause, as it is one mistake.

Recordings are written out with numpy (`probed_stage.py`), where each probe sees the withheld form at its own azimuth.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from draws import seeds
from probed_stage import HIGH, LOW, STAGE, Withheld, blocks_of, recorded

from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.effects.library import load_effects
from rotary_error_monitor.effects.rotor import StageEffect
from rotary_error_monitor.gap.diagnosis import DiagnosisResult, diagnose
from rotary_error_monitor.gap.verdict import Verdict
from rotary_error_monitor.kinds.stage.stretches import stage_problem
from rotary_error_monitor.twin.recording import record_stage
from rotary_error_monitor.twin.stage_parameters import uncertain_parameters

ORDER, SHIFT = 1, (6e-7, -8e-7)
LOOSE, FIXED = 2e-7, 1e-9
PLACE = f"{HIGH}+{LOW}"

_BALL = {
    name: replace(STAGE.sensors[LOW], zero=0.0, gain=gain, uncertainty=FIXED, place={"azimuth": at, "height": 0.1})
    for name, at, gain in ((LOW, 0.0, -1.0), (HIGH, 1.3, 1.0))
}
APART = replace(STAGE, sensors=dict(sorted(_BALL.items())))
"""Two probes at one height that say nothing of one another, each with what it sees of the ball."""

ONE_BALL = replace(APART, sensors={name: replace(each, uncertainty=0.0) for name, each in APART.sensors.items()})
"""What is recorded: what is drawn of a form is each probe's own, and of one ball both see the same."""

BEFORE = replace(APART, sensors={name: replace(each, target="ball") for name, each in APART.sensors.items()})
"""The same before one ball."""


def diagnosed(seed: int, stage: StageDescription, withheld: Withheld) -> DiagnosisResult:
    recording = record_stage(blocks_of(recorded(seed, withheld, ONE_BALL)), "abcd", listed=tuple(APART.sensors))
    return diagnose(stage_problem(stage, recording, load_effects(StageEffect)))


def test_a_ball_that_is_off_centre_is_one_cause_at_both_probes() -> None:
    off = Withheld(form=dict.fromkeys((LOW, HIGH), ((ORDER, *SHIFT),)))
    for seed in seeds(12):
        found = diagnosed(seed, BEFORE, off)
        assert found.verdict is Verdict.EXPLAINED, (seed, found.verdict)
        assert [cause.cause.key for cause in found.causes] == [("probe_form", f"{PLACE}.order_{ORDER}")], seed
        told = found.causes[0].parameters
        for name, value in zip(("cos", "sin"), SHIFT, strict=True):
            assert abs(np.ravel(told[name].value)[0] - value) < 4 * np.ravel(told[name].std)[0], (seed, name)


def test_without_that_knowledge_it_takes_a_cause_for_each_probe() -> None:
    off = Withheld(form=dict.fromkeys((LOW, HIGH), ((ORDER, *SHIFT),)))
    for seed in seeds(12):
        keys = {cause.cause.key for cause in diagnosed(seed, APART, off).causes}
        assert keys == {("probe_form", f"{each}.order_{ORDER}") for each in (LOW, HIGH)}, seed


def test_what_one_probe_alone_shows_is_no_form_of_the_ball() -> None:
    alone = Withheld(form={LOW: ((ORDER, *SHIFT),)})
    for seed in seeds(12):
        keys = {cause.cause.key for cause in diagnosed(seed, BEFORE, alone).causes}
        assert not {key for key in keys if key[0] == "probe_form"}, (seed, keys)


def test_an_uncertain_form_moves_all_that_see_it() -> None:
    """Of each sensor it is stated how far it may be off: it is off by no more than the surest one says."""
    loose = {LOW: replace(BEFORE.sensors[LOW], uncertainty=LOOSE), HIGH: BEFORE.sensors[HIGH]}
    found = [each for each in uncertain_parameters(replace(BEFORE, sensors=loose)) if ".form" in each.name]
    orders = sorted(row.order for row in BEFORE.sensors[LOW].form)
    names = [f"targets.ball.form[order {order}][{part}]" for order in orders for part in ("cos", "sin")]
    assert [each.name for each in found] == names
    assert {each.uncertainty for each in found} == {FIXED} and {each.seen_by for each in found} == {(LOW, HIGH)}
    for each in found:
        moved = each.shifted(BEFORE, 1e-6).sensors
        assert moved[LOW].form == moved[HIGH].form != BEFORE.sensors[LOW].form
