"""Departures: each mechanism is off at no strength, and departs by what the truth says."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from draws import seeds

from rotary_error_monitor.cases.case_faults import sized
from rotary_error_monitor.cases.departures import MECHANISMS, SHARES, Departure, Varied, fit_textbook
from rotary_error_monitor.cases.departures.friction import CompliantFlanks, side_of_play
from rotary_error_monitor.cases.departures.poses import lagging
from rotary_error_monitor.cases.draws import draw_fault, draw_stage, machine_faults, stage_faults
from rotary_error_monitor.cases.faults import make_fault
from rotary_error_monitor.cases.making import MachineCase, StageCase, make_machine_case, make_stage_case
from rotary_error_monitor.cases.response import FaultResponse, MachineResponse, StageResponse
from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.plant.environment import TemperatureCourse, intermittent_forces, lagged_warming
from rotary_error_monitor.plant.machine import MachinePlant, MachineStates
from rotary_error_monitor.plant.motion import Motion, MotionSegment
from rotary_error_monitor.plant.scene import Fault
from rotary_error_monitor.plant.stage import StagePlant

PAIRS = [(effect, kind) for effect, kinds in MECHANISMS.items() for kind in kinds]
WITHOUT_SMALL_LIMIT = (CompliantFlanks,)
"""Play that stays at rest differs from the textbook however stiff its flanks are."""


@cache
def stage_response() -> FaultResponse:
    draw = np.random.default_rng(3)
    return StageResponse(StagePlant(draw_stage(draw), 1, forces=intermittent_forces(1)), 40.0, every=67)


@cache
def machine_response() -> FaultResponse:
    draw, machine = np.random.default_rng(3), load_machine("pan2013")
    low, high = (0.9 * np.array(limits) for limits in zip(*(axis.travel for axis in machine.axes), strict=True))
    warming = -3.0 * np.expm1(-np.arange(60) / 15)
    poses = MachineStates(draw.uniform(low, high, (60, 5)), draw.choice([-1.0, 1.0], (60, 5)), warming)
    return MachineResponse(MachinePlant(machine), poses)


def varied(effect: str, kind: type[Departure]) -> tuple[Varied, FaultResponse]:
    draw = np.random.default_rng(7)
    response = stage_response() if effect in stage_faults() else machine_response()
    fault = sized(draw_fault(effect, draw), draw, (300.0, 300.0), response)
    return Varied(fault, kind.drawn(draw)), response


def as_strong(case: Varied, strength: float) -> Varied:
    return replace(case, departure=case.departure.scaled(strength / abs(case.departure.strength)))


def test_every_effect_of_the_vocabulary_has_mechanisms_of_its_own() -> None:
    assert set(MECHANISMS) == {*stage_faults(), *machine_faults()}
    assert all(len(set(kinds)) == len(kinds) >= 2 for kinds in MECHANISMS.values())


@pytest.mark.parametrize(("effect", "kind"), PAIRS, ids=lambda value: getattr(value, "__name__", value))
def test_a_mechanism_is_off_at_no_strength_and_told_in_words(effect: str, kind: type[Departure]) -> None:
    case, response = varied(effect, kind)
    weak, strong = (fit_textbook(as_strong(case, part * kind.most), response.channels).share for part in (1e-3, 0.7))
    assert weak < 0.3 * strong or kind in WITHOUT_SMALL_LIMIT
    assert SHARES[0] < strong < 0.95
    assert len(case.departure.words) > 10
    larger = replace(case, textbook=case.textbook.scaled(2.0))
    assert response.size((larger,)) == pytest.approx(2 * response.size((case,)), rel=0.1)


def signals(case: StageCase, faults: tuple[Fault, ...]) -> dict[str, np.ndarray]:
    """Of each channel, over the noise as the page of the stage states it."""
    plant, stage = replace(case.plant, faults=faults), case.plant.description
    found = {}
    for stream in ("head_a", "head_b", "head_c", "head_d", "autocollimator", "lvdt"):
        if stream in plant.streams:
            count = plant.index_at(stream, plant.epoch_ns + 40_000_000_000)
            sensor = {"autocollimator": stage.autocollimator, "lvdt": stage.lvdt}.get(stream, stage.encoder)
            step = getattr(sensor, "resolution", 0.0) / np.sqrt(12)
            shown = plant.signal(stream, plant.clocks[stream].times_ns(0, count) * 1e-9)
            names = {"autocollimator": "tilt_{}", "lvdt": "radial_{}"}.get(stream, "angle")
            for letter, column in zip("xy", shown.T, strict=False):
                found[f"/stage/{stream}/samples.{names.format(letter)}"] = column / np.hypot(sensor.noise, step)
    return found


def check_off_textbook(told: dict[str, float], distance) -> None:
    """The truth's figures are those of the fitted textbook form, and no other parameters come nearer."""
    nearest = distance({})
    top = max(told.values())
    for name, value in told.items():
        assert np.linalg.norm(nearest[name]) == pytest.approx(value, rel=0.1, abs=0.03 * top)
    least = np.linalg.norm(np.concatenate(list(nearest.values())))
    for factor in (0.9, 0.97, 1.03, 1.1):
        other = distance({"factor": factor})
        assert np.linalg.norm(np.concatenate(list(other.values()))) > least * 0.999


