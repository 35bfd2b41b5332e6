"""The diagnosis beside what one might use instead, on the same cases in the same run. Figures are printed, none is a
bound. `BENCH_CASES` says how many cases, `BENCH_SEED` which."""

from __future__ import annotations

import hashlib
import json
import os
import sys
import time
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))

from baselines import LargestScore, SparseRegression, residuals_of, signatures
from isolation import IsolationMatrix

from rotary_error_monitor.blind_check.cases import make_case, plan_cases
from rotary_error_monitor.blind_check.scores import score_case
from rotary_error_monitor.cases.making import make_stage_case
from rotary_error_monitor.effects.library import load_effects
from rotary_error_monitor.effects.rotor import StageEffect, effects_of
from rotary_error_monitor.gap.diagnosis import diagnose
from rotary_error_monitor.kinds.stage.problem import StageProblem
from rotary_error_monitor.twin.recording import record_stage

CASES = int(os.environ.get("BENCH_CASES", "30"))
SEED = int(os.environ.get("BENCH_SEED", "1"))
TRAINING_SEED = 900_000
TRAINING = 24
KINDS = ("single", "new speed", "pair", "unknown", "left out", "weak", "null")
OURS = "rotary_error_monitor"


def recorded(case):
    blocks = {stream: list(found) for stream, found in case.blocks.items()}
    return record_stage(blocks, sorted(case.twin.encoder.azimuths))


@pytest.fixture(scope="module")
def methods():
    """Each method as a function of a case's twin and recording, effects that it may not know, giving a verdict."""
    begin = time.perf_counter()
    training = [make_stage_case(TRAINING_SEED + i, "null") for i in range(TRAINING)]
    effects = effects_of(training[0].twin, load_effects(StageEffect))
    nulls = [residuals_of(case.twin, recorded(case)) for case in training]
    library = signatures(training[0].twin, recorded(training[0]), effects)
    scores, sparse = LargestScore.learn(nulls, library, effects), SparseRegression.learn(nulls, library)
    matrix = IsolationMatrix.learn(training[0].twin, nulls, effects)
    print(
        f"\n{TRAINING} recordings without a gap and {len(library)} signatures learnt in "
        f"{time.perf_counter() - begin:.0f} s; {len(matrix.sets)} residuals in the isolation matrix"
    )

    def ours(stage, recording, left_out):
        known = tuple(effect for effect in effects if effect.name not in left_out)
        return diagnose(StageProblem(stage, recording, known)).as_mapping()

    def baseline(method):
        return lambda stage, recording, left_out: method.diagnose(residuals_of(stage, recording), left_out)

    return {
        OURS: ours,
        "largest z-score": baseline(scores),
        "sparse regression": baseline(sparse),
        "isolation matrix": baseline(matrix),
    }


def test_beside_what_one_might_use_instead(methods):
    plans = plan_cases(SEED, CASES, ("stage",), (False,), KINDS)
    truths = []
    for plan in plans:
        truth = make_case(plan).truth
        content = truth.as_mapping()
        content["outside"] = [fault.name for fault in truth.faults] if plan.kind == "unknown" else []
        content["sizes"] = []  # of no interest here
        truths.append(content)
    sealed = json.dumps(truths, sort_keys=True)
    print(f"{len(plans)} cases; sealed truth: sha256 {hashlib.sha256(sealed.encode()).hexdigest()}")
    answers = {name: [] for name in methods}
    for plan in plans:
        case = make_case(plan)
        recording = recorded(case)
        for name, method in methods.items():
            begin = time.perf_counter()
            answers[name].append((method(case.twin, recording, plan.left_out), time.perf_counter() - begin))
    print(f"  {'':<20} {'  '.join(f'{kind:>9}' for kind in KINDS)}  false alarms  names offered  seconds a case")
    for name, found in answers.items():
        rows = [score_case(p, t, a, s) for p, t, (a, s) in zip(plans, truths, found, strict=True)]
        right = [share([row.right for row in rows if row.plan.group == kind]) for kind in KINDS]
        alarms = share([row.alarmed for row in rows if row.plan.group == "null"])
        offered = np.mean([names_offered(a) for a, _ in found if a["verdict"] == "explained"] or [0])
        seconds = np.median([row.seconds for row in rows])
        print(
            f"  {name:<20} {'  '.join(f'{cell:>9}' for cell in right)}  {alarms:>12}  {offered:13.1f}  {seconds:14.2f}"
        )
        for row in rows:
            if row.plan.group == "null" and row.alarmed:
                causes = ", ".join(" ".join(key) for key in row.named)
                print(f"  {'':<20} false alarm at seed {row.plan.seed}: {row.verdict} {causes}")


def share(flags):
    return f"{sum(flags)}/{len(flags)}"


def names_offered(answer):
    """How many effects a verdict leaves open: those it cannot tell apart count as well."""
    return max([len(answer["causes"]), *(len(group["effects"]) for group in answer["indistinguishable"])])
