"""Sensors that a stage lists: what they see with homogeneous matrices, their amplifiers, and sections to draw."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from copy import deepcopy
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .geometry import autocollimator_reading
from .noise import drawn_log, instrument_noise, quantise
from .options import ROUNDINGS, Options, Seeds
from .recording import probe_topic
from .rotor import Components

Array = NDArray[np.float64]
CYLINDER = 0.0225  # m, radius of the artefact before radial probes
EVEN_RATE = 1000.0  # Hz, of probes whose rates are not odd
FIELDS = {"tilt_sensor": ("tilt_x", "tilt_y")}


class Probe:
    """One sensor of the section `sensors`, with the habits of its amplifier.

    Attributes:
        topic: of its samples.
        fields: of a sample.
        rate: samples per second.
        rounding: one of `ROUNDINGS`.
    """

    def __init__(self, seeds: Seeds, name: str, section: Mapping[str, Any], options: Options) -> None:
        self.topic = probe_topic(name, section)
        self._section, self._options = section, options
        rng = seeds.generator(f"{self.topic}/amplifier")
        drawn_rate, drawn_rounding = drawn_log(rng, 300.0, 2600.0), str(rng.choice(ROUNDINGS, p=(0.6, 0.3, 0.1)))
        self.rate = drawn_rate if options.odd_rates else EVEN_RATE
        self.fields = FIELDS.get(section["kind"], ("displacement",))
        self.rounding = options.rounding or drawn_rounding
        self._seeds = seeds

    def __call__(self, pose: Components) -> Array:
        """(n, k) what it gives out: noise comes before the converter, which ends at its range and has steps."""
        section, rng = self._section, self._seeds.generator(f"{self.topic}/noise")
        size = section["noise"] * self._options.noise
        reading = probe_reading(pose, section)
        reading = reading.reshape(len(reading), -1)
        noise = [instrument_noise(rng, len(reading), size, self._options.noise_shape) for _ in self.fields]
        reading = reading + np.stack(noise, axis=1)
        reading = np.clip(reading, -section["range"], section["range"])
        if self._options.quantise:
            reading = quantise(reading, section["resolution"], self.rounding)
        return np.asarray(reading, float)


def probe_reading(pose: Components, section: Mapping[str, Any]) -> Array:
    """Reading of a sensor without noise, range and steps: zero + gain * (motion and form of its target).

    (n,) of a probe, (n, 2) of a tilt sensor.
    """
    seen = SEEN[section["kind"]](pose, section)
    return np.asarray(section.get("zero", 0.0) + section.get("gain", 1.0) * seen, float)


def placed(pose: Components) -> Array:
    """(n, 4, 4) from the frame of the rotor to that of the base: shift, then tilt, then rotation about z."""
    n = len(pose.theta)
    shift, turn = np.tile(np.eye(4), (n, 1, 1)), np.tile(np.eye(4), (n, 1, 1))
    shift[:, :3, 3] = np.stack([pose.exc, pose.eyc, pose.ezc], axis=-1)
    turn[:, 0, 0] = turn[:, 1, 1] = np.cos(pose.theta)
    turn[:, 1, 0] = np.sin(pose.theta)
    turn[:, 0, 1] = -turn[:, 1, 0]
    return np.asarray(shift @ _tilted(pose.eac, pose.ebc) @ turn, float)


def _tilted(x: Array, y: Array) -> Array:
    """(n, 4, 4) rotation by the vector (x, y, 0): 1 + sin(a)/a K + (1 - cos(a))/a² K², K its cross product."""
    k = np.zeros((len(x), 4, 4))
    k[:, 0, 2], k[:, 2, 0] = y, -y
    k[:, 1, 2], k[:, 2, 1] = -x, x
    angle = np.hypot(x, y)[:, None, None]
    return np.asarray(np.eye(4) + np.sinc(angle / np.pi) * k + 0.5 * np.sinc(0.5 * angle / np.pi) ** 2 * (k @ k), float)


def _on_rotor(pose: Components, start: Sequence[float], direction: Sequence[float]) -> tuple[Array, Array]:
    """Start and direction of a line of the base as the rotor sees them, each (n, 3)."""
    back = np.linalg.inv(placed(pose))
    return (back @ np.array([*start, 1.0]))[:, :3], (back @ np.array([*direction, 0.0]))[:, :3]


def _height_of_face(pose: Components, section: Mapping[str, Any]) -> Array:
    """(n,) z at which the line of an axial probe meets the face, which has its form as hills."""
    azimuth, radius = float(section.get("azimuth", 0.0)), float(section["radius"])
    start, direction = _on_rotor(pose, [radius * np.cos(azimuth), radius * np.sin(azimuth), 0.0], [0.0, 0.0, 1.0])
    way = -start[:, 2] / direction[:, 2]
    for _ in range(2):  # a hill shifts the place that is met by next to nothing
        met = start + way[:, None] * direction
        psi = np.arctan2(met[:, 1], met[:, 0]) if radius else azimuth - pose.theta
        way = (_form(psi, section) - start[:, 2]) / direction[:, 2]
    return np.asarray(way, float)


def _way_to_cylinder(pose: Components, section: Mapping[str, Any]) -> Array:
    """(n,) how much farther out than on a perfect axis the line of a radial probe meets the artefact."""
    azimuth, height = float(section["azimuth"]), float(section["height"])
    start, direction = _on_rotor(pose, [0.0, 0.0, height], [np.cos(azimuth), np.sin(azimuth), 0.0])
    a = (direction[:, :2] ** 2).sum(axis=1)
    b = (direction[:, :2] * start[:, :2]).sum(axis=1)
    c = (start[:, :2] ** 2).sum(axis=1)
    radius = np.full(len(a), CYLINDER)
    for _ in range(2):
        way = (np.sqrt(b * b - a * (c - radius**2)) - b) / a
        met = start + way[:, None] * direction
        radius = CYLINDER + _form(np.arctan2(met[:, 1], met[:, 0]), section)
    way = (np.sqrt(b * b - a * (c - radius**2)) - b) / a
    return np.asarray(way - CYLINDER, float)


def _image_of_mirror(pose: Components, section: Mapping[str, Any]) -> Array:
    """(n, 2) half the place of the image of a ray that the mirror reflects, in the turned picture of the instrument."""
    seen = autocollimator_reading(pose, {"flatness": section.get("form", [])})
    roll = float(section.get("roll", 0.0))
    turn = np.array([[np.cos(roll), -np.sin(roll)], [np.sin(roll), np.cos(roll)]])
    return np.asarray(seen @ turn.T, float)


SEEN = {"axial_probe": _height_of_face, "radial_probe": _way_to_cylinder, "tilt_sensor": _image_of_mirror}


def _form(psi: Array, section: Mapping[str, Any]) -> Array:
    """(n,) form of the target at the angle `psi` on the rotor."""
    height = np.zeros(len(psi))
    for row in section.get("form", ()):
        height += row["cos"] * np.cos(row["order"] * psi) + row["sin"] * np.sin(row["order"] * psi)
    return height


def with_probes(stage: Mapping[str, Any], seed: int) -> dict[str, Any]:
    """A copy of a section `stage` with axial error motion and four probes that see all but the rotation.

    Two axial probes, `face` on the axis and `rim` beside it, and two radial ones, `low` and `high`, which stand at
    right angles. Sizes, places and forms are drawn from the seed.
    """
    rng = np.random.default_rng([seed, 20240301])
    made = deepcopy(dict(stage))
    made["spindle"] = {**made.get("spindle", {}), "axial": _rows(rng, drawn_log(rng, 5e-8, 1e-6), (1, 2, 3))}
    turn, low = rng.uniform(-np.pi, np.pi, 2)
    made["sensors"] = {
        "face": {"kind": "axial_probe", "radius": 0.0},
        "rim": {"kind": "axial_probe", "radius": float(rng.uniform(0.01, 0.08)), "azimuth": float(turn)},
        "low": {"kind": "radial_probe", "azimuth": float(low), "height": float(rng.uniform(0.005, 0.03))},
        "high": {"kind": "radial_probe", "azimuth": float(low + np.pi / 2), "height": float(rng.uniform(0.05, 0.1))},
    }
    for name, section in made["sensors"].items():
        section.update(_amplifier(rng))
        if name != "face":
            section["form"] = _rows(rng, drawn_log(rng, 5e-8, 2e-6), (1, 2, 3, 5))
    return made


def with_probes_alone(stage: Mapping[str, Any], seed: int) -> dict[str, Any]:
    """A copy of a section `stage` without heads and autocollimator: three radial probes at 120° see one artefact.

    They stand in the plane in which radial error motion counts. Azimuths and the artefact's form, off centre and out of
    round, are drawn from the seed, one make of amplifier for all, and zero and sign of each.
    """
    rng = np.random.default_rng([seed, 20240401])
    made = {name: part for name, part in deepcopy(dict(stage)).items() if name not in ("encoder", "autocollimator")}
    start, form = float(rng.uniform(-np.pi, np.pi / 3)), _rows(rng, drawn_log(rng, 3e-7, 1e-5), (1, 2, 3, 5))
    make = {name: size for name, size in _amplifier(rng).items() if name not in ("zero", "gain")}
    made["sensors"] = {
        name: {
            "kind": "radial_probe",
            "azimuth": start + 2.0 * np.pi * place / 3.0,
            "height": 0.0,
            **_amplifier(rng),
            **make,
            "form": form,
        }
        for place, name in enumerate(("one", "two", "three"))
    }
    return made


def _amplifier(rng: np.random.Generator) -> dict[str, float]:
    """Numbers of an amplifier, in m: capacitive, inductive or eddy current."""
    return {
        "noise": drawn_log(rng, 2e-9, 5e-8),
        "resolution": drawn_log(rng, 5e-10, 2e-8),
        "range": float(rng.choice((5e-5, 1e-4, 2.5e-4))),
        "uncertainty": drawn_log(rng, 1e-8, 2e-7),
        "zero": float(rng.uniform(-1e-5, 1e-5)),
        "gain": float(rng.choice((1.0, 1.0, -1.0))),
    }


def _rows(rng: np.random.Generator, size: float, orders: Sequence[int]) -> list[dict[str, Any]]:
    """Rows {order, cos, sin} that fall with their order, of a root mean square of `size` over a turn."""
    waves = rng.standard_normal((len(orders), 2)) / np.array(orders, float)[:, None]
    waves *= size / np.sqrt((waves**2).sum() / 2.0)
    return [{"order": int(k), "cos": float(c), "sin": float(s)} for k, (c, s) in zip(orders, waves, strict=True)]


def with_tilt_sensor(stage: Mapping[str, Any], seed: int) -> dict[str, Any]:
    """A copy of a section `stage` with a second autocollimator, `second`, that looks at another mirror.

    Its noise, zero, axes and sign and how askew and uneven the mirror is are drawn from the seed.
    """
    rng = np.random.default_rng([seed, 20240302])
    made = deepcopy(dict(stage))
    askew, uneven = drawn_log(rng, 3e-6, 2e-4), drawn_log(rng, 2e-7, 1e-5)
    azimuth = rng.uniform(-np.pi, np.pi)
    x, y = askew * np.cos(azimuth), askew * np.sin(azimuth)  # turned by theta: (x cos - y sin, x sin + y cos)
    form = [{"order": 1, "x": [float(x), float(-y)], "y": [float(y), float(x)]}]
    for order in (2, 3):
        waves = rng.standard_normal((2, 2)) * uneven / order
        form.append({"order": order, "x": waves[0].tolist(), "y": waves[1].tolist()})
    resolution = drawn_log(rng, 2e-8, 1e-6)
    made["sensors"] = {
        **made.get("sensors", {}),
        "second": {
            "kind": "tilt_sensor",
            "noise": resolution * float(rng.uniform(0.3, 1.5)),
            "resolution": resolution,
            "range": 2e-3,
            "uncertainty": drawn_log(rng, 1e-7, 2e-6),
            "zero": rng.uniform(-1e-4, 1e-4, 2).tolist(),
            "gain": float(rng.choice((1.0, 1.0, -1.0))),
            "roll": float(rng.uniform(-np.pi, np.pi)),
            "form": form,
        },
    }
    return made
