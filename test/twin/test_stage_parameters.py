"""Uncertain parameters: which streams each of them moves, against predictions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from probed_stage import HIGH, LOW, STAGE, TOP

from rotary_error_monitor.cases.making import make_stage_case
from rotary_error_monitor.description.harmonics import AngularHarmonic, PlanarHarmonic
from rotary_error_monitor.twin.recording import record_stage
from rotary_error_monitor.twin.stage import StageInputs, StageTwin, twin_of
from rotary_error_monitor.twin.stage_parameters import uncertain_parameters


def test_a_parameter_moves_the_streams_that_it_names_and_no_other():
    case = next(
        c for c in (make_stage_case(seed, "null", rough=True, duration=10.0) for seed in range(9)) if c.twin.lvdt
    )
    blocks = {stream: list(found) for stream, found in case.blocks.items()}
    twin = twin_of(case.twin, record_stage(blocks, "abcd"))
    base = twin.predict()
    parameters = uncertain_parameters(case.twin)
    assert len(parameters) > 40
    for parameter in parameters:
        # A step of many uncertainties, so that the effect of a compliance stands far above rounding.
        moved = twin.predict(stage=parameter.shifted(case.twin, 100 * parameter.uncertainty))
        kinds = {name.partition("_")[0] for name in base if np.ptp(moved[name] - base[name]) > 1e-15}
        if "compliance" not in parameter.name or "force" in case.blocks:
            assert kinds == set(parameter.seen_by), parameter.name


TIME = np.linspace(0.0, 3.0, 50)


def moved_by(parameter, stage=STAGE):
    """What one standard uncertainty of a parameter adds to each stream, the rotor turning by a radian a second."""
    inputs = StageInputs(
        lambda t: np.asarray(t), np.ones_like, lambda t: np.zeros((len(t), 2)), lambda t: np.zeros(len(t))
    )
    twin = StageTwin(stage, inputs, dict.fromkeys(("head_a", "autocollimator", TOP, LOW, HIGH), TIME))
    after, before = twin.predict(stage=parameter.shifted(stage, parameter.uncertainty)), twin.predict()
    return {name: after[name] - before[name] for name in before if np.any(after[name] != before[name])}


def test_zero_and_form_of_a_listed_sensor_are_uncertain_in_the_orders_that_are_stated_and_in_the_first():
    found = {parameter.name: parameter for parameter in uncertain_parameters(STAGE)}
    form = [f"form[order {order}][{part}]" for order in (1, 2) for part in ("cos", "sin")]
    first = [name for name in form if "order 1" in name]
    expected = {TOP: ("top", ["zero", *first]), LOW: ("low", ["zero", *form]), HIGH: ("high", ["zero", *first])}
    assert set(found) == {f"sensors.{name}.{part}" for name, parts in expected.values() for part in parts}
    for stream, (name, parts) in expected.items():
        probe = STAGE.sensors[stream]
        psi = probe.place["azimuth"] - TIME
        for part in parts:
            (moved,) = moved_by(found[f"sensors.{name}.{part}"]).items()
            order, wave = (int(part[11]), np.cos if "cos" in part else np.sin) if "form" in part else (0, None)
            shown = np.ones(len(TIME)) if wave is None else probe.gain * wave(order * psi)
            assert moved[0] == stream and found[f"sensors.{name}.{part}"].seen_by == (stream,)
            np.testing.assert_allclose(moved[1][:, 0], probe.uncertainty * shown, atol=1e-18)


def test_a_sensor_that_is_exact_has_no_uncertain_parameter():
    exact = {stream: replace(sensor, uncertainty=0.0) for stream, sensor in STAGE.sensors.items()}
    assert uncertain_parameters(replace(STAGE, sensors=exact)) == ()


def test_gain_and_place_of_a_listed_sensor_may_be_uncertain():
    spindle = replace(STAGE.spindle, radial=(), tilt=(PlanarHarmonic(2, (3e-6, 0.0), (0.0, 3e-6)),))
    stage = replace(
        STAGE,
        spindle=spindle,
        sensors={HIGH: replace(STAGE.sensors[HIGH], uncertainty=0.0, form=(AngularHarmonic(3, 1e-6, 0.0),))},
        uncertainty={"sensors.high.gain": 0.1, "sensors.high.height": 2e-3},
    )
    inputs = StageInputs(
        lambda t: np.asarray(t), np.ones_like, lambda t: np.zeros((len(t), 2)), lambda t: np.zeros(len(t))
    )
    twin = StageTwin(stage, inputs, {HIGH: TIME})
    azimuth = STAGE.sensors[HIGH].place["azimuth"]
    lean = 3e-6 * (np.sin(2 * TIME) * np.cos(azimuth) - np.cos(2 * TIME) * np.sin(azimuth))
    seen = 0.16 * lean + 1e-6 * np.cos(3 * (azimuth - TIME))
    for parameter, expected in zip(uncertain_parameters(stage), (0.1 * seen, 2e-3 * lean), strict=True):
        moved = twin.predict(stage=parameter.shifted(stage, parameter.uncertainty))[HIGH] - twin.predict()[HIGH]
        assert moved[:, 0] == pytest.approx(expected, abs=1e-18)


def test_error_motion_that_is_uncertain_is_so_for_the_probes_that_see_it():
    uncertain = {"spindle.axial": 1e-8, "spindle.radial": 1e-8, "spindle.tilt": 1e-8}
    sensors = {stream: replace(sensor, uncertainty=0.0) for stream, sensor in STAGE.sensors.items()}
    found = uncertain_parameters(replace(STAGE, sensors=sensors, uncertainty=uncertain))
    seen: dict[str, set[str]] = {}
    for parameter in found:
        told = {"head_a" if name == "head" else name for name in parameter.seen_by}
        assert set(moved_by(parameter)) <= told, parameter.name
        seen.setdefault(parameter.name.partition("[")[0], set()).update(moved_by(parameter))
    assert seen == {
        "spindle.axial": {TOP},
        "spindle.radial": {"head_a", LOW, HIGH},
        "spindle.tilt": {"autocollimator", TOP, LOW, HIGH},
    }
