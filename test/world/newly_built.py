"""Stages as they are when they are new: mounted by hand, plugged by hand, described by their data sheets alone."""

from __future__ import annotations

import copy
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rotary_error_monitor.signals.blocks import SampleBlock

from .noise import drawn_log
from .options import Options
from .recording import AUTOCOLLIMATOR, COMMAND, Recording, head_topic
from .responses import answered
from .stage import make_recording

Section = dict[str, Any]
DEGREE = np.pi / 180.0
TOLERANCE = 2.0 * DEGREE
MIRRORS = {
    "x": ((-1.0, 0.0), (0.0, 1.0)),
    "y": ((1.0, 0.0), (0.0, -1.0)),
    "exchanged": ((0.0, 1.0), (1.0, 0.0)),
}


@dataclass(frozen=True)
class NewlyBuilt:
    """A stage that was built and recorded.

    Attributes:
        nominal: section `stage` of the data sheets.
        true: section `stage` as it is, with the responses of all instruments.
        recording: what the instruments gave.
        swapped: the two heads that are exchanged, or none.
        noise: of all instruments over what is described.
    """

    nominal: Section
    true: Section
    recording: Recording
    swapped: tuple[str, ...]
    noise: float


def build(
    seed: int,
    *,
    count: int | None = None,
    even: bool | None = None,
    swap: bool | None = None,
    sign: bool = True,
    duration: float = 40.0,
    known_tilt: bool = False,
    pushed: bool = False,
    reversed_heads: int | None = None,
    axes: tuple[float, float] | None = None,
    tilt: float | None = None,
    curves: bool = False,
    graduation: float | None = None,
    **options: Any,
) -> NewlyBuilt:
    """A stage drawn from the seed, turned both ways.

    Args:
        seed: of everything.
        count: of heads, 3 to 6.
        even: whether the heads are described evenly around the ring, or at places of their own.
        swap: whether two heads are exchanged.
        sign: whether the file states the sign of the command, which is drawn.
        duration: s.
        known_tilt: whether the file states the spindle's tilt error motion, with its uncertainty.
        pushed: whether a force that is recorded pushes at a shaft whose compliance in tilt is described.
        reversed_heads: how many heads count the other way; drawn where it is None.
        axes: gain and roll (rad) of the autocollimator; drawn where it is None.
        tilt: root mean square of the spindle's tilt error motion per axis, rad; drawn where it is None.
        curves: whether ring and mirror have errors of many orders, which the file states as measured curves.
        graduation: standard deviation of coefficients of orders 2, 3 and 5 of the ring's, rad, which the file does not
            state; None for a perfect ring.
        options: of the recording.
    """
    rng = np.random.default_rng([seed, 20261127])
    count = int(rng.integers(3, 7)) if count is None else count
    even = bool(rng.integers(0, 2)) if even is None else even
    swap = bool(rng.integers(0, 2)) if swap is None else swap
    nominal, spindle = _nominal(rng, count, even, tilt)
    letters = list(nominal["encoder"]["heads"])
    swapped = tuple(sorted(rng.choice(letters, 2, replace=False).tolist())) if swap else ()
    true = _as_built(rng, nominal, spindle, swapped)
    if reversed_heads is not None:
        for place, letter in enumerate(rng.permutation(letters).tolist()):
            true["encoder"]["heads"][letter]["sign"] = -1 if place < reversed_heads else 1
    if axes is not None:
        true["autocollimator"]["gain"], true["autocollimator"]["roll"] = axes
    if curves:
        _measured(np.random.default_rng([seed, 20261128]), nominal, true)
    if graduation is not None:
        own = np.random.default_rng([seed, 20261129])
        rows = [(order, *own.normal(0.0, graduation, 2).tolist()) for order in (2, 3, 5)]
        true["encoder"]["graduation"] = [{"order": k, "cos": cos, "sin": sin} for k, cos, sin in rows]
    if sign:
        nominal["command"] = {"sign": true["command"]["sign"]}
    if known_tilt:
        nominal["spindle"] = {"tilt": copy.deepcopy(true["spindle"]["tilt"])}
        nominal["uncertainty"] = {"spindle.tilt": 1e-8, "mirror.flatness": 1e-8}
    if known_tilt or curves:
        nominal.setdefault("command", {})["zero"] = true["command"]["zero"]  # where these are counted from
    if pushed:
        for section in (nominal, true):
            section.setdefault("spindle", {})["tilt_compliance"] = 1e-7
        nominal.setdefault("uncertainty", {})["spindle.tilt_compliance"] = 1e-10
    drawn = {
        "motion": "both_directions",
        "peak_speed": float(rng.uniform(40.0, 80.0)) / duration,  # each of up to five moves makes a turn
        "noise": drawn_log(rng, 0.3, 3.0),
        "following_error": float(rng.uniform(-2e-5, 2e-5)),
        "force": pushed,
        "temperature": False,
        "lvdt": False,
    }
    chosen = {**drawn, **options}
    made = make_recording(seed, duration=duration, stage=true, options=Options(**chosen))
    return NewlyBuilt(nominal, true, answered(made, true), swapped, chosen["noise"])


