"""Signatures that are kept follow the noise as if they were made anew."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from rotary_error_monitor.effects.effect import Cause, Role
from rotary_error_monitor.effects.library import load_effects
from rotary_error_monitor.effects.rotor import StageEffect
from rotary_error_monitor.kinds.stage.problem import StageProblem
from rotary_error_monitor.kinds.stage.signatures import KeptSignatures
from rotary_error_monitor.sensors.library import kind_of

EFFECTS = load_effects(StageEffect)
PLACES = {"unbalance": "", "encoder_latency": "", "head_latency": "head_b", "mirror_wobble": "", "lvdt_height": ""}


def signatures(problem):
    found = {}
    for effect in EFFECTS:
        if effect.name in PLACES:
            place = PLACES[effect.name]
            found[effect.name] = problem.signature(
                Cause(effect, place, effect.start(place)), effect.indices(Role.LINEAR)
            )
    return found


@pytest.mark.parametrize(
    ("section", "noise"), [("lvdt", 0.5), ("autocollimator", 0.4), ("encoder", 0.01)], ids=lambda value: str(value)
)
def test_kept_signatures_follow_the_noise(stage_problem, section, noise):
    case, _ = stage_problem(26, "null", rough=section == "autocollimator")
    part = getattr(case.stage, section)
    quiet = dataclasses.replace(
        part,
        noise=noise * part.noise,
        **({"counts_per_line": 2 * part.counts_per_line} if section == "encoder" else {}),
    )
    problem = StageProblem(dataclasses.replace(case.stage, **{section: quiet}), case.recording, EFFECTS)
    before = signatures(problem)
    assert problem.learn_noise(())
    kept = signatures(problem)
    problem._signatures = KeptSignatures()
    anew = signatures(problem)
    changed = False
    for name, rows in anew.items():
        assert set(kept[name]) == set(rows)
        for channel, values in rows.items():
            np.testing.assert_allclose(kept[name][channel], values, atol=1e-9 * np.abs(values).max())
            changed |= not np.allclose(before[name][channel], values, rtol=1e-3)
    assert changed


@pytest.mark.parametrize(
    ("channel", "kind"), [("head_a", "head"), ("lvdt.x", "lvdt"), ("autocollimator.y", "autocollimator")]
)
def test_kinds(channel, kind):
    assert kind_of(channel) == kind
