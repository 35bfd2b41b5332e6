"""What the kinds of listed sensors say, held against two programs that share no formula with them: plant and world."""

from __future__ import annotations

import numpy as np
import pytest
from described_stages import stage_of
from world import Options, make_recording, random_stage, samples, with_probes, with_tilt_sensor

from rotary_error_monitor.description.listed_sensors import is_input
from rotary_error_monitor.description.sensor_section import listed_kinds
from rotary_error_monitor.plant.clocks import stage_clocks
from rotary_error_monitor.plant.stage import StagePlant
from rotary_error_monitor.sensors.library import sensor_of
from rotary_error_monitor.sensors.listed import ListedKind

NEAR = 2e-3
"""Of what is seen: terms of second order of micrometres and some ten microradians."""


def check(kind, sensor, reading, theta, motion):
    """That the displacement by the kind is what the true error motion (n, 6) gives by its sensitivity."""
    assert isinstance(kind, ListedKind)
    seen = kind.displacement(sensor, reading, theta)
    expected = motion @ kind.rows(sensor).T
    assert np.abs(seen - expected).max() < NEAR * np.ptp(expected)


@pytest.mark.parametrize("seed", range(4))
def test_displacements_are_those_of_the_truth(seed):
    section = with_tilt_sensor(with_probes(random_stage(seed), seed), seed)
    stage = stage_of(section)
    recording = make_recording(seed, duration=6.0, stage=section, options=Options.textbook(motion="s_curves"))
    plant = StagePlant(stage, 1, clocks=stage_clocks(tuple(stage.encoder.azimuths), sensors=tuple(stage.sensors)))
    time = np.linspace(0, 30, 2000)
    scene = plant.scene(time)
    assert len(stage.sensors) == len(recording.probes) == 5
    of_poses = {kind for kind in listed_kinds() if not is_input(kind)}
    assert {sensor.kind for sensor in stage.sensors.values()} == of_poses, "a kind that has no world"
    for stream, sensor in stage.sensors.items():
        ns, values = samples(recording.blocks[f"/stage/{stream}/samples"])
        at = recording.truth(ns)
        motion = np.stack([at.exc, at.eyc, at.ezc, at.eac, at.ebc, at.ecc], axis=1)
        check(sensor_of(stream), sensor, values, at.theta, motion)
        check(sensor_of(stream), sensor, plant.signal(stream, time), scene.theta, scene.error_motion)
