"""Thermometers of the mock plant: each place warms on its own, and a drift may follow one of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from rotary_error_monitor.cases.faults import make_fault
from rotary_error_monitor.description.listed_sensors import ListedSensor
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.plant.clocks import stage_clocks
from rotary_error_monitor.plant.environment import TemperatureCourse
from rotary_error_monitor.plant.stage import StagePlant

NAMES = ("thermometer_bearing", "thermometer_housing")
OWN = ListedSensor("thermometer", 0.02, 0.01, 100.0, 0.1, zero=0.5, fields=("temperature",), unit="°C")
STAGE = replace(load_stage(), inputs=dict.fromkeys(NAMES, OWN))
TIME = np.linspace(0.0, 60.0, 200)


def plant(seed, **changes):
    return StagePlant(STAGE, seed, clocks=stage_clocks(inputs=STAGE.inputs), **changes)


@pytest.mark.parametrize("seed", range(5))
def test_each_place_warms_on_its_own_and_the_same_again(seed):
    found = plant(seed)
    courses = {name: found.signal(name, TIME)[:, 0] for name in (*NAMES, "temperature")}
    assert all(np.ptp(course) > 0.3 for course in courses.values())
    bearing, housing = (courses[name] - courses[name][0] for name in NAMES)
    assert np.abs(bearing - housing).max() > 0.05
    for name in NAMES:
        np.testing.assert_array_equal(plant(seed).signal(name, TIME)[:, 0], courses[name])
        assert not np.array_equal(plant(seed + 1).signal(name, TIME)[:, 0], courses[name])


def test_samples_are_slow_noisy_and_in_steps_about_temperature_and_zero():
    told = TemperatureCourse(start=21.0, rise=2.0, settling=30.0)
    block = plant(3, places={"bearing": told}).samples(NAMES[0], 0, 400)
    assert block.names == ("t", "temperature")
    np.testing.assert_allclose(np.diff(block.times_ns), 1_000_000_000, atol=1)
    read, time = block.column("temperature"), block.times_ns * 1e-9
    apart = read - (21.0 + 2.0 * (1 - np.exp(-time / 30.0))) - 0.5
    assert abs(apart.mean()) < 4 * 0.02 / 20 and 0.9 < apart.std() / 0.02 < 1.15
    np.testing.assert_allclose(read, np.rint(read * 100) / 100, atol=1e-12)


@pytest.mark.parametrize("place", ["", "bearing", "housing"])
def test_a_drift_follows_the_place_of_its_location(place):
    drift = make_fault("thermal_drift", place, radial=(2e-7, -1e-7))
    found = plant(4, faults=(drift,))
    moved = found.scene(TIME).radial - plant(4).scene(TIME).radial
    read = found.signal(f"thermometer_{place}", TIME)[:, 0] - 0.5 if place else found.signal("temperature", TIME)[:, 0]
    np.testing.assert_allclose(moved, (2e-7 - 1e-7j) * (read - STAGE.reference_temperature), atol=1e-18)


def test_what_else_the_stage_does_is_what_it_does_without_thermometers():
    bare = StagePlant(load_stage(), 4)
    for stream in bare.streams:
        np.testing.assert_array_equal(plant(4).samples(stream, 100, 50).rows, bare.samples(stream, 100, 50).rows)
