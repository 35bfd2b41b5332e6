"""Stages that differ in their file alone, from the live cell to the diagnosis of its bag.

The mocks show a true stage, by exact geometry that shares no formula with estimator and twin, with something that the
description lacks. Estimates have to be right within their covariance all the same, a replay has to repeat them to the
last bit, and a diagnosis of the bag has to name what is lacking.
"""

from __future__ import annotations

import json
import time

import numpy as np
import pytest
from draws import ALL
from mock_bags import record
from nodes.plant_samples import assert_samples
from nodes.replayed_motion import ESTIMATOR, REPLAY, assert_repeated
from received_blocks import block_of
from staged_files import BALL_PROBE, STAGES

from rotary_error_monitor.bags.reader import BagReader
from rotary_error_monitor.cli import main
from rotary_error_monitor.codec.error_motion_blocks import error_motion_from_block
from rotary_error_monitor.description.listed_sensors import name_of
from rotary_error_monitor.description.stage import load_stage
from rotary_error_monitor.description.topics import samples_topic
from rotary_error_monitor.metrology.error_motion import COMPONENTS
from rotary_error_monitor.nodes.autocollimator import AutocollimatorNode
from rotary_error_monitor.nodes.encoder_head import EncoderHead
from rotary_error_monitor.nodes.error_estimator import ErrorEstimator
from rotary_error_monitor.nodes.gap_monitor import GapMonitor
from rotary_error_monitor.nodes.listed_sensor import ListedSensorNode
from rotary_error_monitor.nodes.mock_controller import MockController
from rotary_error_monitor.nodes.recorder import Recorder
from rotary_error_monitor.recordings.replay import replay_bag
from rotary_error_monitor.sources.mock import MockSettings, mock_stage
from rotary_error_monitor.testing import Cell

SPEED = 2 * np.pi
SECONDS = 15.0 if ALL else 3.0
"""Time that is recorded live, s."""

LONGER = 15.0
"""Time that a diagnosis has, s. The mock's samples are a function of time: what is not waited for is written down."""

SIGMAS = 6.0


def run_live(described, true, folder, seed):
    """Estimates of a cell whose instruments show the true stage, and the plant that they show; a bag in the folder."""
    stage, settings = load_stage(described), MockSettings(seed, time.time_ns() - 2_000_000_000, (SPEED,), False)
    mocks = {"source": "mock", "stage": str(true)}
    parameters = {
        "stage": str(described),
        "block_period": 0.05,
        "mock.seed": settings.seed,
        "mock.epoch": settings.epoch_ns,
        "mock.speeds": list(settings.speeds),
        "mock.forces": False,
    }
    with Cell(tuple(stage.azimuths), parameters, sensors=tuple(stage.listed)) as cell:
        estimates = cell.collect(cell.wire.topic("error_motion_samples"))
        recorder = cell.run(Recorder, "recorder", folder=str(folder))
        for head in stage.azimuths:
            cell.run(EncoderHead, f"encoder_head_{head}", **mocks)
        if stage.autocollimator is not None:
            cell.run(AutocollimatorNode, "autocollimator", **mocks)
        for stream, sensor in stage.listed.items():
            cell.run(ListedSensorNode, f"listed_sensor_{name_of(stream, sensor)}", **mocks)
        cell.run(MockController, "mock_controller", stage=str(true))
        cell.run(GapMonitor, "gap_monitor")
        cell.run(ErrorEstimator, "error_estimator", **ESTIMATOR)
        cell.wait_until(lambda: len(estimates) > 10, "estimates")
        for stream in stage.listed:
            cell.wait_for_status(f"gap_monitor: /stage/{stream}/samples", "alive")
        cell.spin_for(SECONDS)
        cell.forget_status("error_estimator: estimate")
        cell.wait_for_status("error_estimator: estimate", "complete")
        cell.remove(recorder)
    return estimates, mock_stage(load_stage(true), settings)


def check_accuracy(estimates, plant, shows, largest):
    """That what is observable is what the stage shows, and right within its covariance."""
    places = [COMPONENTS.index(name) for name in shows]
    others = [place for place in range(6) if place not in places]
    seen, off, sizes = [], [], []
    for message in estimates[2:]:
        block = block_of(message)
        motion = error_motion_from_block(block)
        truth = plant.scene((block.times_ns - plant.epoch_ns) * 1e-9).error_motion
        assert not motion.observable[:, others].any()
        deviation = np.sqrt(np.diagonal(motion.covariance, axis1=1, axis2=2))[:, places]
        found = motion.observable[:, places]
        seen.append(found)
        off.append(((motion.components - truth)[:, places] / np.where(found, deviation, np.inf))[found])
        sizes.append(deviation[found])
    assert np.concatenate(seen).mean() > 0.9
    # until all nodes have found one another, two heads tell no more than what is no longer motion of this stage
    assert (np.concatenate(sizes) < largest).mean() > 0.8, "an uncertainty that bounds something"
    assert np.abs(np.concatenate(off)).max() < SIGMAS


def check_samples(bag, plant):
    """That what was recorded is what the plant shows, to the last bit."""
    topics = {samples_topic(stream): stream for stream in plant.streams}
    recorded = BagReader(bag).read_blocks([*topics])
    assert {topic for topic in topics if recorded[topic]} == set(topics)
    for topic, stream in topics.items():
        assert_samples(recorded[topic][len(recorded[topic]) // 2], plant, stream)


@pytest.mark.few(2)
@pytest.mark.parametrize("name", STAGES)
def test_from_the_cell_to_the_diagnosis(name, tmp_path, capsys, install_kind):
    case = STAGES[name]
    if case.package:
        install_kind(BALL_PROBE)
    described, bag = case.described(tmp_path), tmp_path / "bag"
    estimates, plant = run_live(described, case.true(tmp_path), bag, [*STAGES].index(name))
    check_accuracy(estimates, plant, case.shows, case.largest)
    check_samples(bag, plant)
    settings = REPLAY
    assert_repeated(estimates, replay_bag(bag, load_stage(described), None, settings))

    longer = bag if ALL else record(tmp_path / "longer", plant, plant.streams, LONGER)
    twin = ["--twin", str(described)]
    assert main(["replay", str(bag), *twin, "-o", str(tmp_path / "again.npz")]) == 0, capsys.readouterr().err
    assert main(["analyse", str(longer), *twin, "-o", str(tmp_path / "page.html")]) in (0, 10), capsys.readouterr().err
    assert main(["check", "--stage", str(described), str(longer)]) in (0, 10), capsys.readouterr().err
    assert main(["diagnose", str(longer), *twin, "-o", str(tmp_path / "out"), "--no-report"]) == 10
    found = json.loads((tmp_path / "out" / "diagnosis.json").read_text(encoding="utf-8"))
    assert [(each["effect"], each["location"]) for each in found["causes"]] == [case.cause], found["causes"]