@pytest.mark.parametrize("rough", [False, True], ids=["clean", "rough"])
@pytest.mark.parametrize("seed", seeds(4))
def test_a_varied_stage_departs_by_what_its_truth_says(seed: int, rough: bool) -> None:
    case = make_stage_case(300 + seed, "variant", rough=rough, snr=(300.0, 1000.0))
    (fault,), departure = case.truth.faults, case.truth.departure
    shown = signals(case, case.plant.faults)

    def distance(change: dict[str, float]) -> dict[str, np.ndarray]:
        textbook = make_fault(fault.name, fault.location, **departure.fitted).scaled(change.get("factor", 1.0))
        return {name: shown[name] - column for name, column in signals(case, (textbook,)).items()}

    check_off_textbook(dict(departure.off_textbook_snr), distance)
    whole = np.linalg.norm(list(case.truth.snr.values()))
    left = np.linalg.norm(list(departure.off_textbook_snr.values()))
    assert left / whole == pytest.approx(departure.share, rel=0.1)
    assert SHARES[0] * 0.8 < departure.share < SHARES[1] * 1.2
    assert max(signals(case, ()).keys() ^ case.truth.snr.keys(), default="") == ""


@pytest.mark.parametrize("rough", [False, True], ids=["clean", "rough"])
@pytest.mark.parametrize("seed", seeds(4))
def test_a_varied_machine_departs_by_what_its_truth_says(seed: int, rough: bool) -> None:
    machine = load_machine("pan2013")
    case = make_machine_case(machine, 400 + seed, "variant", rough=rough)
    (fault,), departure = case.truth.faults, case.truth.departure
    parts = fault.departure.parts(fault.textbook)
    shown = MachinePlant(machine, parts).tool_offset(case.poses)[:, :3]

    def distance(change: dict[str, float]) -> dict[str, np.ndarray]:
        textbook = make_fault(fault.name, fault.location, **departure.fitted).scaled(change.get("factor", 1.0))
        left = shown - MachinePlant(machine, (textbook,)).tool_offset(case.poses)[:, :3]
        return {"/machine/tool_probe": left.ravel() / 1.5e-6}

    check_off_textbook(dict(departure.off_textbook_snr), distance)
    assert SHARES[0] * 0.8 < departure.share < SHARES[1] * 1.2


def told(case: StageCase | MachineCase) -> dict[str, object]:
    return case.truth.as_mapping()


def test_variants_come_again_from_their_seed_and_say_what_they_are() -> None:
    case, again = (make_stage_case(31, "variant", ["mirror_wobble"]) for _ in range(2))
    assert told(case) == told(again)
    for stream, blocks in case.blocks.items():
        for block, other in zip(blocks, again.blocks[stream], strict=True):
            np.testing.assert_array_equal(block.rows, other.rows)
    content = told(case)
    assert [row["effect"] for row in content["effects"]] == ["mirror_wobble"]
    assert content["kind"] == "variant" and content["departure"]["mechanism"]
    assert set(content["off_textbook_snr"]) == set(content["snr"])
    assert "departure" not in told(make_stage_case(31, "single", ["mirror_wobble"], duration=10.0))


def test_samples_of_a_swelling_fault_do_not_depend_on_what_else_is_asked_for() -> None:
    case = make_stage_case(31, "variant", ["mirror_wobble"], duration=20.0)
    whole = case.plant.samples("autocollimator", 0, 4000).rows[:, 1:]
    part = case.plant.samples("autocollimator", 1500, 700).rows[:, 1:]
    np.testing.assert_array_equal(whole[1500:2200], part)


def test_play_stays_at_rest_and_changes_side_as_it_travels() -> None:
    motion = Motion(
        (MotionSegment(2.0, 0.0), MotionSegment(4.0, 1.0), MotionSegment(4.0, -1.0), MotionSegment(2.0, 0.0))
    )
    time = np.linspace(0, 12, 1201)
    side = side_of_play(motion, time, 1e-3, 1e9, -1.0)
    np.testing.assert_allclose(side[time < 1.9], -1.0)
    np.testing.assert_allclose(side[(time > 2.2) & (time < 5.9)], 1.0, atol=1e-6)
    np.testing.assert_allclose(side[time > 6.3], -1.0, atol=1e-6)  # also in the rest at the end
    slow = side_of_play(motion, np.array([4.0]), 1.0, 1e9, -1.0)
    travelled = motion.at(np.array([4.0]))[0] - motion.at(np.array([2.0]))[0]
    np.testing.assert_allclose(slow, 1 - 2 * np.exp(-travelled), atol=1e-4)
    crept = side_of_play(motion, np.array([1.5]), 1e-3, 0.5, -1.0)
    np.testing.assert_allclose(crept, -np.exp(-3.0), rtol=0.02)


def test_a_part_that_lags_follows_the_closed_form() -> None:
    time, rise, settling, lag = np.linspace(0, 40, 81), 3.0, 12.0, 5.0
    follows = lagged_warming(TemperatureCourse(20.0, rise, settling), 20.0, time, lag)
    closed = rise * (1 - (settling * np.exp(-time / settling) - lag * np.exp(-time / lag)) / (settling - lag))
    np.testing.assert_allclose(follows, closed, atol=0.01)
    steps = lagging(np.concatenate([[0.0], np.full(50, 2.0)]), 10.0)
    np.testing.assert_allclose(steps, 2 * -np.expm1(-np.arange(51) / 10), atol=1e-12)
