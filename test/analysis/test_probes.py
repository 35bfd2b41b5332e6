"""A stage with an axial probe: its axial error motion values, against what was drawn into recordings by numpy alone."""

from __future__ import annotations

import numpy as np
from probed_stage import STAGE, START, recorded

from rotary_error_monitor.bags.writer import write_messages
from rotary_error_monitor.description.topics import samples_topic
from rotary_error_monitor.recordings.analysis import analyse_bag
from rotary_error_monitor.signals.blocks import block_from_samples


def contents(streams):
    """Blocks of a fifth of a second, by topic."""
    found = {}
    for name, (time, fields, values) in streams.items():
        stamps = START + np.rint(time * 1e9).astype(np.int64)
        parts = np.split(np.arange(len(time)), np.flatnonzero(np.diff(np.floor(5 * time))) + 1)
        found[samples_topic(name)] = [block_from_samples(stamps[part], fields, values[part]) for part in parts]
    return found


def test_axial_values_are_within_their_uncertainty(tmp_path):
    (wave,) = STAGE.spindle.axial
    truth = {"fundamental": 2 * np.hypot(wave.cos, wave.sin), "synchronous": 2 * np.hypot(wave.cos, wave.sin)}
    inside = []
    for seed in range(6):
        bag = tmp_path / f"bag_{seed}"
        write_messages(bag, contents(recorded(seed, seconds=32.0)))
        analysis = analyse_bag(bag, STAGE)
        found = [f for s in analysis.segments for f in s.signals if f.signal == "axial_z"]
        assert len(found) == 4  # two speeds, both ways
        for figures in found:
            assert figures.spectrum.hidden == tuple(figures.spectrum.orders), "one probe tells no form of its face"
            for name, value in truth.items():
                inside.append(abs(figures.values[name].value - value) <= figures.values[name].expanded)
        heights = {f.height for s in analysis.segments for f in s.signals if f.quantity == "radial"}
        assert heights == {0.0, 0.04, 0.16}
        assert {stream.topic.split("/")[2] for stream in analysis.streams} >= set(STAGE.sensors)
    assert np.mean(inside) >= 0.93
