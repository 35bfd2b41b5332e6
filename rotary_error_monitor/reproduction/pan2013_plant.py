"""The machine of Pan et al. 2013 with its laser instruments, simulated: true errors in closed form.

What the paper prints comes out of its own evaluation as far as sampling allows; all else is chosen. Where tool and
targets are follows from products of exact matrices, T = Tp ΔTp Ts ΔTs of each body (Equation 9). No formula is shared
with what estimates, calibrates and predicts.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from rotary_error_monitor.arrays import Array
from rotary_error_monitor.description.machine import MachineDescription, load_machine, machine_mapping
from rotary_error_monitor.description.machine_parts import Displacement
from rotary_error_monitor.files import write_whole
from rotary_error_monitor.plant.machine import over_travel
from rotary_error_monitor.plant.noise import Noise
from rotary_error_monitor.reproduction.units import ARCSEC, DEGREE, MM, UM

CYCLES = 5
"""Of a positioning test, both ways: as ISO 230-2 asks for; the paper does not say."""


@dataclass(frozen=True)
class PositioningError:
    """True positioning error of an axis, and how it is tested; m of linear axes, rad of rotary ones.

    Spans, lost motions and scatter are such that over many tests the medians of accuracy A, repeatability R and
    reversal error B (ISO 230-2) are the printed figures.

    Attributes:
        span: range of the mean error over the travel.
        reversal: lost motion.
        scatter: standard deviation of a reading about its mean.
        targets: how many, over the travel.
    """

    span: float
    reversal: float
    scatter: float
    targets: int

    def error(self, u: Array, position: Array, direction: Array | float, *, rotary: bool) -> Array:
        """Error at positions, `u` of the half travel from its middle; direction 0 is the mean of both ways."""
        mean = 0.5 * np.sin(position) if rotary else 0.5 * u + 0.04 * np.sin(np.pi * u)
        return np.asarray(self.span * mean - 0.5 * self.reversal * direction, dtype=np.float64)


POSITIONING: Mapping[str, PositioningError] = {
    "X": PositioningError(62.77e-6, 3.896e-6, 0.863e-6, 25),
    "Y": PositioningError(45.84e-6, 6.806e-6, 0.2105e-6, 21),
    "Z": PositioningError(13.886e-6, 9.989e-6, 0.1391e-6, 21),
    # of rotary axes the paper prints the accuracy alone: lost motion of 1 and scatter of 0.3 arcsec are chosen
    "C": PositioningError(131.42 * ARCSEC, 1.0 * ARCSEC, 0.3 * ARCSEC, 121),
    "A": PositioningError(55.175 * ARCSEC, 1.0 * ARCSEC, 0.3 * ARCSEC, 45),
}


@dataclass(frozen=True)
class StraightnessError:
    """True straightness error of a linear axis: a bow, a wave and a ripple, about its line of least squares.

    Attributes:
        size: its range over the travel, m (paper, text of Section 6).
        bow, wave, ripple: parts of the form, chosen, for the paper shows curves alone.
    """

    size: float
    bow: float
    wave: float
    ripple: float

    def error(self, u: Array) -> Array:
        """Error at positions, m; `u` of the half travel from its middle."""
        return np.asarray(self._form(u) * self.size / np.ptp(self._form(np.linspace(-1, 1, 20_001))), dtype=np.float64)

    def _form(self, u: Array) -> Array:
        # the line of least squares of sin(2 pi u) from -1 to 1 falls by 3/(2 pi), that of the others is zero
        wave = np.sin(2 * np.pi * u) + 1.5 * u / np.pi
        return np.asarray(self.bow * (u**2 - 1 / 3) + self.wave * wave + self.ripple * np.cos(3 * np.pi * u))


STRAIGHTNESS: Mapping[str, StraightnessError] = {
    "EYX": StraightnessError(5.52e-6, 1.0, 0.4, 0.06),
    "EZX": StraightnessError(7.79e-6, -1.0, 0.3, 0.08),
    "EXY": StraightnessError(5.71e-6, 0.8, -0.5, 0.05),
    "EZY": StraightnessError(2.11e-6, 0.5, 0.6, 0.06),
}

STRAIGHTNESS_NOISE = 0.1e-6
"""Standard deviation of a straightness reading, m: of a laser interferometer over seconds; the paper does not say."""

STRAIGHTNESS_RUNS, STRAIGHTNESS_STOPS = 4, 61
"""Runs, forth and back by turns, and stops in each; the paper does not say."""

TRACKER_NOISE = 1e-6, 0.1 * ARCSEC
"""Standard deviations of distance, m, and both angles, rad, of a tracker's averaged reading; the paper has none. Single
readings of trackers scatter more, and would not tell the 6 µm over 300 mm of Table 2."""

TRACKER_POINTS = 25
"""Points that the tracker sees along and round each axis; the paper does not say."""

_STATION = np.array([5.0, 3.0, -1.5])
_TURN = Rotation.from_rotvec([0.1, -0.2, 2.1])
"""Where the machine's zero stands before the tracker, m, and how the machine is turned before it: anywhere."""

