"""Wrong descriptions: what somebody writes into the section `stage` of a stage that is otherwise."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import dataclass
from typing import Any

import numpy as np

Stage = dict[str, Any]
LIMITS = {"range": 0.1, "resolution": 0.001, "noise": 0.001}  # what a description may state, in rad
HEAD_ROOM = 0.25  # rad, that a head of 5 mm takes at the smallest ring


@dataclass(frozen=True)
class Description:
    """A mistake in a description: called with the true section `stage`, it gives a wrong one.

    Attributes:
        name: its name.
        sentence: what it is.
        keys: the sections and keys that it changes, such as `encoder.heads`.
        change: changes a copy of the section in place.
    """

    name: str
    sentence: str
    keys: tuple[str, ...]
    change: Callable[[Stage, np.random.Generator], None]

    def __call__(self, stage: Mapping[str, Any], rng: np.random.Generator | None = None) -> Stage:
        """The wrong description of a true stage; it equals the true one where there is nothing to get wrong."""
        wrong = deepcopy(dict(stage))
        self.change(wrong, rng or np.random.default_rng(0))
        return wrong


def _within_turn(angle: float) -> float:
    """An angle in [-2 pi, 2 pi], as a description wants azimuths."""
    return angle if abs(angle) <= 2.0 * np.pi else float(np.fmod(angle, 2.0 * np.pi))


def _swap_heads(stage: Stage, rng: np.random.Generator) -> None:
    """Two heads exchange their places."""
    heads = stage["encoder"]["heads"]
    a, b = rng.choice(sorted(heads), 2, replace=False).tolist()
    heads[a], heads[b] = heads[b], heads[a]


def _scale(section: str, key: str, factor: float) -> Callable[[Stage, np.random.Generator], None]:
    """Mistake: a number times a factor."""

    def change(stage: Stage, rng: np.random.Generator) -> None:
        value = stage[section][key] * factor
        whole = isinstance(stage[section][key], int)
        stage[section][key] = max(1, round(value)) if whole else min(value, LIMITS.get(key, value))

    return change


def _set_noise(value: float) -> Callable[[Stage, np.random.Generator], None]:
    """Mistake: another noise of a reading."""

    def change(stage: Stage, rng: np.random.Generator) -> None:
        stage["encoder"]["noise"] = value

    return change


def _without(section: str, key: str | None = None) -> Callable[[Stage, np.random.Generator], None]:
    """Mistake: a section or one of its keys is missing."""

    def change(stage: Stage, rng: np.random.Generator) -> None:
        if key is None:
            stage.pop(section, None)
        else:
            stage.get(section, {}).pop(key, None)

    return change


def _azimuths(factor: float, offset: float) -> Callable[[Stage, np.random.Generator], None]:
    """Mistake: all azimuths times a factor, plus an offset in rad."""

    def change(stage: Stage, rng: np.random.Generator) -> None:
        for head in stage["encoder"]["heads"].values():
            head["azimuth"] = _within_turn(factor * head["azimuth"] + offset)

    return change


def _one_azimuth(stage: Stage, rng: np.random.Generator) -> None:
    """One head is 30° off its place, where no other head stands: a description with two at one place is refused."""
    azimuths = {name: head["azimuth"] for name, head in stage["encoder"]["heads"].items()}
    drawn = str(rng.choice(sorted(azimuths))), float(rng.choice((-1.0, 1.0))) * np.pi / 6.0

    def room(moved: tuple[str, float]) -> float:
        name, by = moved
        others = np.array([azimuth for other, azimuth in azimuths.items() if other != name])
        return float(np.abs(np.angle(np.exp(1j * (azimuths[name] + by - others)))).min())

    if room(drawn) < HEAD_ROOM:
        drawn = max(((name, by) for name in sorted(azimuths) for by in (-np.pi / 6.0, np.pi / 6.0)), key=room)
    stage["encoder"]["heads"][drawn[0]]["azimuth"] = _within_turn(azimuths[drawn[0]] + drawn[1])


def _vector(section: str, key: str, matrix: tuple[float, ...]) -> Callable[[Stage, np.random.Generator], None]:
    """Mistake: a vector times a matrix [[a, b], [c, d]]."""
    a, b, c, d = matrix

    def change(stage: Stage, rng: np.random.Generator) -> None:
        if key in stage.get(section, {}):
            x, y = stage[section][key]
            stage[section][key] = [a * x + b * y, c * x + d * y]

    return change


def _autocollimator_in_microradian(stage: Stage, rng: np.random.Generator) -> None:
    """Numbers in µrad, as far as a description accepts them."""
    for key, limit in LIMITS.items():
        stage["autocollimator"][key] = min(stage["autocollimator"][key] * 1e6, limit)


_ALL = [
    Description("heads_swapped", "The azimuths of two heads are exchanged.", ("encoder.heads",), _swap_heads),
    Description(
        "diameter_for_radius",
        "The diameter stands for the radius.",
        ("encoder.disc_radius",),
        _scale("encoder", "disc_radius", 2.0),
    ),
    Description(
        "half_radius",
        "Half of the radius stands for the radius.",
        ("encoder.disc_radius",),
        _scale("encoder", "disc_radius", 0.5),
    ),
    Description(
        "no_eccentricity",
        "The eccentricity is left out.",
        ("encoder.eccentricity",),
        _without("encoder", "eccentricity"),
    ),
    Description(
        "no_graduation", "The graduation is left out.", ("encoder.graduation",), _without("encoder", "graduation")
    ),
    Description("no_mirror", "The mirror is left out.", ("mirror",), _without("mirror")),
    Description("no_spindle", "The spindle is left out.", ("spindle",), _without("spindle")),
    Description("azimuths_reversed", "Azimuths have the wrong sign.", ("encoder.heads",), _azimuths(-1.0, 0.0)),
    Description("azimuths_off_30", "All azimuths are off by 30°.", ("encoder.heads",), _azimuths(1.0, np.pi / 6.0)),
    Description("azimuth_off_30", "The azimuth of one head is off by 30°.", ("encoder.heads",), _one_azimuth),
    Description(
        "counts_per_line_double",
        "There are half as many counts per line as stated.",
        ("encoder.counts_per_line",),
        _scale("encoder", "counts_per_line", 2.0),
    ),
    Description(
        "counts_per_line_half",
        "There are twice as many counts per line as stated.",
        ("encoder.counts_per_line",),
        _scale("encoder", "counts_per_line", 0.5),
    ),
    Description("noise_large", "The noise of a reading is stated as 1 mrad.", ("encoder.noise",), _set_noise(1e-3)),
    Description("noise_small", "The noise of a reading is stated as 1 nrad.", ("encoder.noise",), _set_noise(1e-9)),
    Description(
        "autocollimator_in_microradian",
        "Range, resolution and noise of the autocollimator are in µrad, up to what a description may state.",
        ("autocollimator",),
        _autocollimator_in_microradian,
    ),
    Description(
        "mirror_tilt_swapped",
        "x and y of the mirror's tilt are exchanged.",
        ("mirror.tilt",),
        _vector("mirror", "tilt", (0.0, 1.0, 1.0, 0.0)),
    ),
    Description(
        "eccentricity_mirrored",
        "The eccentricity is stated for the other sense of rotation: y has the wrong sign.",
        ("encoder.eccentricity",),
        _vector("encoder", "eccentricity", (1.0, 0.0, 0.0, -1.0)),
    ),
    Description(
        "eccentricity_negated",
        "The eccentricity is stated from the ring to the axis.",
        ("encoder.eccentricity",),
        _vector("encoder", "eccentricity", (-1.0, 0.0, 0.0, -1.0)),
    ),
]

DESCRIPTIONS: dict[str, Description] = {description.name: description for description in _ALL}
