"""A level, as a package of somebody else: a kind of listed sensor that shows one angle, or several along more axes."""

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
    gain: Gain | None = None
    zero: Annotated[float | None, Expected("reading of a perfect axis in rad", -0.1, 0.1)] = None
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


def level_package(folder: Path, axes: int = 1) -> Path:
    """Write the package into a folder, and give it; axes beyond the first look along their number in rad."""
    package, files = folder / "level_kind_of_a_test", dict(FILES)
    package.mkdir(parents=True)
    if axes > 1:
        fields = [f"inclination_{axis}" for axis in range(axes)]
        stated = files["section.py"].partition("    zero:")[0]
        files["section.py"] = stated.replace('("inclination",)', repr(tuple(fields)))
        files["sensor.py"] = (
            files["sensor.py"].replace('"]', f'"] + np.arange({axes})').replace("0.0", f"np.zeros({axes})")
        )
        files["sensor.py"] = files["sensor.py"].replace("np.array(", "np.transpose(")
        column = "      - {name: inclination, unit: rad, meaning: displacement along z}"
        rows = [column.replace("inclination", name) for name in fields]
        assert column in files["topics.yaml"]
        files["topics.yaml"] = files["topics.yaml"].replace(column, "\n".join(rows))
    for name, text in files.items():
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
