"""What a tracker sees of a machine's axes and spindle, by products of matrices that share nothing with the package.

The machine is that of Pan et al. 2013 with location errors drawn anew; what its axes then are to each other follows
from their lines in closed form.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import date
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from rotary_error_monitor.calibration.axis_lines import SquarenessResult, calibrate_squareness
from rotary_error_monitor.calibration.axis_table import AxisRelation
from rotary_error_monitor.calibration.machine_file import MachineFile
from rotary_error_monitor.calibration.steps import Job
from rotary_error_monitor.description.machine import MachineDescription
from rotary_error_monitor.description.machine_parts import Displacement
from rotary_error_monitor.metrology.tracker import TrackerNoise
from rotary_error_monitor.resources import config

Array = NDArray[np.float64]
HEADER = "feature,distance_mm,elevation_deg,azimuth_deg"
STATION = np.array([6.0, 3.0, -1.0])
TURN = Rotation.from_rotvec([0.4, -0.8, 2.1]).as_matrix()
SPINDLE = "spindle"

NOISE = 1e-6, 5e-7
"""Of distance, m, and of both angles, rad: a good tracker, averaged."""

PAPER = {
    ("squareness", "X-Y"),
    ("squareness", "X-Z"),
    ("squareness", "Y-Z"),
    ("perpendicularity", "C-XY plane"),
    ("squareness", "A-C"),
    ("squareness", "spindle-A"),
    ("coplanarity", "A-C"),
    ("coplanarity", "spindle-A"),
    ("concentricity", "spindle-C"),
    ("perpendicularity", "spindle-XY plane"),
}
"""Rows of Table 2 between axes."""

ANGLE, SHIFT = 5e-5, 2e-5
"""Standard deviations of the errors that are drawn: about those of the paper's Table 2, rad and m."""


def matrix(shift: tuple[float, float, float], rotation: Array) -> Array:
    result = np.eye(4)
    result[:3, :3] = Rotation.from_rotvec(rotation).as_matrix()
    result[:3, 3] = shift
    return result


def still(displacement: Displacement) -> Array:
    return matrix(displacement.shift, np.array(displacement.rotation))


TOLD = {
    "carriage": ("", "c"),
    "ram": ("", "ab"),
    "swivel_head": ("", "ab"),
    "rotary_head": ("y", "bc"),
    "spindle": ("xy", "ab"),
}
"""Components of location errors that show in the lines of axes, by body: shifts and rotations."""


def drawn(machine: MachineDescription, rng: np.random.Generator, *, told: bool = False) -> MachineDescription:
    """The machine with location errors of all bodies but the first linear axis and the tool drawn anew.

    All components of them, or those alone that a calibration can find.
    """

    def vector(size: float, letters: str, wanted: str) -> tuple[float, float, float]:
        x, y, z = rng.normal(size=3) * size * [not told or letter in wanted for letter in letters]
        return float(x), float(y), float(z)

    for name, (shifts, turns) in TOLD.items():
        before = machine.body(name).location_error
        x, y, z = (-part for part in before.shift)
        a, b, c = (-part for part in before.rotation)
        machine = machine.with_location_error(name, Displacement((x, y, z), (a, b, c)))
        machine = machine.with_location_error(
            name, Displacement(vector(SHIFT, "xyz", shifts), vector(ANGLE, "abc", turns))
        )
    return machine


def placed(machine: MachineDescription, name: str, at: Mapping[str, float]) -> Array:
    """(4, 4) of a body in the base, with location errors and no others; `spindle` turns the spindle's body."""
    if name == "base":
        return np.eye(4)
    body = machine.body(name)
    here = placed(machine, body.parent, at) @ still(body.pose) @ still(body.location_error)
    if body.axis is not None:
        axis, q = machine.axis(body.axis), at.get(body.axis, 0.0)
        along = q * np.array(axis.direction)
        here = here @ (matrix(tuple(along), np.zeros(3)) if axis.kind == "linear" else matrix((0, 0, 0), along))
    if name == machine.spindle:
        here = here @ matrix((0.0, 0.0, 0.0), np.array([0.0, 0.0, at.get(SPINDLE, 0.0)]))
    return here


def tracks(machine: MachineDescription, points: int = 25) -> dict[str, Array]:
    """(n, 3) places in the base of a reflector that each axis moves, all others at zero."""
    nose = machine.spindle or ""
    targets = {  # of rotary axes: in the frame of the spindle's body, so that each is carried round
        "C.1": [0.4, 0.1, -0.05],
        "C.2": [-0.1, 0.3, -0.65],
        "A.1": [0.2, 0.25, -0.3],
        "A.2": [-0.25, -0.2, -0.35],
        "spindle.1": [0.06, 0.0, 0.0],
        "spindle.2": [0.0, 0.05, -0.3],
    }
    found = {}
    for letter in "YXZ":
        steps = 0.9 * np.linspace(*machine.axis(letter).travel, points)
        found[letter] = np.array([placed(machine, nose, {letter: q})[:3, 3] for q in steps])
    for feature, target in targets.items():
        name, half = feature.partition(".")[0], {"A": 1.5}.get(feature[0], math.pi)
        turns = np.linspace(-half, half, points, endpoint=False)
        at = np.array([*target, 1.0])
        found[feature] = np.array([(placed(machine, nose, {name: q}) @ at)[:3] for q in turns])
    return found


