"""A kind of listed input declares what it measures, and the readers take it by that, whatever it is called."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
import yaml

import rotary_error_monitor.description.sensor_kinds as sections
import rotary_error_monitor.sensors as kinds
from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.stage import StageDescription, load_stage
from rotary_error_monitor.effects.effect import Cause, Parameter, Values
from rotary_error_monitor.effects.rotor import RotorState, StageEffect
from rotary_error_monitor.kinds.stage.forces import with_shaft_force
from rotary_error_monitor.resources import config
from rotary_error_monitor.twin.recording import SignalStream, StageRecording
from rotary_error_monitor.twin.stage import StageTwin, stage_inputs

FLOW = """
from dataclasses import dataclass
from typing import Annotated
from rotary_error_monitor.description.expected import Expected
from rotary_error_monitor.description.sensor_section import SensorSection

@dataclass(frozen=True, kw_only=True)
class CoolantFlow(SensorSection):
    fields = ("flow",)
    unit = "L/min"
    is_input = True
    measures = "flow of the coolant"
    noise: Annotated[float, Expected("noise in L/min", 0, 1)]
    resolution: Annotated[float, Expected("step in L/min", 0, 1)]
    range: Annotated[float, Expected("largest flow in L/min", above=0, most=1000)]
    uncertainty: Annotated[float, Expected("of the zero in L/min", 0, 1)]
    zero: Annotated[float | None, Expected("reading without flow in L/min", -10, 10)] = None
"""
CELL = """
from dataclasses import dataclass
from rotary_error_monitor.description.sensor_kinds.force import ForceSection
from rotary_error_monitor.description.sensor_section import SHAFT_FORCE

@dataclass(frozen=True, kw_only=True)
class Dynamometer(ForceSection):
    measures = SHAFT_FORCE
"""
FLOW_KIND = """
from rotary_error_monitor.sensors.listed_input import ListedInput

class CoolantFlow(ListedInput):
    kind = "coolant_flow"

    def measured(self, sensor, reading):
        return reading[:, 0] - sensor.zeros[0]
"""
ROW = {"noise": 0.01, "resolution": 0.001, "range": 100.0, "uncertainty": 0.01}
TIME = np.linspace(0.0, 4.0, 401)
SWELL = 2e-7
"""Radial displacement per flow, m per L/min."""


class Swelling(StageEffect):
    """The rotor goes along x with the flow of the pump."""

    name = "swelling"
    title = "displacement by the coolant"
    remedy = "Shield the spindle from the coolant."
    source = "made up"
    parameters = (Parameter("size", "m", 1e-7, bound=1e-3),)

    def radial(self, values: Values, state: RotorState) -> Array:
        """(n, 2) m."""
        flow = state.inputs["pump"][:, 0]
        return np.column_stack([float(values[0]) * flow, np.zeros(len(flow))])


@pytest.fixture
def stage(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, forget_kinds: Callable[[], None]
) -> Iterator[StageDescription]:
    """A stage that lists sensors of two kinds that no file of the package knows."""
    folders = {sections: tmp_path / "sections", kinds: tmp_path / "kinds"}
    for room, folder in folders.items():
        folder.mkdir()
        monkeypatch.setattr(room, "__path__", [*room.__path__, str(folder)])
    (tmp_path / "sections" / "coolant_flow.py").write_text(FLOW, encoding="utf-8")
    (tmp_path / "sections" / "dynamometer.py").write_text(CELL, encoding="utf-8")
    (tmp_path / "kinds" / "coolant_flow.py").write_text(FLOW_KIND, encoding="utf-8")
    forget_kinds()
    content = yaml.safe_load(config("stage.yaml").read_text(encoding="utf-8"))
    content["stage"]["sensors"] = {
        "pump": {"kind": "coolant_flow", "zero": 0.5, **ROW},
        "table": {"kind": "dynamometer", "azimuth": 0.3, "zero": [4.0, -2.0], "gain": -1.2, **ROW},
    }
    path = tmp_path / "stage.yaml"
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    yield load_stage(path)
    for name in [name for name in sys.modules if name.endswith((".coolant_flow", ".dynamometer"))]:
        del sys.modules[name]
    monkeypatch.undo()
    forget_kinds()


def recording(seed: int) -> tuple[StageRecording, Array, Array]:
    """One with flow and force as the sensors read them, the flow (n,) and the force (n, 2)."""
    rng = np.random.default_rng(seed)
    flow = 5.0 + 2.0 * np.sin(TIME + rng.uniform(0, 6))
    force = 50.0 * np.column_stack([np.sin(TIME), np.cos(0.5 * TIME)]) + rng.uniform(-20, 20, 2)
    cos, sin = np.cos(0.3), np.sin(0.3)
    own = np.column_stack([cos * force[:, 0] + sin * force[:, 1], -sin * force[:, 0] + cos * force[:, 1]])
    command = np.column_stack([TIME, np.ones(len(TIME))])
    streams = {
        "command": SignalStream(TIME, command),
        "coolant_flow_pump": SignalStream(TIME, 0.5 + flow[:, None]),
        "dynamometer_table": SignalStream(TIME, np.array([4.0, -2.0]) - 1.2 * own),
    }
    return StageRecording(0, streams), flow, force


@pytest.mark.parametrize("seed", range(5))
def test_an_effect_finds_what_a_kind_of_its_own_measured(stage: StageDescription, seed: int) -> None:
    recorded, flow, _ = recording(seed)
    inputs = stage_inputs(recorded, stage.reference_temperature, stage.inputs)
    assert not inputs.warmings, "what is no temperature warms nothing"
    twin = StageTwin(stage, inputs, {"head_a": TIME, "head_c": TIME})
    np.testing.assert_allclose(twin.state("head_a").inputs["pump"][:, 0], flow, rtol=1e-12)
    late = twin.state("head_a", 0.1).inputs["pump"][20:, 0]
    np.testing.assert_allclose(late, np.interp(TIME[20:] - 0.1, TIME, flow), rtol=1e-12)
    _, plain, _ = twin.motion(TIME)
    _, swollen, _ = twin.motion(TIME, [Cause(Swelling(), "", np.array([SWELL]))])
    np.testing.assert_allclose(swollen - plain, np.column_stack([SWELL * flow, 0 * flow]), atol=1e-15)


@pytest.mark.parametrize("seed", range(5))
def test_another_kind_of_load_cell_shows_the_force_on_the_shaft(stage: StageDescription, seed: int) -> None:
    recorded, _, force = recording(seed)
    assert stage.shaft_forces == ("dynamometer_table",)
    described, joined = with_shaft_force(stage, recorded)
    assert [*described.inputs] == ["coolant_flow_pump", "dynamometer_table"] and not joined.remarks
    inside = joined.streams["force"]
    expected = np.column_stack([np.interp(inside.time, TIME, column) for column in force.T])
    np.testing.assert_allclose(inside.values, expected, atol=2e-3)
