"""Curves of ring and mirror as tables, through the house: true stage, replay, twin and diagnosis."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from drawn_curves import DrawnCurves
from draws import seeds
from pushed_inputs import push_block

from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.description.stage import TIMINGS, StageDescription
from rotary_error_monitor.description.topics import samples_topic
from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.effects.library import load_effects
from rotary_error_monitor.effects.rotor import StageEffect
from rotary_error_monitor.gap.diagnosis import diagnose
from rotary_error_monitor.gap.verdict import Verdict
from rotary_error_monitor.kinds.stage.problem import StageProblem
from rotary_error_monitor.notebook.simulation import EPOCH_NS, simulate_bag
from rotary_error_monitor.pipeline.estimation import Estimator
from rotary_error_monitor.recordings.replay import replay_bag
from rotary_error_monitor.twin.stage import twin_of

SEEDS = seeds(3, 3)
EFFECTS = load_effects(StageEffect)


PLACES = {"": "", "following_error": "", "graduation_error": "order_5", "head_latency": "head_b"}
"""Effects that the twin is asked for, and where; none first."""


def exact(stage: StageDescription) -> StageDescription:
    """All that the mock cell does not know is what its tables say."""
    return replace(stage, uncertainty=dict.fromkeys(("encoder.eccentricity", "mirror.tilt", *TIMINGS), 0.0))


@pytest.fixture(scope="module", params=SEEDS)
def recorded(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Any:
    """Curves, their true stage by harmonics, and a bag of it."""
    drawn = DrawnCurves(request.param, even=False)
    folder = tmp_path_factory.mktemp("curves") / "bag"
    plant = simulate_bag(folder, drawn.stages()[0], seconds=12.0, seed=request.param)
    return drawn, plant, folder


def test_a_replay_by_tables_is_that_by_harmonics(recorded: Any) -> None:
    """To what interpolation misses: of the radial error motion two heads' halves, of the tilt once."""
    drawn, _, bag = recorded
    by_orders, by_tables = (replay_bag(bag, exact(stage)) for stage in drawn.stages())
    np.testing.assert_array_equal(by_orders.stamp_ns, by_tables.stamp_ns)
    apart = np.abs(by_orders.error_motion - by_tables.error_motion)
    assert 0 < apart[:, :2].max() <= 0.1 * drawn.ring_bound
    assert 0 < apart[:, 3:5].max() <= drawn.mirror_bound
    one, other = by_orders.motion.covariance.copy(), by_tables.motion.covariance
    # what interpolation of readings misses counts in the tilt's variance: of the described part it is the tables'
    sure, also = (np.sqrt(np.diagonal(each, axis1=1, axis2=2)[:, 3:5]) for each in (one, other))
    assert np.abs(sure - also).max() <= 0.01 * drawn.mirror_bound
    one[:, [3, 4], [3, 4]] = other[:, [3, 4], [3, 4]]
    np.testing.assert_allclose(one, other, rtol=1e-3, atol=1e-24)


def test_a_live_run_in_other_blocks_gives_the_same_bits(recorded: Any) -> None:
    drawn, _, bag = recorded
    stage = drawn.stages()[1]
    replayed = replay_bag(bag, stage)
    estimator = Estimator(stage)
    topics = {samples_topic(name): name for name in estimator.inputs}
    reader = BagReader(bag)
    read = reader.read_blocks([topic for topic in topics if topic in reader.topics])
    parts = [(topic, part) for topic, blocks in read.items() for block in blocks for part in halves(block)]
    live = []
    for topic, part in sorted(parts, key=lambda pair: int(pair[1].times_ns[-1])):
        live += push_block(estimator, topics[topic], part)
    live += estimator.finish()
    components = np.concatenate([motion.components for motion in live])
    seen = np.concatenate([motion.observable for motion in live])
    np.testing.assert_array_equal(np.where(seen, components, np.nan), replayed.error_motion)


def halves(block: Any) -> Any:
    middle = len(block.times_ns) // 2
    return [replace(block, rows=block.rows[part]) for part in (slice(0, middle), slice(middle, None)) if middle]


