"""Bags of a simulated shaft between centres, and the assembly errors that they hold."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import simulated_shaft

from rotary_error_monitor.bags.writer import write_messages
from rotary_error_monitor.description.wire import load_wire
from rotary_error_monitor.signals.blocks import block_from_samples

TRUTH = {
    "eccentricity": (2.0e-5, 1.5e-5),
    "graduation": {2: (1e-6, -2e-6), 13: (0.0, 9e-7)},
    "tilt": (-3.0e-5, 5.5e-5),
    "flatness": {2: (4e-6, 1e-6, -2e-6, 3e-6), 6: (0.0, 2e-6, 2e-6, 0.0)},
}
BOTH_WAYS = simulated_shaft.reversing((np.pi / 2, np.pi), 5.0)


def simulated(folder: Path, changes: Mapping[str, Any] | None = None, motion: Any = BOTH_WAYS, seed: int = 0) -> Path:
    """A bag of a shaft by the contract's formulas, whose assembly errors are `TRUTH`."""
    shaft = simulated_shaft.Shaft(**{**TRUTH, **(changes or {})})
    heads, tilt = simulated_shaft.record(shaft, *motion, seed)
    wire = load_wire()
    contents = {}
    streams = {wire.topic("head_samples", name): (("angle",), *stream) for name, stream in heads.items()}
    streams[wire.topic("autocollimator_samples")] = (("tilt_x", "tilt_y"), *tilt)
    for topic, (names, times, values) in streams.items():
        parts = [slice(k, k + 250) for k in range(0, len(times), 250)]
        contents[topic.name] = [block_from_samples(times[part], names, values[part]) for part in parts]
    bag = folder / f"bag_{seed}_{len(list(folder.iterdir()))}"
    write_messages(bag, contents, wire)
    return bag
