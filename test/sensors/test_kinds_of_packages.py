"""Kinds of sensors of other packages: what is wrong with one is told with its entry point, before anything is done."""

from __future__ import annotations

import json
import shutil
import tomllib
from dataclasses import replace

import numpy as np
import pytest
import yaml
from described_stages import stage_of
from level_kind import POINTS as LEVEL
from level_kind import level_package, levelled_stage
from mock_bags import EPOCH_NS, record
from staged_files import BALL_PROBE, STAGES

from rotary_error_monitor.cli import main
from rotary_error_monitor.description.stage import StageDescription, load_stage, stage_mapping
from rotary_error_monitor.description.wire import wire_of
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.noise.channels import channels_of
from rotary_error_monitor.pipeline.observability import possible_components
from rotary_error_monitor.pipeline.surfaces import surfaces
from rotary_error_monitor.plant.clocks import stage_clocks
from rotary_error_monitor.plant.scene import Fault
from rotary_error_monitor.plant.stage import StagePlant
from rotary_error_monitor.recordings.analysis import analyse_bag
from rotary_error_monitor.resources import config
from rotary_error_monitor.sensors.library import listed_fields, sensor_kinds, sensor_of
from rotary_error_monitor.sources.mock import MockSettings, mock_stage
from rotary_error_monitor.twin.recording import record_stage
from rotary_error_monitor.twin.stage_parameters import uncertain_parameters

GROUP = "rotary_error_monitor."
SECTIONS, SENSORS = f"{GROUP}sensor_sections", f"{GROUP}sensors"
MSG_DEFS, MOCKS = f"{GROUP}msg_defs", f"{GROUP}mock_sensors"
POINTS = tomllib.loads((BALL_PROBE / "pyproject.toml").read_text(encoding="utf-8"))["project"]["entry-points"]


@pytest.fixture
def described(tmp_path):
    return STAGES["ball probes"].described(tmp_path)


@pytest.fixture
def changed(tmp_path, install_kind):
    """Function that installs the example with changes of its files (name: (old, new)) and of its entry points."""

    def made(files=(), points=None):
        package = tmp_path / "own" / "ball_probe"
        shutil.copytree(BALL_PROBE, package)
        for name, (old, new) in dict(files).items():
            text = (package / name).read_text(encoding="utf-8")
            assert old in text
            (package / name).write_text(text.replace(old, new), encoding="utf-8")
        install_kind(package, {**POINTS, **(points or {})})

    return made


def test_the_example_is_a_kind_like_any_other(install_kind, described):
    with pytest.raises(InputError, match=r"sensors\.one\.kind: 'ball_probe' is no kind of sensor; .*axial_probe"):
        load_stage(described)
    install_kind(BALL_PROBE)
    stage = load_stage(described)
    assert tuple(stage.sensors) == ("ball_probe_one", "ball_probe_three", "ball_probe_two")
    assert load_stage_again(stage, described.parent) == stage
    assert wire_of(stage).of_stream("ball_probe_one").columns == ("displacement",)
    assert wire_of(stage).topic("error_motion_samples").field("streams").bits[-3:] == tuple(stage.sensors)


def load_stage_again(stage: StageDescription, folder):
    path = folder / "again.yaml"
    path.write_text(yaml.safe_dump({"stage": stage_mapping(stage)}), encoding="utf-8")
    return load_stage(path)


