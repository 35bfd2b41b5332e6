"""Stages that differ in their sensors alone, as files: the embedded one with what `doc/sensors.md` shows of each."""

from __future__ import annotations

import copy
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml
from without_heads import example

from rotary_error_monitor.metrology.error_motion import COMPONENTS
from rotary_error_monitor.resources import config

BALL_PROBE = Path(__file__).parents[1] / "doc" / "examples" / "ball_probe"
PAGE = Path(__file__).parents[1] / "doc" / "sensors.md"
Content = dict[str, Any]


@dataclass(frozen=True)
class Stage:
    """One of the stages.

    Attributes:
        title: of its paragraph in the page.
        without: sections of the embedded stage that it leaves out.
        shows: components of error motion that it shows.
        truth: makes the true stage of the described one: something that the description lacks.
        cause: effect and location that a diagnosis finds for that.
        heads: letters of the heads that stay; all where there are none.
        largest: standard deviation, m or rad: what a stage is that is no longer measured, at most.
        package: whether its sensors are of the kind of the package in `doc/examples/ball_probe`.
    """

    title: str
    without: tuple[str, ...]
    shows: tuple[str, ...]
    truth: Callable[[Content], None]
    cause: tuple[str, str]
    heads: str = ""
    largest: float = 3e-5
    package: bool = False

    def described(self, folder: Path) -> Path:
        """The file of the description."""
        return _written(folder / "described.yaml", self.content(folder))

    def true(self, folder: Path) -> Path:
        """The file of the true stage, which mocks show."""
        content = copy.deepcopy(self.content(folder))
        self.truth(content["stage"])
        return _written(folder / "true.yaml", content)

    def content(self, folder: Path) -> Content:
        """Of the file."""
        if not self.title:
            return yaml.safe_load(example(folder).read_text(encoding="utf-8"))
        base = yaml.safe_load(config("stage.yaml").read_text(encoding="utf-8"))
        for name in (*self.without, "lvdt"):
            del base["stage"][name]
        heads = base["stage"]["encoder"]["heads"]
        for letter in set(heads).difference(self.heads or heads):
            del heads[letter]
        return _merged(base, shown(self.title))


def shown(title: str) -> Content:
    """What the page shows of a stage in the paragraph that begins with this title."""
    text = PAGE.read_text(encoding="utf-8").split(f"**{title}**")[1]
    return yaml.safe_load(re.findall(r"^```yaml\n(.*?)^```", text, re.MULTILINE | re.DOTALL)[0])


def _merged(base: Mapping[str, Any], more: Mapping[str, Any]) -> Content:
    both = {name: _merged(base[name], more[name]) for name in base if isinstance(more.get(name), Mapping)}
    return {**base, **more, **both}


def _written(path: Path, content: Content) -> Path:
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return path


def _radial(stage: Content) -> None:
    stage["spindle"]["radial"].append({"order": 4, "x": [6e-7, -2e-7], "y": [1e-7, 7e-7]})


def _tilt(stage: Content) -> None:
    stage["spindle"]["tilt"].append({"order": 4, "x": [6e-6, -2e-6], "y": [1e-6, 7e-6]})


def _axial(stage: Content) -> None:
    stage["spindle"]["axial"] = [{"order": 2, "cos": 3e-7, "sin": -2e-7}]


def _thermal(stage: Content) -> None:
    stage["spindle"]["radial_thermal"] = [6e-7, -5e-7]


PLANE, TILT, ANGLE = COMPONENTS[:2], COMPONENTS[3:5], COMPONENTS[5:]
RADIAL_CAUSE, TILT_CAUSE = ("spindle_radial", "order_4"), ("spindle_tilt", "order_4")
AIR = ("autocollimator", "mirror")
STAGES = {
    "fifth head": Stage("A fifth head", (), (*PLANE, *TILT, *ANGLE), _radial, RADIAL_CAUSE),
    "second autocollimator": Stage("A second autocollimator", (), (*PLANE, *TILT, *ANGLE), _tilt, TILT_CAUSE),
    "three probes": Stage("", (), PLANE, _radial, RADIAL_CAUSE),
    "heads alone": Stage("Heads and nothing else", AIR, (*PLANE, *ANGLE), _radial, RADIAL_CAUSE),
    "heads and two probes": Stage("Heads and two probes", AIR, (*PLANE, *TILT, *ANGLE), _tilt, TILT_CAUSE),
    "ball probes": Stage("Three probes at a ball", AIR, COMPONENTS, _axial, ("spindle_axial", "order_2"), package=True),
    "thermometer": Stage("A thermometer", (), (*PLANE, *TILT, *ANGLE), _thermal, ("thermal_drift", "")),
    "one head": Stage("One head and two probes", (), (*PLANE, *TILT, *ANGLE), _radial, RADIAL_CAUSE, "a", 5e-5),
}