def _nominal(rng: np.random.Generator, count: int, even: bool, size: float | None) -> tuple[Section, Section]:
    """Section of the data sheets, and the spindle that the stage has."""
    azimuths = 2.0 * np.pi * np.arange(count) / count
    if not even:  # by gaps of which no two are alike, and no sequence is its own mirror image
        gaps = rng.permutation(np.linspace(0.6, 1.4, count)) if count > 3 else rng.permutation([0.7, 1.0, 1.3])
        azimuths = np.cumsum(gaps / gaps.sum()) * 2.0 * np.pi
    radius = drawn_log(rng, 0.05, 0.15)
    encoder = {
        "disc_radius": radius,
        "lines_per_revolution": round(2.0 * np.pi * radius / 2e-5),
        "counts_per_line": 100,
        "noise": 3e-7,
        "heads": {"abcdef"[i]: {"azimuth": float(azimuth % (2.0 * np.pi))} for i, azimuth in enumerate(azimuths)},
    }
    radial, tilt = drawn_log(rng, 1e-7, 1.5e-6), drawn_log(rng, 2e-6, 1e-5)
    tilt = tilt if size is None else size
    spindle = {"radial": _waves(rng, radial, (1, 2, 3, 5)), "tilt": _waves(rng, tilt, (1, 2, 3))}
    nominal = {
        "encoder": encoder,
        "autocollimator": {"range": 1e-3, "resolution": 4.8e-7, "noise": 4.8e-7},
        "limits": {"speed": 10.0, "radial": max(6.0 * radial, 2.5e-6), "tilt": 6.0 * tilt, "following_error": 2e-4},
    }
    return nominal, spindle


def _as_built(rng: np.random.Generator, nominal: Section, spindle: Section, swapped: Sequence[str]) -> Section:
    true = copy.deepcopy(nominal)
    heads = true["encoder"]["heads"]
    if swapped:
        a, b = swapped
        heads[a], heads[b] = heads[b], heads[a]
    for head in heads.values():
        head["azimuth"] += float(rng.uniform(-TOLERANCE, TOLERANCE))
        head |= {"zero": float(rng.uniform(-6.0, 6.0)), "sign": int(rng.choice([-1, 1]))}
        head["latency"] = float(rng.uniform(0.0, 1e-3))
    true["encoder"]["eccentricity"] = _vector(rng, drawn_log(rng, 1e-5, 5e-5))
    true["mirror"] = {"tilt": _vector(rng, drawn_log(rng, 5e-5, 2e-4))}
    true["autocollimator"] |= {
        "zero": rng.uniform(-1e-4, 1e-4, 2).tolist(),
        "gain": float(rng.uniform(0.95, 1.05)),
        "roll": float(rng.uniform(-0.5, 0.5)),
        "latency": float(rng.uniform(0.0, 5e-3)),
    }
    true["command"] = {"zero": float(rng.uniform(-6.0, 6.0)), "sign": int(rng.choice([-1, 1]))}
    true["command"]["latency"] = float(rng.uniform(0.0, 5e-3))
    true["spindle"] = spindle
    return true


