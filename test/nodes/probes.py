"""A stage that lists two displacement probes, as a file."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from rotary_error_monitor.resources import config

COMMON = {"noise": 2.0e-8, "resolution": 1.0e-9, "range": 5.0e-5, "uncertainty": 1.0e-7}
SENSORS = {
    "top": {"kind": "axial_probe", "radius": 0.03, "azimuth": 0.5, **COMMON},
    "low": {"kind": "radial_probe", "azimuth": 0.0, "height": 0.02, "zero": 2.0e-6, "gain": -1.0, **COMMON},
}
STREAMS = ("axial_probe_top", "radial_probe_low")


def stage_with_probes(folder: Path) -> Path:
    """File of the embedded stage with axial error motion and two probes."""
    content = yaml.safe_load(config("stage.yaml").read_text(encoding="utf-8"))
    content["stage"]["sensors"] = SENSORS
    content["stage"]["spindle"]["axial"] = [{"order": 1, "cos": 3.0e-7, "sin": -2.0e-7}]
    path = folder / "probes.yaml"
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return path


INSTEAD = {
    "nose": {"kind": "axial_probe", "radius": 0.0, **COMMON},
    **{
        f"{axis}{number}": {"kind": "radial_probe", "azimuth": azimuth, "height": height, **COMMON}
        for axis, azimuth in (("x", 0.0), ("y", 1.5707963267948966))
        for number, height in ((1, 0.03), (2, 0.15))
    },
}
"""One probe on the axis, and two at each of two heights: what an autocollimator shows, and axial error motion."""


SECOND = {
    "nose": INSTEAD["nose"],
    "second": {
        "kind": "tilt_sensor",
        "noise": 2.0e-7,
        "resolution": 1.0e-8,
        "range": 1.0e-3,
        "uncertainty": 5.0e-7,
        "zero": [2.0e-5, -1.0e-5],
        "gain": -1.0,
        "roll": 0.4,
        "form": [{"order": 1, "x": [4.0e-5, -1.0e-5], "y": [1.0e-5, 4.0e-5]}],
    },
}
"""A probe on the axis and another autocollimator."""


def stage_with_probes_instead(folder: Path, sensors: Mapping[str, Mapping[str, Any]] = INSTEAD) -> Path:
    """File of the embedded stage without autocollimator, and with listed sensors in its place."""
    content = yaml.safe_load(config("stage.yaml").read_text(encoding="utf-8"))
    del content["stage"]["autocollimator"]
    content["stage"]["sensors"] = dict(sensors)
    content["stage"]["spindle"]["axial"] = [{"order": 1, "cos": 3.0e-7, "sin": -2.0e-7}]
    path = folder / "instead.yaml"
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return path
