"""Recordings of drawn stages beside an LVDT, described as surely as stated, and what `compare` says of them."""

from __future__ import annotations

from copy import deepcopy
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from described_stages import stage_of
from referenced_stage import leaning_stages
from world import Options, make_recording
from world.recording import LVDT, Recording

from rotary_error_monitor.bags.writer import write_messages
from rotary_error_monitor.errors import InputError
from rotary_error_monitor.recordings.verification import verify_bag
from rotary_error_monitor.signals.blocks import SampleBlock

STATED = {
    "encoder.timing": 2e-7,
    "encoder.eccentricity": 1.5e-7,
    "encoder.graduation": 5e-8,
    "mirror.tilt": 5e-7,
    "mirror.flatness": 2e-7,
    "autocollimator.gain": 3e-3,
    "autocollimator.roll": 3e-3,
    "lvdt.gain": 5e-3,
    "lvdt.roll": 5e-3,
    "lvdt.height": 3e-4,
}
"""Standard uncertainties of a stage that was calibrated, as a stage file has them."""

ORDERS = (2, 3, 5)
"""Of the form of an artefact."""


def described(section: dict[str, Any], rng: np.random.Generator) -> dict[str, Any]:
    """The section as a calibration would have it that is as sure as `STATED`; the artefact's eccentricity unknown."""
    found = deepcopy(section)
    found["lvdt"].pop("artefact_eccentricity")

    def off(name: str, count: int = 1) -> np.ndarray:
        return STATED[name] * rng.normal(size=count)

    encoder, mirror = found["encoder"], found.setdefault("mirror", {})
    encoder["eccentricity"] = (np.array(encoder["eccentricity"]) + off("encoder.eccentricity", 2)).tolist()
    mirror["tilt"] = (np.array(mirror.get("tilt", (0.0, 0.0))) + off("mirror.tilt", 2)).tolist()
    for row in encoder["graduation"]:
        row["cos"], row["sin"] = (np.array((row["cos"], row["sin"])) + off("encoder.graduation", 2)).tolist()
    for row in mirror.get("flatness", ()):
        for axis in "xy":
            row[axis] = (np.array(row[axis]) + off("mirror.flatness", 2)).tolist()
    for name in ("autocollimator", "lvdt"):
        found[name] |= {"gain": 1.0 + off(f"{name}.gain").item(), "roll": off(f"{name}.roll").item()}
    found["lvdt"]["height"] += off("lvdt.height").item()
    found["uncertainty"] = dict(STATED)
    return found


def with_form(recording: Recording, size: float, rng: np.random.Generator) -> Recording:
    """The recording with an artefact that is not round: waves of `size`, m, that turn with it, under both axes."""
    phases = rng.uniform(0.0, 2.0 * np.pi, len(ORDERS))
    made = []
    for block in recording.blocks[LVDT]:
        theta = recording.truth(block.stamp_ns + np.rint(block.rows[:, 0] * 1e9).astype(np.int64)).theta
        at = np.array([0.0, np.pi / 2]) - theta[:, None]
        form = sum(size / k * np.cos(k * at + phase) for k, phase in zip(ORDERS, phases, strict=True))
        made.append(
            SampleBlock(block.stamp_ns, block.names, np.column_stack([block.rows[:, 0], block.rows[:, 1:] + form]))
        )
    return recording.with_topics({LVDT: (made, recording.arrivals[LVDT])})


def held(seed: int, section: dict[str, Any]) -> dict[str, list[float]]:
    """What one stage shows of each bound: whether it holds the truth, of differences the part that is inside.

    Noise is 0.7 to 1.3 times what is stated; heads, autocollimator and LVDT round; two to ten turns each way at 2 to
    6 rad/s; every third artefact is out of round.
    """
    rng = np.random.default_rng([seed, 20261129])
    options = Options(
        motion="both_directions",
        peak_speed=float(rng.uniform(2.0, 6.0)),
        lvdt=True,
        odd_rates=False,
        noise=float(rng.uniform(0.7, 1.3)),
        clock_offset=1.4e-7,
        clock_wander=1.4e-7,
        stamp_jitter=1e-7,
    )
    made = make_recording(seed, duration=float(rng.uniform(16.0, 26.0)), stage=section, options=options)
    if seed % 3 == 0:
        made = with_form(made, 3e-8, rng)
    stage = described(section, rng)
    with TemporaryDirectory() as folder:
        write_messages(Path(folder) / "bag", made.blocks)
        (found,) = verify_bag(Path(folder) / "bag", stage_of(stage)).comparisons
    off = found.eccentricity - np.array(section["lvdt"]["artefact_eccentricity"])
    higher = found.higher - (section["lvdt"]["height"] - stage["lvdt"]["height"])
    axes = [axis for turning in found.turnings for axis in turning.axes]
    return {
        "eccentricity": (np.abs(off) <= found.expanded).astype(float).tolist(),
        "height": [float(abs(higher) <= found.higher_expanded)],
        "differences": [axis.judgement.inside for axis in axes],
        "agrees": [float(found.agrees)],
    }


def rates(count: int, skip: int = 0) -> dict[str, float]:
    """Part of the bounds of each kind that hold the truth over so many stages, and of stages that were `compared`.

    A recording without a whole turn at one speed is refused, and says nothing of bounds.
    """
    found = []
    for seed, section in leaning_stages(count, skip):
        try:
            found.append(held(seed, section))
        except InputError as error:
            assert "record a whole turn" in str(error), error
    told = {name: round(float(np.mean([value for each in found for value in each[name]])), 3) for name in found[0]}
    return told | {"compared": len(found) / count}