@pytest.mark.parametrize("seed", range(4))
def test_its_first_order_is_that_of_its_exact_geometry(install_kind, seed):
    """What is left is of second order of micrometres and some ten microradians."""
    install_kind(BALL_PROBE)
    rng = np.random.default_rng(seed)
    content = yaml.safe_load(config("stage.yaml").read_text(encoding="utf-8"))
    row = {"kind": "ball_probe", "noise": 1e-8, "resolution": 1e-9, "range": 1e-4, "uncertainty": 1e-8, "gain": -1.5}
    place = {"azimuth": rng.uniform(-6, 6), "elevation": rng.uniform(-1.5, 1.5), "height": rng.uniform(-0.2, 0.2)}
    content["stage"]["sensors"] = {"one": {**row, **place, "zero": 3e-6}}
    content["stage"]["spindle"]["axial"] = [{"order": 2, "cos": 1e-6, "sin": 2e-6}]
    stage = stage_of(content["stage"])
    plant = StagePlant(stage, seed, clocks=stage_clocks("abcd", sensors=tuple(stage.sensors)))
    time = np.linspace(0, 20, 1500)
    scene = plant.scene(time)
    kind, sensor = sensor_of("ball_probe_one"), stage.sensors["ball_probe_one"]
    seen = kind.displacement(sensor, plant.signal("ball_probe_one", time), scene.theta)
    expected = scene.error_motion @ kind.rows(sensor).T
    assert np.abs(seen - expected).max() < 2e-3 * np.ptp(expected)


@pytest.mark.parametrize(
    ("files", "points", "told"),
    [
        ({}, {SECTIONS: {"ball_probe": "ball_probe.nothing:Ball"}}, "'ball_probe' of ball_probe: cannot be loaded"),
        ({}, {SECTIONS: {"ball_probe": "ball_probe.section"}}, "is no class derived from SensorSection"),
        (
            {},
            {SECTIONS: {"Ball": "ball_probe.section:BallProbe"}},
            "'Ball' makes no topic name; expected small letters",
        ),
        ({}, {SECTIONS: {"force_ball": "ball_probe.section:BallProbe"}}, "cannot be told from those of 'force'"),
        ({}, {SECTIONS: {"head": "ball_probe.section:BallProbe"}}, "cannot be told from those of 'head'"),
        (
            {"section.py": ("@dataclass(frozen=True, kw_only=True)\n", "")},
            {},
            "BallProbe is no dataclass; expected @dataclass(frozen=True, kw_only=True)",
        ),
        (
            {"section.py": ("    azimuth:", '    unit = "furlong"\n    azimuth:')},
            {},
            "unit 'furlong' of kind 'ball_probe'; expected m or rad, or is_input = True",
        ),
        ({"sensor.py": ('kind = "ball_probe"', 'kind = "axial_probe"')}, {}, "kind 'axial_probe' is already known"),
        (
            {"sensor.py": ('kind = "ball_probe"', 'kind = "ball"')},
            {},
            "is of sensor kind 'ball'; there are axial_probe",
        ),
        (
            {"sensor.py": ("def sensitivity", "def sensitive")},
            {},
            "kind 'ball_probe': Can't instantiate abstract class",
        ),
        (
            {"section.py": ("    azimuth:", "    is_input = True\n    azimuth:")},
            {},
            "is none of ListedInput, as its sec",
        ),
        ({}, {SENSORS: {}}, "sensor kind 'ball_probe': it has a section, but no class in"),
        ({}, {SENSORS: {"ball_probe": "ball_probe.sensor:BallProbe"}}, "is no module"),
        ({}, {MSG_DEFS: {}}, "has 0 topics with samples of sensor kind 'ball_probe' and 0 for people"),
        ({}, {MSG_DEFS: {"ball_probe": "ball_probe.mock"}}, "ball_probe.mock is no package with a wire contract"),
        ({"topics.yaml": ("unit: m,", "unit: furlong,")}, {}, "expected: an SI unit such as m^3/s"),
        ({"topics.yaml": ("displacement, unit: m,", "displacement, unit: rad,")}, {}, "has displacement in rad for"),
        ({"topics.yaml": ("name: displacement,", "name: distance,")}, {}, "states displacement in m"),
        (
            {"topics.yaml": ("[listed_sensor]", "[my_node]")},
            {},
            "publishers ('my_node',); expected a topic /stage/KIND_",
        ),
        (
            {"topics.yaml": ("ball_probe_samples:", "head_samples:")},
            {},
            "topic 'head_samples' is already defined in he",
        ),
        ({}, {MOCKS: {}}, "the plant has no geometry of kind 'ball_probe', but axial_probe"),
        ({}, {MOCKS: {"ball_probe": "ball_probe.mock:RADIUS"}}, "expected the function of a kind that is none of"),
        ({}, {MOCKS: {"axial_probe": "ball_probe.mock:seen"}}, "expected the function of a kind that is none of axial"),
        ({"mock.py": ("+ form, np.float64)", "+ form, np.float64)[:1]")}, {}, "gives (1,); expected (3,)"),
    ],
)
def test_what_is_wrong_with_a_kind_is_told(changed, described, files, points, told):
    changed(files, points)
    with pytest.raises(InputError) as error:
        every_use(described)
    assert told in str(error.value), str(error.value)


