"""Diagnosis of a stage with one read head: cases of the exact plant, which knows nothing of the twin."""

from __future__ import annotations

from dataclasses import replace

from draws import seeds

from rotary_error_monitor.cases.making import make_stage_case
from rotary_error_monitor.effects.library import load_effects
from rotary_error_monitor.effects.rotor import StageEffect
from rotary_error_monitor.gap.diagnosis import diagnose
from rotary_error_monitor.gap.verdict import Verdict
from rotary_error_monitor.kinds.stage.problem import StageProblem
from rotary_error_monitor.twin.recording import record_stage

EFFECTS = load_effects(StageEffect)
HEAD = "a"
SEEN = (
    "disc_eccentricity",
    "encoder_latency",
    "mirror_wobble",
    "autocollimator_roll",
    "spindle_tilt",
    "following_error",
)
"""Effects that one head and the autocollimator show, by their names in the library and the plant."""


def diagnosed(case):
    """Of what a case's stage shows with one of its heads."""
    blocks = {
        name: list(found) for name, found in case.blocks.items() if not name.startswith("head_") or name[-1] == HEAD
    }
    ring = replace(case.twin.encoder, azimuths={HEAD: case.twin.encoder.azimuths[HEAD]})
    return diagnose(StageProblem(replace(case.twin, encoder=ring), record_stage(blocks, HEAD), EFFECTS))


def test_a_stage_as_described_has_no_gap():
    verdicts = [diagnosed(make_stage_case(8100 + seed, "null")).verdict for seed in seeds(16)]
    assert verdicts.count(Verdict.NO_GAP) >= len(verdicts) - 1, verdicts


def test_effects_that_the_head_and_the_autocollimator_see_are_named_or_said_to_be_alike():
    """At most one in ten is missed: they stand out by 100 standard deviations and more."""
    right, told = 0, []
    for number, name in enumerate(SEEN * len(seeds(8))):
        found = diagnosed(make_stage_case(8200 + number, "single", [name], (100.0, 400.0), duration=40.0))
        names = {cause.cause.effect.name for cause in found.causes}
        alike = {key[0] for group in found.indistinguishable for key in group.effects}
        right += name in names | alike and found.verdict is Verdict.EXPLAINED
        told.append((name, found.verdict.value, names))
    assert right >= len(told) - max(1, len(told) // 10), told
