"""The problem that a stage's recording is: signatures, uncertain parameters, advice, the page, another stage."""

from __future__ import annotations

import dataclasses
import json
import re

import numpy as np
import pytest

from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.effects.library import load_effects
from rotary_error_monitor.effects.rotor import StageEffect
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.gap.diagnosis import diagnose
from rotary_error_monitor.gap.sentences import verdict_sentence
from rotary_error_monitor.kinds.stage.experiments import advise
from rotary_error_monitor.kinds.stage.problem import StageProblem
from rotary_error_monitor.report.diagnosis import report_files
from rotary_error_monitor.report.painter import Painter

EFFECTS = load_effects(StageEffect)


def effect(name):
    return next(e for e in EFFECTS if e.name == name)


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_a_signature_is_taken_where_the_cause_acts(stage_problem, order):
    problem, _ = stage_problem(19, "null", duration=12.0)
    both = (
        Cause(effect("autocollimator_drift"), "", np.array([3e-6, -2e-6])),
        Cause(effect("autocollimator_nonlinearity"), "", np.array([4e7])),
    )
    causes = tuple(both[i] for i in order)
    drift = both[0]
    columns = problem.signature(drift, [0, 1], causes)
    step = np.array([1e-9, 2e-9])
    moved = tuple(drift.with_values(drift.values + step) if c is drift else c for c in causes)
    before, after = problem.residual(causes), problem.residual(moved)
    for channel in ("autocollimator.x", "autocollimator.y"):
        change = (before[channel] - after[channel])[:, 0]
        np.testing.assert_allclose(columns[channel] @ step, change, atol=2e-3 * np.max(np.abs(change)))


def test_uncertain_parameters_are_seen_beside_the_causes(stage_problem):
    """Where a head stands hardly matters to a good ring; with a large graduation error it does."""
    problem, _ = stage_problem(25, "null", rough=True)
    coarse = Cause(effect("graduation_error"), "order_9", np.array([9.0, 5e-6, -5e-6]))
    plain, beside = problem.nuisance(()).rows, problem.nuisance((coarse,)).rows
    assert set(plain) == set(beside)
    assert np.abs(beside["head_a"] - plain["head_a"]).max() > 0.05
    np.testing.assert_array_equal(beside["autocollimator.x"], plain["autocollimator.x"])


def test_uncertain_parameters_are_made_again_where_causes_change_the_signals(stage_problem):
    problem, _ = stage_problem(25, "null", rough=True)
    alone = problem.own_nuisance(()).rows
    little = Cause(effect("graduation_error"), "order_5", np.array([5.0, 1e-8, 0.0]))
    assert all(rows is alone[channel] for channel, rows in problem.own_nuisance((little,)).rows.items())
    much = Cause(effect("graduation_error"), "order_5", np.array([5.0, 1e-4, 0.0]))
    beside = problem.own_nuisance((much,)).rows
    made = {channel for channel, rows in beside.items() if rows is not alone[channel]}
    assert made == {channel for channel in alone if channel == "command" or channel.startswith("head")}
    # Back to none: what was kept beside the large cause does not serve.
    again = problem.own_nuisance(()).rows
    for channel, rows in alone.items():
        np.testing.assert_array_equal(again[channel], rows)


def test_advice_names_the_measurement_that_tells_apart(stage_problem):
    problem, _ = stage_problem(17, "single", ["graduation_error"], snr=(150.0, 200.0))
    four = effect("graduation_error")
    cause = Cause(four, "order_4", np.array([4.0, 2e-6, 1e-6]))
    # Four heads a quarter turn apart see order 4 alike, as they do the rotation: only another azimuth tells.
    advice = advise(problem, [("graduation_error", "order_4"), ("drive_cyclic_error", "order_4")], [cause])
    assert advice.startswith("move head a by 20° along the ring")


def test_the_output_is_plain_json_and_a_page(stage_problem):
    problem, _ = stage_problem(5, "single", ["mirror_wobble"], snr=(150.0, 300.0))
    diagnosis = diagnose(problem)
    content = json.loads(json.dumps(diagnosis.as_mapping(), allow_nan=False))
    assert content["schema"] == 1
    assert set(content) >= {"verdict", "causes", "ranking", "indistinguishable", "where", "gap"}
    assert set(content["gap"]) == {"before", "after", "noise_floor", "shrink", "interval"}
    assert content["ranking"][0]["effect"] == "mirror_wobble"
    assert content["ranking"][0]["held_out_gap"] < content["ranking"][-1]["held_out_gap"]
    with Painter() as painter:
        files = report_files(problem, diagnosis, "a <case>", painter, {"recorded": "2026-11-26 <now>"})
    written = files["diagnosis.html"].decode()
    assert "mirror mounted askew (mirror_wobble)" in written and "a &lt;case&gt;" in written
    assert "2026-11-26 &lt;now&gt;" in written and "Align the mirror" in written
    (found,) = diagnosis.causes
    told = re.search(r"tilt \((-?[\d.]+) ± [\d.]+, (-?[\d.]+) ± [\d.]+\) ([nµ])rad", verdict_sentence(diagnosis))
    assert told is not None
    tilt = np.array([float(told[1]), float(told[2])]) * {"n": 1e-9, "µ": 1e-6}[told[3]]
    np.testing.assert_allclose(tilt, found.parameters["tilt"].value, atol=0.1 * max(found.parameters["tilt"].std))
    # Four letters of an embedded picture may happen to be those.
    assert "http" not in re.sub(r"base64,[A-Za-z0-9+/=]*", "", written).replace("http-equiv", "")
    assert set(files) == {"diagnosis.html", "diagnosis.png"} and files["diagnosis.png"].startswith(b"\x89PNG")


def test_a_twin_of_another_stage_is_refused(stage_problem):
    problem, _ = stage_problem(18, "null")
    stage = problem.stage
    turned = dataclasses.replace(
        stage,
        encoder=dataclasses.replace(stage.encoder, eccentricity=(3e-4, -2e-4)),
        mirror=dataclasses.replace(stage.mirror, tilt=(-4e-4, 4e-4)),
        lvdt=dataclasses.replace(stage.lvdt, artefact_eccentricity=(-9e-5, 8e-5)),
    )
    other = StageProblem(turned, problem.recording, EFFECTS)
    with pytest.raises(InputError, match="describes another stage"):
        diagnose(other)