def test_the_estimate_of_a_stage_whose_true_curves_are_tables(recorded: Any, tmp_path: Path) -> None:
    """The plant interpolates by itself; the truth is within the stated uncertainty as often as it says."""
    drawn, _, _ = recorded
    stage = exact(drawn.stages()[1])
    plant = simulate_bag(tmp_path / "bag", stage, seconds=12.0, seed=9)
    found = replay_bag(tmp_path / "bag", stage)
    scene = plant.scene((found.stamp_ns - EPOCH_NS) * 1e-9)
    late = found.stamp_ns > EPOCH_NS + 6_000_000_000  # after a turn has confirmed the description
    for places, truth in (((0, 1), scene.radial), ((3, 4), scene.tilt)):
        for place, true in zip(places, (truth.real, truth.imag), strict=True):
            error = (found.error_motion[:, place] - true)[late]
            std = np.sqrt(found.motion.covariance[late, place, place])
            assert np.mean(np.abs(error) < 1.96 * std) > 0.93
            assert np.sqrt(np.mean((error / std) ** 2)) < 1.1


def test_the_twin_by_tables_is_that_by_harmonics(stage_problem: Callable[..., Any]) -> None:
    """Also where an effect turns the rotor, or adds an order to what the table says."""
    problem, _ = stage_problem(41, "null")
    known = {effect.name: effect for effect in EFFECTS}
    for seed in SEEDS:
        drawn = DrawnCurves(seed, even=False)
        twins = [twin_of(curved(problem.stage, stage), problem.recording) for stage in drawn.stages()]
        for name, place in PLACES.items():
            effect = known.get(name)
            causes = () if effect is None else (Cause(effect, place, effect.start(place) + effect.scales()),)
            assert name == "" or effect is not None, name
            by_orders, by_tables = (twin.predict(causes) for twin in twins)
            for stream, values in by_orders.items():
                bound = {"h": drawn.ring_bound, "a": drawn.mirror_bound}.get(stream[0], 0.0)
                # the sight line cuts the ring where the slope of the curve counts as well: 1e-3 of it
                assert np.abs(values - by_tables[stream]).max() <= 1.05 * bound + 1e-12, (name, stream)


@pytest.mark.long
def test_a_diagnosis_knows_tables_and_what_they_leave_unsure(stage_problem: Callable[..., Any]) -> None:
    """Of a stage described by tables nothing is missing; an order that is not described is found beside one."""
    quiet = 0
    for seed in (51, 52, 53):
        problem, _ = stage_problem(seed, "null")
        drawn = DrawnCurves(seed, u=2e-8)
        ring, mirror = problem.stage.ring, problem.stage.mirror
        recording = with_curves(problem.recording, ring.azimuths, drawn)
        full = replace(
            problem.stage,
            encoder=replace(ring, graduation_table=drawn.ring_table),
            mirror=replace(mirror, flatness_table=drawn.mirror_table),
        )
        quiet += diagnose(StageProblem(full, recording, EFFECTS)).verdict is Verdict.NO_GAP
    assert quiet >= 2, "of a hundred one alarms"
    strongest = max((row for row in drawn.ring if row.order % 4), key=lambda row: float(np.hypot(row.cos, row.sin)))
    others = (*ring.graduation, *(row for row in drawn.ring if row is not strongest))
    lacking = replace(full, encoder=replace(ring, graduation=others))
    found = diagnose(StageProblem(lacking, recording, EFFECTS))
    assert [cause.cause.key for cause in found.causes] == [("graduation_error", f"order_{strongest.order}")]


def curved(stage: StageDescription, other: StageDescription) -> StageDescription:
    """A stage with ring errors and mirror of another."""
    ring = other.ring
    encoder = replace(stage.ring, graduation=ring.graduation, graduation_table=ring.graduation_table)
    return replace(stage, encoder=encoder, mirror=other.mirror)


def with_curves(recording: Any, azimuths: Any, drawn: DrawnCurves) -> Any:
    """The recording of a stage whose ring and mirror have these curves besides."""
    streams = dict(recording.streams)
    command = streams["command"]
    for name, stream in recording.streams.items():
        theta = np.interp(stream.time, command.time, command.values[:, 0])
        if name.startswith("head_"):
            more = drawn.graduation(azimuths[name[-1]] - stream.values[:, 0])[:, None]
        elif name == "autocollimator":
            more = drawn.flatness(theta)
        else:
            continue
        streams[name] = replace(stream, values=stream.values + more)
    return replace(recording, streams=streams)
