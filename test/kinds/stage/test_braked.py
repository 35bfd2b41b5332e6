"""Tables that are clamped while they stand: the rotor keeps what the jitter had made of its place.

A servo that holds the rotor jitters on; a hydraulic clamp or a brake does not. The recordings are those of a world
written apart.
"""

from __future__ import annotations

import numpy as np
import pytest
import yaml
from described_stages import by_stream, stage_of
from draws import seeds
from kinds.stage.test_jitter import NOISE, PERIOD, low_passed
from scipy.ndimage import uniform_filter1d
from world import Options, make_recording

from rotary_error_monitor.effects.library import load_effects
from rotary_error_monitor.effects.rotor import StageEffect
from rotary_error_monitor.gap.diagnosis import diagnose
from rotary_error_monitor.gap.verdict import Verdict
from rotary_error_monitor.kinds.stage.jitter import SharedMotion, estimate_jitter
from rotary_error_monitor.kinds.stage.stretches import stage_problem
from rotary_error_monitor.noise.jitter import Jitter, JitterFilter
from rotary_error_monitor.resources import config
from rotary_error_monitor.twin.recording import record_stage

EFFECTS = load_effects(StageEffect)
SECONDS = 25.0
COUNTS = [100, 4096]
"""Of a graduation line: at 100 noise does not break up the steps of a rotor that stands, at 4096 it does."""

COUNT = 8000
TIME = PERIOD * np.arange(COUNT)
MOVING = TIME % 1.7 < 0.5
FLOOR = 2 * PERIOD * NOISE**2


def described(counts):
    section = yaml.safe_load(config("stage.yaml").read_text(encoding="utf-8"))["stage"]
    section["encoder"]["counts_per_line"] = counts
    return section


def diagnosed(seed, counts, change=None, brake=True):
    """An indexing table beside its description; what is true beyond that `change` makes so."""
    true = described(counts)
    if change is not None:
        change(true)
    rates = {f"/stage/head_{head}/samples": 250.0 for head in "abcd"}
    habits = {"noise": 1.0, "quantise": True, "rounding": "round", "jitter": 1.0, "brake": brake}
    options = Options.textbook(motion="indexing", peak_speed=3.0, rates=rates, **habits)
    topics = make_recording(seed, duration=SECONDS, stage=true, options=options).blocks
    recording = record_stage(by_stream(topics), "abcd", without=("force", "temperature"))
    return diagnose(stage_problem(stage_of(described(counts)), recording, EFFECTS))


@pytest.mark.parametrize("counts", COUNTS)
def test_a_clamped_table_that_is_as_described_has_no_gap(counts):
    """What alarms beside a servo that holds it too, as one of a hundred does, does so by its other readings."""
    told = [seed for seed in seeds(24) if diagnosed(seed, counts).verdict is not Verdict.NO_GAP]
    told = [seed for seed in told if diagnosed(seed, counts, brake=False).verdict is Verdict.NO_GAP]
    assert len(told) <= 1, told


def off_centre(true):
    true["encoder"]["eccentricity"][0] += 3e-7


def turned(true):
    true["encoder"]["heads"]["c"]["azimuth"] += 4e-3


@pytest.mark.parametrize(("change", "effect"), [(off_centre, "disc_eccentricity"), (turned, "head_misplacement")])
def test_causes_are_named_on_a_clamped_table(change, effect):
    """And as often as beside a servo that holds it they leave nothing."""
    explained = np.zeros(2, int)
    for seed in seeds(12, 100):
        for i, brake in enumerate((True, False)):
            found = diagnosed(seed, COUNTS[seed % 2], change, brake)
            assert [each.cause.effect.name for each in found.causes] == [effect], (seed, brake)
            explained[i] += found.verdict is Verdict.EXPLAINED
    assert explained[0] >= explained[1] - 1 and explained[0] >= 0.5 * len(seeds(12))


def moved(draw, at_rest):
    """Shared motion of a rotor that is commanded to move and to stand in turn, and the jitter's size in motion."""
    jitter, _ = low_passed(draw, COUNT, 9.0)
    if at_rest == "held":
        jitter = jitter[np.maximum.accumulate(np.where(MOVING, np.arange(COUNT), 0))]
    elif at_rest == "hunting":
        jitter = jitter * uniform_filter1d(np.where(MOVING, 1.0, 3.0), 25)
    command = 2.0 * PERIOD * np.cumsum(MOVING)
    values, known = jitter + NOISE * draw.normal(size=COUNT), np.ones(COUNT, bool)
    return SharedMotion(TIME, command, values, known, MOVING, np.ones(COUNT), np.ones((COUNT, 1)), FLOOR)


@pytest.mark.parametrize("at_rest", ["jitters", "held", "hunting"])
def test_what_a_rotor_does_at_rest_is_told(at_rest):
    held, in_motion, standing = 0, [], []
    for seed in range(20):
        found, _ = estimate_jitter(moved(np.random.default_rng(seed), at_rest))
        held += found.is_held
        in_motion.append(np.log(found.std * found.in_motion / 2e-6))
        standing.append(np.log(found.std * found.at_rest / 2e-6))
    assert held >= 19 if at_rest == "held" else held <= 1
    # in the quieter state it is taken for as large as over the whole recording
    if at_rest != "hunting":
        assert np.exp(np.mean(in_motion)) == pytest.approx(1.0, rel=0.25)
    if at_rest != "held":
        assert np.exp(np.mean(standing)) == pytest.approx(3.0 if at_rest == "hunting" else 1.0, rel=0.25)


def test_rows_are_white_where_a_brake_held_the_rotor():
    """Also where some rows weigh less: in the mean over many stops, each with one value that all of its rows share."""
    draw, moving = np.random.default_rng(4), np.arange(60000) % 60 < 20
    stops = np.cumsum(np.diff(moving.astype(int), prepend=1) < 0)
    jitter = Jitter(is_held=True)
    white = JitterFilter(jitter, FLOOR, PERIOD, moving)
    weight = np.where(np.arange(len(moving)) % 3 == 0, 0.4, 1.0)
    shared = white.held * draw.normal(size=stops[-1] + 1)[stops] * ~moving
    rows = weight * (draw.normal(size=len(moving)) / weight + shared)
    found = white.without_holds(rows[:, None].copy(), weight)[:, 0]
    sums = np.array([found[(stops == stop) & ~moving].sum() for stop in range(1, stops[-1])])
    assert np.mean(np.square(sums)) == pytest.approx(40, rel=0.15)
    assert np.mean(np.square(found)) == pytest.approx(1.0, rel=0.02)
    np.testing.assert_array_equal(found[moving], rows[moving])
