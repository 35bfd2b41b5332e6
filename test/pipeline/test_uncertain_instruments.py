"""Zero of a listed sensor and latency of the autocollimator, known as well as stated: errors within covariance."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest
from described_stages import stage_of
from motion_numbers import assert_same_bits, decisions_of
from pipeline.test_estimation import values
from pipeline.test_listed_sensors import AXIAL, SECOND, described, off, recorded
from pushed_inputs import push_block
from scipy.stats import chi2

from rotary_error_monitor.description.stage import StageDescription, stage_mapping
from rotary_error_monitor.description.stage_section import Mirror
from rotary_error_monitor.metrology.error_motion import ErrorMotion
from rotary_error_monitor.pipeline.estimation import Estimator
from rotary_error_monitor.pipeline.estimator_settings import EstimatorSettings
from rotary_error_monitor.pipeline.evidence import COLUMNS
from rotary_error_monitor.pipeline.late_tilt import LateTilt
from rotary_error_monitor.pipeline.listed_readings import ListedReadings
from rotary_error_monitor.signals.blocks import block_from_samples
from rotary_error_monitor.signals.resampling import tick_times
from rotary_error_monitor.signals.streams import SampleStream
from rotary_error_monitor.twin.stage_parameters import uncertain_parameters

SEEDS, AT = range(12), 0.1
ZEROS = {"axial_probe_top": 2e-7, "tilt_sensor_second": 1e-6}  # m and rad, standard uncertainty
LATENCY = 1.5e-2  # s, that of the autocollimator
BY_ZERO = {"sensors.top.zero": 2e-7, "sensors.second.zero": 1e-6}
BY_LATENCY = {"autocollimator.timing": LATENCY}
SENSORS = {**AXIAL, **SECOND}


def stated(stage: StageDescription, more: dict[str, float]) -> StageDescription:
    return dataclasses.replace(stage, uncertainty={**stage.uncertainty, **more})


def estimated(pairs: Any, stage: StageDescription) -> tuple[ErrorMotion, list[tuple[str, str]]]:
    """Error motion of a short recording, which need not prove the description, and what is doubted."""
    estimator = Estimator(stage, EstimatorSettings(check_turns=0.0))
    found = [made for name, block in pairs for made in push_block(estimator, name, block)]
    return ErrorMotion.joined([*found, *estimator.finish()]), list(estimator.reasons)


def with_wrong_zeros(seed: int) -> ErrorMotion:
    """Without an autocollimator: what two sensors show whose zeros are others than described."""
    draw = np.random.default_rng([seed, 1])
    wrong = {name: ZEROS[name] * draw.normal(size=len(sensor.fields)) for name, sensor in SENSORS.items()}

    def moved(name: str, t: np.ndarray, readings: np.ndarray, _: object) -> np.ndarray:
        return readings + wrong.get(name, 0.0)

    return recorded(SENSORS, seed, duration=0.14, fault=moved, tilt=False)


def with_late_tilt(seed: int) -> Any:
    """An autocollimator that reads later or earlier than it is described to do."""
    late = LATENCY * np.random.default_rng([seed, 2]).normal()

    def delayed(name: str, t: np.ndarray, readings: np.ndarray, draw: np.random.Generator) -> np.ndarray:
        return readings if name != "autocollimator" else values(name, t - late) + 5e-7 * draw.normal(size=(len(t), 2))

    return recorded({}, seed, duration=0.14, fault=delayed)


CASES = {
    "zeros": (with_wrong_zeros, described(SENSORS, tilt=False), BY_ZERO, [2, 3, 4]),
    "latency": (with_late_tilt, described({}), BY_LATENCY, [3, 4]),
}


@pytest.mark.parametrize("case", CASES)
def test_errors_over_random_instruments_are_as_large_as_stated(case: str) -> None:
    """Mean square of errors at one time of many runs, in standard deviations: 1, and far more where none is stated."""
    record, stage, more, places = CASES[case]
    squares, without = [], []
    for seed in SEEDS:
        pairs = record(seed)
        motion, doubts = estimated(pairs, stated(stage, more))
        assert not doubts
        squares.append(square(motion, places))
        if seed < 4:
            without.append(square(estimated(pairs, stage)[0], places))
    low, high = chi2.ppf([1e-4, 1 - 1e-4], len(SEEDS) * len(places)) / len(SEEDS) / len(places)
    assert low < np.mean(squares) < high < np.nanmean(without)
    assert np.max(squares) < 25.0


def square(motion: ErrorMotion, places: list[int]) -> np.ndarray:
    """(k,) squares of errors in standard deviations at the time that counts."""
    found, t = off(motion)
    return found[np.searchsorted(t, AT), places] ** 2


def test_a_replay_has_the_same_bits_however_blocks_came_together() -> None:
    """Also of samples that are not even: live, several blocks may be there before the first is reckoned with."""
    more = BY_LATENCY | {"sensors.top.timing": 1e-3, "sensors.second.timing": 1e-3}
    stage = stated(described(SENSORS), more | {"encoder.timing": 1e-5})
    draw, pairs = np.random.default_rng(1), []
    for name, block in recorded(SENSORS, 1, duration=0.3):
        uneven = block.times_ns + draw.integers(-2000, 2000, len(block.rows))
        pairs.append((name, block_from_samples(uneven, block.names[1:], block.rows[:, 1:])))
    made: list[ErrorMotion] = []
    for batch in (25, 1):
        decisions = decisions_of(made[0]) if made else None
        estimator, parts = Estimator(stage, EstimatorSettings(check_turns=0.0), decisions), []
        for number, (name, block) in enumerate(pairs):
            estimator.accept(name, block)
            parts += estimator.advance() if number % batch == 0 else []
        made.append(ErrorMotion.joined([*parts, *estimator.finish()]))
    assert len(made[0].times_ns) > 200
    assert_same_bits(*made)


def test_what_is_known_exactly_changes_nothing() -> None:
    pairs = with_wrong_zeros(1)
    both = [
        estimated(pairs, stated(described(SENSORS), dict.fromkeys(more, 0.0)))[0] for more in ({}, BY_ZERO | BY_LATENCY)
    ]
    assert_same_bits(*both)


@pytest.mark.parametrize("rate", [1000.0, 20000.0])
@pytest.mark.parametrize("speed", [0.0, 2.0, -9.0])
def test_a_delay_is_as_uncertain_as_the_mirror_turns_meanwhile(speed: float, rate: float) -> None:
    """The closed form: a mirror turns past at its tilt times the speed; at rest nothing does."""
    stage = stated(dataclasses.replace(described({}), mirror=Mirror((4e-5, 3e-5))), BY_LATENCY)
    head, times, ticks = (
        SampleStream(("angle",), 10**9),
        np.arange(0, 10**8, round(1e9 / rate)),
        tick_times(20, 40, 10**6),
    )
    head.push(block_from_samples(times, ("angle",), speed * times[:, None] * 1e-9))
    theta, nothing, used = speed * ticks * 1e-9, np.zeros((40, len(COLUMNS))), np.ones(40, np.int64)
    given = ticks, theta, nothing, {"head_a": head}, used, 40
    found = LateTilt(stage, {"head_a": 1}).variance(*given)
    x, y = 4e-5 * np.cos(theta) - 3e-5 * np.sin(theta), 3e-5 * np.cos(theta) + 4e-5 * np.sin(theta)
    expected = LATENCY * abs(speed) * np.abs(np.stack([y, x], axis=1))
    assert found is not None
    np.testing.assert_allclose(np.sqrt(found), expected, rtol=1e-4, atol=1e-10 * abs(speed))
    assert LateTilt(described({}), {"head_a": 1}).variance(*given) is None


def test_a_zero_counts_by_itself_and_the_rest_is_the_form() -> None:
    """Sizes that count live and that the twin may shift, of one field and of two."""
    stage = described(
        {**SENSORS, "axial_probe_top": dataclasses.replace(SENSORS["axial_probe_top"], gain=-2.0)}, tilt=False
    )
    known = stated(stage, BY_ZERO)
    np.testing.assert_allclose(ListedReadings(stage, 1e-3).stated, [1e-16, 1e-14, 1e-14], rtol=1e-12)
    np.testing.assert_allclose(
        ListedReadings(known, 1e-3).stated, [1e-16 + 1e-14, 1e-14 + 1e-12, 1e-14 + 1e-12], rtol=1e-12
    )
    plain, own = ({each.name: each for each in uncertain_parameters(one)} for one in (stage, known))
    zeros = {name: each.uncertainty for name, each in own.items() if ".zero" in name}
    assert zeros == {"sensors.top.zero": 2e-7, "sensors.second.zero[x]": 1e-6, "sensors.second.zero[y]": 1e-6}
    assert own.keys() == plain.keys() and plain["sensors.top.zero"].uncertainty == 1e-8
    assert {own[name].uncertainty for name in own if name.startswith("sensors.top.form")} == {1e-8}
    moved = own["sensors.second.zero[y]"].shifted(known, 1e-5).sensors["tilt_sensor_second"]
    assert moved.zeros == (2e-5, 0.0)


def test_the_file_states_them() -> None:
    made = stated(described(SENSORS), BY_ZERO | BY_LATENCY)
    assert stage_of(stage_mapping(made)) == made
    assert made.zero_uncertainty("tilt_sensor_second") == 1e-6 and made.timing("autocollimator") == LATENCY
    assert described(SENSORS).zero_uncertainty("tilt_sensor_second") is None
    assert not any(each.name == "autocollimator.timing" for each in uncertain_parameters(made))
