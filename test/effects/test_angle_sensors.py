"""Effects of listed sensors that show one angle, by their formulas; the sensors are of a package of somebody else."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from level_kind import POINTS, level_package, levelled_stage
from mock_bags import EPOCH_NS, record

from rotary_error_monitor.cli import main
from rotary_error_monitor.description.listed_sensors import ListedSensor
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.effects.effect import Cause
from rotary_error_monitor.effects.library import effect_named, load_effects
from rotary_error_monitor.effects.listed import ListedEffect
from rotary_error_monitor.effects.rotor import StageEffect, effects_of
from rotary_error_monitor.sources.mock import MockSettings, mock_stage
from rotary_error_monitor.twin.stage import StageInputs, StageTwin

EFFECTS = load_effects(StageEffect)
LISTED = [effect for effect in EFFECTS if isinstance(effect, ListedEffect)]
ANGLES = ("zero", "gain", "drift", "form")
X, Y = "level_x", "level_y"
AZIMUTH, GAIN = 1.9, -1.2
TIMES = np.linspace(0.3, 9.7, 23)
THETA = 3 * np.sin(TIMES)


@pytest.fixture
def levelled(tmp_path, install_kind):
    """File of a stage with two levels, of the kind of a package that is installed."""
    install_kind(level_package(tmp_path / "own"), POINTS)
    return levelled_stage(tmp_path / "stage.yaml")


@pytest.mark.parametrize("shape", [("m", 1), ("m", 2), ("rad", 1), ("rad", 2), ("rad", 3)])
@pytest.mark.parametrize("effect", LISTED, ids=lambda effect: effect.name)
def test_an_effect_is_of_the_sensors_that_have_its_fields(effect, shape):
    unit, count = shape
    sensor = ListedSensor("any", 1e-7, 1e-8, 1e-3, 1e-7, fields=tuple("abc"[:count]), unit=unit)
    stage = replace(load_stage(), sensors={"any_one": sensor})
    is_known = effect in effects_of(stage, EFFECTS)
    assert is_known == bool(effect.locations(stage)) == ((effect.listed_unit, effect.listed_fields) == shape)


def test_these_are_all():
    found = {each.name for each in EFFECTS if each.name.startswith("angle_sensor_")}
    assert found == {f"angle_sensor_{name}" for name in ANGLES}


def form(order, cos, sin):
    phase = order * (AZIMUTH - THETA)
    return cos * np.cos(phase) + sin * np.sin(phase)


@pytest.mark.parametrize(
    ("name", "location", "parameters", "more"),
    [
        ("zero", Y, {"shift": 3e-5}, lambda tilt: 3e-5),
        ("gain", Y, {"relative": 0.1}, lambda tilt: 0.1 * GAIN * tilt),
        ("drift", Y, {"rate": 2e-7}, lambda tilt: 2e-7 * TIMES),
        ("form", f"{Y}.order_3", {"order": 3, "cos": 2e-6, "sin": -1e-6}, lambda tilt: GAIN * form(3, 2e-6, -1e-6)),
    ],
)
def test_effects_agree_with_their_formulas(levelled, name, location, parameters, more):
    stage, nothing = load_stage(levelled), np.zeros_like
    inputs = StageInputs(
        lambda time: 3 * np.sin(time), lambda time: 3 * np.cos(time), lambda t: np.zeros((len(t), 2)), nothing
    )
    twin = StageTwin(stage, inputs, dict.fromkeys((X, Y), TIMES))
    effect, plain = effect_named(f"angle_sensor_{name}", EFFECTS), twin.predict()
    rows = [(row.order * THETA, row) for row in stage.spindle.tilt]
    eac = sum(row.x[0] * np.cos(phase) + row.x[1] * np.sin(phase) for phase, row in rows)
    ebc = sum(row.y[0] * np.cos(phase) + row.y[1] * np.sin(phase) for phase, row in rows)
    tilt = eac * np.cos(AZIMUTH) + ebc * np.sin(AZIMUTH)
    np.testing.assert_allclose(plain[Y][:, 0], GAIN * tilt, rtol=0, atol=1e-12)
    found = twin.predict((Cause(effect, location, effect.values_from(parameters)),))
    np.testing.assert_allclose(found[Y][:, 0], GAIN * tilt + more(tilt), rtol=0, atol=1e-12)
    np.testing.assert_array_equal(found[X], plain[X])


@pytest.mark.few(1)
@pytest.mark.parametrize("seed", range(2))
def test_a_diagnosis_names_the_zero_of_a_level(levelled, tmp_path, capsys, seed):
    stage, settings = load_stage(levelled), MockSettings(seed, EPOCH_NS, (4.0,), forces=False)
    true = replace(stage, sensors={**stage.sensors, X: replace(stage.sensors[X], zero=2e-5)})
    plant = mock_stage(true, settings)
    bag = record(tmp_path / "bag", plant, plant.streams, 13)
    out = ["-o", str(tmp_path / "out"), "--no-report"]
    assert main(["diagnose", str(bag), "--twin", str(levelled), *out]) == 10, capsys.readouterr().err
    found = json.loads((tmp_path / "out" / "diagnosis.json").read_text(encoding="utf-8"))
    assert [(each["effect"], each["location"]) for each in found["causes"]] == [("angle_sensor_zero", X)]
    shift = found["causes"][0]["parameters"]["shift"]
    assert abs(shift["value"] - 2e-5) < 4 * shift["std"]
