"""Listed load cells of the mock plant: what they read of a push, by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rotary_error_monitor.description.listed_sensors import ListedSensor
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.plant.clocks import stage_clocks
from rotary_error_monitor.plant.environment import intermittent_forces
from rotary_error_monitor.plant.stage import StagePlant

OWN = ListedSensor("force", 0.05, 0.01, 200.0, 0.3, fields=("force_x", "force_y"), unit="N")
NOSE = replace(OWN, zero=(4.0, -2.0), gain=-1.5, place={"azimuth": np.pi / 6})
SIDE = replace(OWN, zero=(0.0, 0.0), place={"azimuth": -np.pi / 2, "axes": 1})
STAGE = replace(load_stage(), inputs={"force_nose": NOSE, "force_side": SIDE})
TIME = np.linspace(0.0, 60.0, 2000)


def plant(seed):
    clocks = stage_clocks(inputs=STAGE.inputs)
    return StagePlant(STAGE, seed, clocks=clocks, forces=intermittent_forces(seed, 20.0))


@pytest.mark.parametrize("seed", range(3))
def test_each_cell_reads_along_its_own_axes(seed):
    x, y = plant(seed).signal("force", TIME).T
    assert np.hypot(x, y).max() > 10.0
    half, most = 0.5, np.sqrt(0.75)
    expected = [4.0 - 1.5 * (most * x + half * y), -2.0 - 1.5 * (most * y - half * x)]
    np.testing.assert_allclose(plant(seed).signal("force_nose", TIME), np.column_stack(expected), atol=1e-12)
    np.testing.assert_allclose(plant(seed).signal("force_side", TIME), np.column_stack([-y, 0 * y]), atol=1e-12)


def test_samples_are_noisy_in_steps_and_end_at_the_range():
    found = plant(1)
    block = found.samples("force_nose", 0, 4000)
    assert block.names == ("t", "force_x", "force_y")
    np.testing.assert_allclose(np.diff(block.times_ns), 10_000_000, atol=1)
    read, shown = block.rows[:, 1:], found.signal("force_nose", block.times_ns * 1e-9)
    apart = (read - shown)[(np.abs(shown) < 199.0).all(axis=1)]
    assert len(apart) > 3000 and abs(apart.std() / 0.05 - 1) < 0.05 and np.abs(read).max() <= 200.0
    np.testing.assert_allclose(read, np.rint(read * 100) / 100, atol=1e-10)


def test_what_else_the_stage_does_is_what_it_does_without_them():
    bare = StagePlant(load_stage(), 4, forces=intermittent_forces(4, 20.0))
    for stream in bare.streams:
        np.testing.assert_array_equal(plant(4).samples(stream, 100, 50).rows, bare.samples(stream, 100, 50).rows)
