"""Recordings of drawn stages that lean, with an LVDT on an artefact, by the independent world."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from copy import deepcopy
from typing import Any

import numpy as np
from described_stages import stage_of
from world import Options, make_recording, random_stage

from rotary_error_monitor.bags.writer import write_messages

LEANING = 2e-5
"""Tilt error motion of these stages, rad, root mean square over a turn and axis."""


def leaning_stages(count: int, skip: int = 0) -> Iterator[tuple[int, dict[str, Any]]]:
    """Seed and section `stage` of drawn stages with fine heads, which lean by `LEANING` at orders 1 to 3."""
    seeds = (seed for seed in range(10_000) if _is_fine(random_stage(seed)["encoder"]))
    for _, seed in zip(range(skip + count), seeds, strict=False):
        if skip:
            skip -= 1
            continue
        rng = np.random.default_rng([seed, 20261126])
        section = random_stage(seed)
        waves = rng.normal(size=(3, 2, 2))
        waves *= LEANING / np.sqrt((waves**2).sum() / 4)
        section["spindle"]["tilt"] = [
            {"order": k + 1, "x": wave[0].tolist(), "y": wave[1].tolist()} for k, wave in enumerate(waves)
        ]
        section["autocollimator"] |= {"range": 5e-3, "resolution": 2e-7, "noise": 3e-7}
        section["autocollimator"].pop("turbulence", None)
        angle, size = rng.uniform(-np.pi, np.pi), rng.uniform(1e-6, 1.5e-5)
        section["lvdt"] = {
            "height": round(float(rng.uniform(0.01, 0.08)), 4),
            "noise": 4e-8,
            "artefact_eccentricity": [float(size * np.cos(angle)), float(size * np.sin(angle))],
        }
        yield seed, section


def _is_fine(encoder: Mapping[str, Any]) -> bool:
    """Whether there are four heads or more, and a reading and a count of them stay below what such a tilt makes."""
    count = 2 * np.pi / (encoder["lines_per_revolution"] * encoder["counts_per_line"])
    return len(encoder["heads"]) >= 4 and encoder["disc_radius"] * max(encoder["noise"], count / 2) < 8e-8


def record(folder, seed: int, section: Mapping[str, Any], seconds: float = 16.0, **options: Any):
    """Bag of such a stage that turns forth and back at 4 rad/s, with the habits of real instruments."""
    made = Options(motion="both_directions", peak_speed=4.0, lvdt=True, odd_rates=False, **options)
    bag = folder / f"bag_{seed}"
    write_messages(bag, make_recording(seed, duration=seconds, stage=section, options=made).blocks)
    return bag


def raised(section: Mapping[str, Any], by: float):
    """Description of the stage in which the LVDT stands higher, m, and the artefact's eccentricity is not known."""
    changed = deepcopy(dict(section))
    changed["lvdt"] = {"height": section["lvdt"]["height"] + by, "noise": section["lvdt"]["noise"]}
    return stage_of(changed)
