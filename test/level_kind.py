"""A level with one axis, as a package of somebody else: a kind of listed sensor that shows one angle."""

from __future__ import annotations

from pathlib import Path

import yaml

from rotary_error_monitor.resources import config

FILES = {
    "__init__.py": "",
    "section.py": """
from dataclasses import dataclass
from typing import Annotated
from rotary_error_monitor.description.expected import Expected
from rotary_error_monitor.description.harmonics import Waves
from rotary_error_monitor.description.quantities import Angle, Gain
from rotary_error_monitor.description.sensor_section import SensorSection

@dataclass(frozen=True, kw_only=True)
class Level(SensorSection):
    fields = ("inclination",)
    unit = "rad"
    azimuth: Annotated[Angle, Expected("of the axis about which it sees tilt, an angle about +z in rad")]
    zero: Annotated[float | None, Expected("reading of a perfect axis in rad", -0.1, 0.1)] = None
    gain: Gain | None = None
    form: Annotated[Waves | None, Expected("what it shows over a turn: at most 500 rows in rad")] = None
""",
    "sensor.py": """
import numpy as np
from rotary_error_monitor.sensors.listed import ListedKind

class Level(ListedKind):
    kind = "level"
    moved_by = ("sensors", "spindle.tilt")

    def sensitivity(self, place):
        return np.array([0.0, 0.0, 0.0, np.cos(place["azimuth"]), np.sin(place["azimuth"]), 0.0])
""",
    "mock.py": """
import numpy as np

def seen(sensor, scene):
    return (scene.tilt * np.exp(-1j * sensor.place["azimuth"])).real
""",
    "topics.yaml": (Path(__file__).parents[1] / "msg_defs" / "axial_probe.yaml")
    .read_text(encoding="utf-8")
    .replace("axial_probe", "level")
    .replace("{name: displacement, unit: m,", "{name: inclination, unit: rad,")
    .replace("unit: m,", "unit: rad,"),
}
POINTS = {
    "rotary_error_monitor.sensor_sections": {"level": "level_kind_of_a_test.section:Level"},
    "rotary_error_monitor.sensors": {"level": "level_kind_of_a_test.sensor"},
    "rotary_error_monitor.msg_defs": {"level": "level_kind_of_a_test"},
    "rotary_error_monitor.mock_sensors": {"level": "level_kind_of_a_test.mock:seen"},
}
ROW = {"kind": "level", "noise": 2e-7, "resolution": 1e-8, "range": 1e-3, "uncertainty": 5e-7}


def level_package(folder: Path) -> Path:
    """Write the package into a folder, and give it."""
    package = folder / "level_kind_of_a_test"
    package.mkdir(parents=True)
    for name, text in FILES.items():
        (package / name).write_text(text, encoding="utf-8")
    return package


def levelled_stage(path: Path) -> Path:
    """Write the file of a stage whose tilt two levels show, and give it."""
    content = yaml.safe_load(config("stage.yaml").read_text(encoding="utf-8"))
    for name in ("autocollimator", "mirror", "lvdt"):
        del content["stage"][name]
    content["stage"]["sensors"] = {"x": {**ROW, "azimuth": 0.3}, "y": {**ROW, "azimuth": 1.9, "gain": -1.2}}
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    return path