def every_use(path):
    """All that looks at a kind."""
    stage = load_stage(path)
    sensor_kinds()
    listed_fields(stage)
    wire_of(stage)
    plant = StagePlant(stage, 1, clocks=stage_clocks("abcd", sensors=tuple(stage.sensors)))
    for stream in stage.sensors:
        plant.signal(stream, np.arange(3.0))


@pytest.mark.parametrize("axes", [1, 2, 3, 4])
def test_a_kind_may_have_any_number_of_fields(install_kind, tmp_path, axes):
    """A form is stated of one field or two, zero and noise of each."""
    install_kind(level_package(tmp_path / "own", axes), LEVEL)
    stage = load_stage(levelled_stage(tmp_path / "stage.yaml"))
    assert possible_components(stage) == ("exc", "eyc", "eac", "ebc", "ecc")
    assert len(channels_of("level_x")) == len(set(channels_of("level_x"))) == axes
    doubted = [each.name for each in uncertain_parameters(stage) if "level_x" in each.seen_by]
    assert len(set(doubted)) == len(doubted) == axes * (3 if axes <= 2 else 1)
    assert any("level_x" in each.streams for each in surfaces(stage)) == (axes <= 2)


FLOW = {
    "__init__.py": "",
    "section.py": """
from dataclasses import dataclass
from typing import Annotated
from rotary_error_monitor.description.expected import Expected
from rotary_error_monitor.description.sensor_section import SensorSection

@dataclass(frozen=True, kw_only=True)
class CoolantFlow(SensorSection):
    fields = ("flow",)
    unit = "m^3/s"
    is_input = True
    measures = "flow of the coolant"
    zero: Annotated[float | None, Expected("reading without flow in m^3/s", -1, 1)] = None
""",
    "sensor.py": """
from rotary_error_monitor.sensors.listed_input import ListedInput

class CoolantFlow(ListedInput):
    kind = "coolant_flow"

    def measured(self, sensor, reading):
        return reading[:, 0] - sensor.zeros[0]
""",
    "mock.py": """
import numpy as np

def flow(sensor, scene):
    return 1e-4 * (1 + 0.5 * np.sin(0.9 * scene.time))
""",
    "effects.py": """
import numpy as np
from rotary_error_monitor.effects.effect import Parameter
from rotary_error_monitor.effects.rotor import StageEffect

class Swelling(StageEffect):
    name = "swelling"
    title = "displacement by the coolant"
    remedy = "Shield the spindle from the coolant."
    source = "made up"
    parameters = (Parameter("size", "m*s/m^3", 1e-3, size=2, bound=1.0),)

    def radial(self, values, state):
        return state.inputs["pump"] * values if "pump" in state.inputs else np.zeros((len(state.time), 2))
""",
    "topics.yaml": (BALL_PROBE / "topics.yaml")
    .read_text(encoding="utf-8")
    .replace("ball_probe", "coolant_flow")
    .replace("error_estimator, ", "")
    .replace("{name: displacement, unit: m,", "{name: flow, unit: m^3/s,"),
}
FLOW_POINTS = {
    SECTIONS: {"coolant_flow": "coolant_flow.section:CoolantFlow"},
    SENSORS: {"coolant_flow": "coolant_flow.sensor"},
    MSG_DEFS: {"coolant_flow": "coolant_flow"},
    MOCKS: {"coolant_flow": "coolant_flow.mock:flow"},
    f"{GROUP}effects": {"coolant_flow": "coolant_flow.effects"},
}
PUSH = complex(3e-3, -2e-3)
"""By which the true rotor is displaced per flow, m per m³/s."""


