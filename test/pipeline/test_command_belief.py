"""Whether rotation and command belong together, of drives in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from described_stages import stage_of
from world import random_stage

from rotary_error_monitor.description.stage import StageDescription
from rotary_error_monitor.pipeline.command_belief import CommandBelief
from rotary_error_monitor.pipeline.evidence import COLUMNS, Means, Scatter, Window

PERIOD, TICKS = 0.01, 10
COUNT = 1200


@pytest.fixture(scope="module")
def stage() -> StageDescription:
    return stage_of(random_stage(3))


def windows(theta: np.ndarray, command: np.ndarray) -> list[Window]:
    shown = {"heads": 1.0, "radial": 1.0, "command": 1.0, "head_samples": 1.0, "radial_variance": 1e-18}
    return [
        Window(
            number,
            PERIOD,
            TICKS,
            Means._make(float((shown | {"theta": angle, "ecc": angle - commanded}).get(name, 0.0)) for name in COLUMNS),
            Scatter(1e-7, 1e-7, 1e-7),
            np.zeros(1),
            0,
            True,
        )
        for number, (angle, commanded) in enumerate(zip(theta, command, strict=True))
    ]


def doubts(stage: StageDescription, theta: np.ndarray, command: np.ndarray) -> set[str]:
    belief, found = CommandBelief(stage), set()
    for window in windows(theta, command):
        belief.judge(window)
        found.add(belief.doubt)
    return found - {""}


def moved(time: np.ndarray) -> np.ndarray:
    """A command that goes to and fro, 1 rad/s at most, and stands every other while."""
    return np.where(time % 4.0 < 2.0, 1.0 - np.cos(np.pi * time), 0.0) / np.pi


@pytest.mark.parametrize("settling", [0.02, 0.05, 0.3, 2.0])
def test_a_drive_that_settles_while_its_command_stands_is_not_late(settling, stage):
    """Its distance goes as its speed does, with the time it settles in; stamps have no part in that."""
    generator = np.random.default_rng(round(1e3 * settling))
    time = PERIOD * np.arange(COUNT)
    for _ in range(4):
        since = time % generator.uniform(1.0, 4.0)  # some disturbance sets it off again and again
        off = generator.uniform(0.02, 0.05) * stage.limits.following_error * np.exp(-since / settling)
        theta = np.cumsum(np.diff(off, prepend=0.0)) + 1e-8 * generator.normal(size=COUNT)
        assert not doubts(stage, theta, np.zeros(COUNT))


@pytest.mark.parametrize("part", [0.5, 2.0, -2.0])
def test_heads_that_are_late_are_found_where_the_command_moves(part, stage):
    generator = np.random.default_rng(7)
    time, late = PERIOD * np.arange(COUNT), part * stage.limits.latency
    for _ in range(4):
        theta = moved(time - late) + 1e-7 * generator.normal(size=COUNT)
        found = doubts(stage, theta, moved(time))
        assert any("behind the command" in text for text in found) is (abs(part) > 1.0)
