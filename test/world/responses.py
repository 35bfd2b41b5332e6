"""Instruments that answer in their own way: zero, sign, gain, axes and delay drawn, and readings as they would give."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np

from rotary_error_monitor.signals.blocks import SampleBlock

from .recording import AUTOCOLLIMATOR, COMMAND, LVDT, Recording, head_topic, probe_topic


def draw_responses(seed: int, stage: dict[str, Any]) -> dict[str, Any]:
    """Section `stage` in which every instrument has a response of its own."""
    rng = np.random.default_rng([seed, 20261126])
    section = copy.deepcopy(stage)
    for head in section["encoder"]["heads"].values():
        head |= {"zero": float(rng.uniform(-6.0, 6.0)), "sign": int(rng.choice([-1, 1]))}
        head["latency"] = float(rng.uniform(0.0, 1e-3))
    for name, size in (("autocollimator", 2e-5), ("lvdt", 2e-5)):
        if name in section:
            section[name] |= {
                "zero": rng.uniform(-size, size, 2).tolist(),
                "gain": float(rng.choice([-1, 1]) * rng.uniform(0.9, 1.1)),
                "roll": float(rng.uniform(-3.0, 3.0)),
                "latency": float(rng.uniform(0.0, 5e-3)),
            }
    command = {"zero": float(rng.uniform(-6.0, 6.0)), "sign": int(rng.choice([-1, 1]))}
    section["command"] = command | {"latency": float(rng.uniform(0.0, 5e-3))}
    for probe in section.get("sensors", {}).values():
        probe["latency"] = float(rng.uniform(0.0, 2e-3))
    return section


def answered(recording: Recording, section: dict[str, Any]) -> Recording:
    """The recording as instruments with these responses would have given it: what they read, stamped late."""
    changed = {}
    rows = {head_topic(letter): head for letter, head in section["encoder"]["heads"].items()}
    rows |= {AUTOCOLLIMATOR: section.get("autocollimator", {}), LVDT: section.get("lvdt", {})}
    for topic, own in rows.items():
        for_all = own.get("gain", own.get("sign", 1)) * _axes(own.get("roll", 0.0), 2 if "roll" in own else 1)
        zero = np.atleast_1d(own.get("zero", 0.0))
        changed[topic] = for_all, zero, own.get("latency", 0.0)
    if "command" in section:
        own = section["command"]
        changed[COMMAND] = own["sign"] * np.eye(2), np.array([own["zero"], 0.0]), own["latency"]
    for name, own in section.get("sensors", {}).items():
        changed[probe_topic(name, own)] = np.eye(1), np.zeros(1), own["latency"]
    made = {}
    for topic, (matrix, zero, latency) in changed.items():
        if topic in recording.blocks:
            blocks = [_late(block, matrix, zero, round(latency * 1e9)) for block in recording.blocks[topic]]
            made[topic] = blocks, recording.arrivals[topic] + round(latency * 1e9)
    return recording.with_topics(made)


def _axes(angle: float, count: int) -> np.ndarray:
    """Components along turned axes of unit vectors, a column for each."""
    if count == 1:
        return np.eye(1)
    first = np.array([np.cos(angle), np.sin(angle)])
    return np.column_stack([first, [-first[1], first[0]]])


def _late(block: SampleBlock, matrix: np.ndarray, zero: np.ndarray, latency_ns: int) -> SampleBlock:
    read = np.einsum("ij,nj->ni", matrix, block.rows[:, 1:]) + zero
    return SampleBlock(block.stamp_ns + latency_ns, block.names, np.column_stack([block.rows[:, 0], read]))