ORDERS = (1, 2, 3, 4, 5, 7, 11)
"""Of the errors of a ring and a mirror that are measured."""


def _measured(rng: np.random.Generator, nominal: Section, true: Section) -> None:
    """Give ring and mirror errors of `ORDERS`, and state them as curves of 360 angles, each to some nanoradians."""
    size = drawn_log(rng, 3e-6, 3e-5)
    ring = [
        {"order": k, **dict(zip(("cos", "sin"), (size / np.sqrt(k) * rng.normal(size=2)).tolist(), strict=True))}
        for k in ORDERS
    ]
    mirror = _waves(rng, drawn_log(rng, 5e-7, 3e-6), ORDERS)
    true["encoder"]["graduation"], true["mirror"]["flatness"] = ring, mirror
    angles = float(rng.uniform(-3, 0)) + np.linspace(0.0, 2.0 * np.pi, 360, endpoint=False)
    uncertainty = 5e-9
    values = sum(r["cos"] * np.cos(r["order"] * angles) + r["sin"] * np.sin(r["order"] * angles) for r in ring)
    nominal["encoder"]["graduation_table"] = {
        "angles": angles.tolist(),
        "values": (values + uncertainty * rng.normal(size=360)).tolist(),
        "uncertainties": [uncertainty] * 360,
    }
    columns = {
        axis: sum(r[axis][0] * np.cos(r["order"] * angles) + r[axis][1] * np.sin(r["order"] * angles) for r in mirror)
        for axis in "xy"
    }
    nominal["mirror"] = {
        "flatness_table": {
            "angles": angles.tolist(),
            **{axis: (each + uncertainty * rng.normal(size=360)).tolist() for axis, each in columns.items()},
            "uncertainties": [uncertainty] * 360,
        }
    }


def in_unit(recording: Recording, topics: Sequence[str], size: float) -> Recording:
    """The recording with values of some topics in a unit of which one in SI makes `size`."""
    return _changed(recording, topics, lambda values: values * size)


def wrapped(recording: Recording, topics: Sequence[str]) -> Recording:
    """The recording with angles of some topics within a turn."""

    def fold(values: np.ndarray) -> np.ndarray:
        return np.column_stack([np.mod(values[:, :1], 2.0 * np.pi), values[:, 1:]])

    return _changed(recording, topics, fold)


def mirrored(recording: Recording, how: str) -> Recording:
    """The recording with an autocollimator of which an axis is reversed (`x`, `y`) or both are `exchanged`."""
    matrix = np.array(MIRRORS[how])
    return _changed(recording, [AUTOCOLLIMATOR], lambda values: values @ matrix.T)


def _changed(recording: Recording, topics: Sequence[str], change: Any) -> Recording:
    made = {}
    for topic in topics:
        blocks = [
            SampleBlock(each.stamp_ns, each.names, np.column_stack([each.rows[:, 0], change(each.rows[:, 1:])]))
            for each in recording.blocks[topic]
        ]
        made[topic] = blocks, recording.arrivals[topic]
    return recording.with_topics(made)


def _waves(rng: np.random.Generator, size: float, orders: Sequence[int]) -> list[Section]:
    """Rows of a root mean square of `size` per axis that fall with their order."""
    waves = rng.standard_normal((len(orders), 2, 2)) / np.array(orders, float)[:, None, None]
    waves *= size / np.sqrt((waves**2).sum() / 4.0)
    return [
        {"order": order, "x": wave[0].tolist(), "y": wave[1].tolist()}
        for order, wave in zip(orders, waves, strict=True)
    ]


def _vector(rng: np.random.Generator, size: float) -> list[float]:
    angle = rng.uniform(0.0, 2.0 * np.pi)
    return [float(size * np.cos(angle)), float(size * np.sin(angle))]


__all__ = ["COMMAND", "NewlyBuilt", "build", "head_topic", "in_unit", "mirrored", "wrapped"]
