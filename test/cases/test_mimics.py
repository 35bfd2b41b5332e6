"""Mimics: outside the vocabulary, and like a known effect by about half of its power."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from draws import seeds

from rotary_error_monitor.cases.draws import machine_faults, stage_faults
from rotary_error_monitor.cases.faults import VOCABULARY, make_fault
from rotary_error_monitor.cases.making import make_machine_case, make_stage_case
from rotary_error_monitor.cases.mimics import CORRELATIONS, NO_HALF, NOT_ONE_WAY
from rotary_error_monitor.description.machine import load_machine
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.plant.machine import MachinePlant

NOISE = 1.5e-6


def correlation(shown: np.ndarray, others: list[np.ndarray]) -> float:
    """Multiple correlation of a signal with others, about zero."""
    table = np.stack(others, axis=1)
    fitted = table @ np.linalg.lstsq(table, shown, rcond=None)[0]
    return float(np.linalg.norm(fitted) / np.linalg.norm(shown))


@pytest.mark.parametrize("rough", [False, True], ids=["clean", "rough"])
@pytest.mark.parametrize("seed", seeds(5))
def test_a_mimic_of_a_machine_resembles_what_its_truth_says_by_half(seed: int, rough: bool) -> None:
    machine = load_machine("pan2013")
    case = make_machine_case(machine, 50 + seed, "mimic", rough=rough)
    content = case.truth.as_mapping()
    assert content["kind"] == "unknown" and content["effects"] == []
    told = content["resembles"]
    (mimic,) = case.truth.faults

    def moved(*parts) -> np.ndarray:
        plants = [MachinePlant(machine, parts), MachinePlant(machine)]
        return np.subtract(*(plant.tool_offset(case.poses)[:, :3].ravel() for plant in plants)) / NOISE

    whole = moved(*mimic.departure.parts(mimic.textbook))
    assert mimic.textbook.name not in NO_HALF
    own = correlation(whole, [moved(part) for part in one_parameter_each(mimic.textbook)])
    if (told["effect"], told["location"]) == (mimic.textbook.name, mimic.textbook.location):
        assert own == pytest.approx(told["correlation"], abs=0.02)
    assert own <= told["correlation"] + 0.02
    assert CORRELATIONS[0] <= told["correlation"] <= CORRELATIONS[1]
    for name, kind in VOCABULARY.items():  # nor does any other known effect of one place come nearer
        if name in ("head_droop", "tool_length", "pivot_offset", "setup_offset"):
            zero = kind(**nothing(name))
            others = [moved(part) for part in one_parameter_each(zero)]
            assert correlation(whole, others) <= told["correlation"] + 0.02


def nothing(name: str) -> dict[str, object]:
    sizes = {"head_droop": {"coefficient": 1e-6}, "tool_length": {"offset": 1e-6}}
    vectors = {"pivot_offset": {"shift": (1e-6,) * 2}, "setup_offset": {"shift": (1e-6,) * 3, "rotation": (1e-6,) * 3}}
    return {**sizes.get(name, {}), **vectors.get(name, {})}


def one_parameter_each(fault) -> list:
    """The fault with each of its parameters alone, shapes as they are."""
    found = []
    larger = fault.scaled(2.0).parameters
    free = [name for name, value in fault.parameters.items() if larger[name] != value]
    for name in free:
        count = len(np.atleast_1d(fault.parameters[name]))
        for index in range(count):
            values = dict(fault.parameters)
            for other in free:
                zero = np.zeros(len(np.atleast_1d(values[other])))
                if other == name:
                    zero[index] = 1e-5
                values[other] = zero.tolist() if len(zero) > 1 else float(zero[0])
            found.append(make_fault(fault.name, fault.location, **values))
    return found


@pytest.mark.parametrize("rough", [False, True], ids=["clean", "rough"])
@pytest.mark.parametrize("seed", seeds(4))
def test_a_mimic_of_a_stage_resembles_the_effect_that_it_is_half_of_by_no_more_than_half(
    seed: int, rough: bool
) -> None:
    case = make_stage_case(70 + seed, "mimic", rough=rough)
    (mimic,), told = case.truth.faults, case.truth.resemblance
    stage, plain = case.plant.description, replace(case.plant, faults=())
    noise = {"autocollimator": stage.autocollimator, "lvdt": stage.lvdt}
    time = np.sort(np.random.default_rng(seed).uniform(0, 40, 1500))

    def moved(parts) -> np.ndarray:
        plant, shown = replace(case.plant, faults=tuple(parts)), []
        for stream in plain.streams:
            if stream not in ("command", "force", "temperature"):
                sensor = noise.get(stream, stage.encoder)
                scale = np.hypot(sensor.noise, getattr(sensor, "resolution", 0.0) / np.sqrt(12))
                rate = np.sqrt(plain.clocks[stream].rate)
                shown.append((plant.signal(stream, time) - plain.signal(stream, time)).ravel() * rate / scale)
        return np.concatenate(shown)

    whole = moved(case.plant.faults)
    size = np.linalg.norm(whole) * np.sqrt(40 / len(time))
    assert size == pytest.approx(np.linalg.norm(list(case.truth.snr.values())), rel=0.1)
    own = correlation(whole, [moved([part]) for part in one_parameter_each(mimic.textbook)])
    assert CORRELATIONS[0] <= told.correlation <= CORRELATIONS[1]
    assert own <= told.correlation + 0.05
    if (told.effect, told.location) == (mimic.textbook.name, mimic.textbook.location):
        assert own == pytest.approx(told.correlation, abs=0.05)


def test_mimics_come_again_from_their_seed_and_are_told_in_words() -> None:
    one, two = (make_stage_case(9, "mimic", duration=40.0) for _ in range(2))
    assert one.truth == two.truth
    assert one.truth.faults[0].name.startswith(one.truth.faults[0].textbook.name + " ")
    assert set(NO_HALF) <= set(stage_faults())
    assert set(NOT_ONE_WAY) <= set(machine_faults())


def test_what_has_no_half_makes_no_mimic() -> None:
    with pytest.raises(InputError, match=r"a case of kind mimic takes .* got radial_hysteresis"):
        make_stage_case(9, "mimic", ["radial_hysteresis"])