def rows(
    features: Mapping[str, Array],
    noise: tuple[float, float],
    rng: np.random.Generator,
    digits: tuple[int, int] = (9, 12),
) -> str:
    """Table of what a tracker reads, with standard deviations of distance (m) and of both angles (rad)."""
    near, fine = digits
    lines = [HEADER]
    for feature, points in features.items():
        seen = points @ TURN.T + STATION
        distance = np.linalg.norm(seen, axis=1)
        elevation, azimuth = np.arcsin(seen[:, 2] / distance), np.arctan2(seen[:, 1], seen[:, 0])
        distance = distance + noise[0] * rng.normal(size=len(seen))
        angles = np.stack([elevation, azimuth]) + noise[1] * rng.normal(size=(2, len(seen)))
        table = zip(distance * 1e3, *np.rad2deg(angles), strict=True)
        lines += [f"{feature},{d:.{near}f},{e:.{fine}f},{a:.{fine}f}" for d, e, a in table]
    return "\n".join(lines)


@dataclass(frozen=True)
class Lines:
    """Lines of a machine's axes and spindle in the base, all axes at zero, and what they are to each other."""

    machine: MachineDescription

    def of(self, name: str) -> tuple[Array, Array]:
        """Point and direction."""
        if name == SPINDLE:
            body, direction = self.machine.spindle or "", np.array([0.0, 0.0, 1.0])
        else:
            body, direction = self.machine.body_of(name).name, np.array(self.machine.axis(name).direction)
        at = placed(self.machine, body, {})
        return at[:3, 3], at[:3, :3] @ direction

    def squareness(self, one: str, other: str) -> float:
        return math.acos(float(self.of(one)[1] @ self.of(other)[1])) - math.pi / 2

    def perpendicularity(self, one: str, plane: str) -> float:
        normal = np.cross(self.of(plane[0])[1], self.of(plane[1])[1])
        return self._angle(self.of(one)[1], normal)

    def parallelism(self, one: str, other: str) -> float:
        return self._angle(self.of(one)[1], self.of(other)[1])

    def coplanarity(self, one: str, other: str) -> float:
        (p, d), (q, e) = self.of(one), self.of(other)
        normal = np.cross(d, e)
        return float((p - q) @ normal / np.linalg.norm(normal))

    def concentricity(self, one: str, other: str) -> float:
        """At the nose, the origin of the spindle's body."""
        (p, d), (q, e) = self.of(one), self.of(other)
        here = q + e * ((p - q) @ d) / (e @ d)
        return float(np.linalg.norm(p - here))

    @staticmethod
    def _angle(d: Array, e: Array) -> float:
        cross = float(np.linalg.norm(np.cross(d, e)))
        return math.atan2(cross, abs(float(d @ e)))

    def value(self, item: str, axes: str) -> float:
        """Of a row by its names, rad or m."""
        one, other = axes.removesuffix(" plane").split("-")
        return float(getattr(self, item)(one, other))


def straight(folder: Path, name: str) -> Path:
    """A copy of a shipped machine without error components: the axes here move along lines."""
    content = yaml.safe_load(config(f"machines/{name}.yaml").read_text(encoding="utf-8"))
    del content["machine"]["errors"]
    machine = folder / "machine.yaml"
    machine.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return machine


def calibrated(
    folder: Path,
    machine: MachineDescription,
    noise: tuple[float, float],
    rng: np.random.Generator,
    features: Mapping[str, Array] | None = None,
) -> SquarenessResult:
    """What the calibration of the shipped file finds of another machine, by all features or by these."""
    source = folder / "tracker.csv"
    source.write_text(rows(features or tracks(machine), noise, rng), encoding="utf-8")
    file = MachineFile(straight(folder, "pan2013"))
    job = Job(source, file, folder / "machine.yaml", date(2026, 11, 26), force=True)
    return calibrate_squareness(job, TrackerNoise(NOISE[0], 0.0, NOISE[1], NOISE[1]))


def held(machine: MachineDescription, relations: Iterable[AxisRelation]) -> Counter[tuple[str, str]]:
    """Rows whose bounds hold what the machine is."""
    lines = Lines(machine)
    found = [(row.relation, (row.item, row.axes)) for row in relations]
    return Counter(key for relation, key in found if relation.low <= lines.value(*key) <= relation.high)
