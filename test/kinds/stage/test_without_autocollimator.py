"""Diagnosis of a stage without autocollimator: cases of the exact plant, which knows nothing of the twin."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from draws import seeds

from rotary_error_monitor.blind_check.cases import write_case
from rotary_error_monitor.cases.making import make_stage_case
from rotary_error_monitor.cli import main
from rotary_error_monitor.effects.library import load_effects
from rotary_error_monitor.effects.rotor import StageEffect
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.gap.diagnosis import diagnose
from rotary_error_monitor.gap.verdict import Verdict
from rotary_error_monitor.kinds.stage.problem import StageProblem
from rotary_error_monitor.twin.recording import record_stage

EFFECTS = load_effects(StageEffect)
SEEN_BY_HEADS = ("disc_eccentricity", "encoder_latency", "head_offset", "spindle_radial", "following_error")
SEEN_BY_THE_AUTOCOLLIMATOR = ("mirror_tilt", "autocollimator_gain", "autocollimator_roll", "autocollimator_drift")


def blind(case):
    """A case whose stage has no autocollimator, and so no stream of one."""
    blocks = {name: block for name, block in case.blocks.items() if name != "autocollimator"}
    return replace(case, twin=replace(case.twin, autocollimator=None), blocks=blocks)


def diagnosed(case):
    blocks = {name: list(found) for name, found in case.blocks.items()}
    recording = record_stage(blocks, "abcd", without=("autocollimator",))
    assert "autocollimator" not in recording.sensors
    return diagnose(StageProblem(case.twin, recording, EFFECTS))


def test_effects_that_heads_and_lvdt_see_are_named():
    """At most one in ten is missed: they stand out by 100 standard deviations and more."""
    right, told = 0, []
    for number, name in enumerate(SEEN_BY_HEADS * len(seeds(2))):
        if name not in {effect.name for effect in EFFECTS}:
            continue
        found = diagnosed(blind(make_stage_case(9100 + number, "single", [name], (100.0, 400.0), number % 2 == 1)))
        names = {cause.cause.effect.name for cause in found.causes}
        alike = {key[0] for group in found.indistinguishable for key in group.effects}
        right += name in names | alike and found.verdict is Verdict.EXPLAINED
        told.append((name, found.verdict, names))
        assert not any(cause.cause.effect.acts_on == ("autocollimator",) for cause in found.causes)
    assert right >= len(told) - max(1, len(told) // 10), told


def test_what_only_an_autocollimator_shows_is_no_gap():
    for number, name in enumerate(SEEN_BY_THE_AUTOCOLLIMATOR):
        if name not in {effect.name for effect in EFFECTS}:
            continue
        found = diagnosed(blind(make_stage_case(9200 + number, "single", [name], (100.0, 400.0))))
        assert found.verdict is Verdict.NO_GAP, (name, found.verdict, [c.cause.key for c in found.causes])


def test_from_file_to_file(tmp_path, capsys):
    case = blind(make_stage_case(9300, "single", ["disc_eccentricity"], (200.0, 400.0)))
    write_case(case, tmp_path / "case")
    paths = [str(tmp_path / "case" / "bag"), "--twin", str(tmp_path / "case" / "twin.yaml")]
    improved = tmp_path / "improved.yaml"
    assert main(["diagnose", *paths, "-o", str(tmp_path / "out"), "--write-twin", str(improved)]) == 10
    assert "disc_eccentricity" in capsys.readouterr().out
    assert "autocollimator" not in improved.read_text(encoding="utf-8")
    assert (tmp_path / "out" / "diagnosis.html").stat().st_size > 10_000


def test_a_stage_with_an_autocollimator_still_needs_its_stream():
    case = make_stage_case(9300, "null")
    blocks = {name: list(found) for name, found in case.blocks.items() if name != "autocollimator"}
    with pytest.raises(InputError, match="the recording lacks /stage/autocollimator/samples"):
        record_stage(blocks, "abcd")
    assert np.isfinite(case.twin.tilt_instrument.noise)
    with pytest.raises(InputError, match="the stage has no section 'autocollimator'"):
        _ = blind(case).twin.tilt_instrument
