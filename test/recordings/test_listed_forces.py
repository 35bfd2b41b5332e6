"""Recordings of a stage that lists its load cells and its command: replayed, analysed, commissioned."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import yaml
from mock_bags import EPOCH_NS, record

from rotary_error_monitor.commissioning.bag_streams import read_streams
from rotary_error_monitor.description.stage import StageDescription, load_stage
from rotary_error_monitor.recordings.analysis import analyse_bag
from rotary_error_monitor.recordings.replay import replay_bag
from rotary_error_monitor.resources import config
from rotary_error_monitor.sources.mock import MockSettings, mock_stage

STREAMS = (*(f"head_{head}" for head in "abcd"), "autocollimator", "command", "temperature")
CELL = {"kind": "force", "noise": 0.05, "resolution": 0.01, "range": 500.0, "uncertainty": 0.3}
NOSE = {**CELL, "azimuth": 0.7, "gain": -1.2, "zero": [40.0, -20.0], "latency": 0.004}
ACROSS = {
    "first": {**CELL, "azimuth": -0.4, "axes": 1, "zero": [12.0, 0.0]},
    "second": {**CELL, "azimuth": 1.1, "axes": 1, "gain": 2.0},
}
WARM = {"kind": "thermometer", "noise": 0.02, "resolution": 0.01, "range": 100.0, "uncertainty": 0.1, "zero": 5.0}


def described(folder, sensors, named=None, command=None):
    """The embedded stage with these in its list, from a file."""
    content = yaml.safe_load(config("stage.yaml").read_text(encoding="utf-8"))
    content["stage"]["sensors"] = sensors
    if named:
        content["stage"]["environment"]["force"] = named
    if command:
        content["stage"]["command"] = command
    path = folder / "stage.yaml"
    path.write_text(yaml.safe_dump(content), encoding="utf-8")
    return load_stage(path)


def recorded(folder: Path, stage: StageDescription, streams: tuple[str, ...], seconds: int = 8, seed: int = 5):
    """Bag and plant of a stage at whose shaft something pushes now and then."""
    plant = mock_stage(stage, MockSettings(seed, EPOCH_NS, (4.0,), rate=500.0, force_cycle=8.0))
    return record(folder / "bag", plant, streams, seconds), plant


@pytest.mark.parametrize("seed", range(2))
def test_what_acted_is_told_of_each_cell_as_it_is_meant(seed, tmp_path):
    """Largest force by each: without its zero, over its gain, of one axis along that, as the plant's own is."""
    stage = described(tmp_path, {"nose": NOSE, **ACROSS, "warm": WARM}, ["nose"])
    bag, plant = recorded(tmp_path, stage, (*STREAMS, "force", *stage.inputs), seed=seed)
    acting = analyse_bag(bag, stage).acting
    assert list(acting) == ["force, N", "temperature, °C", "first, N", "nose, N", "second, N", "warm, °C"]
    time = np.linspace(0.0, 8.0, 4000)
    push = plant.forces.at(time)
    assert np.abs(push).max() > 10.0
    for name, true in (
        ("force, N", np.abs(push)),
        ("nose, N", np.abs(push)),
        ("first, N", np.abs((push * np.exp(0.4j)).real)),
        ("second, N", np.abs((push * np.exp(-1.1j)).real)),
    ):
        assert acting[name].values.max() == pytest.approx(true.max(), abs=1.5), name
    warm = plant.place_temperatures["warm"].at(time)
    assert acting["warm, °C"].values.mean() == pytest.approx(warm.mean(), abs=0.1), "without its zero of 5 K"


def test_a_push_is_said_though_the_stage_has_listed_load_cells_alone(tmp_path):
    stage = described(tmp_path, {"nose": NOSE})
    bag, plant = recorded(tmp_path, stage, (*STREAMS, "force_nose"))
    (said,) = [each for each in analyse_bag(bag, stage).remarks if "acted on the shaft" in each]
    most = float(said.partition("up to ")[2].partition(" N")[0])
    assert most == pytest.approx(np.abs(plant.forces.at(np.linspace(0.0, 8.0, 4000))).max(), abs=1.0)


@pytest.mark.parametrize(("sensors", "named"), [({"nose": NOSE}, None), (ACROSS, ["first", "second"])])
def test_commissioning_takes_the_force_on_the_shaft_from_them(sensors, named, tmp_path):
    stage = described(tmp_path, sensors, named)
    bag, plant = recorded(tmp_path, stage, (*STREAMS, *stage.inputs))
    found = read_streams(bag, stage).streams["force"]
    true = plant.forces.at((found.times_ns - EPOCH_NS) * 1e-9)
    assert len(true) > 700 and np.abs(true).max() > 10.0
    assert np.abs(found.values @ [1, 1j] - true).max() < 1.0


def test_a_command_of_the_list_is_that_of_the_section_to_the_last_bit(tmp_path):
    own = {"zero": 0.4, "sign": -1, "latency": 2e-4}
    listed = described(tmp_path, {"drive": {"kind": "command", **own}})
    section = described(tmp_path, {}, command=own)
    bag, _ = recorded(tmp_path, listed, STREAMS, 4)
    one, other = replay_bag(bag, listed), replay_bag(bag, section)
    assert len(one.stamp_ns) > 500 and listed == section
    np.testing.assert_array_equal(one.error_motion, other.error_motion)


def test_a_command_with_a_gain_is_the_rotation_that_one_without_is(tmp_path):
    """Before a gear of 3, counted backwards: the same rotation, but for the last bits of the command."""
    for name in ("plain", "geared"):
        (tmp_path / name).mkdir()
    drive = {"kind": "command", "zero": 0.4, "sign": -1, "gain": 3.0, "latency": 2e-4}
    plain = described(tmp_path, {}, command={"latency": 2e-4})
    geared = described(tmp_path, {"drive": drive})
    found = [
        replay_bag(recorded(tmp_path / name, stage, STREAMS, 4)[0], stage)
        for name, stage in (("plain", plain), ("geared", geared))
    ]
    seen = np.isfinite(found[0].error_motion[:, [0, 1, 3, 4, 5]]).all(axis=1)
    assert seen.sum() > 500
    for one, other in zip(*(each.error_motion[seen][:, [0, 1, 3, 4, 5]].T for each in found), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-11)
