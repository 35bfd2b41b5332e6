"""An ideal stage that turns evenly: what its heads and its autocollimator read at a stamp follows from the stamp alone.

Without error motion, readings of one instant give none. A reading that is joined with those of another instant shows as
a radial error motion of half the disc's radius times the angle between the two, so that an estimate tells by itself
whether what it joined belongs together.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

from rotary_error_monitor.resources import config

SPEED = 4.0
"""Speed of the stage, rad/s: what the other benchmarks take, and less than half of what the stage allows."""

RADIUS = 0.1
"""Radius of the disc, m: that of `config/stage.yaml`."""

WOBBLE = (7.0e-5, 2.4e-5)
"""Tilt of the mirror on the rotor, rad, as in `config/stage.yaml`: an autocollimator that shows nothing is doubted."""

HEADS = ("head_a", "head_b", "head_c", "head_d")
STREAMS = (*HEADS, "autocollimator")
TURN = 2 * np.pi


def angle_at(times_ns: NDArray[np.int64] | int, epoch_ns: int) -> NDArray[np.float64]:
    """Angle of the stage at timestamps (ns), rad, from `epoch_ns` on; unwrapped."""
    return SPEED * 1e-9 * np.asarray(times_ns - epoch_ns, np.float64)


def values_at(stream: str, times_ns: NDArray[np.int64], epoch_ns: int) -> NDArray[np.float64]:
    """Samples (n, 1) rad of a head, or (n, 2) rad of the autocollimator, at timestamps (ns)."""
    angle = angle_at(times_ns, epoch_ns)
    if stream in HEADS:
        return angle[:, None]
    cos, sin = np.cos(angle), np.sin(angle)
    return np.stack([WOBBLE[0] * cos - WOBBLE[1] * sin, WOBBLE[0] * sin + WOBBLE[1] * cos], 1)


def radial_of_one_step(rate: float) -> float:
    """Radial error motion, m, that joining a head with one a sample later would show."""
    return 0.5 * RADIUS * SPEED / rate


def write_stage(path: Path) -> Path:
    """Write the stage's description: `config/stage.yaml` without what would have to be taken out of the readings."""
    content = yaml.safe_load(config("stage.yaml").read_text(encoding="utf-8"))
    stage = content["stage"]
    for name in ("eccentricity", "graduation"):
        del stage["encoder"][name]
    del stage["mirror"]["flatness"]
    for name in ("radial", "tilt"):
        del stage["spindle"][name]
    path.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")
    return path