_TARGETS: Mapping[str, tuple[float, float, float]] = {
    "C.1": (0.4, 0.1, -0.05),
    "C.2": (-0.1, 0.3, -0.65),
    "A.1": (0.2, 0.25, -0.3),
    "A.2": (-0.25, -0.2, -0.35),
    "spindle.1": (0.06, 0.0, 0.0),
    "spindle.2": (0.0, 0.05, -0.3),
}
"""Where the reflectors are that an axis of rotation carries round, in the spindle's frame, m."""


@dataclass(frozen=True)
class PanMachine:
    """What is true, and what its builder knows before anything was measured.

    Attributes:
        seed: of noise, scatter, and the poses that are drawn.
    """

    seed: int

    @cached_property
    def described(self) -> MachineDescription:
        """The machine of Table 2: its bodies and how they lie are true here; its error motions are not used."""
        return load_machine("pan2013")

    @property
    def known(self) -> MachineDescription:
        """The machine as drawn: bodies and travels, no error of any kind."""
        return replace(
            self.described,
            bodies=tuple(replace(body, location_error=Displacement()) for body in self.described.bodies),
            axes=tuple(replace(axis, reversal=0.0, repeatability=None) for axis in self.described.axes),
            errors={},
        )

    def write_known(self, path: Path) -> None:
        """Write the machine file that the calibrations fill."""
        import yaml

        head = "# The machine before calibration: as drawn, without errors; SI units.\n"
        text = yaml.safe_dump({"machine": machine_mapping(self.known)}, sort_keys=False)
        write_whole(path, (head + text).encode())

    def write_positioning(self, path: Path, letter: str) -> None:
        """Write a test over the whole travel, forth and back, the instrument set to zero where the axis says zero."""
        test, rotary = POSITIONING[letter], self._is_rotary(letter)
        low, high = self.described.axis(letter).travel
        targets, draw = np.linspace(low, high, test.targets), self._draw(f"positioning {letter}")
        unit, scale, shown = ("arcsec", ARCSEC, DEGREE) if rotary else ("um", UM, MM)
        rows = [f"target_{'deg' if rotary else 'mm'},direction,cycle,deviation_{unit}"]
        for cycle in range(1, CYCLES + 1):
            for way in (1, -1):
                error = self.positioning_error(letter, targets, way) + draw.normal(0.0, test.scatter, len(targets))
                table = zip(targets[::way] / shown, error[::way] / scale, strict=True)
                rows += [f"{round(target, 6):g},{way},{cycle},{value:.3f}" for target, value in table]
        write_whole(path, _lines(rows))

    def write_straightness(self, path: Path, name: str) -> None:
        """Write runs over the whole travel; the beam of the laser lies at a slope and beside the axis."""
        low, high = self.described.axis(name[2]).travel
        stops, draw = np.linspace(low, high, STRAIGHTNESS_STOPS), self._draw(f"straightness {name}")
        beam = draw.normal(0.0, 2e-5) + draw.normal(0.0, 1e-5) * stops  # as well as one aligns it: 10 µrad
        rows = ["segment,run,direction,position_mm,reading_um"]
        for run in range(1, STRAIGHTNESS_RUNS + 1):
            way = 1 if run % 2 else -1
            error = STRAIGHTNESS[name].error(self._u(name[2], stops)) + beam
            readings = (error + draw.normal(0.0, STRAIGHTNESS_NOISE, len(stops))) / UM
            table = zip(stops[::way] * 1e3, readings[::way], strict=True)
            rows += [f"1,{run},{way},{stop:.6g},{reading:.3f}" for stop, reading in table]
        write_whole(path, _lines(rows))

    def write_tracker(self, path: Path) -> None:
        """Write what a laser tracker sees: the spindle's nose along each linear axis, reflectors round the others."""
        draw, rows = self._draw("tracker"), ["feature,distance_mm,elevation_deg,azimuth_deg"]
        for feature, points in self._tracks().items():
            seen = _TURN.apply(points) + _STATION
            distance = np.linalg.norm(seen, axis=1)
            angles = np.stack([np.arcsin(seen[:, 2] / distance), np.arctan2(seen[:, 1], seen[:, 0])])
            distance = distance + draw.normal(0.0, TRACKER_NOISE[0], distance.shape)
            angles = np.rad2deg(angles + draw.normal(0.0, TRACKER_NOISE[1], angles.shape))
            table = zip(distance * 1e3, *angles, strict=True)
            rows += [f"{feature},{d:.6f},{elevation:.9f},{azimuth:.9f}" for d, elevation, azimuth in table]
        write_whole(path, _lines(rows))

    def write_poses(self, path: Path, count: int) -> None:
        """Write poses drawn in the working volume, each axis come from a side that is drawn as well."""
        draw = self._draw("poses")
        axes = self.described.axes
        poses = np.stack([draw.uniform(*axis.travel, count) * axis.shown[0] for axis in axes], axis=1)
        ways = draw.choice([-1, 1], (count, len(axes)))
        names = [f"{axis.letter}_{axis.shown[1]}" for axis in axes]
        rows = [",".join([*names, *(f"{letter}_direction" for letter in self._letters)])]
        for pose, way in zip(poses, ways, strict=True):
            rows.append(",".join([*(f"{value:.6f}" for value in pose), *map(str, way)]))
        write_whole(path, _lines(rows))

    def offset(self, pose: Mapping[str, float], ways: Mapping[str, float]) -> Array:
        """(6,) tool as it is against where it should be, in the workpiece's frame, m and rad (Equations 13 to 15)."""
        machine = self.described
        should = np.linalg.solve(self._ideal(machine.workpiece, pose), self._ideal(machine.tool, pose))
        actual = np.linalg.solve(self.placed(machine.workpiece, pose, ways), self.placed(machine.tool, pose, ways))
        turned = Rotation.from_matrix(actual[:3, :3] @ should[:3, :3].T).as_rotvec()
        return np.concatenate([actual[:3, 3] - should[:3, 3], turned])

    def placed(self, name: str, pose: Mapping[str, float], ways: Mapping[str, float], spun: float = 0.0) -> Array:
        """(4, 4) of a body in the base as the machine is; axes not named stand at 0, the spindle turned by `spun`."""
        if name == "base":
            return np.eye(4)
        body = self.described.body(name)
        here = self.placed(body.parent, pose, ways, spun) @ _still(body.pose) @ _still(body.location_error)
        if body.axis is not None:
            q = pose.get(body.axis, 0.0)
            here = here @ self._moved(body.axis, q) @ self._error_motion(body.axis, q, ways.get(body.axis, 0.0))
        return here @ _matrix(np.zeros(3), np.array([0.0, 0.0, spun])) if name == self.described.spindle else here

    def positioning_error(self, letter: str, positions: Array, direction: float) -> Array:
        """Along or about its own direction, at positions of an axis, m or rad."""
        u, test = self._u(letter, positions), POSITIONING[letter]
        return test.error(u, positions, direction, rotary=self._is_rotary(letter))

    @property
    def _letters(self) -> tuple[str, ...]:
        return tuple(axis.letter for axis in self.described.axes)

    def _is_rotary(self, letter: str) -> bool:
        return self.described.axis(letter).kind == "rotary"

    def _u(self, letter: str, positions: Array) -> Array:
        return over_travel(self.described.axis(letter), positions)

    def _draw(self, name: str) -> np.random.Generator:
        return Noise(self.seed, name).generator()

    def _ideal(self, name: str, pose: Mapping[str, float]) -> Array:
        if name == "base":
            return np.eye(4)
        body = self.described.body(name)
        here = self._ideal(body.parent, pose) @ _still(body.pose)
        return here if body.axis is None else here @ self._moved(body.axis, pose.get(body.axis, 0.0))

    def _moved(self, letter: str, q: float) -> Array:
        along = q * np.array(self.described.axis(letter).direction)
        return _matrix(np.zeros(3), along) if self._is_rotary(letter) else _matrix(along, np.zeros(3))

    def _error_motion(self, letter: str, q: float, direction: float) -> Array:
        at = np.array([q])
        own = float(self.positioning_error(letter, at, direction)[0])
        along = own * np.array(self.described.axis(letter).direction)
        if self._is_rotary(letter):
            return _matrix(np.zeros(3), along)
        for number, across in enumerate("XYZ"):
            curve = STRAIGHTNESS.get(f"E{across}{letter}")
            along[number] += 0.0 if curve is None else float(curve.error(self._u(letter, at))[0])
        return _matrix(along, np.zeros(3))

    def _tracks(self) -> dict[str, Array]:
        """(n, 3) places in the base, means of both ways, of the reflector that each axis moves, all others at zero."""
        nose, found = self.described.spindle or "", dict[str, Array]()
        for letter in "YXZ":
            stops = np.linspace(*self.described.axis(letter).travel, TRACKER_POINTS)
            found[letter] = np.array([self.placed(nose, {letter: q}, {})[:3, 3] for q in stops])
        for feature, target in _TARGETS.items():
            name, at = feature.partition(".")[0], np.array([*target, 1.0])
            half = 1.5 if name == "A" else math.pi  # A goes ±86°, the others all round
            turns = np.linspace(-half, half, TRACKER_POINTS, endpoint=False)
            spins = turns if name == "spindle" else np.zeros_like(turns)
            poses = [{} if name == "spindle" else {name: float(q)} for q in turns]
            places = [self.placed(nose, pose, {}, spun) @ at for pose, spun in zip(poses, spins, strict=True)]
            found[feature] = np.array(places)[:, :3]
        return found


def _matrix(shift: Array, rotation: Array) -> Array:
    result = np.eye(4)
    result[:3, :3] = Rotation.from_rotvec(rotation).as_matrix()
    result[:3, 3] = shift
    return result


def _still(displacement: Displacement) -> Array:
    return _matrix(np.array(displacement.shift), np.array(displacement.rotation))


def _lines(rows: Iterable[str]) -> bytes:
    return ("\n".join(rows) + "\n").encode()