class Pushed(Fault):
    """The coolant pushes at the rotor."""

    def displace(self, radial, scene):
        return radial + PUSH * 1e-4 * (1 + 0.5 * np.sin(0.9 * scene.time))


@pytest.fixture
def pump(tmp_path, install_kind):
    """Function that installs the flow meter and gives the file of a stage with one."""

    def installed(points=FLOW_POINTS):
        package = tmp_path / "own" / "coolant_flow"
        package.mkdir(parents=True)
        for name, text in FLOW.items():
            (package / name).write_text(text, encoding="utf-8")
        install_kind(package, points)
        row = {"kind": "coolant_flow", "noise": 1e-7, "resolution": 1e-8, "range": 1e-3, "uncertainty": 1e-7}
        content = yaml.safe_load(config("stage.yaml").read_text(encoding="utf-8"))
        content["stage"]["sensors"] = {"pump": {**row, "zero": 5e-6}}
        path = tmp_path / "stage.yaml"
        path.write_text(yaml.safe_dump(content), encoding="utf-8")
        return path

    return installed


def bag_of(path, folder, seed):
    """Of a stage at which the coolant pushes."""
    stage = load_stage(path)
    plant = replace(mock_stage(stage, MockSettings(seed, EPOCH_NS, (4.0,), forces=False)), faults=(Pushed(),))
    return record(folder, plant, plant.streams, 16)


@pytest.mark.parametrize("seed", range(2))
def test_what_an_input_of_a_package_measures_explains_what_goes_with_it(pump, tmp_path, capsys, seed):
    path = pump()
    bag = bag_of(path, tmp_path / "bag", seed)
    out = ["-o", str(tmp_path / "out"), "--no-report"]
    assert main(["diagnose", str(bag), "--twin", str(path), *out]) == 10, capsys.readouterr().err
    found = json.loads((tmp_path / "out" / "diagnosis.json").read_text(encoding="utf-8"))
    assert [each["effect"] for each in found["causes"]] == ["swelling"]
    size = found["causes"][0]["parameters"]["size"]
    off = (np.array(size["value"]) - [PUSH.real, PUSH.imag]) / size["std"]
    assert np.abs(off).max() < 4, (size, off)
    shown = analyse_bag(bag, load_stage(path)).acting["pump, m^3/s"]
    assert shown.values.max() == pytest.approx(1.5e-4, rel=0.01), "without its zero"


def test_an_input_without_class_is_told_and_left_out(pump):
    stage = load_stage(pump({**FLOW_POINTS, SENSORS: {}}))
    plant = mock_stage(stage, MockSettings(1, EPOCH_NS, (4.0,), forces=False))
    blocks = {stream: [plant.samples(stream, 0, 400)] for stream in plant.streams}
    recording = record_stage(blocks, "abcd", listed=tuple(stage.listed))
    assert "coolant_flow_pump" not in recording.streams and "head_a" in recording.streams
    assert any(each.startswith("coolant_flow_pump: it has a section, but no class in") for each in recording.remarks)


def test_a_mock_of_an_input_without_a_course_is_told(pump):
    path = pump({**FLOW_POINTS, MOCKS: {}})
    stage = load_stage(path)
    plant = mock_stage(stage, MockSettings(1, EPOCH_NS, (4.0,), forces=False))
    with pytest.raises(
        InputError, match=r"what 'coolant_flow_pump' measures; .* function of kind 'coolant_flow' as an"
    ):
        plant.samples("coolant_flow_pump", 0, 2)
