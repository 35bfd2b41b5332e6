"""On less than a turn few waves over the rotation are independent: what sums of more fit is something unknown."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from draws import seeds

from rotary_error_monitor.cases.making import make_stage_case
from rotary_error_monitor.description.streams import COMMAND
from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.effects.library import effect_named, load_effects
from rotary_error_monitor.effects.rotor import StageEffect
from rotary_error_monitor.gap.diagnosis import diagnose
from rotary_error_monitor.gap.verdict import Verdict
from rotary_error_monitor.kinds.stage.another import BURIED, FALSE, stage_statements
from rotary_error_monitor.kinds.stage.arc import Arc
from rotary_error_monitor.kinds.stage.problem import StageProblem
from rotary_error_monitor.plant.motion import Motion, MotionSegment
from rotary_error_monitor.twin.recording import record_stage

EFFECTS = load_effects(StageEffect)


def wave(order, effect="drive_cyclic_error"):
    known = effect_named(effect, EFFECTS)
    return Cause(known, f"order_{order}", known.start(f"order_{order}"))


def swings(seed, duration):
    """To and fro within half a turn or so, a stop at either end."""
    draw = np.random.default_rng([seed, 6])
    count = round(duration / 4)
    rows = [MotionSegment((duration - 3) / count, (-1) ** i * float(draw.uniform(0.3, 0.75))) for i in range(count)]
    return Motion((MotionSegment(1.5, 0.0), *rows, MotionSegment(1.5, 0.0)))


@pytest.fixture
def pulled(stage_problem):
    """Function that gives a stage without a gap whose rotor is then moved by a function of its rotation in rad."""

    def make(seed, course, size, duration=20.0):
        problem, _ = stage_problem(seed, "null", duration=duration, motion=swings(seed, duration))
        streams, command = dict(problem.recording.streams), problem.recording.streams[COMMAND]
        for name in [name for name in streams if name.startswith("head_")]:
            stream = streams[name]
            angle = np.interp(stream.time, command.time, command.values[:, 0])
            values = stream.values.copy()
            values[:, 0] += size * course(angle)
            streams[name] = dataclasses.replace(stream, values=values)
        return StageProblem(problem.stage, dataclasses.replace(problem.recording, streams=streams), EFFECTS)

    return make


def test_on_an_arc_no_statement_of_the_right_twin_is_false():
    """Amplitudes that others pass for are none: they were false in 15 of 40, as if it were another stage's twin."""
    false = 0
    for seed in seeds(40):
        draw = np.random.default_rng([11, seed])
        arc, speed = draw.uniform(1.5, 8.0), draw.uniform(0.3, 3.0)
        to_and_fro = Motion((MotionSegment(arc / speed, speed), MotionSegment(arc / speed, -speed)))
        case = make_stage_case(seed, "null", rough=True, duration=20.0, motion=to_and_fro)
        recording = record_stage({name: list(blocks) for name, blocks in case.blocks.items()}, "abcd")
        problem = StageProblem(case.twin, recording, EFFECTS)
        statements = stage_statements(recording, problem.raw_residual(()), problem.twin, problem.noise.std)
        false += any(each.stated > BURIED * each.measured and each.apart > FALSE * each.stated for each in statements)
    assert false <= 0.2 * len(seeds(40))


def test_waves_of_whole_turns_are_told_apart():
    whole = Arc(1.0)
    assert whole.tells_apart(range(1, 9)) and whole.independent(wave(1)) == 1.0
    assert not whole.doubt([wave(1), wave(2)], ["command", "head_a"])


@pytest.mark.parametrize(
    ("turns", "orders", "apart"),
    [(0.6, (1,), True), (0.6, (1, 2), False), (0.6, (1, 4), True), (0.6, (1, 4, 4), False), (0.1, (5, 30), True)],
)
def test_as_many_waves_as_are_independent_are_told_apart(turns, orders, apart):
    """Up to order K there are K turns of them, a cosine and a sine each."""
    assert Arc(turns).tells_apart(orders) is apart
    doubt = Arc(turns).doubt([wave(order) for order in orders], ["command", "head_a"])
    assert bool(doubt) is not apart and (apart or "record whole turns" in doubt)


def test_waves_of_other_instruments_are_no_sum():
    assert not Arc(0.5).doubt([wave(1), wave(2, "mirror_flatness")], ["command", "head_a", "autocollimator.x"])


def test_a_smooth_course_over_an_arc_is_unknown(pulled):
    """The torque of a cable, cubic in the rotation; with orders beside orders 1 and 2 each was explained before."""
    verdicts = {}
    for seed in seeds(6, 30):
        diagnosis = diagnose(pulled(seed, lambda angle: (angle / 1.5) ** 3 - 0.2 * angle, 6e-6))
        verdicts[seed] = diagnosis.verdict.value, [found.cause.key for found in diagnosis.causes]
    assert sum(verdict == "unknown" for verdict, _ in verdicts.values()) >= 0.75 * len(verdicts), verdicts


def test_one_order_over_an_arc_is_told(pulled):
    """In its textbook form: it leaves nothing, which few smooth courses would."""
    right = []
    for seed in seeds(6, 40):
        diagnosis = diagnose(pulled(seed, lambda angle: np.cos(2 * angle + 1.0), 3e-6))
        causes = [found.cause.key for found in diagnosis.causes]
        right.append(diagnosis.verdict is Verdict.EXPLAINED and causes == [("drive_cyclic_error", "order_2")])
    assert sum(right) >= 0.75 * len(right), right
