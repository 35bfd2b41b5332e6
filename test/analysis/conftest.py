"""Replays of the independent plant's recordings, by seed."""

from __future__ import annotations

import itertools
from functools import cache

import numpy as np
import pytest

from rotary_error_monitor.analysis.signals import Estimates
from rotary_error_monitor.bags.writer import write_messages
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.description.topics import samples_topic
from rotary_error_monitor.recordings.long_estimates import estimates_of
from rotary_error_monitor.recordings.replay import replay_bag
from rotary_error_monitor.sources.mock import MockSettings, mock_stage

EPOCH_NS = 1_763_700_000_000_000_000
SECONDS, RATE = 44, 500.0
STREAMS = (*(f"head_{head}" for head in "abcd"), "autocollimator", "command", "lvdt", "force", "temperature")


def plant_of(seed, speeds=(2.0, 4.0)):
    return mock_stage(load_stage(), MockSettings(seed, EPOCH_NS, speeds, forces=False, rate=RATE))


def write_plant(bag, plant, seconds=SECONDS, streams=STREAMS):
    """A bag of what a plant's instruments say, by blocks of a fifth of a second."""
    contents = {}
    for stream in streams:
        edges = [plant.index_at(stream, EPOCH_NS + k * 200_000_000) for k in range(5 * seconds + 1)]
        pairs = itertools.pairwise(edges)
        contents[samples_topic(stream)] = [plant.samples(stream, a, b - a) for a, b in pairs if b > a]
    write_messages(bag, contents)
    return bag


@pytest.fixture(scope="session")
def recorded(tmp_path_factory):
    """Function that gives the bag of a seed, 40 s both ways at two speeds."""

    @cache
    def bag(seed):
        return write_plant(tmp_path_factory.mktemp("plant") / "bag", plant_of(seed))

    return bag


@pytest.fixture(scope="session")
def estimated(recorded):
    """Function that gives the estimates of a seed: those of the replay."""

    @cache
    def estimates(seed) -> Estimates:
        return estimates_of(replay_bag(recorded(seed), load_stage()))

    return estimates


@pytest.fixture(scope="session")
def true_profiles():
    """Function of angles: the described spindle's own waves, as the plant's stage has them, by component."""
    spindle = load_stage().spindle

    def profiles(angle, without=()):
        def waves(rows, axis):
            total = np.zeros(len(angle))
            for row in rows:
                if row.order not in without:
                    cos, sin = getattr(row, axis)
                    total += cos * np.cos(row.order * angle) + sin * np.sin(row.order * angle)
            return total

        return {
            "exc": waves(spindle.radial, "x"),
            "eyc": waves(spindle.radial, "y"),
            "eac": waves(spindle.tilt, "x"),
            "ebc": waves(spindle.tilt, "y"),
        }

    return profiles
