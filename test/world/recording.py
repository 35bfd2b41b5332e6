"""A recording: sample blocks by topic, when they arrived, and the truth behind them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rotary_error_monitor.signals.blocks import SampleBlock

from .rotor import Rotor

Array = NDArray[np.float64]
Times = NDArray[np.int64]
AUTOCOLLIMATOR = "/stage/autocollimator/samples"
LVDT = "/stage/lvdt/samples"
COMMAND = "/stage/command/samples"
FORCE = "/stage/force/samples"
TEMPERATURE = "/stage/temperature/samples"
THERMOMETER, LOAD_CELL = "thermometer", "force"  # kinds of listed sensors that are no probes


def head_topic(head: str) -> str:
    """Topic of a head by its letter."""
    return f"/stage/head_{head}/samples"


def probe_topic(name: str, section: Mapping[str, Any]) -> str:
    """Topic of a probe by its name in the section `sensors` and what stands there."""
    return f"/stage/{section['kind']}_{name}/samples"


@dataclass(frozen=True)
class Recording:
    """What was recorded.

    Attributes:
        stage: the true section `stage`.
        blocks: blocks of each topic in the order of their arrival.
        arrivals: (n,) timestamp (ns) of the arrival of each block, by a clock that never steps.
        truth: the rotor's true motion as a function of timestamps.
        start_ns: timestamp (ns) of the begin.
        duration: length in s.
        drawn: what was left to the seed, for a look: motion, rates, clocks, rounding.
    """

    stage: Mapping[str, Any]
    blocks: dict[str, list[SampleBlock]]
    arrivals: dict[str, Times]
    truth: Rotor
    start_ns: int
    duration: float
    drawn: Mapping[str, Any] = field(default_factory=dict)

    @property
    def head_topics(self) -> list[str]:
        """Topics of the heads that the stage has, in the order of its description."""
        return [head_topic(head) for head in self.stage.get("encoder", {}).get("heads", ())]

    @property
    def probes(self) -> dict[str, Mapping[str, Any]]:
        """What the description says of each probe, by its topic, in the order of the description."""
        sensors = self.stage.get("sensors", {})
        return {
            probe_topic(name, row): row for name, row in sensors.items() if row["kind"] not in (THERMOMETER, LOAD_CELL)
        }

    @property
    def count(self) -> float:
        """One count of the encoder in rad."""
        encoder = self.stage["encoder"]
        return float(2.0 * np.pi / (encoder["lines_per_revolution"] * encoder["counts_per_line"]))

    def timeline(self) -> list[tuple[int, str, SampleBlock]]:
        """All blocks as (arrival in ns, topic, block) in the order of their arrival."""
        rows = [
            (int(arrival), topic, block)
            for topic, blocks in self.blocks.items()
            for arrival, block in zip(self.arrivals[topic], blocks, strict=True)
        ]
        return sorted(rows, key=lambda row: row[0])

    def with_topics(self, changed: Mapping[str, tuple[list[SampleBlock], Times]]) -> Recording:
        """The same recording with other blocks and arrivals of some topics."""
        blocks = {**self.blocks, **{topic: pair[0] for topic, pair in changed.items()}}
        arrivals = {**self.arrivals, **{topic: pair[1] for topic, pair in changed.items()}}
        return replace(self, blocks=blocks, arrivals=arrivals)


def samples(blocks: Sequence[SampleBlock]) -> tuple[Times, Array]:
    """Timestamps (n,) and values (n, k) of all samples of a topic, in the order of arrival."""
    if not blocks:
        return np.zeros(0, np.int64), np.zeros((0, 0))
    rows = np.concatenate([block.rows for block in blocks])
    stamps = np.repeat([block.stamp_ns for block in blocks], [len(block.rows) for block in blocks])
    return stamps + np.rint(rows[:, 0] * 1e9).astype(np.int64), rows[:, 1:]
